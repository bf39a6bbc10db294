"""Find the keys that do not apply to a kind of display, and state the reason for each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vctune.document.schema.number_units import units_stated
from vctune.document.schema.validation import Contradiction
from vctune.document.text.raw import number_at
from vctune.model.hands import HAND
from vctune.model.parts import PARTS

# Keys that do not apply to an impedance display, each with the reason
OF_ADMITTANCE: dict[tuple[str, ...], str] = {
    **{("device", key): part.refused_by["impedance"] for key, part in PARTS.items() if "impedance" in part.refused_by},
    ("gains", "position"): "it has no velocity loop, whose error an integrator would add up",
    ("coupling", "mass"): "its coupling is coupling.damping beside coupling.stiffness",
    ("coupling", "drag"): "its coupling is coupling.damping beside coupling.stiffness",
    ("stability", "band_hz"): "its demands are proved at every frequency up to the Nyquist frequency",
    ("environment",): "its demands are proved with every passive environment",
    ("uncertainty", "unmodelled"): "its demands are not proved of a response that is not known",
}
# Keys that do not apply to a servo, each with the reason
MEANINGLESS_WITH_SERVO: dict[tuple[str, ...], str] = {
    ("device", "mass"): "the hand does not move it: its motion follows the command alone",
    ("device", "damping"): "the hand does not move it: its motion follows the command alone",
    ("device", "delay"): "the delay is device.servo.delay",
    ("device", "hold"): "its command is held over a sample, or interpolated",
    ("device", "display"): "a servo is an admittance display",
    **{("device", key): part.refused_by["servo"] for key, part in PARTS.items() if "servo" in part.refused_by},
    ("gains",): "its loop is the vendor's; only the coupling is designed",
    ("coupling", "stiffness"): "its coupling is damping and mass in series, beside drag",
    ("stability", "band_hz"): "its requirements are proved at every frequency up to the Nyquist frequency",
    ("uncertainty", "mass"): "the hand does not move it: its motion follows the command alone",
    ("uncertainty", "damping"): "the hand does not move it: its motion follows the command alone",
    ("uncertainty", "delay"): 'the delay is "servo.delay"',
    ("stability", "max_sensitivity"): "the file closes no loop of its own that could be too sensitive",
}


def impossible_display(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the keys of a problem that do not apply to its display, and values that its display does not permit."""
    device = raw.get("device")
    if not isinstance(device, dict):
        return
    if "servo" in device:
        yield from _meaningless(raw, MEANINGLESS_WITH_SERVO, "[device.servo]")
        yield from _criterion_of_servo(raw)
        yield from _hands_of_servo(raw)
    elif device.get("display", "admittance") != "impedance":
        if _stated(raw, ("coupling", "stiffness")):
            yield (
                ("coupling", "stiffness"),
                'is of an impedance display; write device.display = "impedance", or leave it out',
            )
        lowest: tuple[tuple[str, ...], ...] = ("coupling", "damping"), ("coupling", "damping", "min")
        for path in lowest:
            if number_at(raw, *path) == 0:
                yield (
                    path,
                    "0 is too small on an admittance display, whose coupling it would open; write a positive one",
                )
    else:
        yield from _meaningless(raw, OF_ADMITTANCE, 'device.display = "impedance"')
        yield from _unproved_impedance(device)


def _meaningless(raw: dict[str, Any], keys: dict[tuple[str, ...], str], display: str) -> Iterator[Contradiction]:
    for path, reason in keys.items():
        if _stated(raw, path):
            yield path, f"means nothing with {display}: {units_stated(raw).translated(reason)}; leave it out"


def _criterion_of_servo(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the fault of a criterion that includes any passive hand. No servo is stable in a hand of any stiffness."""
    stability = raw.get("stability")
    criterion = stability.get("criterion", "hands") if isinstance(stability, dict) else "hands"
    if criterion in ("passive", "both"):
        yield (
            ("stability", "criterion"),
            f'"{criterion}" asks for any passive hand, and no servo is stable in a hand of unlimited stiffness, since '
            'it follows late; write "hands", or leave it out, and state the stiffest contact in [operator]',
        )


def _hands_of_servo(raw: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the fault of a box whose only hand has no impedance, on a servo without a spring of its own."""
    paths = [key.split(".") for key in HAND]
    held = any(0.0 not in (number_at(raw, *path), number_at(raw, *path, "max")) for path in paths)
    if not held and not number_at(raw, "device", "servo", "stiffness"):
        yield ("operator",), "no hand of it pushes, so that nothing is fed back; give one of its ranges a positive max"


def _unproved_impedance(device: dict[str, Any]) -> Iterator[Contradiction]:
    """Yield the keys of a device that the proof for impedance displays does not allow."""
    velocity = device.get("velocity")
    if isinstance(velocity, dict) and velocity.get("from") == "measured":
        yield (
            ("device", "velocity", "from"),
            '"measured" is not what an impedance display\'s coupling runs on; write "difference", or leave it out',
        )
    if device.get("hold") == "lag":
        yield ("device", "hold"), '"lag" is not proved on an impedance display; write "zoh", or leave it out'


def _stated(raw: dict[str, Any], path: tuple[str, ...]) -> bool:
    """Return whether a document states a key."""
    at: Any = raw
    for key in path:
        if not isinstance(at, dict) or key not in at:
            return False
        at = at[key]
    return True
