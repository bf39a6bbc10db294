"""Study the log of a mechanism: the device, its intervals, and why a log is refused (README, section 4)."""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, inf, pi, sin, sqrt

import numpy as np

from vctune.document.recording import Recording
from vctune.document.records.identification_json import Estimate, NumberRecord
from vctune.document.text.errors import Note, coded
from vctune.identification.box import COULOMB_SHARE, COULOMB_SHARE_MOVING, box, left_to_the_hand, unexplained
from vctune.identification.checks import position_noise
from vctune.identification.fit import SEGMENTS, Fit, Task, fitted, noise_is_all
from vctune.identification.limits import force_limit_of
from vctune.identification.remainder import halves, motion_of, root_mean_square_speed, share_left, spectrum
from vctune.identification.search import (
    LONGEST,
    SIGNIFICANT,
    WHITE,
    Found,
    in_segments,
    mechanism_fit,
    starts_of,
    task_of,
)
from vctune.identification.stepped import Drive, Numbers, linear, response
from vctune.identification.study import KEYS, Lines, Study, number, record_of

MAX_SHARE = 0.25  # Of the motion that is left, above which a log is refused
AGAINST = 0.5  # Share of the force left by a regression below which a negative mass is a sign
SHORTEST_MOTOR = 0.1  # Shortest lag of a motor that a measured force tells, in rows
FELT = 0.02  # Share of the force from which a spring is felt
MASSES = {False: (1e-4, 5e3), True: (1e-8, 5e3)}  # Masses of haptic devices, kg, or kg m2 if rotary
# What limits the damping where more than noise is left of the motion, and where nothing tells another friction
FRICTION = coded("friction is not quite Coulomb's", "limit-friction")
DRY = coded("taken together with dry friction", "limit-friction")


def mechanism_study(recording: Recording, T: float, fixed: Numbers, *, held: bool) -> Study:
    """Study the log of a mechanism. If `held`, a spring may pull, which stays outside the device as a hand does."""
    has = recording.channels
    motor = motor_lag(recording, T) if {"command", "force"} <= set(has) and "lag" not in fixed else []
    if motor:
        fixed = {**fixed, "lag": 1 / (2 * pi * motor[0].value)}
    task = task_of(recording, T, fixed)
    if not np.ptp(task.drive.input) > 0:
        task = replace(task, fixed={"delay": 0.0} | dict(task.fixed))
    found = mechanism_fit(task, recording.rotary)
    fit, share = found.fit, found.share
    if fit.size > WHITE and np.ptp(task.drive.input) > 0 and (limit := force_limit_of(fit)) is not None:
        message = (
            f"the {recording.units.force_name} saturates, at about {limit:.2g} {recording.units.force}: the motion is "
            "that of a command that is cut there; use smaller commands, or log the measured one as force"
        )
        raise unexplained(recording, message, has["command" if "command" in has else "force"].header)
    refuse_unexplained(recording, fit, share)
    if not found.agree and fit.size > WHITE and fit.numbers.get("delay", 0.0) > -T:  # which is refused as such
        message = (
            f"two searches end at different devices, and {share:.1%} of the motion is left: record longer, or move more"
        )
        raise unexplained(recording, message, has["position" if "position" in has else "velocity"].header)
    remarks, numbers, sigma = list[Note](), fit.numbers, fit.sigmas()
    if (stiffness := pull_of(fit)) is not None:
        remarks.append(left_to_the_hand(recording, stiffness, numbers["mass"], held=held))
    lines = [lines_of(fit)] if not noise_is_all(fit) else []
    hand, coulomb = recording.values("hand"), numbers.get("coulomb", 0.0)
    curves = motion_of(fit)
    record = record_of(
        recording, T, kind=kind_of(fit), used=curves.time.size, residual_share=share, chi2=fit.size**2,
        numbers=[number(name, value, sigma[name]) for name, value in numbers.items()],
        derived=derived(fit, recording),
    )  # fmt: skip
    return Study(
        recording, record,
        [*estimates_of(recording.name, found), *motor],
        lines=lines,
        curves=curves,
        remarks=remarks,
        friction=coulomb if coulomb > SIGNIFICANT * sigma.get("coulomb", 0.0) > 0 else None,
        force_noise=None if hand is None else float(1.4826 * np.median(np.abs(np.diff(hand, 3))) / sqrt(20)),
    )  # fmt: skip


