"""Compute the exact limits of R and Re Z_c at the ends of the frequency axis.

See model/README.md, sections 6, 9 and 12.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from vctune.model.device import Device
from vctune.model.gains import Coupling, Gains
from vctune.model.loop.device_response import device_response
from vctune.model.numbers.arithmetic import FLOATS, Arithmetic, Number


@dataclass(frozen=True, slots=True)
class EndLimit:
    """Re Z_c and R at an end of the frequency axis. If both vanish, both are divided by the same positive power of
    omega.

    Attributes
    ----------
    coupling : the limit of Re Z_c. If `required` is inf, only one of the two limits may be divided by a power of omega
    required : the limit of R; inf if no coupling suffices
    """

    coupling: Number
    required: Number


@dataclass(frozen=True, slots=True)
class Lags:
    """The lags of a device's parts for omega -> 0, and the loss and the compliance of the device's spring.

    Attributes
    ----------
    drive : tau, the lag of hold, delay and actuator; for a servo of hold, delay, low-pass and interpolation, s
    estimate, sensor : lags of the velocity estimate and of the force sensor, s. The sensor's lag contains its delay,
        but not the lag of a servo's firmware filter
    loss : c/k^2 of the spring, m s/N
    compliance : 1/k of the spring, m/N
    """

    drive: Number
    estimate: Number
    sensor: Number
    loss: Number
    compliance: Number


def lags(device: Device, ops: Arithmetic) -> Lags:
    """Return the lags of a device's parts for omega -> 0 (model/README.md, section 12).

    A low-pass of order 1 lags by 1/w, a low-pass of order 2 by sqrt(2)/w, a low-pass of the firmware by T (1 - a)/a,
    and a difference or an interpolation by T/2.

    Parameters
    ----------
    device : device in SI units
    ops : arithmetic of the device's parameters

    Returns
    -------
    Lags
        The lag of a part that the device lacks is 0.
    """
    at = device_response(device, 0 * device.sample_time, ops)
    spring = at.spring
    return Lags(
        drive=at.drive.lag,
        estimate=0 if at.estimate is None else at.estimate.lag,
        sensor=0 if at.sensor is None else at.sensor.lag,
        loss=0 if spring is None else spring.y_c,
        compliance=0 if spring is None else spring.y_k,
    )


def low_frequency_limit(device: Device, gains: Gains, coupling: Coupling, ops: Arithmetic = FLOATS) -> EndLimit:
    """Return the limits of Re Z_c and R for omega -> 0, for an admittance display with any hold.

    See model/README.md, sections 6, 9 and 12. With K_p > 0, Re Z_c -> b_0 and R -> (b + tau_s K_p)^2/(4 (b + k)) with k
    = K_v - tau K_p + K_p^2 c/k_s^2. In this limit, tau is the drive's lag, tau_s the force sensor's lag, and k_s and c
    belong to the spring between motor and handle. With K_p = 0, R vanishes like omega^2, and without drag so does Re
    Z_c. The ratio then tends to (m_c^2/b_c) 4 (b + K_v)^2/(K_v M^2), M = m + b tau - K_v tau_F + (b + K_v) tau_s with
    the velocity estimate's lag tau_F. With K_p > 0 and b = tau_s = 0, R vanishes like omega^4. In the hand of an
    operator with damping b_h,

        R -> ((b + tau_s K_p)^2 - 4 b_h Re(C conj N))/(4 (b + k + b_h n^2)),   n = 1 + K_p/k_s,

    and R -> -b_h K_v/(b + b_h + K_v) with K_p = 0.

    Parameters
    ----------
    device : admittance display in SI units
    gains : K_v and K_p, N s/m and N/m
    coupling : b_c, m_c and b_0 of an admittance display
    ops : arithmetic of these numbers; it must be able to compare them with 0

    Returns
    -------
    EndLimit
        In N s/m, or in N s^3/m where both limits are divided by omega^2. R is inf if the loop's resistance is not
        positive.
    """
    at, b = lags(device, ops), device.damping
    mass = device.mass
    K_v, K_p, b_0 = gains.velocity, gains.position, coupling.drag
    integral = not _is_zero(K_p)
    told = K_v - at.drive * K_p if integral else K_v
    n = 1 + K_p * at.compliance
    operator = device.operator.damping if device.operator is not None else 0
    resistance = b + told + K_p * K_p * at.loss + operator * (n * n)
    coupling_limit = coupling.mass * coupling.mass / coupling.damping if _is_zero(b_0) else b_0
    if resistance < 0 or _is_zero(resistance):
        return EndLimit(coupling_limit, inf)
    late = b + at.sensor * K_p if integral else b
    if not _is_zero(operator):
        # Re(C conj N) of C -> told - tau_s K_p - j K_p/omega and N -> n + j omega n'
        slope = at.loss * -K_p + at.compliance * (b + told)
        met = (told - at.sensor * K_p) * n - K_p * slope if integral else K_v
        return EndLimit(b_0, ((late * late if integral else 0) - 4 * operator * met) / (4 * resistance))
    if integral:
        return EndLimit(coupling_limit, 0) if _is_zero(late) else EndLimit(b_0, late * late / (4 * resistance))
    inertia = mass + b * at.drive - K_v * at.estimate + at.sensor * (b + K_v)
    return EndLimit(coupling_limit, K_v * inertia * inertia / (4 * resistance * resistance) if _is_zero(b_0) else 0)


def high_frequency_limit(device: Device, gains: Gains, coupling: Coupling) -> EndLimit:
    """Return the limits for omega -> inf, for an ideal device with hold "lag" and no delay.

    See model/README.md, sections 6 and 9. R -> 2 m K_v/((b + b_h) T), Re Z_c -> b_c + b_0. A coupling without mass and
    a rigid coupling have Re Z_c = b_0 at every frequency.

    Parameters
    ----------
    device : ideal device in SI units; b_h is the damping of its least operator, 0 without one
    gains : gains of the loop; the function uses only K_v, N s/m
    coupling : b_c, m_c and b_0 of an admittance display

    Returns
    -------
    EndLimit
        In N s/m. R is inf if neither device nor operator has damping.
    """
    needed = 2 * device.mass * gains.velocity / device.sample_time
    damping = device.damping if device.operator is None else device.damping + device.operator.damping
    required = needed / damping if not _is_zero(damping) else inf
    of_branch = 0 if coupling.rigid or _is_zero(coupling.mass) else coupling.damping
    return EndLimit(of_branch + coupling.drag, required)


def _is_zero(x: Number) -> bool:
    return bool(x == 0)
