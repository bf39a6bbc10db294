"""Write the controller as C99: vctune_controller.h and vctune_controller.c."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple
from typing import Any

from vctune.firmware.c_text import code, comment, literal, operations
from vctune.firmware.firmware import Firmware, certified
from vctune.firmware.preamble import statement
from vctune.model.numbers.keys import QUANTITIES, SYMBOLS
from vctune.model.numbers.units import Units
from vctune.simulation.firmware import equations
from vctune.simulation.firmware.equations import COEFFICIENTS, COMMANDS, INPUTS, STATE, Equation, Parts, Quantity
from vctune.simulation.firmware.expression import Symbol

BUILT_IN = ("inertance", "inertia_carry", "stiffness", "zero", "slope", "least_contact")
"""Names of the coefficients of a built-in environment."""
LIMITING = ("limit", "position_reach")
"""Names of the coefficients of a limited force. Impedance displays and servos have no `reach`, because nothing winds
up."""
SYSTEM = {
    "linear": "SI units; of a rotary device kg m^2, N m and rad in place of\n * kg, N and m.",
    "rotary": "SI units of a rotary device: kg m2, N m and rad; its\n * force is a torque, its mass an inertia.",
}
"""Remark on units in the head of a C header, by the motion of the device."""
GAINS = "velocity_gain", "position_gain"
WIDTH = 118
"""Greatest width of a line of C, characters."""


def c_source(made: Firmware) -> dict[str, str]:
    """Return the texts of vctune_controller.h and vctune_controller.c.

    Parameters
    ----------
    made : the design as firmware
    """
    given = {**names_and_numbers(made), **_code(made)}
    return {name: rendered_template(name, given) for name in ("vctune_controller.h", "vctune_controller.c")}


def rendered_template(name: str, given: dict[str, Any]) -> str:
    """Return a text of the folder templates/ with its variables filled in.

    Parameters
    ----------
    name : name of the template without .j2
    given : variables of the template
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(  # C and XML need no HTML escaping
        loader=PackageLoader("vctune.firmware"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return templates.get_template(f"{name}.j2").render(given)


def names_and_numbers(made: Firmware) -> dict[str, Any]:
    """Return the data of a design for the templates, except for the equations."""
    double = made.precision == "double"
    top = "\n".join(f" * {line}".rstrip() for text in statement(made) for line in comment(text) or [""])
    T, numbers = made.device.sample_time, (*astuple(made.coupling), *astuple(made.gains))
    keys = [key for key in made.device.kind.stated if key.startswith("coupling")]
    keys += [key for key in made.device.kind.stated if key.startswith("gains")]
    stated = [
        (SYMBOLS[key], number, made.units.of(QUANTITIES[key])) for key, number in zip(keys, numbers, strict=False)
    ]
    stated.append(("T", T, "s"))
    command, reads = COMMANDS[made.parts.command], reads_of(made)
    design = [
        (name.upper(), made.coefficients[name], COEFFICIENTS[name].symbol, COEFFICIENTS[name].unit(made.units))
        for name in GAINS
        if name in made.coefficients
    ]
    constants = [
        (name.upper(), number, COEFFICIENTS[name].symbol, COEFFICIENTS[name].unit(made.units))
        for name, number in made.coefficients.items()
        if name not in GAINS and (name != "smoothing" or made.parts.low_passes)
    ]
    return {
        "top": top,
        "period": f"{round(T * 1e9)}",
        "sample_time": repr(T),
        "double": double,
        "real": "double" if double else "float",
        "zero": literal(0.0, made.precision),
        "one": literal(1.0, made.precision),
        "two": literal(2.0, made.precision),
        "problem_sha256": made.problem_sha256,
        "design_sha256": made.design_sha256,
        "proved": certified(made),
        "integrator": made.gains.position > 0,
        "force": not made.parts.spring,
        "units": made.units,
        "system": SYSTEM[made.device.units],
        "limited": limiting(made),
        "difference": made.parts.difference,
        "start_head": _start_head(made),
        "reads": reads,
        "reads_in_words": _listed([made.units.force_name if name == "force" else name for name in reads]),
        "columns": {_short(one): column for column, one in enumerate(INPUTS)},
        "command": made.parts.command,
        "command_unit": command.unit(made.units),
        "law_told": made.units.translated(_law_told(made)),
        "design": [
            *(f"/* {name} = {number!r} {unit} */" for name, number, unit in stated),
            *_defined(made, design),
        ],
        "constants": _defined(made, constants),
    }


def _start_head(made: Firmware) -> str:
    """Return the head of the function vctune_start.

    Only a differenced velocity needs the start position of the motor.
    """
    first = "vctune_real position, " if made.parts.difference else ""
    last = ", vctune_real limit" if limiting(made) else ""
    indent = " " * len("vctune_state vctune_start(")
    rest = f"{indent}vctune_environment_function render, void *environment)"
    return f"vctune_state vctune_start({first}vctune_real reference{last},\n{rest}"


def _law_told(made: Firmware) -> str:
    """Return comments on the last equations of a step."""
    if not made.parts.limit:
        return f"The coupling, and the {made.parts.command} that the servo is to follow."
    return "The force against the coupling." if made.parts.spring else "The law on the velocity error."


def _listed(words: list[str]) -> str:
    """Return words in the form "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _defined(made: Firmware, constants: list[tuple[str, float, str, str]]) -> list[str]:
    rows = [
        (f"#define VCTUNE_{name} ({literal(number, made.precision)})", told, unit)
        for name, number, told, unit in constants
    ]
    width = max((len(row[0]) for row in rows), default=0)
    return [f"{text:<{width}} /* {told}, {unit} */" for text, told, unit in rows]


def _code(made: Firmware) -> dict[str, Any]:
    blocks, step = _blocks(made.parts), ("estimate", "drive", "law")
    kept = [name for name in state_names(made) if name != "desired"]
    names = _names(made, blocks)
    counted = operations(equation for block in blocks.values() for equation in block)
    return {
        **{name: _lines(blocks[name], names, made) for name in step},
        "render": _lines(blocks["environment"], _environment_names(names), made),
        "counted": ", ".join(
            f"{counted[kind]} {kind}" for kind in ("additions", "multiplications", "divisions", "comparisons")
        ),
        "measurement": _fields({_short(one): one for one in inputs_of(made)}, made.units),
        "built_in": _fields({name: (COEFFICIENTS | STATE)[name] for name in (*BUILT_IN, "inertia")}, made.units),
        "state": _fields(
            {name: (STATE | COEFFICIENTS)[name] for name in (*state_names(made), *limiting(made))}, made.units
        ),
        "start": [f"state.{name} = {_begin(name, made)};" for name in state_names(made)],
        "remember": [f"state->{name} = {name};" for name in ("desired", *kept)],
    }


def state_names(made: Firmware) -> list[str]:
    """Return the names of a firmware's state variables, without those of an environment's mass."""
    return [name for name in equations.remembered(made.parts) if name != "inertia"]


def limiting(made: Firmware) -> tuple[str, ...]:
    """Return the names of the coefficients with which a firmware limits its force."""
    if not made.parts.limit:
        return ()
    return LIMITING[:1] if made.parts.spring else LIMITING


def inputs_of(made: Firmware) -> list[Quantity]:
    """Return the inputs of a firmware."""
    known = _used(_blocks(made.parts))
    return [one for one in INPUTS if one.name in known]


def reads_of(made: Firmware) -> list[str]:
    """Return the inputs of a firmware, by the field names of the measurement."""
    return [_short(one) for one in inputs_of(made)]


def _blocks(parts: Parts) -> dict[str, list[Equation]]:
    return {name: list(getattr(equations, name)(parts)) for name in ("estimate", "drive", "law", "environment")}


def _used(blocks: dict[str, list[Equation]]) -> set[str]:
    """Return the names that occur on the right-hand sides of equations."""
    found, terms = set(), [equation.right for block in blocks.values() for equation in block]
    while terms:
        term = terms.pop()
        if isinstance(term, Symbol):
            found.add(term.name)
        else:
            terms += getattr(term, "operands", ())
    return found


def _short(quantity: Quantity) -> str:
    return quantity.name.removeprefix("measured_")


def _begin(name: str, made: Firmware) -> str:
    return {"reference": "reference", "measured": "position"}.get(name, literal(0.0, made.precision))


def _fields(quantities: dict[str, Quantity], units: Units) -> list[str]:
    """Return quantities as fields of a struct, with aligned comments."""
    width = max(len(name) for name in quantities)
    return [
        f"vctune_real {name};{' ' * (width - len(name))} /* {_told(one, units)} */" for name, one in quantities.items()
    ]


def _told(quantity: Quantity, units: Units) -> str:
    return f"{quantity.symbol}, {quantity.unit(units)}: {units.translated(quantity.meaning)}"


def _names(made: Firmware, blocks: dict[str, list[Equation]]) -> dict[Symbol, str]:
    """Return the C names of symbols in vctune_step."""
    local = {Symbol(equation.quantity.name): equation.quantity.name for block in blocks.values() for equation in block}
    return {
        **{Symbol(name): f"VCTUNE_{name.upper()}" for name in made.coefficients},
        **{Symbol(quantity.name): f"measurement->{_short(quantity)}" for quantity in INPUTS},
        **{Symbol(name, before=True): f"state->{name}" for name in STATE},
        **{Symbol(name): f"state->{name}" for name in LIMITING},
        **local,
    }


def _environment_names(names: dict[Symbol, str]) -> dict[Symbol, str]:
    """Return the C names of symbols in vctune_render."""
    return {
        **names,
        **{Symbol(name): f"built_in->{name}" for name in BUILT_IN},
        Symbol("inertia", before=True): "built_in->inertia",
        Symbol("desired", before=True): "velocity_before",
        Symbol("resistance"): "resistance",
    }


def _lines(block: Iterable[Equation], names: dict[Symbol, str], made: Firmware) -> list[str]:
    """Return equations as declarations, each with a comment on its meaning."""
    lines = []
    for equation in block:
        quantity = equation.quantity
        line = f"const vctune_real {quantity.name} = {code(equation.right, names, made.precision)};"
        told = f"/* {_told(quantity, made.units)} */"
        lines += [f"{line} {told}"] if len(line) + len(told) + 5 <= WIDTH else [told, *_wrapped(line)]
    return lines


def _wrapped(line: str) -> list[str]:
    """Return a long line as two or more lines, broken before operators."""
    if len(line) + 4 <= WIDTH:
        return [line]
    places = [at for at in range(WIDTH // 4, WIDTH - 4) if line[at : at + 3] in (" + ", " - ", " ? ", " : ")]
    at = min(places, key=lambda at: (line[:at].count("(") - line[:at].count(")"), -at))  # only outside of parentheses
    return [line[:at], *_wrapped(f"    {line[at + 1 :]}")]
