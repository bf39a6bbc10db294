"""The loop and the force path as a block diagram: one block for each part of the device, and lines elsewhere."""

from __future__ import annotations

from math import inf

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.numbers.units import UNITS, Units
from vctune.model.parts import Servo, Structure
from vctune.report.figures.style import BLUE, GREEN, GREY, INK, STYLE
from vctune.report.typography import quantity

SIZE = (6.28, 4.2)
"""Size of the figure, inches, which fits the screen of a telephone. All positions below are in inches, too."""
TOP, MIDDLE, BOTTOM = 3.42, 2.02, 0.72
"""Heights of the three rows: firmware, feedback and actuator, mechanism."""
LEFT, COUPLING, LAW, RIGHT = 0.95, 2.5, 4.05, 5.6
"""Horizontal positions of the columns."""
HAND = 0.43
"""Horizontal position of the hand."""
WIDTH, HEIGHT, TALL, LINE = 1.26, 0.82, 1.1, 0.195
"""Width and height of a box, height of a box in the top row, and height of a line of text."""
FITS = 17 / WIDTH
"""Number of letters that fit into an inch of a box. A longer line gets smaller letters."""
POSITION_AT = 4.58
"""Horizontal position where the line of the position passes the velocity estimate."""


def loop_figure(device: Device, gains: Gains, coupling: AnyCoupling) -> Figure:
    """Return the block diagram of a design: force sensor, coupling, law, hold, actuator, mechanism, velocity estimate.

    For an impedance display, the measured motion drives the coupling, and the block after the coupling adds up the
    forces.

    Parameters
    ----------
    device : the device, whose parts are the blocks
    gains, coupling : the design
    """
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0, SIZE[0]), ylim=(0, SIZE[1]))
        axes.set_axis_off()
        if device.servo is not None and isinstance(coupling, Coupling):
            _servo_loop(axes, device, device.servo, coupling)
            return figure
        _firmware(axes, device, LAW + 0.78)
        if isinstance(coupling, SpringDamper):
            _motion_path(axes, coupling, UNITS[device.units])
        else:
            _force_path(axes, device, coupling)
        _drive(axes, device, gains)
        _mechanism(axes, device)
        _feedback(axes, device, gains)
    return figure


def _force_path(axes: Axes, device: Device, coupling: Coupling) -> None:
    sensor, low, units = device.sensing, BOTTOM, UNITS[device.units]
    if not device.senses_late:
        _arrow(axes, (LEFT, low), (LEFT, TOP), (COUPLING - WIDTH / 2, TOP))
    else:
        lines = [] if sensor.bandwidth_hz is None else [_low_pass(sensor.bandwidth_hz, sensor.order)]
        lines += [f"delay {_time(sensor.delay)}"] if sensor.delay > 0 else []
        _arrow(axes, (LEFT, low), (LEFT, TOP - TALL / 2))
        _box(axes, LEFT, TOP, f"{units.force_name} sensor", lines, colour=GREEN)
        _arrow(axes, (LEFT + WIDTH / 2, TOP), (COUPLING - WIDTH / 2, TOP), label="f_s")
    axes.plot([LEFT], [low], "o", color=INK, markersize=3)
    axes.text(LEFT + 0.07, 1.6, "f_h", ha="left", va="center")
    lines = [] if coupling.damping == inf else [f"b_c {quantity(coupling.damping, units.damping)}"]
    lines += [f"m_c {quantity(coupling.mass, units.mass)}"]
    lines += [f"b_0 {quantity(coupling.drag, units.damping)}"] if coupling.drag > 0 else []
    _box(axes, COUPLING, TOP, "coupling and\nenvironment", lines, colour=BLUE)


