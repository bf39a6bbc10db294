"""Represent a transfer function with its units, as arrays over frequency and as matrices. python-control accepts
both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from vctune.analysis.extrema import Floats
from vctune.analysis.resonance import round_at_resonance
from vctune.analysis.sampled_loop import Complex
from vctune.markup import html_facts, html_table
from vctune.model.device import Device

if TYPE_CHECKING:
    import control

POINTS, DECADES = 1600, 5.0  # Number of drawn frequencies, and number of decades below Nyquist
MOST_SHOWN = 20  # Number of rows of a response that a notebook shows


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """A transfer function at frequencies up to Nyquist."""

    symbol: str  # symbol of the transfer function
    omega: Floats  # frequency, rad/s, in ascending order, shape (n,)
    values: Complex  # complex values, in `unit`, shape (n,)
    unit: str  # unit of the values; "1" if they are dimensionless
    sample_time: float  # T, s

    @property
    def hz(self) -> Floats:
        """The frequencies, Hz."""
        return self.omega / (2 * pi)

    def to_control(self) -> control.FrequencyResponseData:
        """Return the response as python-control's object, with dt in s (needs the extra `control`)."""
        import control

        return control.FrequencyResponseData(
            self.values, self.omega, dt=self.sample_time, smooth=self.omega.size > SPLINE, name=self.symbol
        )

    def __repr__(self) -> str:
        return f"Response({self.symbol} [{self.unit}], {self.omega.size} frequencies{self._band})"

    @property
    def _band(self) -> str:
        return f", {self.hz[0]:.4g} to {self.hz[-1]:.4g} Hz" if self.omega.size else ""

    def _repr_html_(self) -> str:
        shown = np.unique(np.linspace(0, self.omega.size - 1, min(self.omega.size, MOST_SHOWN)).astype(int))
        rows = [
            (float(self.hz[i]), float(np.abs(self.values[i])), float(np.angle(self.values[i], deg=True))) for i in shown
        ]
        caption = f"{self.symbol}: {shown.size} of {self.omega.size} frequencies"
        return html_table(caption, rows, ("frequency, Hz", f"|{self.symbol}|, {self.unit}", "phase, deg"))


SPLINE = 3  # Order of python-control's interpolation


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """The system x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]."""

    A: Floats  # arrays of shape (n, n), (n, 1), (1, n) and (1, 1)
    B: Floats
    C: Floats
    D: Floats
    sample_time: float  # T, s
    states: tuple[str, ...]  # names with units, such as "velocity, m/s"
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def poles(self) -> Complex:
        """The eigenvalues of A."""
        return np.asarray(np.linalg.eigvals(self.A), np.complex128)

    def at(self, z: Complex) -> Complex:
        """Return C (z - A)^-1 B + D at points z of the complex plane. The result has the shape of z."""
        points = np.asarray(z, np.complex128)
        left = points[..., None, None] * np.eye(len(self.states)) - self.A
        return np.asarray((self.C @ np.linalg.solve(left, self.B.astype(complex)) + self.D)[..., 0, 0])

    def to_control(self) -> control.StateSpace:
        """Return the system as python-control's object, with dt in s (needs the extra `control`)."""
        import control

        named = {key: list(map(_plain, getattr(self, key))) for key in ("states", "inputs", "outputs")}
        return control.StateSpace(
            self.A, self.B, self.C, self.D, self.sample_time, remove_useless_states=False, **named
        )

    def __repr__(self) -> str:
        return f"StateSpace({', '.join(self.inputs)} -> {', '.join(self.outputs)}, {len(self.states)} states)"

    def _repr_html_(self) -> str:
        numbers = np.block([[self.A, self.B], [self.C, self.D]]).tolist()
        rows = [[name, *row] for name, row in zip((*self.states, *self.outputs), numbers, strict=True)]
        return html_table(repr(self), rows, ("", *self.states, *self.inputs))


def _plain(name: str) -> str:
    """Return a name in the form that python-control accepts: without unit and dots."""
    return name.partition(", ")[0].replace(".", "_")


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """A transfer function of the sampled loop."""

    symbol: str  # symbol of the function, such as L, S or Z_c
    unit: str  # unit of the values; "1" if they are dimensionless
    device: Device = field(repr=False)  # device of the loop, with plain numbers
    response: Callable[[Floats], Complex] = field(repr=False)
    realised: Callable[[], StateSpace] = field(repr=False)  # function that returns the state space

    def at(self, omega: Floats | None = None) -> Response:
        """Return the transfer function as an array over frequency."""
        grid = up_to_nyquist(self.device) if omega is None else np.atleast_1d(np.asarray(omega, float))
        T = float(self.device.sample_time)
        values = np.asarray(self.response(grid * T) + 0 * grid, np.complex128)
        return Response(self.symbol, grid, values, self.unit, T)

    @property
    def state_space(self) -> StateSpace:
        """Return the transfer function as matrices."""
        return self.realised()

    def to_control(self) -> control.StateSpace:
        """Return the state space as python-control's object, with dt in s (needs the extra `control`)."""
        return self.state_space.to_control()

    def _repr_html_(self) -> str:
        return html_facts(self.symbol, {"unit": self.unit, "sample time, s": self.device.sample_time})


def up_to_nyquist(device: Device) -> Floats:
    """Return five decades of frequencies up to Nyquist, rad/s, with more of them around a structure's resonance."""
    top = 0.5 / float(device.sample_time)
    return 2 * pi * round_at_resonance(device, np.geomspace(top * 10.0**-DECADES, top, POINTS))
