"""What a report consists of: the page, its figures and how each is read. Draws nothing, imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

REPORT = "report.html"
READINGS = {
    "loop": (
        "The loop as designed",
        "From the hand's force to its velocity, or from its motion to a force: blue is what is designed, green what "
        "makes it late. A part that the device has not is a plain line.",
    ),
    "llewellyn": (
        "Absolute stability",
        "Wherever the coupling's Re Z_c lies above the required R, below: where the ratio is above 1, no passive hand "
        "and no passive environment can make the handle unstable at such a frequency, as far as the frequency model "
        "goes; dashed lines bound the band on which this is proved. The lower axis shows the ratios around 1 alone.",
    ),
    "hands": (
        "In every hand",
        "In a hand the coupling's Re Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency: no "
        "environment that is passive as it runs then makes the loop grow. Below: how much of Re Z_c the worst damping "
        "at the worst frequency needs in a hand of a mass and a stiffness; 100 % is the limit.",
    ),
    "any-hand": (
        "In any passive hand",
        "The coupling's Re 1/Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency: where the "
        "ratio is above 1, no passive hand and no environment that is passive as it runs make the handle unstable. The "
        "lower axis shows the ratios around 1 alone.",
    ),
    "nyquist": (
        "Velocity loop",
        "The loop must pass -1 without encircling it and stay out of the hatched circle around it: |S| then keeps its "
        "limit.",
    ),
    "transparency": (
        "Transparency",
        "All four should be small in the shaded band: the free handle should yield, follow the environment, and the "
        "coupling should not be felt. Of an admittance display, grey: the same loop without a "
        "coupling, and the device without any loop.",
    ),
    "z-width": (
        "What may be rendered?",
        "Each point is a wall and a tool, with any damping: blue is proved stable in every hand, in orange there is a "
        "hand in which it holds an oscillation with the reserve used up. The frame is what the problem asks for. "
        "`vctune region --x environment.stiffness --y environment.mass` draws the map in full.",
    ),
    "impedance": (
        "What the hand feels",
        "In the transparency band each line with marks should lie on its thin ideal; outside the stability band "
        "nothing is promised. Between the lines for a free and for a rigid environment lies everything that the device "
        "can render (its Z-width).",
    ),
    "simulation": (
        "Experiments",
        "The force of the hand over position (springs) or velocity, first cycle apart: left a regular PID, right this "
        "design, on the same device with the same friction, simulated. Dashed: what the environment asks for. Loading "
        "and unloading should lie on one another and on the dashed line.",
    ),
    "optimality": (
        "How much better could any design be?",
        "No design that meets the demands has an error below the full line, proved by searching every box of gains and "
        "couplings; what lies between it and the dashed line is all that could still be gained.",
    ),
}
"""Title and reading of each figure, by name."""
OF_DISPLAY: dict[str, dict[str, str]] = {
    "servo": {
        "loop": "From the hand's force to the motion of the arm: blue is what is designed, green what makes it late. "
        "The hand does not move the arm; what it feels is what the coupling makes of its force, late.",
        "hands": "What a hand or a contact returns of a late motion acts as the negative resistance R: it does not "
        "depend on the design, and the coupling's Re Z_c, as the firmware runs it, must lie above it up to the Nyquist "
        "frequency. At rest R is stiffness times latency. Below: how much of Re Z_c the worst damping at the worst "
        "frequency needs in a hand of a mass and a stiffness; 100 % is the limit.",
        "transparency": "Both should be small in the shaded band: the motion should follow its command, which is the "
        "servo's business, and the coupling should not be felt, which is what is designed.",
        "impedance": "In the transparency band each line with marks should lie on its thin ideal. No environment feels "
        "lighter than the free arm: its drag is what the contacts ask for.",
    }
}
"""Readings that are other ones for a kind of display, by its name and that of the figure."""


def reading(figure: str, display: str) -> str:
    """Return how a figure of a kind of display is read.

    Parameters
    ----------
    figure, display : their names
    """
    return OF_DISPLAY.get(display, {}).get(figure, READINGS[figure][1])


def report_paths(folder: Path) -> list[Path]:
    """Return where a folder's report is, and the files of its figures."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in READINGS)]


IDENTIFICATION_READINGS = {
    "time-fit": (
        "Force in time",
        "What was recorded and what mass and friction make of the motion, where the difference is largest; below, the "
        "difference alone over the whole log.",
    ),
    "following": (
        "How the servo follows",
        "Where it was told to be, where it was, and the fit, where that is furthest off; below, by how much "
        "over the whole log. A velocity that arrives early or late leaves the position off for good.",
    ),
    "response": (
        "Response",
        "Measured lines or bands with twice their standard deviation, the fit, and in grey the box times what is "
        "unmodelled: each lies inside. Where a line repeats, how well it does is below.",
    ),
    "residual-spectrum": (
        "What is left",
        "Where the residual has its power. Noise of the encoder alone is the dashed line: what stands above it is "
        "no noise but what the model lacks, and the intervals are made for it.",
    ),
    "numbers": (
        "Each number and what limits it",
        "Dots are single records and directions with twice their standard deviation, the bar is the box, "
        "as a share of its middle.",
    ),
}
"""Title and reading of each figure of an identification, by name."""


def identification_paths(folder: Path) -> list[Path]:
    """Return where the report of an identification is, and the files of its figures."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in IDENTIFICATION_READINGS)]
