"""The drive, from the held command to the motor's force: its response, its states and their rates.

A part of the drive adds to each function here; no other module knows which parts there are.
"""

from __future__ import annotations

from collections.abc import Callable

from vctune.model.device import Device
from vctune.model.loop.filters import FilterResponse, filter_rows, low_pass
from vctune.model.numbers.arithmetic import Arithmetic, Number
from vctune.model.numbers.matrices import times

COMMAND = "command"
"""Column of the held command in the rates of a system."""
Rows = dict[str, dict[str, Number]]
"""Rates of states by the names of what drives them."""
LowPassRows = Callable[[Rows, tuple[str, str], Number, int, Arithmetic], Number]
"""Writes a low-pass into rates, as `filter_rows` does."""


def drive_states(device: Device) -> tuple[str, ...]:
    """Return the names of the drive's states; none if the motor's force is the command."""
    return () if device.actuator is None else ("force", "rate")[: device.actuator.order]


def drive_response(device: Device, omega: Number, ops: Arithmetic) -> FilterResponse | None:
    """Return A, from the held command to the force on the motor, at s = j omega.

    Parameters
    ----------
    device : the parts of its drive are used
    omega : angular frequency, rad/s, >= 0
    ops : arithmetic of both

    Returns
    -------
    FilterResponse or None
        The result has the shape of omega; None if the motor's force is the command.
    """
    actuator = device.actuator
    return None if actuator is None else low_pass(actuator.bandwidth_hz, actuator.order, omega, ops)


def drive_rows(
    rows: Rows, device: Device, ops: Arithmetic, low_pass_rows: LowPassRows = filter_rows
) -> dict[str, Number]:
    """Write the rates of the drive's states and return the motor's force, by the states and the command it is made of.

    Parameters
    ----------
    rows : rates of each state with T = 1; those of the drive are filled in here
    device : the parts of its drive are used
    ops : arithmetic of the rates
    low_pass_rows : the form of a low-pass's states

    Returns
    -------
    dict
        Shares, the integer 1 for a whole one.
    """
    actuator = device.actuator
    if actuator is None:
        return {COMMAND: 1}
    corner = low_pass_rows(rows, ("force", "rate"), actuator.bandwidth_hz * device.sample_time, actuator.order, ops)
    rows[drive_states(device)[-1]][COMMAND] = corner
    return {"force": 1}


def drive_at_rest(device: Device) -> dict[str, float]:
    """Return the drive's states under a steady command of 1, by name; those of a low-pass are as of `plain_rows`.

    Parameters
    ----------
    device : the parts of its drive are used
    """
    return {} if device.actuator is None else {"force": 1.0}


def pushed(force: dict[str, Number], share: Number) -> dict[str, Number]:
    """Return what a force is made of, times a share.

    Parameters
    ----------
    force : see `drive_rows`
    share : of it

    Returns
    -------
    dict
        A whole share stays as it is, so that it adds no rounding.
    """
    return {name: share if type(part) is int and part == 1 else times(part, share) for name, part in force.items()}
