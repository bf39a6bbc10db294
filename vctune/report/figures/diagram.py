"""The loop and the force path as a block diagram: one block for each part of the device, and lines elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Coupling, Gains, SpringDamper
from vctune.model.numbers.units import UNITS, Units
from vctune.model.parts import Servo, Structure
from vctune.report.svg.drawing import Drawing
from vctune.report.svg.elements import BLUE, DASHES, GREEN, GREY, INK, path, polyline, text
from vctune.report.typography import quantity

SIZE = (6.28, 4.2)  # Size of the figure, inches, which fits the screen of a telephone
TOP, MIDDLE, BOTTOM = 3.42, 2.02, 0.72  # Heights of the three rows: firmware, feedback and actuator, mechanism
LEFT, COUPLING, LAW, RIGHT = 0.95, 2.5, 4.05, 5.6  # Horizontal positions of the columns
HAND = 0.43  # Horizontal position of the hand
# Width and height of a box, height of a box in the top row, and height of a line of text
WIDTH, HEIGHT, TALL, LINE = 1.26, 0.82, 1.1, 0.195
FITS = 17 / WIDTH  # Number of letters that fit into an inch of a box
HEAD = 5.0  # Length of an arrow's head, points
POSITION_AT = 4.58  # Horizontal position where the line of the position passes the velocity estimate


def loop_figure(device: Device, gains: Gains, coupling: AnyCoupling) -> Drawing:
    """Return the block diagram of a design: force sensor, coupling, law, hold, actuator, mechanism, velocity
    estimate."""
    drawing = Drawing(*SIZE)
    if device.servo is not None and isinstance(coupling, Coupling):
        _servo_loop(drawing, device, device.servo, coupling)
        return drawing
    _firmware(drawing, device, LAW + 0.78)
    if isinstance(coupling, SpringDamper):
        _motion_path(drawing, coupling, UNITS[device.units])
    else:
        _force_path(drawing, device, coupling)
    _mechanism(drawing, device)  # before its arrow, because some PDF readers mix words at the same height
    _drive(drawing, device, gains)
    _feedback(drawing, device, gains)
    return drawing


def _force_path(drawing: Drawing, device: Device, coupling: Coupling) -> None:
    sensor, low, units = device.sensing, BOTTOM, UNITS[device.units]
    if not device.senses_late:
        _arrow(drawing, (LEFT, low), (LEFT, TOP), (COUPLING - WIDTH / 2, TOP))
    else:
        lines = [] if sensor.bandwidth_hz is None else [_low_pass(sensor.bandwidth_hz, sensor.order)]
        lines += [f"delay {_time(sensor.delay)}"] if sensor.delay > 0 else []
        _arrow(drawing, (LEFT, low), (LEFT, TOP - TALL / 2))
        _box(drawing, LEFT, TOP, f"{units.force_name} sensor", lines, colour=GREEN)
        _arrow(drawing, (LEFT + WIDTH / 2, TOP), (COUPLING - WIDTH / 2, TOP), label="f_s")
    (x, y) = _place(LEFT, low)
    drawing.over.append(path(f"M{x:.1f} {y:.1f}m-1.5 0a1.5 1.5 0 1 0 3 0a1.5 1.5 0 1 0-3 0z", fill=INK))
    _words(drawing, LEFT + 0.07, 1.6, "f_h", va="center")
    lines = [] if coupling.damping == inf else [f"b_c {quantity(coupling.damping, units.damping)}"]
    lines += [f"m_c {quantity(coupling.mass, units.mass)}"]
    lines += [f"b_0 {quantity(coupling.drag, units.damping)}"] if coupling.drag > 0 else []
    _box(drawing, COUPLING, TOP, "coupling and\nenvironment", lines, colour=BLUE)


def _servo_loop(drawing: Drawing, device: Device, servo: Servo, coupling: Coupling) -> None:
    """Draw the path from the hand's force to the motion, which follows only the command, and the path back to the
    hand."""
    low, edge = BOTTOM, LAW + WIDTH / 2
    _firmware(drawing, device, COUPLING + 0.95)
    _force_path(drawing, device, coupling)
    command = {"velocity": "v_cmd", "position": "x_cmd"}[servo.command]
    _arrow(drawing, (COUPLING + WIDTH / 2, TOP), (RIGHT - WIDTH / 2 - 0.35, TOP), label=command)
    held = {"velocity": "hold", "position": "interpolation"}[servo.command]
    lines = [f"{held} {_time(device.sample_time)}"]
    lines += [f"delay {_time(servo.delay)}"] if servo.delay > 0 else []
    lines += [_low_pass(servo.bandwidth_hz, servo.order)]
    _box(drawing, RIGHT - 0.175, TOP, "vendor's loop", lines, colour=GREEN, width=WIDTH + 0.35)
    _arrow(drawing, (RIGHT, TOP - TALL / 2), (RIGHT, low), (edge, low), label="")
    left = 1.25
    _arrow(drawing, (left, low), (HAND + 0.38, low))
    moves = {"linear": "moves as commanded", "rotary": "turns as commanded"}[device.units]
    _box(drawing, (left + edge) / 2, low, "arm", [f"{moves}, however the hand pushes"], width=edge - left)
    _box(drawing, HAND, low, "hand or\ncontact", [], width=0.76, colour=GREY)
    _words(drawing, (HAND + 0.38 + left) / 2, low - 0.06, "v_h", ha="center", va="top")


def _motion_path(drawing: Drawing, coupling: SpringDamper, units: Units) -> None:
    """Draw the path of the measured motion to the coupling. The path branches off after the velocity estimate."""
    _arrow(drawing, (LAW - WIDTH / 2, MIDDLE), (COUPLING, MIDDLE), (COUPLING, TOP - TALL / 2), label="x, v̂")
    lines = [f"k_c {quantity(coupling.stiffness, units.stiffness)}"]
    lines += [f"b_c {quantity(coupling.damping, units.damping)}"] if coupling.damping > 0 else []
    _box(drawing, COUPLING, TOP, "coupling and\nenvironment", lines, colour=BLUE)


def _drive(drawing: Drawing, device: Device, gains: Gains) -> None:
    units = UNITS[device.units]
    lines = [f"K_v {quantity(gains.velocity, units.damping)}"] if gains.velocity > 0 or device.kind.senses_force else []
    lines += [f"K_p {quantity(gains.position, units.stiffness)}"] if gains.position > 0 else []
    told, law = ("f_c", units.force_name) if not device.kind.senses_force else ("v_e", "velocity law")
    _arrow(drawing, (COUPLING + WIDTH / 2, TOP), (LAW - WIDTH / 2, TOP), label=told)
    _box(drawing, LAW, TOP, law, lines, colour=BLUE)
    _arrow(drawing, (LAW + WIDTH / 2, TOP), (RIGHT - WIDTH / 2, TOP))
    late = [f"delay {_time(device.delay)}"] if device.delay > 0 else []
    _box(
        drawing,
        RIGHT,
        TOP,
        "hold and delay" if late else "hold",
        [f"T {_time(device.sample_time)}", *late],
        colour=GREEN,
    )
    start = TOP
    if device.actuator is not None:
        _arrow(drawing, (RIGHT, TOP - TALL / 2), (RIGHT, MIDDLE + HEIGHT / 2))
        lines = [_low_pass(device.actuator.bandwidth_hz, device.actuator.order)]
        _box(drawing, RIGHT, MIDDLE, "actuator", lines, colour=GREEN)
        start = MIDDLE
    _arrow(
        drawing,
        (RIGHT, start - (TALL if start == TOP else HEIGHT) / 2),
        (RIGHT, BOTTOM),
        (LAW + WIDTH / 2, BOTTOM),
        label="u",
    )


def _mechanism(drawing: Drawing, device: Device) -> None:
    hand, units = device.operator, UNITS[device.units]
    least = [] if hand is None else [(hand.mass, units.mass), (hand.damping, units.damping)]
    lines = [str(quantity(number, unit, 3)) for number, unit in least if number > 0]
    _box(drawing, HAND, BOTTOM, "hand ≥" if lines else "hand", lines, width=0.76, colour=GREY)
    damping = str(quantity(device.damping, units.damping))
    if device.structure is None:
        left, right = 1.25, LAW + WIDTH / 2
        _arrow(drawing, (HAND + 0.38, BOTTOM), (left, BOTTOM), both=True)
        _box(
            drawing,
            (left + right) / 2,
            BOTTOM,
            "mechanism",
            [f"{quantity(device.mass, units.mass)}, {damping}"],
            width=right - left,
        )
        return
    structure, handle = device.structure, 1.85
    _arrow(drawing, (HAND + 0.38, BOTTOM), (handle - 0.6, BOTTOM), both=True)
    _box(drawing, handle, BOTTOM, "handle", [str(quantity(structure.handle_mass, units.mass))], width=1.2)
    _spring(drawing, handle + 0.6, LAW - WIDTH / 2, structure)
    _box(drawing, LAW, BOTTOM, "motor", [str(quantity(device.motor_mass, units.mass)), damping])


def _spring(drawing: Drawing, left: float, right: float, structure: Structure) -> None:
    x = np.linspace(left, right, 13)
    y = BOTTOM + 0.12 * np.array([0, 0, 1, -1, 1, -1, 1, -1, 1, -1, 1, 0, 0])
    _line(drawing, [*zip(x, y, strict=True)])
    words = f"{quantity(structure.frequency_hz, 'Hz')}\nζ {structure.damping_ratio:.3g}"
    _words(drawing, (left + right) / 2, BOTTOM - 0.2, words, ha="center", va="top", size=10)


def _feedback(drawing: Drawing, device: Device, gains: Gains) -> None:
    """Draw the feedback to the control law: the measured or estimated velocity, and the position if K_p > 0."""
    low, high, estimate = BOTTOM + HEIGHT / 2, TOP - TALL / 2, device.velocity
    if estimate is None:
        _arrow(drawing, (LAW, low), (LAW, high), label="v, x" if gains.position > 0 else "v")
        return
    lines = ["of the position"] if estimate.source == "difference" else []
    if estimate.filter_hz is not None:
        lines += [_low_pass(estimate.filter_hz, estimate.filter_order)]
    width, at = 1.06, LAW - WIDTH / 2 + 0.53
    title = "difference" if estimate.source == "difference" else "velocity filter"
    _arrow(drawing, (at, low), (at, MIDDLE - HEIGHT / 2), label="x" if estimate.source == "difference" else "v")
    _box(drawing, at, MIDDLE, title, lines, width=width, colour=GREEN)
    _arrow(drawing, (at, MIDDLE + HEIGHT / 2), (at, high), label="v̂")
    if gains.position > 0:
        _arrow(drawing, (POSITION_AT, low), (POSITION_AT, high), label="x")


def _firmware(drawing: Drawing, device: Device, right: float) -> None:
    left, low, high = COUPLING - 0.67, 1.36, 4.12
    _outline(drawing, (left, low), (right, high), GREY, 1.0, DASHES["--"])
    _words(drawing, left + 0.08, low + 0.08, f"firmware, every {_time(device.sample_time)}", va="bottom")


def _box(
    drawing: Drawing, x: float, y: float, title: str, lines: list[str], *, width: float = WIDTH, colour: str = INK
) -> None:
    height = TALL if y == TOP else HEIGHT
    _outline(drawing, (x - width / 2, y - height / 2), (x + width / 2, y + height / 2), colour, 1.4)
    rows = [*title.split("\n"), *lines]
    top = y + LINE * (len(rows) - 1) / 2
    for number, row in enumerate(rows):
        bold = number < title.count("\n") + 1
        size = 11 if bold else 10.5 * min(1.0, FITS * width / len(row))
        _words(drawing, x, top - LINE * number, row, size=size, ha="center", va="center", bold=bold)


def _arrow(drawing: Drawing, *points: tuple[float, float], label: str = "", both: bool = False) -> None:
    """Draw a polyline with an arrow head at its end, and a label beside the middle of its last part."""
    _line(drawing, points)
    (x_0, y_0), (x_1, y_1) = points[-2:]
    _head(drawing, points[-2], points[-1])
    if both:
        _head(drawing, points[-1], points[-2])
    upright = x_0 == x_1
    place = ((x_0 + x_1) / 2 + (0.07 if upright else 0), (y_0 + y_1) / 2 + (0 if upright else 0.06))
    if label:
        _words(drawing, *place, label, ha="left" if upright else "center", va="center" if upright else "bottom")


def _place(x: float, y: float) -> tuple[float, float]:
    """Return a place in the drawing, points from the upper left corner."""
    return 72 * x, 72 * (SIZE[1] - y)


def _line(drawing: Drawing, points: Sequence[tuple[float, float]]) -> None:
    drawing.over.append(path(polyline(np.array([_place(*point) for point in points])), stroke=INK))


def _outline(
    drawing: Drawing, low: tuple[float, float], high: tuple[float, float], colour: str, width: float,
    dashes: tuple[float, ...] = (),
) -> None:  # fmt: skip
    (x, y), (X, Y) = _place(*low), _place(*high)
    data = f"M{x:.1f} {y:.1f}H{X:.1f}V{Y:.1f}H{x:.1f}z"
    drawing.over.append(path(data, stroke=colour, width=width, dashes=dashes))


def _head(drawing: Drawing, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw the head of an arrow."""
    tip = np.array(_place(*end))
    along = tip - _place(*start)
    along *= HEAD / np.hypot(*along)
    across = 0.4 * np.array([-along[1], along[0]])
    drawing.over.append(path(polyline(np.array([tip, tip - along + across, tip - along - across, tip])), fill=INK))


def _words(drawing: Drawing, x: float, y: float, words: str, **style: Any) -> None:
    drawing.over.append(text(*_place(x, y), words, **{"size": 9.0} | style))


def _low_pass(corner_hz: float, order: int) -> str:
    return str(quantity(corner_hz, "Hz")) + (f", order {order}" if order > 1 else "")


def _time(seconds: float) -> str:
    return str(quantity(seconds, "s"))
