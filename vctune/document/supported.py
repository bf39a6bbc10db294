"""What cannot be done yet with a design of an impedance display."""

from __future__ import annotations

from vctune.document.errors import InputError, Mistake
from vctune.model.quantities import AnyCoupling, Coupling, Device, SpringDamper


def of_admittance_display(source: str, coupling: AnyCoupling, doing: str) -> Coupling:
    """Return the coupling of an admittance display.

    Parameters
    ----------
    source : what messages call the problem
    coupling : of any display
    doing : what was asked for, a gerund

    Raises
    ------
    InputError
        If it is that of an impedance display.
    """
    if isinstance(coupling, SpringDamper):
        raise InputError(source, [_not_yet(doing)])
    return coupling


def only_admittance(source: str, device: Device, doing: str) -> None:
    """Raise an `InputError` if a device is an impedance display.

    Parameters
    ----------
    source : what messages call the problem
    device : of the problem
    doing : what was asked for, a gerund
    """
    if device.renders_force:
        raise InputError(source, [_not_yet(doing)])


def _not_yet(doing: str) -> Mistake:
    return Mistake("device.display", f'"impedance": {doing} is for admittance displays only, so far')
