"""The page of an exported controller: block diagram, coefficients and difference equations."""

from __future__ import annotations

from typing import Any

from vctune.model.device import Device
from vctune.model.gains import AnyCoupling, Gains
from vctune.model.numbers.units import UNITS
from vctune.report.figures.diagram import loop_figure
from vctune.report.page.page import inline_svg
from vctune.report.page.templates import templates

# Titles of a controller's blocks, in the order in which the firmware executes them
BLOCKS = {
    "estimate": "Velocity estimate",
    "drive": "Coupling, before the environment",
    "environment": "Environment, built in",
    "law": "Coupling, and control law of the velocity error",
}
# Titles for a servo, whose motion the vendor's loop controls
FOLLOWED = BLOCKS | {"law": "Coupling, and the command that the servo follows"}


def controller_page(controller: dict[str, Any], device: Device, gains: Gains, coupling: AnyCoupling) -> str:
    """Return the HTML of a controller, one page without external files."""
    titles, written = BLOCKS if device.kind.own_loop else FOLLOWED, controller["equations"]
    blocks = {title: [one for one in written if one["block"] == block] for block, title in titles.items()}
    read = [name.removeprefix("measured_") for name in controller["inputs"]]
    *others, last = [UNITS[device.units].translated(name) for name in read]
    diagram = inline_svg(loop_figure(device, gains, coupling).svg("controller"), "The loop as a block diagram")
    return (
        templates()
        .get_template("controller.html.j2")
        .render(
            controller=controller,
            blocks={title: equations for title, equations in blocks.items() if equations},
            diagram=diagram,
            doubt=controller.get("not_proved", ""),
            reads=f"{', '.join(others)} and {last}" if others else last,
        )
    )
