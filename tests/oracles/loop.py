"""One sample of a whole loop, exact between samples: device with its parts, firmware, hand, coupling and environment.

It reads the same tables as a problem file and imports nothing of vctune. Every number of a loop comes from
one function, `step`: its matrix says what grows, its port what coupling and environment see of device and hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from arithmetic import DOUBLES, Arithmetic
from frequency import STRUCTURES, firmware

Triple = tuple[float, float, float]
NOTHING: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Loop:
    """A device's table, its gains (K_v, K_p), and mass, damping and stiffness of a hand and of an environment.

    The coupling is (b_c, m_c, b_0), of an impedance display (b_c, k_c). Without a coupling nothing is behind the port.
    Resonators are mass, damping and stiffness of what hangs on a handle beside the hand. A rule is mass, damping and
    stiffness of ROS 2's admittance_controller, which then takes the place of the coupling: on a servo its spring pulls
    at the measured position, and what it commands, a held velocity or an interpolated position, is one motion.
    """

    device: Mapping[str, Any]
    gains: tuple[float, float] = (0.0, 0.0)
    coupling: tuple[float, ...] = (0.0, 1.0, 0.0)
    hand: Triple = NOTHING
    world: Triple = NOTHING
    num: Arithmetic = field(default=DOUBLES)
    resonators: tuple[Triple, ...] = ()
    rule: Triple | None = None
    delta: tuple[float, float] | None = None

    @property
    def kind(self) -> str:
        """What the device is: "servo", "impedance" or "admittance"."""
        return "servo" if "servo" in self.device else self.device.get("display", "admittance")

    def number(self, table: str, key: str, default: float = 0.0) -> Any:
        """Return a number of one of the device's tables."""
        return self.num.number(self.device.get(table, {}).get(key, default))

    @property
    def at_handle(self) -> bool:
        """Whether the firmware reads the handle's position and velocity, not the motor's."""
        return self.device.get("velocity", {}).get("at") == "handle"

    def read(self, body: np.ndarray) -> tuple[Any, Any]:
        """Return the position and the velocity that the firmware reads."""
        if not self.at_handle:
            return body[0], body[1 % len(body)]
        springs = sum(table in self.device for table in STRUCTURES)
        return body[0] + sum(body[2 + 2 * n] for n in range(springs)), body[1 + 2 * springs]

    @cached_property
    def T(self) -> Any:
        """Sample time, s."""
        return self.num.number(self.device["sample_time"])

    def parts(self, delay: float) -> tuple[int, Any]:
        """Return the whole samples of a delay, and the rest in seconds, as decimals."""
        T = Fraction(repr(float(self.device["sample_time"])))
        whole, rest = divmod(Fraction(repr(float(delay))), T)
        return int(whole), self.num.number(rest)

    @cached_property
    def late(self) -> tuple[int, Any]:
        """Whole samples and the rest by which the command acts late."""
        return self.parts(self.device.get("servo", self.device).get("delay", 0.0))

    @cached_property
    def sensed(self) -> tuple[int, Any]:
        """Whole samples and the rest by which the force is read late."""
        return self.parts(self.device.get("force_sensor", {}).get("delay", 0.0))

    @cached_property
    def plant(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
        """A and B of x' = A x + B u, and C and D of the sensed force; x is the motor's position, its velocity, ..."""
        return _plant(self)

    @cached_property
    def spans(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Each e^{A t} with what a held command leaves: up to the newer command, from there on, and to the reading."""
        _, rest = self.late
        _, ago = self.sensed
        on = self.T - ago  # where within the sample the force is read that arrives at its end
        first = min(on, rest)
        return {
            "old": _over(self, rest),
            "new": _over(self, self.T - rest),
            "read_old": _over(self, first),
            "read_new": _over(self, on - first),
        }


def _plant(loop: Loop) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:  # noqa: PLR0915
    num, device = loop.num, loop.device
    M, B, K = (num.number(x) for x in loop.hand)
    lag = "servo" if loop.kind == "servo" else "actuator"
    pushers, sensors = _order(loop, lag), _order(loop, "force_sensor") if loop.kind != "impedance" else 0
    springs = [table for table in STRUCTURES if table in device]
    body = 1 if loop.kind == "servo" else 2 + 2 * len(springs)
    size = body + pushers + sensors + 2 * len(loop.resonators)
    row = list(num.eye(size + 1))
    command, acting, reading = row[-1], row[body : body + pushers], row[body + pushers : body + pushers + sensors]
    push = acting[0] if acting else command
    v_h, pull, hung = row[max(body - 1, 1) % len(row)], 0 * row[0], []
    for k, resonator in enumerate(loop.resonators):  # its stretch and its velocity
        m_r, b_r, k_r = (num.number(x) for x in resonator)
        stretch, v_r = row[size - 2 * len(loop.resonators) + 2 * k :][:2]
        own = k_r * stretch + b_r * (v_r - v_h)
        pull, hung = pull + own, [*hung, v_r - v_h, -own / m_r]
    if loop.kind == "servo":  # the velocity follows, whatever the hand does
        rates = [push, *_filtered(loop, lag, command, acting)]
        v, x = push, row[0]
        acceleration = rates[1] if acting else None
        assert acceleration is not None, "a servo has a bandwidth"
        force = -(M * acceleration + B * v + K * x)
    elif body == 2:
        m, b = num.number(device["mass"]), num.number(device["damping"])
        acceleration = (push + pull - (b + B) * row[1] - K * row[0]) / (m + M)
        rates = [row[1], acceleration, *_filtered(loop, lag, command, acting)]
        force = pull - (M * acceleration + B * row[1] + K * row[0])
    else:  # motor x, v; then the stretch of each spring and the velocity behind it; the handle is the last mass
        m, b = num.number(device["mass"]), num.number(device["damping"])
        masses = [loop.number(table, "handle_mass") for table in springs]
        masses.insert(0, m - sum(masses))
        ahead, rates = row[1], [row[1]]
        pulls, moved = [push - b * row[1]], row[0]
        for n, table in enumerate(springs):
            stretch, v_2 = row[2 + 2 * n : 4 + 2 * n]
            mu = sum(masses[: n + 1]) * sum(masses[n + 1 :]) / m  # of the two sides of the spring
            if "stiffness" in device[table]:
                k = loop.number(table, "stiffness")
                w = num.sqrt(k / mu)
            else:
                w = 2 * num.pi * loop.number(table, "frequency_hz")
                k = mu * w**2
            spring = k * stretch + 2 * loop.number(table, "damping_ratio") * mu * w * (v_2 - ahead)
            pulls[-1] = pulls[-1] + spring  # towards the handle
            pulls.append(-spring)
            rates += [v_2 - ahead, None]
            ahead, moved = v_2, moved + stretch
        acceleration = (pull + pulls[-1] - B * ahead - K * moved) / (masses[-1] + M)
        rates[1:1] = [pulls[0] / masses[0]]
        for n in range(1, len(springs)):
            rates[1 + 2 * n] = pulls[n] / masses[n]
        rates[-1] = acceleration
        rates += _filtered(loop, lag, command, acting)
        force = pull - (M * acceleration + B * ahead + K * moved)
    if reading:
        rates += _filtered(loop, "force_sensor", force, reading)
        force = reading[0]
    rates += hung
    A = num.array([list(rate) for rate in rates])
    return A[:, :size], A[:, size], force[:size], force[size]


def _order(loop: Loop, part: str) -> int:
    table = loop.device.get(part, {})
    return int(table.get("order", 1)) if "bandwidth_hz" in table else 0


def _filtered(loop: Loop, part: str, source: np.ndarray, states: list[np.ndarray]) -> list[np.ndarray]:
    """Return the rates of a low-pass: y' = w (x - y), or y'' = w^2 (x - y) - sqrt(2) w y'."""
    if not states:
        return []
    num = loop.num
    w = 2 * num.pi * loop.number(part, "bandwidth_hz")
    if len(states) == 1:
        return [w * (source - states[0])]
    return [states[1], w**2 * (source - states[0]) - num.sqrt(num.number(2)) * w * states[1]]


def _over(loop: Loop, time: Any) -> tuple[np.ndarray, np.ndarray]:
    A, B, _, _ = loop.plant
    n = len(B)
    joined = loop.num.eye(n + 1) * 0
    joined[:n, :n], joined[:n, n] = A * time, B * time
    found = loop.num.expm(joined)
    return found[:n, :n], found[:n, n]


class Memory:
    """Named places in what the loop remembers from one sample to the next."""

    def __init__(self, loop: Loop) -> None:
        filters, heard = (_remembered(loop, table) for table in ("velocity", "force_sensor"))
        sizes = {
            "body": len(loop.plant[1]),
            "commands": loop.late[0] + 1,  # u[k - N - 1] ... u[k - 1]
            "readings": loop.sensed[0] + 1,  # of the force; the first is this sample's
            "before": 1,  # the position of a sample ago
            "smoothed": filters,  # of the velocity
            "rendered": filters,  # of the coupling's velocity, on an impedance display
            "firmware": heard,  # of the sensed force
            "spring": 1,  # of the coupling, on an impedance display
            "x_e": 1,
            "p_c": 1,  # of the coupling's mass
            "p_e": 1,  # of the environment's
            "v_e": 1,
            "delta": 1,
        }
        self.at, self.size = dict[str, slice](), 0
        for name, size in sizes.items():
            self.at[name] = slice(self.size, self.size + size)
            self.size += size


def step(  # noqa: PLR0912, PLR0915
    loop: Loop, memory: np.ndarray, given: Any = None, extra: Any = 0, misread: Any = 0, misheard: Any = 0
) -> tuple[np.ndarray, Any]:
    """Return the memory one sample later, and what leaves the port; a memory's columns are as many loops at once.

    Parameters
    ----------
    given : what enters the port in place of coupling and environment: v_e, or on an impedance display f_c
    extra : a force on the environment's velocity beside those of its table
    misread, misheard : errors of this sample's position and of its force

    Returns
    -------
    memory, out : with `given` the sensed force, or on an impedance display y; without it v_e
    """
    num, T, at = loop.num, loop.T, Memory(loop).at
    get = {name: memory[place] for name, place in at.items()}
    new = {name: 0 * value for name, value in get.items()}
    K_v, K_p = (num.number(x) for x in loop.gains)
    m, d, k = (num.number(x) for x in loop.world)
    body, (x, v) = get["body"], loop.read(get["body"])
    x = x + misread
    velocity = loop.device.get("velocity", {})
    y = (x - get["before"][0]) / T
    source = velocity.get("from", "difference" if loop.kind == "impedance" else "measured")
    estimated = y if source == "difference" else v
    smoothed, new["smoothed"] = _smoothed(loop, get["smoothed"], estimated)
    hard = 2 / T * m
    if loop.kind == "impedance":
        if given is not None:
            f_c, out = given, y
        elif source == "measured":  # a wall, which nothing moves
            b_c, k_c = (num.number(each) for each in loop.coupling)
            v_e = out = 0 * x
            f_c = b_c * smoothed + k_c * x
        else:  # f_c = at rest + slope (y - v_e), which the environment bears: f_c = Z_e v_e
            b_c, k_c = (num.number(x) for x in loop.coupling)
            rest, slope = _answer(loop, get["rendered"], b_c)
            rest, slope = rest + get["spring"][0], slope + k_c * T
            own = hard + d + k * T / 2
            v_e = (rest + slope * y - (k * get["x_e"][0] - hard * get["p_e"][0]) + extra) / (slope + own)
            f_c, out = rest + slope * (y - v_e), v_e
            _, new["rendered"] = _smoothed(loop, get["rendered"], y - v_e)
            new["spring"] = get["spring"] + k_c * T * (y - v_e)
        command = -(f_c + K_v * smoothed)
    else:
        force, new["firmware"] = _smoothed(loop, get["firmware"], get["readings"][0] + misheard, "force_sensor")
        if "servo" in loop.device:
            force = force - loop.number("servo", "stiffness") * x
        if given is not None:
            v_e, out = given, force
        elif loop.rule is not None:  # the acceleration of the velocity and the position of a sample ago
            M, D, S = (num.number(x) for x in loop.rule)
            pulled = D * get["v_e"][0] + S * (x if loop.kind == "servo" else get["x_e"][0])
            pushed = force + extra + hard * get["p_e"][0] - k * get["x_e"][0]
            v_e = out = (get["v_e"][0] + T * (pushed - pulled) / M) / (1 + T / M * (hard + d + k * T / 2))
        else:
            b_c, m_c, b_0 = loop.coupling
            rigid = math.isinf(b_c)
            h_c = 2 / T * num.number(m_c)
            soft = h_c if rigid else num.number(b_c) * h_c / (num.number(b_c) + h_c)
            own = num.number(b_0) + soft + hard + d + k * T / 2
            pushed = force + soft * get["p_c"][0] + hard * get["p_e"][0] - k * get["x_e"][0] + extra
            v_e = out = pushed / own
            new["p_c"] = num.array(
                [2 * v_e - get["p_c"][0] if rigid else get["p_c"][0] + 2 * soft / h_c * (v_e - get["p_c"][0])]
            )
        if loop.kind == "servo":
            between = loop.device["servo"].get("command") == "position" and loop.rule is None
            command = (v_e + get["v_e"][0]) / 2 if between else v_e
        else:
            led = get["x_e"][0] + (T / 2 if loop.rule is None else T) * v_e
            command = K_v * (v_e - smoothed) + K_p * (led - x)
        new["v_e"] = num.array([v_e])
    if loop.kind == "impedance" and given is not None:
        v_e = 0
    if loop.delta is not None:
        r, a = (num.number(x) for x in loop.delta)
        passed = get["delta"][0] - a * command
        new["delta"] = num.array([command + a * passed])
        command = command + r * passed
    new["x_e"] = get["x_e"] + T * v_e
    new["p_e"] = num.array([2 * v_e - get["p_e"][0] if m else 0 * x])
    queue = [*get["commands"], command]
    moved = _through(body, loop.spans["old"], queue[0])
    new["body"] = _through(moved, loop.spans["new"], queue[1])
    C, D = loop.plant[2:]
    late = _through(body, loop.spans["read_old"], queue[0])
    _, rest = loop.late
    _, ago = loop.sensed
    acting = queue[0]
    if loop.T - ago > rest:  # the newer command acts already where the force is read
        late, acting = _through(late, loop.spans["read_new"], queue[1]), queue[1]
    new["readings"] = num.array([*get["readings"][1:], C @ late + D * acting])
    new["commands"] = num.array(queue[1:])
    new["before"] = num.array([x])
    found = np.empty_like(memory)
    for name, place in at.items():
        found[place] = new[name]
    return found, out


def _through(body: np.ndarray, span: tuple[np.ndarray, np.ndarray], command: Any) -> np.ndarray:
    return span[0] @ body + np.multiply.outer(span[1], command)


def _share(loop: Loop, table: str) -> Any:
    """Return a of the firmware's one-pole y += a (x - y), 1 without a filter."""
    stated, num = loop.device.get(table, {}), loop.num
    if "filter_hz" in stated:
        return 1 - num.exp(-2 * num.pi * num.number(stated["filter_hz"]) * loop.T)
    return num.number(stated.get("filter_coefficient", 1))


def _low_passes(loop: Loop, table: str) -> int:
    return int(loop.device.get(table, {}).get("filter_order", 1))


def _remembered(loop: Loop, table: str) -> int:
    return _low_passes(loop, table) + 2 * len(loop.device.get(table, {}).get("sections", ()))


def _smoothed(loop: Loop, states: np.ndarray, value: Any, table: str = "velocity") -> tuple[Any, np.ndarray]:
    """Return a value behind the firmware's filter, and the states: low-passes, then sections in transposed form."""
    a, found, low_passes = _share(loop, table), [], _low_passes(loop, table)
    for state in states[:low_passes]:
        value = state + a * (value - state)
        found.append(value)
    for k, row in enumerate(loop.device.get(table, {}).get("sections", ())):
        b_0, b_1, b_2, a_0, a_1, a_2 = (loop.num.number(each) for each in row)
        first, second = states[low_passes + 2 * k], states[low_passes + 2 * k + 1]
        passed = (b_0 * value + first) / a_0
        found += [b_1 * value - a_1 * passed + second, b_2 * value - a_2 * passed]
        value = passed
    return value, loop.num.array(found)


def _answer(loop: Loop, states: np.ndarray, gain: Any) -> tuple[Any, Any]:
    """Return what a gain behind the filters gives of the input 0, and by how much more of the input 1."""
    zero, one = (_smoothed(loop, states, 0 * states[0] + loop.num.number(value))[0] for value in (0, 1))
    return gain * zero, gain * (one - zero)


def matrix(loop: Loop, *, at_rest: bool = False) -> np.ndarray:
    """Return the matrix of one sample of everything, without positions that nothing depends on.

    With the environment at rest v_e is 0; an impedance display renders nothing then.
    """
    one = loop.num.eye(Memory(loop).size)
    whole, at = step(loop, one, 0 * one[0] if at_rest else None)[0], Memory(loop).at
    body, x_e, before = at["body"].start, at["x_e"].start, at["before"].start
    ruled, servo = loop.rule is not None and loop.rule[2] != 0, loop.kind == "servo"
    measured = loop.device.get("velocity", {}).get("from") == "measured"
    walled = measured and loop.kind == "impedance" and not at_rest
    held, tied, hung = (
        loop.hand[2] != 0 or loop.device.get("servo", {}).get("stiffness", 0.0) != 0 or (ruled and servo) or walled,
        loop.kind == "admittance" and loop.gains[1] != 0,
        loop.world[2] != 0 or (ruled and not servo) or at_rest,
    )
    drop = [x_e] if at_rest or (not hung and not tied) else []
    if not held and not (tied and hung):  # everything else is where it is from the motor
        for place in [before] + ([x_e] if tied else []):
            whole[place, :] = whole[place, :] - whole[body, :]
        drop.append(body)
    keep = [i for i in range(len(whole)) if i not in drop]
    return whole[np.ix_(keep, keep)]


def radius(loop: Loop, *, at_rest: bool = False) -> float:
    """Return the greatest modulus of an eigenvalue of one sample: above 1 the motion grows."""
    return float(max(abs(x) for x in loop.num.eigenvalues(matrix(loop, at_rest=at_rest))))


@dataclass(frozen=True)
class Port:
    """A sample of the loop without coupling and environment, from what enters the port to what leaves it."""

    A: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: Any
    num: Arithmetic

    def __call__(self, z: Any) -> Any:
        """Return the response at a number or an array z."""
        if np.ndim(z):
            inner = np.linalg.solve(z[:, None, None] * np.eye(len(self.b)) - self.A, self.b[:, None])[..., 0]
            return inner @ self.c + self.d
        return self.c @ self.num.solve(z * self.num.eye(len(self.b)) - self.A, self.b) + self.d


def port(loop: Loop) -> Port:
    """Return the response from v_e to the sensed force, or of an impedance display from f_c to y."""
    size, one = Memory(loop).size, loop.num.eye(Memory(loop).size + 1)
    after, out = step(loop, one[:size], one[size])
    return Port(after[:, :size], after[:, size], out[:size], out[size], loop.num)


def seen(loop: Loop, z: Any) -> Any:
    """Return what the environment sees of device and hand: Z_seen, or of an impedance display Y_seen (y per -f_c)."""
    return -port(loop)(z)


def offered(loop: Loop, z: Any) -> Any:
    """Return Z_c as the firmware runs it, or 1/Z_c of an impedance display."""
    num, T = loop.num, loop.T
    if loop.kind == "impedance":
        b_c, k_c = (num.number(x) for x in loop.coupling)
        smooth = firmware(loop.device.get("velocity", {}), T, z, num)
        return (1 - 1 / z) / (b_c * smooth * (1 - 1 / z) + k_c * T)
    b_c, m_c, b_0 = loop.coupling
    s = 2 / T * (z - 1) / (z + 1)
    mass = num.number(m_c) * s
    return num.number(b_0) + (mass if math.isinf(b_c) else num.number(b_c) * mass / (num.number(b_c) + mass))


def sensitivity(loop: Loop, z: Any) -> Any:
    """Return S of the velocity loop: what remains at the sensor of a force that is added to the command."""
    open_ = Loop(loop.device, (0.0, 0.0), loop.coupling, loop.hand, NOTHING, loop.num)
    return _motion(loop, z) / _motion(open_, z)


def _motion(loop: Loop, z: Any) -> Any:
    """Return the sensed velocity per unit of a force beside the command, the environment at rest."""
    num, size, at = loop.num, Memory(loop).size, Memory(loop).at
    one = num.eye(size)
    b = one[0] * 0
    b[at["commands"].stop - 1] = num.number(1)
    if loop.late[0] == 0:
        b[at["body"]] = loop.spans["new"][1]
    after, _ = step(loop, one, 0 * one[0])
    return Port(after, b, loop.read(one[at["body"]])[1], num.number(0), num)(z)


def turn(loop: Loop, theta: Any) -> Any:
    """Return z = e^{j theta}; an array of angles in doubles, a number in the loop's arithmetic."""
    return np.exp(1j * theta) if np.ndim(theta) else loop.num.exp(loop.num.i * loop.num.number(theta))


def slowest(loop: Loop, *, at_rest: bool) -> tuple[float, float, float]:
    """Return damping ratio, frequency and time constant of the least damped oscillation of one loop."""
    z = np.linalg.eigvals(matrix(loop, at_rest=at_rest).astype(float)).astype(complex)
    heard = np.abs(z + 1) > 1e-9  # a rigid coupling and a mass behind it are one
    s = np.log(z[(np.abs(z) > 1e-3) & (np.abs(z - 1) > 1e-5) & heard]) / loop.T
    s = s[np.abs(s.imag) > 2 * math.pi * 0.1]
    if not s.size:
        return math.inf, 0.0, math.inf
    ratio = -s.real / np.abs(s)
    k = int(np.argmin(ratio))
    return float(ratio[k]), abs(s[k].imag) / (2 * math.pi), float(-1 / s[k].real)