def motor_lag(recording: Recording, T: float) -> list[Estimate]:
    """Return the bandwidth of the motor, from its command to its measured force; none if the two tell no lag.

    The lag is as uncertain as the share of the force that it leaves, because no motor is quite of first order.
    """
    told, force = recording.channels["command"].values[:LONGEST], recording.channels["force"].values[:LONGEST]
    unit = np.array([position_noise(recording.channels["force"])])
    task = Task(Drive(T, told, servo=1, reads=(1,)), force[:, None] / unit, unit, np.arange(1), 1)
    task = in_segments(task, (inf, 1 / SEGMENTS), SEGMENTS)
    starts = ({"gain": 1.0, "delay": rows * T, "lag": T / 2} for rows in (-1.0, 0.0, 1.0))
    fit = min((fitted(task, start) for start in starts), key=lambda each: each.cost)
    lag, sigma, share = fit.numbers["lag"], fit.sigmas()["lag"], share_left(fit)
    if not (share < MAX_SHARE and lag > SHORTEST_MOTOR * T and SIGNIFICANT * sigma < lag):
        return []
    hertz = 1 / (2 * pi * lag)
    text = f"{recording.name}: force"
    return [Estimate("actuator.bandwidth_hz", hertz, hertz * sigma / lag, text, (share * hertz, share * hertz))]


def kind_of(fit: Fit) -> str:
    """Return in words what was fitted."""
    numbers = fit.known
    parts = ["two masses" if "handle_mass" in numbers else "one mass"]
    named = {
        "coulomb": "dry friction",
        "stiffness": "a spring",
        "sine": "gravity that turns",
        "lag": "an actuator's lag",
    }
    return ", ".join([*parts, *(text for name, text in named.items() if name in numbers)])


def pull_of(fit: Fit) -> float | None:
    """Return the stiffness, at the mean position, of what pulls with the position; None if nothing is felt of it."""
    numbers, sigma, place = fit.numbers, fit.sigmas(), fit.task.read[:, 0] * fit.task.unit[0]
    at = float(np.mean(place))
    terms = {"stiffness": (place, 1.0), "sine": (np.sin(place), cos(at)), "cosine": (np.cos(place), -sin(at))}
    pulls = {name: term for name, term in terms.items() if name in numbers}
    stiffness = sum(numbers[name] * slope for name, (_, slope) in pulls.items())
    unsure = hypot(*(sigma[name] * slope for name, (_, slope) in pulls.items()))
    force = float(np.std(sum(numbers[name] * value for name, (value, _) in pulls.items())))
    pushed = sum(float(np.std(each)) for each in (fit.task.drive.input, fit.task.drive.hand) if each is not None)
    return stiffness if force > FELT * pushed and abs(stiffness) > SIGNIFICANT * unsure else None


def estimates_of(source: str, found: Found) -> list[Estimate]:
    """Return the estimates of the parameters that a problem file states.

    Each reaches as far as halves of the log differ, or fits with other weights or beside a lag do; the damping further
    where a part of the dry friction may pass for it.
    """
    fit, estimates = found.fit, list[Estimate]()
    numbers, sigma, apart = fit.numbers, fit.sigmas(), halves(fit)
    share = COULOMB_SHARE_MOVING if found.moving else COULOMB_SHARE
    rubbing = share * numbers.get("coulomb", 0.0) / (root_mean_square_speed(fit) + 1e-300)
    for name in (name for name in KEYS if name in numbers):
        value, unsure = numbers[name], sigma[name]
        excess = max(0.0, max(apart[name], *(abs(value - each[name]) for each in found.others)) - 2 * unsure)
        one = Estimate(KEYS[name], value, unsure, f"{source}: motion", (excess, excess))
        if name.startswith("damping") and name != "damping_ratio" and rubbing > excess:
            one = replace(one, excess=(rubbing, rubbing), reason=DRY if noise_is_all(fit) else FRICTION)
        elif name == "lag":
            hertz = 1 / (2 * pi * value)
            ends = (hertz - 1 / (2 * pi * (value + excess)), excess / value * hertz)
            one = replace(one, value=hertz, sigma=hertz * unsure / value, excess=ends)
        estimates.append(one)
    return estimates


