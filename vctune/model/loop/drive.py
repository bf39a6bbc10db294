"""Model the drive, which turns the held command into the motor's force: its response, its states and their rates.

The drive of a servo is inside the vendor's loop and does not appear here. To add a part to the drive, extend each
function of this module. No other formula of `vctune.model` and no simulation knows the parts of the drive.
"""

from __future__ import annotations

from collections.abc import Callable

from vctune.model.device import Device
from vctune.model.loop.filters import FilterResponse, low_pass, low_pass_rates
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import times

COMMAND = "command"
"""Name of the held command's column in the rates of a system."""
Rows = dict[str, dict[str, Number]]
"""Rates of the states, by the names of the states or inputs that drive them."""
LowPassRows = Callable[[Rows, tuple[str, str], Number, int, Arithmetic], Number]
"""Type of a function that writes a low-pass into the rates, such as `low_pass_rates`."""


def drive_states(device: Device) -> tuple[str, ...]:
    """Return the names of the drive's states; the tuple is empty if the motor's force is the command."""
    return () if device.actuator is None else ("force", "rate")[: device.actuator.order]


def drive_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return A, the response of the force on the motor to the held command, at s = j omega.

    Parameters
    ----------
    device : device; the function uses the parts of its drive
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of device and omega

    Returns
    -------
    FilterResponse or None
        It has the shape of omega; None if the motor's force is the command.
    """
    actuator = device.actuator
    return None if actuator is None else low_pass(actuator.bandwidth_hz, actuator.order, omega, ops)


def drive_rows(
    rows: Rows, device: Device, ops: Arithmetic, low_pass_rows: LowPassRows = low_pass_rates
) -> dict[str, Number]:
    """Write the rates of the drive's states, and return the motor's force as a linear combination of states and
    command.

    Parameters
    ----------
    rows : rates of each state with T = 1; the function fills the rows of `drive_states`, which must exist
    device : device; the function uses the parts of its drive
    ops : arithmetic of the rates
    low_pass_rows : function that writes the states of a low-pass

    Returns
    -------
    dict
        The coefficients of states and command, by name. A coefficient of 1 is the integer 1.
    """
    actuator = device.actuator
    if actuator is None:
        return {COMMAND: 1}
    corner = low_pass_rows(rows, ("force", "rate"), actuator.bandwidth_hz * device.sample_time, actuator.order, ops)
    rows[drive_states(device)[-1]][COMMAND] = corner
    return {"force": 1}


def drive_at_rest(device: Device) -> dict[str, float]:
    """Return the drive's states under a steady command of 1, by name. States that are 0 are absent.

    Low-passes have the states of `plain_low_pass_rates`.

    Parameters
    ----------
    device : device; the function uses the parts of its drive
    """
    return {} if device.actuator is None else {"force": 1.0}


def pushed(force: dict[str, Number], share: Number) -> dict[str, Number]:
    """Return a force times a share.

    Parameters
    ----------
    force : the force as `drive_rows` returns it
    share : factor of the force; the integer 1 leaves the force unchanged

    Returns
    -------
    dict
        The coefficients of states and command. A coefficient that is the integer 1 becomes the share itself, without a
        rounding error.
    """
    return {name: share if type(part) is int and part == 1 else times(part, share) for name, part in force.items()}
