"""The sampled device as the firmware meets it: read the sensors, give a command, wait a sample; not from vctune."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from arithmetic import DIGITS, Arithmetic
from device_oracle import Gains, Real
from sampled_device_oracle import LET_GO, Hand, exact, held, matrix_of, order, plant, split


@dataclass(frozen=True)
class Device:
    """The device in a hand, sampled; its memory is one vector.

    (plant states; the last commands N, newest first; motion during the last sample m; velocity filters m/s;
    forces waiting in the sensor N, newest first). The sensor is left out when only the motion matters.
    """

    real: Real
    hand: Hand = LET_GO
    num: Arithmetic = DIGITS
    sensor: bool = True

    @property
    def parts(self) -> list[int]:
        """How many numbers each part of the memory has."""
        states = (2 if self.real.structure is None else 4) + order(self.real.actuator)
        states += order(self.real.force_sensor) if self.sensor else 0
        commands = self._late(self.real.delay)[0] + 1
        moved = int(self.real.velocity.source == "difference")
        filters = self.real.velocity.filter_order if self.real.velocity.filter_hz is not None else 0
        forces = self._late(self.real.force_sensor.delay)[0] + 1 if self.sensor else 0
        return [states, commands, moved, filters, forces]

    @property
    def size(self) -> int:
        """The length of the memory."""
        return sum(self.parts)

    def position(self, memory: np.ndarray) -> Any:
        """Return the sampled motor position (m)."""
        return memory[0]

    def velocity(self, memory: np.ndarray) -> Any:
        """Return the velocity estimate (m/s)."""
        return self._estimates(memory)[-1]

    def force(self, memory: np.ndarray) -> Any:
        """Return the sensed force (N), as it was just before the command of now acts."""
        return memory[-1]

    def wait(self, memory: np.ndarray, command: Any) -> np.ndarray:
        """Return the memory one sample later: the command (N) starts to act `delay` from now."""
        state, commands, _, _, forces = self._unpack(memory)
        T = exact(self.real.sample_time)
        rest = self._late(self.real.delay)[1]
        commands = [command, *commands]
        new, old = commands[-2], commands[-1]
        switched = self._held(state, old, rest)
        after = self._held(switched, new, T - rest)
        moved = [after[0] - state[0]] if self.real.velocity.source == "difference" else []
        if self.sensor:
            instant = T - self._late(self.real.force_sensor.delay)[1]
            body = plant(self.real, self.hand, self.num)
            if instant <= rest:
                felt = body.force @ self._held(state, old, instant) + body.feed * old
            else:
                felt = body.force @ self._held(switched, new, instant - rest) + body.feed * new
            forces = [felt, *forces[:-1]]
        return np.array([*after, *commands[:-1], *moved, *self._estimates(memory)[1:], *forces], dtype=memory.dtype)

    def _late(self, delay: float) -> tuple[int, Any]:
        return split(exact(delay), exact(self.real.sample_time))

    def _held(self, state: np.ndarray, command: Any, time: Any) -> np.ndarray:
        Phi, Gamma = held(self.real, self.hand, time, self.num, self.sensor)
        return Phi @ state + Gamma * command

    def _unpack(self, memory: np.ndarray) -> list[Any]:
        ends = np.cumsum(self.parts)[:-1]
        state, *registers = np.split(memory, ends)
        return [state, *(list(register) for register in registers)]

    def _estimates(self, memory: np.ndarray) -> list[Any]:
        """Return the raw velocity and what each one-pole y += a (x - y) makes of it (m/s)."""
        _, _, moved, filters, _ = self._unpack(memory)
        T = self.num.number(self.real.sample_time)
        values = [moved[0] / T if moved else memory[1]]
        if filters:
            pole = self.num.exp(-2 * self.num.pi * self.num.number(self.real.velocity.filter_hz) * T).real
            for last in filters:
                values.append(pole * last + (1 - pole) * values[-1])
        return values


def loop_matrix(real: Real, gains: Gains, hand: Hand = LET_GO, num: Arithmetic = DIGITS) -> np.ndarray:
    """Return the matrix of the loop with the environment at rest: u = -(K_v v_hat + K_p x).

    Where nothing depends on the position (K_p = 0 and no spring in the hand) the position is left out.
    """
    device = Device(real, hand, num, sensor=False)
    K_v, K_p = num.number(gains.velocity), num.number(gains.position)

    def step(memory: np.ndarray) -> np.ndarray:
        return device.wait(memory, -(K_v * device.velocity(memory) + K_p * device.position(memory)))

    matrix = matrix_of(step, device.size, num)
    return matrix[1:, 1:] if gains.position == 0 and hand.stiffness == 0 else matrix


def spectral_radius(real: Real, gains: Gains, hand: Hand = LET_GO, num: Arithmetic = DIGITS) -> Any:
    """Return the largest |eigenvalue| of the loop with the environment at rest, u = -(K_v v_hat + K_p x).

    Parameters
    ----------
    real, gains
        The device and K_v in N s/m, K_p in N/m. The force sensor is not in this loop.
    hand
        The hand that holds it (kg, N s/m, N/m); let go unless told.
    num
        DIGITS or DOUBLES.

    Returns
    -------
    real number
        Dimensionless, per sample; below 1 is stable.
    """
    return max(abs(value) for value in num.eigenvalues(loop_matrix(real, gains, hand, num)))
