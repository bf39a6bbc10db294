"""Write the head of every exported file: the problem, the design, the proved claims and their assumptions."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from vctune.design.records.claims import ENVIRONMENTS
from vctune.firmware.firmware import Firmware, certified
from vctune.model.device import Device
from vctune.model.numbers.units import Units, in_full
from vctune.model.parts import PARTS
from vctune.version import __version__

# Assumption on the environments of a design without a box of environments
PASSIVE_ENVIRONMENTS = "environments are passive as they run"


def statement(firmware: Firmware) -> list[str]:
    """Return the head of every file: a warning if the design is not certified, the problem, precision and digests, the
    proved claims, and the assumptions."""
    doubt = [] if certified(firmware) else [not_proved(firmware), ""]
    proved = (
        f"Proved: {firmware.record.promise}." if firmware.record.promise else "vctune proved nothing about this design."
    )
    single = "Proved again with the constants below, rounded to single precision, and with their sample time."
    return [
        *doubt,
        f"Controller of {firmware.name}, written by vctune {__version__}; {firmware.precision} precision.",
        f"problem sha256 {firmware.problem_sha256}",
        f"design sha256 {firmware.design_sha256}",
        "",
        proved,
        *([single] if certified(firmware) and firmware.precision == "single" else []),
        *assumptions(firmware),
    ]


def not_proved(firmware: Firmware) -> str:
    """Return the warning at the top of the files of a design that is not certified."""
    return f"NOT PROVED. {firmware.record.status}: {firmware.doubt}"


def assumptions(firmware: Firmware) -> list[str]:
    """Return the assumptions of the certificate, in words."""
    device, units = firmware.device, firmware.units
    box = ", and any other of the problem's [uncertainty]" if firmware.record.uncertainty is not None else ""
    certificate = firmware.record.certificate
    hands = None if certificate is None else certificate.hands
    rest = [] if firmware.record.rest is None else [" ".join(firmware.record.rest.sentences(units))]
    met = PASSIVE_ENVIRONMENTS
    if hands is not None and hands.worlds is not None:
        met = "environments are those of the box, by the trapezoidal rule"
    elif certificate is not None and any(claim.id == "alone" for claim in certificate.claims):
        met = "nothing is behind the coupling, f_e = 0"
    if certificate is not None and certificate.wall is not None:
        met = "the environment is rigid, so that the coupling is a wall that is always in contact"
    built = f"{_mechanics(device, units)}{box}; a step every {device.sample_time!r} s"
    if device.servo is not None:
        return [
            f"Assumed: {built}; the {units.force_name} is sampled just before a command is given; {met}. "
            "The proof does not cover a limited speed or acceleration, a lost or late command, "
            "and the rounding of each operation.",
            *rest,
        ]
    sampled = "" if firmware.controller.spring else f"; the {units.force_name} is sampled just before"
    return [
        f"Assumed: {built}; the command acts {device.delay!r} s after the "
        f"sample and is held{sampled}; {met}. The "
        f"proof does not cover static friction, a limited {units.force_name}, quantisation and the rounding of each "
        "operation.",
        *rest,
    ]


def rendered(firmware: Firmware) -> dict[str, str]:
    """Return which environments the proved claims cover, and what of the built-in ones by either rule, in words."""
    certificate, units = firmware.record.certificate, firmware.units
    mass = units.mass_name
    if certificate is None or not certified(firmware):
        return dict.fromkeys(("covered", "backward", "trapezoidal"), "No environment is proved.")
    if certificate.wall is not None:
        covered = (
            "The certificate holds with an environment that returns v_e = 0 alone: the coupling is then a wall, always "
            "in contact."
        )
        return {"covered": covered, "backward": "Not proved.", "trapezoidal": "Not proved."}
    hands = certificate.hands
    if hands is None and any(claim.id == "alone" for claim in certificate.claims):
        return {"covered": "The certificate holds with nothing behind, f_e = 0, alone."} | dict.fromkeys(
            ("backward", "trapezoidal"), "Not proved."
        )
    if hands is None or hands.worlds is None:
        stepped = f"{units.translated('a mass')} that is stepped explicitly is not"
        return {
            "covered": f"The certificate holds {ENVIRONMENTS}: {stepped}.",
            "backward": "It stays passive however stiff it is, also as a wall.",
            "trapezoidal": "It is passive; a wall by this rule is not.",
        }
    covered = f"The certificate holds {hands.environments(units)}, stepped by the trapezoidal rule, and with no other."
    least_of = {name: low or 0.0 for name, (low, _) in hands.worlds.items()}
    # a built-in wall is nothing when it is not touched, and only pushes
    walls = hands.walls is not None and least_of["stiffness"] == least_of["damping"] == 0
    wall = f" but for a wall without {mass} and damping" if walls and least_of["mass"] == 0 else ""
    low, high = hands.worlds["mass"]
    most = "" if high is None else f" and at most {in_full(high)} {units.mass}"
    as_wall = "also as a wall without damping" if walls else "not as a wall"
    least = f"a {mass} of at least {in_full(low or 0.0)} {units.mass}{most}"
    return {
        "covered": covered,
        "backward": f"Not proved{wall}: by this rule {mass} and spring are other environments.",
        "trapezoidal": f"Proved within the box: {least}; {as_wall}.",
    }


def _mechanics(device: Device, units: Units) -> str:
    """Describe a device in words: mass and damping, or the response of a servo, and the parts."""
    servo = device.servo
    listed = ", ".join(
        f"{units.translated(part.stated)} ({_numbers(getattr(device, key))})"
        for key, part in PARTS.items()
        if key != "servo" and getattr(device, key) is not None
    )
    if servo is None:
        mass_and_damping = f"{device.mass!r} {units.mass} and {device.damping!r} {units.damping}"
        return f"a linear device of {mass_and_damping} with {listed or 'ideal parts'}"
    if device.divided:
        late = f"{device.stated_delay!r} s late by a delay and a low-pass of order {servo.order} in any division"
    else:
        late = f"{servo.delay!r} s late through a low-pass of order {servo.order} and {servo.bandwidth_hz!r} Hz"
    between_samples = "held over a sample" if servo.command == "velocity" else "interpolated linearly over a sample"
    return (
        f"a servo that follows the commanded {servo.command}, {between_samples}, {late}, and that the hand cannot "
        f"push, with {listed or f'an ideal {units.force_name} sensor'}"
    )


def _numbers(part: Any) -> str:
    stated = ((name, number) for name, number in asdict(part).items() if number not in (None, "motor"))
    return ", ".join(f"{name} {number}" for name, number in stated)
