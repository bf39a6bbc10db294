"""Model the drive, which turns the held command into the motor's force: its response, its states and their rates."""

from __future__ import annotations

from collections.abc import Callable

from vctune.model.device import Device
from vctune.model.loop.filters import FilterResponse, low_pass, low_pass_rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import times

COMMAND = "command"  # Name of the held command's column in the rates of a system
Rows = dict[str, dict[str, Number]]  # Rates of the states, by the names of the states or inputs that drive them
# Type of a function that writes a low-pass into the rates, such as `low_pass_rates`
LowPassRows = Callable[[Rows, tuple[str, str], Number, int, Arithmetic], Number]


def drive_states(device: Device) -> tuple[str, ...]:
    """Return the names of the drive's states; the tuple is empty if the motor's force is the command."""
    return () if device.actuator is None else ("force", "rate")[: device.actuator.order]


def drive_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return A, the response of the force on the motor to the held command, at s = j omega."""
    actuator = device.actuator
    return None if actuator is None else low_pass(actuator.bandwidth_hz, actuator.order, omega, ops)


def drive_rows(
    rows: Rows, device: Device, ops: Arithmetic, low_pass_rows: LowPassRows = low_pass_rates
) -> dict[str, Number]:
    """Write the rates of the drive's states, and return the motor's force as a linear combination of states and
    command."""
    actuator = device.actuator
    if actuator is None:
        return {COMMAND: 1}
    corner = low_pass_rows(rows, ("force", "rate"), actuator.bandwidth_hz * device.sample_time, actuator.order, ops)
    rows[drive_states(device)[-1]][COMMAND] = corner
    return {"force": 1}


def drive_at_rest(device: Device) -> dict[str, float]:
    """Return the drive's states under a steady command of 1, by name. States that are 0 are absent."""
    return {} if device.actuator is None else {"force": 1.0}


def pushed(force: dict[str, Number], share: Number) -> dict[str, Number]:
    """Return a force times a share."""
    return {name: share if type(part) is int and part == 1 else times(part, share) for name, part in force.items()}
