"""What cannot be done yet with an impedance display."""

from __future__ import annotations

from vctune.document.errors import InputError, Mistake
from vctune.model.quantities import Device


def only_admittance(source: str, device: Device, doing: str) -> None:
    """Refuse an impedance display where only admittance displays are supported.

    Parameters
    ----------
    source : what messages call the problem
    device : of the problem
    doing : what was asked for, a gerund

    Raises
    ------
    InputError
        If it is one.
    """
    if device.renders_force:
        message = f'"impedance": {doing} is for admittance displays only, so far'
        raise InputError(source, [Mistake("other-display", "device.display", message)])
