"""Step a loop that a hand pushes at one frequency: the mechanism by exponentials, the firmware by its laws.

It reads the same tables as a problem file and imports nothing of vctune.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from scipy.linalg import expm

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def _low_pass(table: dict[str, Any], A: np.ndarray, source: np.ndarray, at: int, rate: int) -> None:
    """Write y' = w (x - y), or y'' = w^2 (x - y) - sqrt(2) w y', into the rows of y and of y'/w."""
    w = 2 * pi * table["bandwidth_hz"]
    if table.get("order", 1) == 1:
        A[at, at], source[at] = -w, w
        return
    A[at, rate], A[rate, at], A[rate, rate], source[rate] = w, -w, -np.sqrt(2) * w, w


@dataclass
class Stepped:
    """A device whose hand pushes with e^(j omega t), in its steady state."""

    device: dict[str, Any]
    gains: tuple[float, float]
    coupling: tuple[float, ...]
    world: tuple[float, float, float]
    omega: float

    def mechanism(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return A, and what command and force of the hand push.

        The states are x_m, v_m, bend, v_h, actuator, sensor, and the rates of the last two or of a servo's velocity.
        """
        A, u, f = np.zeros((9, 9)), np.zeros(9), np.zeros(9)
        wide = "actuator" in self.device
        A[0, 1] = 1.0
        pushing = np.zeros(9)
        if wide:
            _low_pass(self.device["actuator"], A, u, 4, 6)
            pushing[4] = 1.0
        if "bandwidth_hz" in self.device.get("force_sensor", {}):
            _low_pass(self.device["force_sensor"], A, f, 5, 7)
        if "servo" in self.device:
            _low_pass(self.device["servo"], A, u, 1, 8)
            self.handle = 1
            return A, u, f
        m, b = self.device["mass"], self.device["damping"]
        if "structure" not in self.device:
            A[1] += pushing / m
            A[1, 1] -= b / m
            u[1], f[1], self.handle = (0.0 if wide else 1 / m), 1 / m, 1
            return A, u, f
        table, self.handle = self.device["structure"], 3
        m_2 = table["handle_mass"]
        m_1, w = m - m_2, 2 * pi * table["frequency_hz"]
        mu = m_1 * m_2 / m
        k, c = mu * w**2, 2 * table["damping_ratio"] * mu * w
        spring = np.array([0, c, k, -c, 0, 0, 0, 0, 0])  # pulls the motor back while the motor is ahead by the bend
        A[2, 1], A[2, 3] = 1.0, -1.0
        A[1] += (pushing - spring) / m_1
        A[1, 1] -= b / m_1
        A[3] += spring / m_2
        u[1], f[3] = (0.0 if wide else 1 / m_1), 1 / m_2
        return A, u, f

    def felt(self) -> complex:
        """Return force over velocity of the handle."""
        T = self.device["sample_time"]
        late = self.device.get("servo", self.device).get("delay", 0.0) / T
        whole, rest = int(late + 1e-9), late - int(late + 1e-9)
        A, u, f = self.mechanism()
        ago = self.device.get("force_sensor", {}).get("delay", 0.0)
        n, between = len(A), self.device.get("servo", {}).get("command") == "position"
        joined = np.zeros((n + 2, n + 2), complex)
        joined[:n, :n], joined[:n, n], joined[:n, n + 1], joined[n + 1, n + 1] = A, u, f, 1j * self.omega

        def over(time: float) -> np.ndarray:
            return expm(joined * time)

        def sample(memory: np.ndarray, force: complex) -> tuple[np.ndarray, complex]:
            """Return the memory a sample later, and the integral of v_h e^(-j omega t) over it."""
            x, firmware = memory[:n].copy(), memory[n : n + 40].copy()
            queue = memory[n + 40 :].copy()  # the last commands, the newest first
            slow = "bandwidth_hz" in self.device.get("force_sensor", {})
            read = (x[5] if slow else force) * np.exp(-1j * self.omega * ago)  # nothing but the hand moves the sensor
            at_handle = self.device.get("velocity", {}).get("at") == "handle"
            place, speed = (x[0] - x[2], x[3]) if at_handle else (x[0], x[1])
            command, firmware = self.firmware(place, speed, read, firmware)
            queue = np.concatenate(([command], queue[:-1]))
            held = (queue[:-1] - queue[1:]) / T if between else queue
            spans, total, at = ((0.0, rest, held[whole + 1]), (rest, 1.0, held[whole])), 0j, x
            for first, last, given in spans:
                begin = np.concatenate((at, [given, force * np.exp(1j * self.omega * first * T)]))
                for node, weight in zip(NODES, WEIGHTS, strict=True):
                    t = (last - first) * T * (node + 1) / 2
                    value = (over(t) @ begin)[self.handle]
                    total += weight * (last - first) / 2 * value * np.exp(-1j * self.omega * (first * T + t))
                at = (over((last - first) * T) @ begin)[:n]
            return np.concatenate((at, firmware, queue)), total

        size = n + 40 + whole + 4
        columns = [sample(unit, 0j) for unit in np.eye(size, dtype=complex)]
        step, sums = np.array([column for column, _ in columns]).T, np.array([total for _, total in columns])
        driven, own = sample(np.zeros(size, complex), 1.0 + 0j)
        state = np.linalg.lstsq(np.exp(1j * self.omega * T) * np.eye(size) - step, driven, rcond=None)[0]
        return 1 / complex(sums @ state + own)

    def filtered(self, table: str, value: complex, memory: np.ndarray) -> tuple[complex, np.ndarray]:
        """Run the firmware's filter of one table; memory has ten places."""
        stated, after = self.device.get(table, {}), memory.copy()
        a = stated.get("filter_coefficient", 1.0)
        if "filter_hz" in stated:
            a = 1 - np.exp(-2 * pi * stated["filter_hz"] * self.device["sample_time"])
        for k in range(stated.get("filter_order", 1)):
            value = after[k] = memory[k] + a * (value - memory[k])
        for k, (b0, b1, b2, _, a1, a2) in enumerate(stated.get("sections", ())):
            first, second = memory[2 + 2 * k : 4 + 2 * k]
            passed = b0 * value + first
            after[2 + 2 * k : 4 + 2 * k] = b1 * value - a1 * passed + second, b2 * value - a2 * passed
            value = passed
        return value, after

    def firmware(self, x: complex, v: complex, force: complex, memory: np.ndarray) -> tuple[complex, np.ndarray]:
        """Return the command. Memory: ten of the velocity's filter, ten of the force's, ten of v_t's, and numbers."""
        T, (M, B, K), after = self.device["sample_time"], self.world, memory.copy()
        before, x_e, v_e, f_m, f_c = memory[30:35]
        table, dual = self.device.get("velocity", {}), self.device.get("display") == "impedance"
        differenced = table.get("from", "difference" if dual else "measured") == "difference"
        estimate, after[:10] = self.filtered("velocity", (x - before) / T if differenced else v, memory[:10])
        after[30] = x
        K_v, K_p = self.gains
        free = (M, B, K) == (0.0, 0.0, 0.0)
        inertia, reach = 2 * M / T, T / 2
        if dual:
            b_c, k_c = self.coupling
            still, _ = self.filtered("velocity", 0.0, memory[20:30])
            once, _ = self.filtered("velocity", 1.0, memory[20:30])
            slope = once - still  # of the filter's answer to the new v_t
            if inf == K:
                new = 0.0
            elif free:
                new = None
            else:  # b_c (F v - F v_t) + k_c (x - x_t) is what the environment bears; x_t by the trapezoidal rule
                pulled = b_c * (estimate - still) + k_c * (x - x_e - reach * v_e)
                borne = K * (x_e + reach * v_e) - inertia * v_e - f_m
                new = (pulled - borne) / (b_c * slope + k_c * T + inertia + B + K * reach)
            if new is None:
                return -K_v * estimate, after
            _, after[20:30] = self.filtered("velocity", new, memory[20:30])
            after[31], after[32] = x_e + reach * v_e + reach * new, new
            after[33] = inertia * (new - v_e) - f_m
            asked = b_c * (estimate - still - slope * new) + k_c * (x - x_e - reach * v_e - T * new)
            return -asked - K_v * estimate, after
        heard, after[10:20] = self.filtered("force_sensor", force, memory[10:20])
        if "servo" in self.device:
            heard = heard - self.device["servo"].get("stiffness", 0.0) * x
        if len(self.coupling) == 2:  # M a + D v = F, with nothing behind
            M_0, D_0 = self.coupling
            after[32] = v_e + T * (heard - D_0 * v_e) / M_0
            after[31] = x_e + T * after[32]
            return after[31 if self.device["servo"].get("command") == "position" else 32], after
        b_c, m_c, b_0 = self.coupling
        new = 0.0
        if inf != K:  # force = f_c + b_0 v + f_m + B v + K x_e, f_c of m_c and b_c in series by the trapezoidal rule
            step, decay = 2 * m_c / T, 1.0
            if b_c < inf:
                tau = m_c / b_c
                step, decay = 2 * m_c / (T + 2 * tau), (T - 2 * tau) / (T + 2 * tau)
            pushed = heard + step * v_e + decay * f_c + inertia * v_e + f_m - K * (x_e + reach * v_e)
            new = pushed / (step + b_0 + inertia + B + K * reach)
            after[34] = step * (new - v_e) - decay * f_c
        led = x_e + reach * (v_e + new)
        after[31], after[32], after[33] = led, new, inertia * (new - v_e) - f_m
        if "servo" in self.device:
            return led if self.device["servo"].get("command") == "position" else new, after
        return K_v * (new - estimate) + K_p * (led - x), after
