"""The parts of a report: the page, its figures and how to read each. Draws nothing, imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

REPORT = "report.html"
READINGS = {
    "loop": (
        "The loop as designed",
        "The diagram goes from the hand's force to its velocity, or from its motion to a force. Designed parts are "
        "blue; parts that delay the loop are green. An absent part is a plain line.",
    ),
    "llewellyn": (
        "Absolute stability",
        "The coupling's Re Z_c must lie above the required R; below, their ratio must be above 1. At such a frequency, "
        "no passive hand and no passive environment can make the handle unstable, as far as the frequency model goes. "
        "Dashed lines bound the band on which this is proved. The lower axis only shows ratios around 1.",
    ),
    "hands": (
        "In every hand",
        "In each hand the coupling's Re Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency. No "
        "environment that is passive as it runs then makes the loop grow. The lower panel shows, for each mass and "
        "stiffness of the hand, the share of Re Z_c that R takes at the worst damping and frequency; 100 % is the "
        "limit.",
    ),
    "any-hand": (
        "In any passive hand",
        "The coupling's Re 1/Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency. Where the "
        "ratio is above 1, no passive hand and no environment that is passive as it runs make the handle unstable. The "
        "lower axis only shows ratios around 1.",
    ),
    "nyquist": (
        "Velocity loop",
        "The curve must pass -1 without encircling it and stay out of the hatched circle, where |S| exceeds its limit.",
    ),
    "transparency": (
        "Transparency",
        "All four should be small in the shaded band: the free handle should yield and follow the environment, and the "
        "hand should not feel the coupling. For an admittance display, grey curves show the same loop without a "
        "coupling, and the device without a loop.",
    ),
    "z-width": (
        "What may be rendered?",
        "Each point is a spring and a tool, with any damping: blue is proved stable in every hand, in orange there is "
        "a hand in which it holds an oscillation with the reserve used up. The frame is what the problem asks for. "
        "`vctune region --x environment.stiffness --y environment.mass` draws the map in full.",
    ),
    "impedance": (
        "What the hand feels",
        "In the transparency band each line with marks should lie on its thin ideal; no claim holds outside the "
        "stability band. The device can render everything between the lines for a free and for a rigid environment "
        "(its Z-width).",
    ),
    "simulation": (
        "Experiments",
        "Simulated force of the hand over position (springs) or velocity, without the first cycle: on the left a "
        "regular PID, on the right this design, on the same device with the same friction. The dashed line is the "
        "rendered environment. Loading and unloading should lie on each other and on the dashed line.",
    ),
    "optimality": (
        "How much better could any design be?",
        "No design that meets the constraints has an error below the full line; a search of every box of gains and "
        "couplings proves this. The gap to the dashed line is all that another design could gain.",
    ),
}
"""Title and reading of each figure, by name."""
OF_DISPLAY: dict[str, dict[str, str]] = {
    "servo": {
        "loop": "The diagram goes from the hand's force to the motion of the arm. Designed parts are blue; parts that "
        "delay the loop are green. The hand does not move the arm; it feels the late answer of the coupling.",
        "hands": "The late answer of a hand or a contact acts as a negative resistance of size R, which does not "
        "depend on the design. The coupling's Re Z_c, as the firmware runs it, must lie above R up to the Nyquist "
        "frequency. At rest R is stiffness times latency. The lower panel shows, for each mass and stiffness of the "
        "hand, the share of Re Z_c that R takes at the worst damping and frequency; 100 % is the limit.",
        "transparency": "Both should be small in the shaded band: the motion should follow its command, which depends "
        "on the servo alone, and the hand should not feel the coupling, which is designed.",
        "impedance": "In the transparency band each line with marks should lie on its thin ideal. No environment feels "
        "lighter than the free arm, whose drag the contacts require.",
    }
}
"""Readings that differ for a kind of display, by its name and that of the figure."""


def reading(figure: str, display: str) -> str:
    """Return how to read a figure of a kind of display.

    Parameters
    ----------
    figure, display : their names
    """
    return OF_DISPLAY.get(display, {}).get(figure, READINGS[figure][1])


def report_paths(folder: Path) -> list[Path]:
    """Return the paths of a folder's report and of its figures."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in READINGS)]


IDENTIFICATION_READINGS = {
    "time-fit": (
        "Force in time",
        "The recorded force, and the force of mass and friction for the motion, where the difference is largest. The "
        "lower panel shows the difference over the whole log.",
    ),
    "following": (
        "How the servo follows",
        "Commanded position, measured position and fit, where the fit is furthest off. The lower panel shows the "
        "difference over the whole log. A velocity that arrives early or late shifts the position permanently.",
    ),
    "response": (
        "Response",
        "Measured lines or bands with twice their standard deviation, the fit, and in grey the box with the unmodelled "
        "disc, which contains them all. The lower panel shows how well each line repeats.",
    ),
    "residual-spectrum": (
        "The residual",
        "Power of the residual over frequency. The dashed line is the noise of the encoder alone. Power above it is "
        "model error, and the intervals allow for it.",
    ),
    "numbers": (
        "Each number and what limits it",
        "Dots are single records and directions with twice their standard deviation. The bar is the box, relative to "
        "its middle.",
    ),
}
"""Title and reading of each figure of an identification, by name."""


def identification_paths(folder: Path) -> list[Path]:
    """Return the paths of an identification's report and of its figures."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in IDENTIFICATION_READINGS)]