def lines_of(fit: Fit) -> Lines:
    """Return the measured response where the log shows it, without the effects of friction and springs."""
    hertz, ratio, spread = spectrum(fit)
    drive, numbers = fit.task.drive, fit.known | {"stiffness": 0.0}
    fitted_response = response(drive, numbers, hertz)
    free = 1 + fit.numbers.get("stiffness", 0.0) * fitted_response
    behind = None
    if drive.ramp and "delay" in fit.numbers:
        behind = box([Estimate("delay", fit.numbers["delay"], fit.sigmas()["delay"], "")], drive.T)[0]
    return Lines(hertz, fitted_response * (1 + (ratio - 1) * free), spread, fitted_response, drive, behind)


def refuse_unexplained(recording: Recording, fit: Fit, share: float) -> None:
    """Refuse a log if no mass and friction explain its motion, or if only an impossible mass explains it."""
    mass, units, task = fit.numbers["mass"], recording.units, fit.task
    headers = {role: channel.header for role, channel in recording.channels.items()}
    pushed = headers.get("command", headers.get("force", headers.get("hand", "")))
    place = headers.get("position", headers.get("velocity", ""))
    least, most = MASSES[recording.rotary]
    if share > MAX_SHARE:
        best, turned = starts_of(task)[0], replace(
            task, drive=replace(task.drive, input=task.read[:, 0] * task.unit[0], reads=(0,)),
            read=task.drive.input[:, None], unit=np.ones(1),
        )  # fmt: skip
        may_be_turned = task.drive.hand is None and task.drive.reads[0] == 0
        if may_be_turned and starts_of(turned)[0].share < 0.3 * best.share:
            text = f"{share:.0%} of the motion of {place} follows no {units.mass_name} and friction"
            message = f"{text}, and {pushed} would follow it: are the two columns swapped?"
        elif best.numbers["mass"] < 0 and best.share < AGAINST:
            text = f"the {units.mass_name} comes out as {best.numbers['mass']:.3g} {units.mass}"
            message = f"{text}: {pushed} pushes against the motion; turn one sign by scale = -1"
        else:
            hint = f"is {units.translated('a force')} missing (a hand's), or is one of another axis or of another time?"
            text = f"{share:.0%} of the motion of {place} is explained by no {units.mass_name} and friction"
            message = f"{text} that {pushed} moves; {hint}"
    elif not least <= mass <= most:
        question = f"is {place} or {pushed} off by 1000? write its unit or scale"
        text = f"the {units.mass_name} comes out as {mass:.3g} {units.mass}, which is no haptic device"
        message = f"{text}: {question}"
    else:
        return
    raise unexplained(recording, message, pushed)


def derived(fit: Fit, recording: Recording) -> list[NumberRecord]:
    """Return the quantities that describe a structure, such as both masses, the stiffness and the antiresonance."""
    numbers = fit.known
    if "handle_mass" not in numbers:
        return []
    A, _, motor = linear(fit.task.drive, numbers)
    handle = numbers["handle_mass"]
    found = {
        "motor mass": motor,
        "handle mass": handle,
        "stiffness of the spring": A[3, 0] * handle,
        "antiresonance, Hz": sqrt(A[3, 0]) / (2 * pi),
        "resonance, Hz": numbers["frequency_hz"],
        f"damping between them, {recording.units.damping}": A[3, 1] * handle,
    }
    return [number(name, value) for name, value in found.items()]