def _servo_loop(axes: Axes, device: Device, servo: Servo, coupling: Coupling) -> None:
    """Draw the paths from the hand's force to the motion, which follows the command alone, and back to the hand."""
    low, edge = BOTTOM, LAW + WIDTH / 2
    _firmware(axes, device, COUPLING + 0.95)
    _force_path(axes, device, coupling)
    command = {"velocity": "v_cmd", "position": "x_cmd"}[servo.command]
    _arrow(axes, (COUPLING + WIDTH / 2, TOP), (RIGHT - WIDTH / 2 - 0.35, TOP), label=command)
    held = {"velocity": "hold", "position": "interpolation"}[servo.command]
    lines = [f"{held} {_time(device.sample_time)}"]
    lines += [f"delay {_time(servo.delay)}"] if servo.delay > 0 else []
    lines += [_low_pass(servo.bandwidth_hz, servo.order)]
    _box(axes, RIGHT - 0.175, TOP, "vendor's loop", lines, colour=GREEN, width=WIDTH + 0.35)
    _arrow(axes, (RIGHT, TOP - TALL / 2), (RIGHT, low), (edge, low), label="")
    left = 1.25
    _arrow(axes, (left, low), (HAND + 0.38, low))
    moves = {"linear": "moves as commanded", "rotary": "turns as commanded"}[device.units]
    _box(axes, (left + edge) / 2, low, "arm", [f"{moves}, however the hand pushes"], width=edge - left)
    _box(axes, HAND, low, "hand or\ncontact", [], width=0.76, colour=GREY)
    axes.text((HAND + 0.38 + left) / 2, low - 0.06, "v_h", ha="center", va="top")


def _motion_path(axes: Axes, coupling: SpringDamper, units: Units) -> None:
    """Draw the path of the measured motion to the coupling. It branches off behind the velocity estimate."""
    _arrow(axes, (LAW - WIDTH / 2, MIDDLE), (COUPLING, MIDDLE), (COUPLING, TOP - TALL / 2), label="x, v̂")
    lines = [f"k_c {quantity(coupling.stiffness, units.stiffness)}"]
    lines += [f"b_c {quantity(coupling.damping, units.damping)}"] if coupling.damping > 0 else []
    _box(axes, COUPLING, TOP, "coupling and\nenvironment", lines, colour=BLUE)


def _drive(axes: Axes, device: Device, gains: Gains) -> None:
    units = UNITS[device.units]
    lines = [f"K_v {quantity(gains.velocity, units.damping)}"] if gains.velocity > 0 or device.kind.senses_force else []
    lines += [f"K_p {quantity(gains.position, units.stiffness)}"] if gains.position > 0 else []
    told, law = ("f_c", units.force_name) if not device.kind.senses_force else ("v_e", "velocity law")
    _arrow(axes, (COUPLING + WIDTH / 2, TOP), (LAW - WIDTH / 2, TOP), label=told)
    _box(axes, LAW, TOP, law, lines, colour=BLUE)
    _arrow(axes, (LAW + WIDTH / 2, TOP), (RIGHT - WIDTH / 2, TOP))
    late = [f"delay {_time(device.delay)}"] if device.delay > 0 else []
    _box(
        axes, RIGHT, TOP, "hold and delay" if late else "hold", [f"T {_time(device.sample_time)}", *late], colour=GREEN
    )
    start = TOP
    if device.actuator is not None:
        _arrow(axes, (RIGHT, TOP - TALL / 2), (RIGHT, MIDDLE + HEIGHT / 2))
        lines = [_low_pass(device.actuator.bandwidth_hz, device.actuator.order)]
        _box(axes, RIGHT, MIDDLE, "actuator", lines, colour=GREEN)
        start = MIDDLE
    _arrow(
        axes,
        (RIGHT, start - (TALL if start == TOP else HEIGHT) / 2),
        (RIGHT, BOTTOM),
        (LAW + WIDTH / 2, BOTTOM),
        label="u",
    )


def _mechanism(axes: Axes, device: Device) -> None:
    hand, units = device.operator, UNITS[device.units]
    least = [] if hand is None else [(hand.mass, units.mass), (hand.damping, units.damping)]
    lines = [str(quantity(number, unit, 3)) for number, unit in least if number > 0]
    _box(axes, HAND, BOTTOM, "hand ≥" if lines else "hand", lines, width=0.76, colour=GREY)
    damping = str(quantity(device.damping, units.damping))
    if device.structure is None:
        left, right = 1.25, LAW + WIDTH / 2
        _arrow(axes, (HAND + 0.38, BOTTOM), (left, BOTTOM), both=True)
        _box(
            axes,
            (left + right) / 2,
            BOTTOM,
            "mechanism",
            [f"{quantity(device.mass, units.mass)}, {damping}"],
            width=right - left,
        )
        return
    structure, handle = device.structure, 1.85
    _arrow(axes, (HAND + 0.38, BOTTOM), (handle - 0.6, BOTTOM), both=True)
    _box(axes, handle, BOTTOM, "handle", [str(quantity(structure.handle_mass, units.mass))], width=1.2)
    _spring(axes, handle + 0.6, LAW - WIDTH / 2, structure)
    _box(axes, LAW, BOTTOM, "motor", [str(quantity(device.motor_mass, units.mass)), damping])


