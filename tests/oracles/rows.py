"""What each row of a design says: where its number stands in the record, its unit, and when a sentence is said."""

from __future__ import annotations

import re
from math import isclose

from vctune.design.records.design import design_of

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]|\|)")
UNITS = {
    "linear": {"mass": "kg", "damping": "N s/m", "stiffness": "N/m", "force": "N", "speed": "m/s", "position": "m"},
    "rotary": {
        "mass": "kg m2", "damping": "N m s/rad", "stiffness": "N m/rad", "force": "N m", "speed": "rad/s",
        "position": "rad",
    },
}  # fmt: skip


def at(record, path):
    """Return what a record holds at a path, None if a part of it is missing."""
    for name in path.split("."):
        record = None if record is None else record.get(name)
    return record


SHOWN = {
    ("gains", "velocity K_v"): ("gains.velocity", "damping"),
    ("gains", "position K_p"): ("gains.position", "stiffness"),
    ("coupling", "damping b_c"): ("coupling.damping", "damping"),
    ("coupling", "mass m_c"): ("coupling.mass", "mass"),
    ("coupling", "inertia m_c"): ("coupling.mass", "mass"),
    ("coupling", "drag b_0"): ("coupling.drag", "damping"),
    ("coupling", "stiffness k_c"): ("coupling.stiffness", "stiffness"),
    ("transparency", "error"): ("transparency.error", ""),
    ("transparency", "|Z_0 G_hh|"): ("transparency.admittance", ""),
    ("transparency", "|1 - G_he|"): ("transparency.tracking", ""),
    ("transparency", "|Z_c|/Z_0"): ("transparency.coupling", ""),
    ("transparency", "|1/G_hh|/Z_0"): ("transparency.admittance", ""),
    ("transparency", "|1 - A H/N|"): ("transparency.tracking", ""),
    ("transparency", "Z_0 |1/Z_c|"): ("transparency.coupling", ""),
    ("in the hand", "count of the encoder"): ("felt.count", "force"),
    ("in the hand", "stiffest wall felt"): ("felt.felt_wall_10hz", "stiffness"),
    ("in the hand", "1 N from rest"): ("felt.first_speed", "speed"),
    ("in the hand", "1 N m from rest"): ("felt.first_speed", "speed"),
    ("in the hand", "noise at the command"): ("felt.noise_speed", "speed"),
    ("ringing", "damping ratio"): ("ringing.damping_ratio", ""),
    ("ringing", "rings for"): ("ringing.time_constant_s", "s to 1/e"),
    ("certificate", "least Re Z_c / R"): (("certificate.hands.min_ratio", "certificate.min_ratio"), ""),
    ("certificate", "least Re 1/Z_c / R"): (("certificate.any_hand.min_ratio", "certificate.hands.min_ratio"), ""),
    ("certificate", "Z_c over its limit"): (("certificate.hands.min_ratio", "certificate.min_ratio"), ""),
    ("certificate", "least with walls"): ("certificate.hands.walls.min_ratio", ""),
    ("certificate", "unstable at"): ("certificate.wall.min_ratio", "times the wall"),
    ("certificate", "peak |S|"): ("certificate.wall.peak_sensitivity", ""),
    ("certificate", "phase margin"): ("certificate.wall.phase_margin_deg", "deg"),
    ("velocity loop", "spectral radius"): ("inner_loop.spectral_radius", ""),
    ("velocity loop", "peak |S|"): ("inner_loop.peak_sensitivity", ""),
    ("velocity loop", "gain margin"): ("inner_loop.gain_margin_db", "dB"),
    ("velocity loop", "phase margin"): ("inner_loop.phase_margin_deg", "deg"),
    ("velocity loop", "delay margin"): ("inner_loop.delay_margin_s", "s"),
    ("velocity loop", "unstable poles"): ("inner_loop.nyquist.Z", ""),
    ("contact", "latency L"): ("contact.latency_s", "ms"),
    ("contact", "least drag at rest"): ("contact.rest_drag", "damping"),
    ("contact", "least drag without b_c"): ("contact.drag_alone", "damping"),
    ("contact", "stiffest contact"): ("contact.stiffest_contact", "stiffness"),
    ("uncertainty", "worst error"): ("uncertainty.worst_error", ""),
}  # fmt: skip
"""Rows of one number: where it stands in the record, and its quantity or unit. Of two places, either."""
VERDICTS = {
    "verdict": "certificate.verdict", "every hand": "certificate.hands.verdict", "wall": "certificate.wall.verdict",
    "any passive hand": "certificate.any_hand.verdict", "every wall": "certificate.hands.walls.verdict",
}  # fmt: skip


