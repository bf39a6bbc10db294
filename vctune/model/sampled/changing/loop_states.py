"""Write, in state-space form, the sampled loop in a hand whose damping changes (model/README.md, section 21)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from vctune.model.coupling import trapezoidal
from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.hands import Hand
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number
from vctune.model.numbers.matrices import Matrix, Vector, add, nothing, times
from vctune.model.sampled.changing.held_plant import PULL, HeldPlant, held_plant
from vctune.model.sampled.changing.held_servo import held_servo
from vctune.model.sampled.changing.named_rows import COMMAND, Row, substituted, total

DESIRED, REACHED, COUPLED = "v_e", "q", "g"


class Pull(NamedTuple):
    """The hand's spring in a loop whose first state is the spring's force p. Over a sample, p grows by K d, where d is
    the motion of the handle."""

    stiffness: Number  # K
    motion: Vector  # d, as a row over zeta and v_e

    def grown(self, i: int, j: int) -> Number:
        """Return an entry of the quadratic form 2 p d + K d^2 in zeta and v_e, by which p^2/K grows over a sample."""
        d = self.motion
        found = times(times(self.stiffness, d[i]), d[j])
        for one, other in ((i, j), (j, i)):
            found = add(found, d[other]) if one == 0 else found
        return found


class LoopStates(NamedTuple):
    """The loop zeta[k+1] = change zeta[k] + push v_e[k], y = Z_c v_e - f = seen zeta + spring q + direct v_e."""

    names: tuple[str, ...]  # names of the entries of zeta
    staying: int  # number of leading states that hardly change over a sample
    change: Matrix  # coefficients of zeta[k] in zeta[k+1]; for the leading states, in zeta[k+1] - zeta[k]
    push: Vector  # coefficients of v_e in zeta[k+1] and of zeta in y, n numbers each
    seen: Vector
    direct: Number  # immediate response of y to v_e
    spring: Number  # k_eq: hand's spring, structure and K_p in series
    pull: Pull | None  # the hand's spring, if its force is the first state, as with K_p = 0


class Law(NamedTuple):
    """The law that runs on a device, in any arithmetic."""

    gains: Gains  # K_v and K_p; without effect for a servo
    coupling: Coupling  # b_c, m_c and b_0


def loop_states(
    plain: tuple[Device, Law], exact: tuple[Device, Law], hand: Hand, sensed: Number, ops: Arithmetic
) -> LoopStates:
    """Sample a device in a hand exactly. The device has a velocity loop or is a servo."""
    (own, given), (device, law) = plain, exact
    T, unit = device.sample_time, device.sample_time / device.mass
    if own.servo is not None:
        held, command = held_servo(own, device, hand, sensed, ops), {DESIRED: 0 * T + 1}
    else:
        stiffness = law.gains.position if given.gains.position > 0 else None
        held = held_plant(own, device, stiffness, hand, sensed, ops)
        k_v = law.gains.velocity * unit
        command = total([(-k_v, held.velocity), (k_v, {DESIRED: 1})])
        if stiffness is not None:
            k_p = stiffness * (T * unit)
            command = total([(1, command), (-k_p, held.position), (k_p, {REACHED: 1}), (0.5 * k_p, {DESIRED: 1})])
    y, memory = held.felt, dict(held.memory)
    direct = law.coupling.drag * unit
    if not given.coupling.rigid:
        slope, decay = trapezoidal(law.coupling, T)
        memory[COUPLED] = total([(decay, {COUPLED: 1}), (1, {DESIRED: 1})])
        y, direct = total([(1, y), (-(slope * unit) * (1 - decay), {COUPLED: 1})]), direct + slope * unit
    return _loop(held, memory, command, total([(1, y), (direct, {DESIRED: 1})]), hand, unit * T)


def _loop(held: HeldPlant, memory: dict[str, Row], command: Row, y: Row, hand: Hand, unit: Number) -> LoopStates:
    rows = {name: substituted(row, COMMAND, command) for name, row in (held.change | memory).items()}
    y, moved = substituted(y, COMMAND, command), substituted(held.moved, COMMAND, command)
    names = _used(rows, y)
    staying = sum(name in held.change for name in names)

    def of(row: Row) -> Vector:
        return tuple(row.get(name, 0) for name in names)

    push = (add(rows[name].get(DESIRED, 0), times(-1, held.rest.get(name, 0))) for name in names)
    pull = None
    if PULL in names:
        pull = Pull(hand.stiffness * unit, (*of(moved), moved.get(DESIRED, 0)))
    return LoopStates(
        names, staying, tuple(of(rows[name]) for name in names), tuple(push), of(y), y[DESIRED], held.spring, pull
    )


def _used(rows: dict[str, Row], y: Row) -> tuple[str, ...]:
    """Return the states on which y depends, in their order."""
    found, ahead = set[str](), _states(y, rows)
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            ahead += _states(rows[name], rows)
    return tuple(name for name in rows if name in found)


def _states(row: Row, rows: Iterable[str]) -> list[str]:
    return [name for name, x in row.items() if name in rows and not nothing(x)]


def states_of(device: Device, law: Law) -> list[str]:
    """Return the names of the states zeta of a loop."""
    one = Hand(device.mass, 0.0, device.mass / device.sample_time**2)
    return list(loop_states((device, law), (device, law), one, 0.0, FLOATS).names)