def _spring(axes: Axes, left: float, right: float, structure: Structure) -> None:
    x = np.linspace(left, right, 13)
    y = BOTTOM + 0.12 * np.array([0, 0, 1, -1, 1, -1, 1, -1, 1, -1, 1, 0, 0])
    axes.plot(x, y, color=INK, linewidth=1)
    text = f"{quantity(structure.frequency_hz, 'Hz')}\nζ {structure.damping_ratio:.3g}"
    axes.text((left + right) / 2, BOTTOM - 0.2, text, ha="center", va="top", fontsize=10)


def _feedback(axes: Axes, device: Device, gains: Gains) -> None:
    """Draw the feedback to the control law: the measured or estimated velocity, and the position."""
    low, high, estimate = BOTTOM + HEIGHT / 2, TOP - TALL / 2, device.velocity
    if estimate is None:
        _arrow(axes, (LAW, low), (LAW, high), label="v, x" if gains.position > 0 else "v")
        return
    lines = ["of the position"] if estimate.source == "difference" else []
    if estimate.filter_hz is not None:
        lines += [_low_pass(estimate.filter_hz, estimate.filter_order)]
    width, at = 1.06, LAW - WIDTH / 2 + 0.53
    title = "difference" if estimate.source == "difference" else "velocity filter"
    _arrow(axes, (at, low), (at, MIDDLE - HEIGHT / 2), label="x" if estimate.source == "difference" else "v")
    _box(axes, at, MIDDLE, title, lines, width=width, colour=GREEN)
    _arrow(axes, (at, MIDDLE + HEIGHT / 2), (at, high), label="v̂")
    if gains.position > 0:
        _arrow(axes, (POSITION_AT, low), (POSITION_AT, high), label="x")


def _firmware(axes: Axes, device: Device, right: float) -> None:
    left, low, high = COUPLING - 0.67, 1.36, 4.12
    outline = Rectangle((left, low), right - left, high - low, facecolor="none", edgecolor=GREY, linestyle="--")
    axes.add_patch(outline)
    axes.text(left + 0.08, low + 0.08, f"firmware, every {_time(device.sample_time)}", va="bottom")


def _box(
    axes: Axes, x: float, y: float, title: str, lines: list[str], *, width: float = WIDTH, colour: str = INK
) -> None:
    height = TALL if y == TOP else HEIGHT
    corner = (x - width / 2, y - height / 2)
    axes.add_patch(Rectangle(corner, width, height, facecolor="none", edgecolor=colour, linewidth=1.4))
    rows = [*title.split("\n"), *lines]
    top = y + LINE * (len(rows) - 1) / 2
    for number, row in enumerate(rows):
        bold = number < title.count("\n") + 1
        axes.text(
            x, top - LINE * number, row, ha="center", va="center_baseline",
            fontsize=11 if bold else 10.5 * min(1.0, FITS * width / len(row)), fontweight="bold" if bold else "normal",
        )  # fmt: skip


def _arrow(axes: Axes, *points: tuple[float, float], label: str = "", both: bool = False) -> None:
    """Draw a polyline with an arrow head at its end, and a label beside the middle of its last part."""
    x, y = zip(*points[:-1], strict=True)
    axes.plot(x, y, color=INK, linewidth=1)
    (x_0, y_0), (x_1, y_1) = points[-2:]
    style = {"arrowstyle": "<|-|>" if both else "-|>", "color": INK, "linewidth": 1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x_1, y_1), (x_0, y_0), arrowprops=style)
    upright = x_0 == x_1
    place = ((x_0 + x_1) / 2 + (0.07 if upright else 0), (y_0 + y_1) / 2 + (0 if upright else 0.06))
    axes.text(*place, label, ha="left" if upright else "center", va="center" if upright else "bottom")


def _low_pass(corner_hz: float, order: int) -> str:
    return str(quantity(corner_hz, "Hz")) + (f", order {order}" if order > 1 else "")


def _time(seconds: float) -> str:
    return str(quantity(seconds, "s"))