def numbers_of(part):
    """Yield every number of a part of a record."""
    if isinstance(part, dict):
        part = [*part.values()]
    if isinstance(part, list):
        for each in part:
            yield from numbers_of(each)
    elif isinstance(part, int | float) and not isinstance(part, bool):
        yield float(part)
    elif isinstance(part, str):
        yield from map(float, NUMBER.findall(part))


def printed(text, value):
    """Return whether a text is a number as it is printed, to its last digit."""
    digits = len(re.sub(r"e.*|^[-0.]+|\.|(?<=[1-9])0+$", "", text)) or 1
    return isclose(float(text), value, rel_tol=1.01 * 10.0 ** (1 - digits), abs_tol=1e-300)


def said(record):
    """Return what is proved and all rows of a record as one text."""
    found = design_of(record, "x")
    rows = [row for group in found.groups().values() for row in group]
    return "\n".join([found.promise, *(f"{row.label}: {row.value} {row.unit}" for row in rows)])


def of_parts(record):
    """Yield numbers of rows that consist of several, each with what it is of the record."""
    text = said(record)
    for value, parts in re.findall(r"latency L: (\S+) ms = (.*)", text):
        yield sum(float(part.rpartition(" ")[2]) for part in parts.split(" + ")), float(value)
    for step, force in re.findall(r"rests: \w+ where it stops: \S+ q = (\S+) .* twice the friction, (\S+) ", text):
        yield float(step), at(record, "rest.step_N")
        yield float(force), 2 * at(record, "rest.friction_N")
    for mass, unit in re.findall(r"binding world: (\S+) (kg m2|kg|g) ", text):
        yield float(mass) * (1e-3 if unit == "g" else 1.0), at(record, "certificate.hands.worst_world.mass")
    for mass, unit in re.findall(r"feels like: (\S+) (kg m2|kg|g) ", text):
        yield float(mass) * (1e-3 if unit == "g" else 1.0), at(record, "felt.mass_1hz")


def hands_less(record):
    """Whether the drag that rest requires is less than K L, with the safety factor, and no spring of its own."""
    drag, factor, stiffness, late = (
        at(record, f"contact.{name}") for name in ("rest_drag", "safety_factor", "stiffness", "latency_s")
    )
    return drag is not None and drag < (factor * stiffness * late + at(record, "contact.own_spring")) * (1 - 1e-6)


def world_is(name):
    """Return a condition on the binding environment."""

    def holds(record):
        world = at(record, "certificate.hands.worst_world")
        if world is None:
            return False
        kinds = {(True, True): "both", (True, False): "mass", (False, True): "spring", (False, False): "nothing"}
        return kinds[bool(world["mass"]), bool(world["stiffness"])] == name

    return holds


