"""Logs of simulated devices: the project's own step, driven by any force through the channel of the sensor's noise.

A law whose reference impedance is a damping of 1 turns the sensed force, which no hand makes, into a velocity command.
With next to no gain and a damping as small the loop is open, and the command is the force itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from vctune.model.device import Device
from vctune.model.experiment import Environment, Friction, MovingHand
from vctune.model.loop.filters import velocity_sections
from vctune.model.numbers.arithmetic import FLOATS
from vctune.model.parts import Actuator, Structure, VelocityEstimate
from vctune.simulation.compiled import (
    INPUT_NAMES,
    INTENDED,
    INTENDED_VELOCITY,
    NEXT_INTENDED,
    NEXT_INTENDED_VELOCITY,
    NOISE,
    SAMPLES_PER_CALL,
    build,
)
from vctune.simulation.controller import Law
from vctune.simulation.sample import columns
from vctune.simulation.scene import Scene, intended_motion

OPEN = 1e-9
"""K_v of an open loop, N s/m: what it takes from the motion is nothing."""
FREE = Environment(0.0, 0.0, 0.0, 0.0, False)


@dataclass(frozen=True)
class Log:
    """What was recorded: arrays by header, and the map that is not in the headers."""

    columns: dict[str, np.ndarray]
    toml: str

    def write(self, folder, name="log"):
        """Write NAME.csv and NAME.toml; return their paths."""
        header = ",".join(self.columns)
        rows = np.column_stack(list(self.columns.values()))
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
        (folder / f"{name}.toml").write_text(self.toml)
        return folder / f"{name}.csv", folder / f"{name}.toml"


def driven(device: Device, friction: Friction | None, excitation, *, gains=None, hand=None) -> dict[str, np.ndarray]:
    """Return what a device does under an excitation: a force in N, or with gains a velocity in m/s.

    Parameters
    ----------
    device, friction : what is identified
    excitation : shape (n,)
    gains : K_v and K_p of a closed loop; None for an open one
    hand : an `MovingHand`; None for nobody
    """
    K_v, K_p = gains or (OPEN, 0.0)
    damping = 1.0 if gains else OPEN
    estimate = device.velocity or VelocityEstimate()
    law = Law(
        sample_time=device.sample_time, velocity=K_v, position=K_p, integral=0.0, coupling=None,
        virtual_mass=0.0, virtual_damping=damping, environment=FREE, position_resolution=0.0,
        difference=estimate.source == "difference",
        velocity_filter=velocity_sections(device, FLOATS), force_filter=(), limit=None,
    )  # fmt: skip
    nobody = MovingHand("reciprocate", 0.0, 1.0, 1.0, 1, 0.0, 0.0, 0.0)
    scene = Scene(device, hand or nobody, friction, law, 1.0, 0)
    step = build(scene)
    chunk, state, blocks = step.chunk(), step.start, []
    for first in range(0, excitation.size, SAMPLES_PER_CALL):
        part = np.zeros((len(INPUT_NAMES), SAMPLES_PER_CALL))
        if hand is not None:
            motion = intended_motion(hand, device.sample_time, first, first + SAMPLES_PER_CALL)
            part[INTENDED], part[NEXT_INTENDED] = motion.position[:-1], motion.position[1:]
            part[INTENDED_VELOCITY], part[NEXT_INTENDED_VELOCITY] = motion.velocity[:-1], motion.velocity[1:]
        part[NOISE, : excitation[first : first + SAMPLES_PER_CALL].size] = excitation[first : first + SAMPLES_PER_CALL]
        states, records = chunk(state, part)
        state = np.asarray(states)[:, -1]
        blocks.append(np.asarray(records).T)
    recorded = np.vstack(blocks)[: excitation.size]
    return dict(zip(columns(scene.device), recorded.T, strict=True))


def multisine(random, lines, period, periods, sample_time):
    """Return a random-phase multisine of unit root mean square."""
    t = np.arange(period)
    phases = random.uniform(0, 2 * pi, len(lines))
    wave = sum(np.cos(2 * pi * k * t / period + p) for k, p in zip(lines, phases, strict=True))
    return np.tile(wave / np.sqrt(np.mean(wave**2)), periods)


def encoded(position, quantum):
    """Return positions as an encoder has them."""
    return quantum * np.floor(position / quantum + 0.5)


KINDS = ("multisine, open loop", "multisine, closed loop", "motion, open loop", "motion, closed loop")


@dataclass(frozen=True)
class Case:
    """A random device, how it was moved, and the log of it."""

    kind: str
    device: Device
    friction: Friction
    log: Log


def random_case(seed: int) -> Case:
    """Return a random device with encoder, LuGre friction, delay and filters, and a log of one kind after the other."""
    random, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    T = float(random.choice([2.5e-4, 5e-4, 1e-3]))
    mass = float(np.exp(random.uniform(np.log(0.05), np.log(2.0))))
    damping = mass * float(np.exp(random.uniform(np.log(1.0), np.log(20.0))))
    periodic = kind.startswith("multisine")
    velocity = VelocityEstimate("difference", float(random.uniform(0.1, 0.25)) / T, 1)
    actuator = Actuator(float(random.uniform(0.1, 0.4)) / T) if periodic else None
    structure = None
    if periodic and random.uniform() < 0.5:
        share, hertz = float(random.uniform(0.1, 0.5)), float(random.uniform(0.04, 0.1)) / T
        structure = Structure(share * mass, hertz, float(random.uniform(0.005, 0.05)))
    device = Device(
        mass, damping, T, float(random.uniform(0.1, 1.5)) * T, velocity=velocity, actuator=actuator, structure=structure
    )
    speed = 0.2
    coulomb = float(np.exp(random.uniform(np.log(0.05), np.log(0.5)))) * damping * speed
    friction = Friction(
        coulomb, coulomb * float(random.uniform(1.0, 1.3)), 0.005, 1e5 * mass, float(np.sqrt(1e5) * mass)
    )
    closed = "closed" in kind
    K_v = mass / (4 * (device.loop_lag + T + (1 / (2 * pi * actuator.bandwidth_hz) if actuator else 0)))
    if structure is not None:
        K_v *= 0.1
    gains = (K_v, 0.0) if closed else None
    if periodic:
        period = 1024
        top = int(0.25 * period)
        lines = np.unique(np.round(np.exp(np.linspace(np.log(8), np.log(top), 60)))).astype(int)
        wave = multisine(random, lines, period, 16, T)
        force = 0.5 * mass * 2 * pi * 8 / (period * T) * speed
    else:
        n = int(12.0 / T)
        white = np.fft.rfft(random.normal(size=n))
        f = np.fft.rfftfreq(n, T)
        wave = np.fft.irfft(white * (f > 0.3) / (1 + (f / 4.0) ** 2), n)
        wave /= wave.std()
        force = mass * 2 * pi * 2.0 * speed + damping * speed + 2 * coulomb
    amplitude = (
        (force + 3 * coulomb) / K_v
        if closed and periodic
        else speed
        if closed
        else force + (3 * coulomb if periodic else 0)
    )
    recorded = driven(device, friction, amplitude * wave, gains=gains)
    position = recorded.get("motor_position", recorded["position"])
    quantum = float(np.ptp(position)) * float(np.exp(random.uniform(np.log(1e-6), np.log(1e-5))))
    time = np.arange(position.size) * T
    toml = f'[device.velocity]\nfrom = "difference"\nfilter_hz = {velocity.filter_hz!r}\n'
    log = Log({"time_s": time, "position_m": encoded(position, quantum), "command_N": recorded["motor"]}, toml)
    return Case(kind, device, friction, log)


def spoiled(case: Case, seed: int) -> Log:
    """Return a log of a case as users have them: a force alone or a copy of the command, noise, a start that is cut."""
    random = np.random.default_rng(seed)
    columns = dict(case.log.columns)
    command = columns.pop("command_N")
    noise = float(random.choice([0.0, 1e-3, 3e-2, 0.3])) * command.std()
    noisy = command + noise * random.normal(size=command.size)
    role = seed // len(KINDS) % 3
    columns |= [{"command_N": noisy}, {"force_N": noisy}, {"command_N": command, "force_N": noisy}][role]
    first = int(random.integers(0, command.size // 4))
    columns = {header: values[first:] for header, values in columns.items()}
    return Log(columns, case.log.toml if random.uniform() < 0.5 else "")
