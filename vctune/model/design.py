"""A design: the gains and the coupling of a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from math import inf

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains
from vctune.model.numbers.arithmetic import Number


@dataclass(frozen=True, slots=True)
class Design:
    """A device with gains and coupling, in numbers of any arithmetic."""

    device: Device
    gains: Gains
    coupling: AnyCoupling

    def converted(self, number: Callable[[Number], Number]) -> Design:
        """Return the design with its numbers in another arithmetic; inf stays a float."""
        coupling = type(self.coupling)(*(x if x == inf else number(x) for x in astuple(self.coupling)))
        return Design(self.device.converted(number), Gains(*map(number, astuple(self.gains))), coupling)

    @property
    def series(self) -> Coupling:
        """The coupling of an admittance display or a servo: damping and mass in series with a drag in parallel."""
        assert isinstance(self.coupling, Coupling)
        return self.coupling