FORMS = {
    r"absolutely stable in": lambda r: r["status"] == "certified" and at(r, "certificate.band_hz") is not None
    and not any(claim["id"] == "alone" for claim in r["certificate"]["claims"]),
    r"stable in every hand of": lambda r: (r["status"] == "certified" and at(r, "certificate.hands") is not None)
    or (r["status"] == "certified" and at(r, "certificate.wall.box") is not None),
    r"^position K_p:": lambda r: at(r, "transparency.display") is None,
    r"^velocity K_v:": lambda r: at(r, "transparency.display") != "servo",
    r"^:  in the hand of": lambda r: any(claim.get("witness_hand") for claim in r["certificate"]["claims"]),
    r"\b1 of \d+ kicks keeps moving": lambda r: at(r, "buzz.moving") == 1,
    r"kicks keep moving": lambda r: (at(r, "buzz.moving") or 0) > 1,
    r"none of \d+ kicks": lambda r: at(r, "buzz.moving") == 0,
    r"is at most twice the friction": lambda r: at(r, "rest.rests") is True,
    r"is more than twice the friction": lambda r: at(r, "rest.rests") is False,
    r"less the damping of every hand": hands_less,
    r"rests: yes": lambda r: at(r, "rest.rests") is True,
    r"rests: no": lambda r: at(r, "rest.rests") is False,
    r"comes to rest: yes": lambda r: at(r, "rest.settles") is True,
    r"comes to rest: no": lambda r: at(r, "rest.settles") is False,
    r"comes to rest: open": lambda r: at(r, "rest.settles") is None and at(r, "rest.rests") is not None,
    r"buzzes: yes": lambda r: bool(at(r, "buzz.moving")),
    r"buzzes: no": lambda r: at(r, "buzz.moving") == 0,
    r"keeps moving:": lambda r: at(r, "buzz.moving") == 1,
    r"without friction, since none": lambda r: bool(at(r, "buzz.moving")) and at(r, "buzz.friction_N") is None,
    r"that drive at 1 Hz": lambda r: (at(r, "felt.damping_1hz") or 0) < 0,
    r"of a spring and": lambda r: (at(r, "felt.mass_1hz") or 0) < 0,
    r"the bare device": lambda r: at(r, "felt.bare_mass_1hz") is not None,
    r"stable, but not rendered": lambda r: at(r, "felt.wall") is not None
    and abs(at(r, "felt.felt_wall_10hz") / at(r, "felt.wall") - 1) > 0.1,
    r": rendered to": lambda r: at(r, "felt.wall") is not None
    and abs(at(r, "felt.felt_wall_10hz") / at(r, "felt.wall") - 1) <= 0.1,
    r"no bound found": lambda r: any(
        (found := at(r, f"rest.{name}")) is not None
        and all(not found.get(key) for key in ("chatter_m", "chatter_m_s", "chatter_N"))
        for name in ("encoder", "force_sensor")
    ),
    r"binding world: \S+ (N/m|N m/rad) spring": world_is("spring"),
    r"binding world: \S+ (kg|kg m2|g) tool": world_is("mass"),
    r"binding world: \S+ (kg|kg m2|g) on": world_is("both"),
    r"binding world: none nothing": world_is("nothing"),
    r"K_p q": lambda r: at(r, "rest.spring") == "K_p" and at(r, "rest.rests") is not None,
    r"k_c q": lambda r: at(r, "rest.spring") == "k_c" and at(r, "rest.rests") is not None,
    r"stable(; nominal)?$": lambda r: at(r, "inner_loop.stable") is True,
    r"even the softest hands": lambda r: at(r, "contact") is not None and at(r, "contact.stiffest_contact") is None,
    r"proved with this coupling": lambda r: at(r, "contact.stiffest_contact_verdict") == "proved",
    r"undecided with this coupling": lambda r: at(r, "contact.stiffest_contact_verdict") == "undecided",
    r"and the drag of the own spring": lambda r: bool(at(r, "contact.own_spring")),
    r"; nominal": lambda r: at(r, "uncertainty.box") not in (None, {}) or bool(at(r, "uncertainty.unmodelled")),
    r"(limit|walls): no limit estimated$": lambda r: "worlds" in (at(r, "certificate.hands") or {})
    and None in (at(r, "certificate.hands.min_ratio"), (at(r, "certificate.hands.walls") or {}).get("min_ratio", 0.0)),
    r"none at 0 Hz": lambda r: False,
    r"^claim: refuted": lambda r: any(claim["verdict"] == "refuted" for claim in r["certificate"]["claims"]),
    r"^claim: undecided": lambda r: any(claim["verdict"] == "undecided" for claim in r["certificate"]["claims"]),
    r"not counted": lambda r: bool(at(r, "transparency.apart")),
}  # fmt: skip
"""Forms of sentences, and when a record has them: then, and only then."""
SELDOM = (
    r"keeps moving:", r"\b1 of \d+ kicks keeps moving", r"comes to rest: yes", r"(limit|walls): no limit estimated$",
    r"none at 0 Hz",
    r"undecided with this coupling", r"binding world: none nothing", r"of a spring and", r"no bound found",
    r"that drive at 1 Hz", r": rendered to",
)  # fmt: skip
"""Forms that a few drawn problems need not have."""
