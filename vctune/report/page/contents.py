"""The files of a report, and the texts that explain its figures. This module imports no heavy package."""

from __future__ import annotations

from pathlib import Path

from vctune.model.worlds import Worlds

REPORT = "report.html"
# The terms of the error in words
IN_WORDS = {"admittance": "does not yield", "tracking": "does not follow", "coupling": "gives way"}
# Title of each figure and a text that explains it, by the name of the figure
READINGS = {
    "hands": (
        "Coupling against the requirement of the worst hand",
        "Top: Re Z_c, as the firmware runs it, must lie above R in each hand, up to the Nyquist frequency. The motion "
        "then does not grow with any environment that is passive as it runs. Bottom: the share of Re Z_c that R takes "
        "at the worst damping and frequency of each hand; 100 % is the limit.",
    ),
    "llewellyn": (
        "Coupling against the requirement of any passive hand",
        "Re Z_c must lie above R, and their ratio above 1, on the band between the dashed lines. On this band, in the "
        "frequency model, no passive hand and no passive environment can make the handle unstable.",
    ),
    "any-hand": (
        "Coupling against the requirement of any passive hand",
        "Re 1/Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency. No passive hand and no "
        "environment that is passive as it runs then make the handle unstable.",
    ),
    "latency": (
        "Drag is stiffness times latency",
        "The force of a contact of stiffness K arrives late by the latency L. At rest this acts as a damping of −K L. "
        "The drag D must compensate for it. Each bar shows one part of the latency.",
    ),
    "impedance": (
        "What the hand feels, beside what it should feel",
        "In the shaded transparency band each line with marks should lie on the thin line of its ideal. The device "
        "can render everything between free and rigid.",
    ),
    "transparency": (
        "Which term makes the error",
        "All terms should be small in the shaded band. Grey curves show the same loop without a coupling, and the "
        "device without a loop.",
    ),
    "nyquist": (
        "How far the velocity loop stays from -1",
        "The curve must pass -1 without encircling it and stay out of the hatched circle, where |S| exceeds its limit.",
    ),
    "optimality": (
        "How much better any design could be",
        "No design that meets the constraints has an error below the full line; a search of every box of gains and "
        "couplings proves this. The gap to the dashed line is all that another design could gain.",
    ),
    "simulation": (
        "The design and a regular PID in simulated experiments",
        "Each panel shows the force of the hand over position (springs) or velocity, without the first cycle. The "
        "left column shows a regular PID, and the right column shows this design, on the same device with the same "
        "friction. The curves of loading and unloading should coincide with the dashed line, which is the rendered "
        "environment.",
    ),
}
# Texts that differ for a kind of display, by the names of the display and of the figure
OF_DISPLAY: dict[str, dict[str, str]] = {
    "servo": {
        "hands": "Top: the late response of a hand or a contact acts as a negative resistance of size R, whatever the "
        "design. Re Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency. Bottom: the share of "
        "Re Z_c that R takes at the worst damping and frequency of each hand; 100 % is the limit.",
        "transparency": "Both terms should be small in the shaded band. The motion should follow its command, which "
        "depends only on the servo. The hand should not feel the coupling, which vctune designs.",
        "impedance": "In the shaded transparency band each line with marks should lie on the thin line of its ideal. "
        "No environment feels lighter than the free arm, whose drag the contacts require.",
    }
}


# Addition to the text about curves in hands if the problem states its environments
IN_WORLDS = (
    " The curves are for any passive environment, which is more than the claim covers. Where the ratio is below 1, the "
    "loop is stable only because the problem limits its environments."
)


def reading(figure: str, display: str, worlds: Worlds | None) -> str:
    """Return the text that explains a figure for a kind of display."""
    own = OF_DISPLAY.get(display, {}).get(figure, READINGS[figure][1])
    if worlds is None or figure != "hands":
        return own
    return own + IN_WORLDS


def report_paths(folder: Path) -> list[Path]:
    """Return the paths of a folder's report and of every figure that it can have."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in READINGS)]


# Title of each figure of an identification and a text that explains it, by the name of the figure
IDENTIFICATION_READINGS = {
    "time-fit": (
        "Force in time",
        "The upper panel shows the recorded force, and the force that mass and friction need for the motion, where the "
        "difference is largest. The lower panel shows the difference over the whole log.",
    ),
    "following": (
        "How the servo follows",
        "The upper panel shows commanded position, measured position and fit, where the fit is worst. The "
        "lower panel shows the difference over the whole log. A velocity that arrives early or late shifts the "
        "position permanently.",
    ),
    "response": (
        "Response",
        "The panels show measured lines or bands with twice their standard deviation, and the fit. The grey area is "
        "the box with the unmodelled disc. It contains every measured magnitude. The box does not include dry "
        "friction, which shifts the phase of slow lines out of it. The lower panel shows how well each line repeats.",
    ),
    "residual-spectrum": (
        "The residual",
        "The curve shows the power of the residual over frequency. The dashed line is the noise of the encoder "
        "alone. Power above it is model error, and the intervals allow for it.",
    ),
    "numbers": (
        "Each parameter and what limits it",
        "Dots are single records and directions with twice their standard deviation. The bar is the box, relative to "
        "its middle.",
    ),
}


def identification_paths(folder: Path) -> list[Path]:
    """Return the paths of an identification's report and of every figure that it can have."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in IDENTIFICATION_READINGS)]
