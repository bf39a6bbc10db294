"""Logs of simulated servos: every jump of a command acts when it arrives, by its step response in closed form.

It shares nothing with `vctune.identification`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

KINDS = ("sweep", "steps", "motion", "slow")
SPEED = 0.1


def step_response(t, w, order):
    """Return the way that a low-pass of the velocity makes of a step of 1 m/s."""
    t = np.maximum(t, 0.0)
    if order == 1:
        return t - (1 - np.exp(-w * t)) / w
    a = w / sqrt(2)
    return t - (1 - np.exp(-a * t) * np.cos(a * t)) / a


def velocity_step(t, w, order):
    """Return the velocity that a low-pass makes of a step of 1 m/s."""
    a, t = w / sqrt(2), np.maximum(t, 0.0)
    if order == 1:
        return 1 - np.exp(-w * t)
    return 1 - np.exp(-a * t) * (np.cos(a * t) + np.sin(a * t))


def moved(at, velocity, arrivals, bandwidth_hz, order, response=step_response):
    """Return where a servo is at some instants, or another response, of velocities that arrive at others and stay."""
    x = np.zeros(at.size)
    for arrival, jump in zip(arrivals, np.diff(velocity, prepend=0.0), strict=True):
        first = np.searchsorted(at, arrival)
        x[first:] += jump * response(at[first:] - arrival, 2 * pi * bandwidth_hz, order)
    return x


@dataclass(frozen=True)
class ServoCase:
    """A servo, how it was moved, and its log.

    Attributes
    ----------
    T, delay, bandwidth_hz : s, s, Hz
    order, command : as in a problem file
    kind : of motion
    link : standard deviation of the delay, s
    columns : arrays by header
    """

    T: float
    delay: float
    bandwidth_hz: float
    order: int
    command: str
    kind: str
    link: float
    columns: dict[str, np.ndarray]

    def write(self, folder, name="servo.csv", **more):
        """Write its log, with more columns or others in the place of its own; return the path."""
        columns = self.columns | more
        rows = np.column_stack(list(columns.values()))
        np.savetxt(folder / name, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
        return folder / name


def motion(kind, random, n, T):
    """Return a velocity for each row."""
    t, whole = np.arange(n) * T, n * T
    if kind == "sweep":
        low, high = 0.002 / T, 0.25 / T
        return SPEED * np.sin(2 * pi * low * whole / np.log(high / low) * ((high / low) ** (t / whole) - 1))
    if kind == "steps":
        levels = np.repeat(random.uniform(-1, 1, n // 100 + 1), 100)[:n]
        return SPEED * (levels - levels.mean())
    f = np.fft.rfftfreq(n, T) * T
    share = 1 / (1 + (f / 0.01) ** 4) if kind == "motion" else f < 0.002
    wave = np.fft.irfft(np.fft.rfft(random.normal(size=n)) * share, n)
    return SPEED * wave / wave.std()


def servo_case(seed, *, kind=None, n=4000, **fixed) -> ServoCase:
    """Return a random servo with encoder, noise and a link that may jitter; a sweep of it in three of five."""
    random = np.random.default_rng(seed)
    T = float(random.choice([1e-3, 2e-3, 4e-3, 8e-3]))
    late = float(np.exp(random.uniform(np.log(0.2), np.log(80.0))))
    order = int(random.integers(1, 3))
    bandwidth = float(np.exp(random.uniform(np.log(0.01), np.log(0.2)))) / T
    kind = kind or KINDS[0 if random.uniform() < 0.6 else int(random.integers(0, 3))]
    command = str(random.choice(["velocity", "position"]))
    jitter = float(random.choice([0.0, 0.0, 0.1, 0.3]))
    fineness, noise = float(np.exp(random.uniform(np.log(1e-6), np.log(1e-4)))), float(random.choice([0, 0.3, 1, 3]))
    made = {"T": T, "late": late, "order": order, "bandwidth": bandwidth, "command": command, "jitter": jitter} | fixed
    T, late, order, bandwidth, command, jitter = made.values()
    velocity, time = motion(kind, random, n, T), np.arange(n) * T
    arrivals = time + late * T + jitter * T * random.uniform(-0.5, 0.5, n)
    if command == "velocity":
        told, header = velocity, "velocity_command_m_s"
        x = moved(time, velocity, arrivals, bandwidth, order)
    else:
        told, header = np.concatenate([[0.0], np.cumsum(velocity[:-1]) * T]), "position_command_m"
        reached = arrivals + T
        x = moved(time, np.append(np.diff(told) / np.diff(reached), 0.0), reached, bandwidth, order)
    quantum = fineness * float(np.ptp(x))
    position = quantum * np.floor((x + noise * quantum * random.normal(size=n)) / quantum + 0.5)
    columns = {"time_s": time, header: told, "position_m": position}
    return ServoCase(T, late * T, bandwidth, order, command, kind, jitter * T / sqrt(12), columns)


def robot_case(seed, n=2500) -> ServoCase:
    """Return a random robot whose position or velocity was read, rounded as robots log it, with stamps that jitter."""
    random = np.random.default_rng(seed)
    T, order = float(random.choice([4e-3, 8e-3, 12e-3])), int(random.integers(1, 3))
    delay = T * float(np.exp(random.uniform(np.log(0.2), np.log(10.0))))
    bandwidth = float(np.exp(random.uniform(np.log(1.5), np.log(min(20.0, 0.15 / T)))))
    kind = str(random.choice([*KINDS, "sweep", "ramps"]))
    command, reads = str(random.choice(["velocity", "position"])), str(random.choice(["position", "velocity"]))
    quantum = float(np.exp(random.uniform(np.log(1e-5), np.log(1e-3))))
    speeds = np.repeat(random.choice([-1.0, -0.3, 0.0, 0.3, 1.0], n // 150 + 1), 150)[:n]
    velocity = SPEED * (speeds - speeds.mean()) if kind == "ramps" else motion(kind, random, n, T)
    time = np.arange(n) * T
    arrivals, told = time + delay, velocity
    if command == "position":
        told = np.concatenate([[0.0], np.cumsum(velocity[:-1]) * T])
        arrivals, velocity = arrivals + T, np.append(np.diff(told) / T, 0.0)
    x = moved(time, velocity, arrivals, bandwidth, order, step_response if reads == "position" else velocity_step)

    def rounded(values, step):
        return step * np.floor(values / step + 0.5)

    if command == "position":
        told = rounded(told, quantum)
    x = rounded(x, quantum) if reads == "position" else rounded(x + 2e-3 * SPEED * random.normal(size=n), 1e-4)
    jitter = float(random.choice([0.0, 0.1, 0.3])) * T * random.uniform(-1, 1, n)
    units = {"position": "m", "velocity": "m_s"}
    columns = {"time_s": time + jitter, f"{command}_command_{units[command]}": told, f"{reads}_{units[reads]}": x}
    return ServoCase(T, delay, bandwidth, order, command, kind, 0.0, columns)


def limited_case(seed, *, speed=np.inf, acceleration=np.inf, T=4e-3, n=3000, parts=16) -> ServoCase:
    """Return a robot of first order whose speed and acceleration are limited, as shares of what it is asked for."""
    random = np.random.default_rng(seed)
    hertz, phases = random.uniform(0.2, 3.0, 6), random.uniform(0.0, 2 * pi, 6)
    told = np.sum(np.sin(2 * pi * hertz[:, None] * np.arange(n) * T + phases[:, None]), axis=0)
    told *= 0.2 / np.abs(told).max()
    late, bandwidth = int(random.integers(8, 100)), float(random.uniform(4.0, 12.0))
    w = 2 * pi * bandwidth
    fastest = speed * np.abs(told).max()
    strongest = acceleration * np.abs(np.diff(told)).max() / T
    goals = np.concatenate([np.full(late, 0.0), np.repeat(told, parts)])
    x, v, h, positions = 0.0, 0.0, T / parts, []
    for part in range(n * parts):
        if part % parts == 0:
            positions.append(x)
        change = min(max((goals[part] - v) * (1 - np.exp(-w * h)), -strongest * h), strongest * h)
        after = min(max(v + change, -fastest), fastest)
        x, v = x + h * (v + after) / 2, after
    position = 1e-6 * np.floor(np.array(positions) / 1e-6 + 0.5)
    columns = {"time_s": np.arange(n) * T, "velocity_command_m_s": told, "position_m": position}
    return ServoCase(T, late * h, bandwidth, 1, "velocity", "limited", 0.0, columns)


def mildly_limited_case(seed, *, limited, n=900) -> ServoCase:
    """Return a robot of either order with a limit at 30 to 90 % of the greatest value that it would have without; none
    if `limited` is None.

    The limit of acceleration bounds the change of the command, of the low-pass's own speed, or of the speed that leaves
    it.
    """
    random = np.random.default_rng(seed)
    T, order = float(random.choice([2e-3, 4e-3, 8e-3, 0.02])), int(random.integers(1, 3))
    bandwidth = float(np.exp(random.uniform(np.log(2.0), np.log(min(60.0, 0.3 / T)))))
    place, share = str(random.choice(["command", "servo", "motion"])), float(random.uniform(0.3, 0.9))
    f = np.fft.rfftfreq(n, T)
    smooth = np.fft.irfft(np.fft.rfft(random.normal(size=n)) * np.exp(-((f / 2.5) ** 2)) * (f > 0), n)
    steps = np.repeat(random.uniform(-1, 1, n // 40 + 1), 40)[:n]
    told = smooth if random.uniform() < 0.5 else steps
    told = 0.3 * told / np.abs(told).max()
    command = str(random.choice(["velocity", "position"]))
    w, parts = 2 * pi * bandwidth, 8 * int(np.ceil(2 * pi * bandwidth * T + 1))
    h = T / parts
    late = round(float(random.uniform(5e-3, 0.06)) / h)
    path = np.concatenate([[0.0], np.cumsum(told[:-1]) * T])
    acts = told if command == "velocity" else np.diff(path, prepend=0.0) / T
    goals = np.concatenate([np.full(late, acts[0]), np.repeat(acts, parts)])[: n * parts]
    free = limited_motion(goals, h, w, order, place, np.inf, np.inf)
    speed = share * np.abs(free).max() if limited == "speed" else np.inf
    acceleration = share * np.abs(np.diff(free)).max() / h if limited == "acceleration" else np.inf
    speeds = limited_motion(goals, h, w, order, place, speed, acceleration)
    way = np.concatenate([[0.0], np.cumsum(0.5 * h * (speeds[1:] + speeds[:-1]))])[::parts]
    position = 1e-5 * np.floor((way + 2e-5 * random.normal(size=n)) / 1e-5 + 0.5)
    header, sent = ("velocity_command_m_s", told) if command == "velocity" else ("position_command_m", path)
    columns = {"time_s": np.arange(n) * T, header: sent, "position_m": position}
    return ServoCase(T, late * h, bandwidth, order, command, "mild", 0.0, columns)


def limited_motion(goals, h, w, order, place, speed, acceleration):
    """Return the speed at the starts of steps of h s of a low-pass of speeds that are held in a step."""
    a = w / sqrt(2)
    decay, cosine, sine, lead = np.exp(-a * h), np.cos(a * h), np.sin(a * h), 1 - np.exp(-w * h)

    def clipped(value, most):
        return min(max(value, -most), most)

    told = v = out = clipped(goals[0], speed)
    slope, speeds = 0.0, []
    for goal in goals.tolist():
        speeds.append(out)
        if place == "command":
            told += clipped(clipped(goal, speed) - told, acceleration * h)
        else:
            told = goal
        off = v - told
        change = -lead * off if order == 1 else (decay * (cosine + sine) - 1) * off + decay * sine / a * slope
        slope = decay * (-2 * a * sine * off + (cosine - sine) * slope)
        if place == "servo":
            v = clipped(v + clipped(change, acceleration * h), speed)
        else:
            v += change
        out = out + clipped(clipped(v, speed) - out, acceleration * h) if place == "motion" else v
    return np.array(speeds)
