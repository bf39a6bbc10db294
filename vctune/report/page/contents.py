"""The parts of a report: the page, its figures and how to read each. Draws nothing, imports nothing heavy."""

from __future__ import annotations

from pathlib import Path

from vctune.model.worlds import Worlds

REPORT = "report.html"
IN_WORDS = {"admittance": "does not yield", "tracking": "does not follow", "coupling": "gives way"}
"""The terms of the error in words."""
READINGS = {
    "hands": (
        "Coupling against what the worst hand asks for",
        "Top: Re Z_c, as the firmware runs it, must lie above R in each hand, up to the Nyquist frequency. No "
        "environment that is passive as it runs then makes the loop grow. Bottom: the share of Re Z_c that R takes at "
        "the worst damping and frequency of each hand; 100 % is the limit.",
    ),
    "llewellyn": (
        "Coupling against what any passive hand asks for",
        "Re Z_c must lie above R, and their ratio above 1, on the band between the dashed lines. There no passive hand "
        "and no passive environment can make the handle unstable, as far as the frequency model goes.",
    ),
    "any-hand": (
        "Coupling against what any passive hand asks for",
        "Re 1/Z_c, as the firmware runs it, must lie above R up to the Nyquist frequency. No passive hand and no "
        "environment that is passive as it runs then make the handle unstable.",
    ),
    "latency": (
        "Drag is stiffness times latency",
        "A contact of stiffness K pushes back late, by L. At rest that acts as a damping of −K L, and the drag D must "
        "make up for it, part by part.",
    ),
    "z-width": (
        "What may be rendered",
        "Each point is a spring and a tool, with any damping: blue is proved stable in every hand, in orange there is "
        "a hand in which it holds an oscillation with the reserve used up. The frame is what the problem asks for.",
    ),
    "impedance": (
        "What the hand feels, beside what it should feel",
        "In the shaded transparency band each line with marks should lie on its thin ideal. The device can render "
        "everything between free and rigid.",
    ),
    "transparency": (
        "Which term makes the error",
        "All should be small in the shaded band. Grey: the same loop without a coupling, and the device without a "
        "loop.",
    ),
    "nyquist": (
        "How far the velocity loop stays from -1",
        "The curve must pass -1 without encircling it and stay out of the hatched circle, where |S| exceeds its limit.",
    ),
    "loop": (
        "The loop as designed",
        "From the hand's force to its velocity, or from its motion to a force. Blue parts are designed, green parts "
        "delay the loop.",
    ),
    "optimality": (
        "How much better any design could be",
        "No design that meets the constraints has an error below the full line; a search of every box of gains and "
        "couplings proves this. The gap to the dashed line is all that another design could gain.",
    ),
    "simulation": (
        "The design and a regular PID in simulated experiments",
        "Force of the hand over position (springs) or velocity, without the first cycle: on the left a regular PID, on "
        "the right this design, on the same device with the same friction. Loading and unloading should lie on each "
        "other and on the dashed line, which is the rendered environment.",
    ),
}
"""Title of each figure and a text that explains it, by the name of the figure."""
OF_DISPLAY: dict[str, dict[str, str]] = {
    "servo": {
        "loop": "From the hand's force to the motion of the arm. Blue parts are designed, green parts delay it. The "
        "hand does not move the arm; it feels the late answer of the coupling.",
        "hands": "Top: the late answer of a hand or a contact acts as a negative resistance of size R, whatever the "
        "design. Re Z_c, as the firmware runs it, must lie above it up to the Nyquist frequency. Bottom: the share of "
        "Re Z_c that R takes at the worst damping and frequency of each hand; 100 % is the limit.",
        "transparency": "Both should be small in the shaded band: the motion should follow its command, which depends "
        "on the servo alone, and the hand should not feel the coupling, which is designed.",
        "impedance": "In the shaded transparency band each line with marks should lie on its thin ideal. No "
        "environment feels lighter than the free arm, whose drag the contacts require.",
    }
}
"""Readings that differ for a kind of display, by its name and that of the figure."""


IN_WORLDS = (
    " The curves are before any passive environment, which is more than the claim covers: where the ratio is below 1, "
    "the environments of the problem are what keeps the loop stable."
)
"""What the curves of hands show where the environments are stated."""
IN_ACTIVE_WORLDS = (
    " The environments of the problem are not passive as they run, so that these curves do not decide about them. The "
    "claim does: the ratio above is with them."
)
"""The same where the stated environments are late or stepped by explicit Euler."""


def reading(figure: str, display: str, worlds: Worlds | None) -> str:
    """Return how to read a figure of a kind of display.

    Parameters
    ----------
    figure, display : their names
    worlds : the environments that the problem states; None if it states none
    """
    own = OF_DISPLAY.get(display, {}).get(figure, READINGS[figure][1])
    if worlds is None or figure != "hands":
        return own
    return own + (IN_WORLDS if worlds.passive else IN_ACTIVE_WORLDS)


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
        "disc, which contains every size. Dry friction, which the box leaves out, turns the phase of slow lines beyond "
        "it. The lower panel shows how well each line repeats.",
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
"""Title of each figure of an identification and a text that explains it, by the name of the figure."""


def identification_paths(folder: Path) -> list[Path]:
    """Return the paths of an identification's report and of its figures."""
    return [folder / REPORT, *(folder / f"{name}.svg" for name in IDENTIFICATION_READINGS)]
