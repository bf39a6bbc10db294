"""Write the controller as C99: vctune_controller.h and vctune_controller.c."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple
from typing import Any

from vctune.firmware.c_text import code, comment, literal
from vctune.firmware.firmware import Firmware, certified
from vctune.firmware.preamble import statement
from vctune.model.numbers.keys import QUANTITIES, SYMBOLS
from vctune.model.numbers.units import Units
from vctune.simulation.firmware import equations
from vctune.simulation.firmware.equations import COEFFICIENTS, COMMANDS, INPUTS, STATE, Equation, Parts, Quantity
from vctune.simulation.firmware.expression import Symbol

# The names of the coefficients of a built-in environment
BUILT_IN = ("inertance", "inertia_carry", "stiffness", "zero", "slope", "least_contact")
LIMITING = ("limit", "position_reach")  # The names of the coefficients that limit the force
# The remark on units in the head of the C header, for a linear and for a rotary device
SYSTEM = {
    "linear": "SI units; of a rotary device kg m^2, N m and rad in place of\n * kg, N and m.",
    "rotary": "SI units of a rotary device: kg m2, N m and rad; its\n * force is a torque, its mass an inertia.",
}
GAINS = "velocity_gain", "position_gain"  # The names of the coefficients that are gains of the design
WIDTH = 118  # Greatest width of a line of C, characters


def c_source(firmware: Firmware) -> dict[str, str]:
    """Return the texts of vctune_controller.h and vctune_controller.c."""
    variables = {**names_and_numbers(firmware), **_code(firmware)}
    return {name: rendered_template(name, variables) for name in ("vctune_controller.h", "vctune_controller.c")}


def rendered_template(name: str, variables: dict[str, Any]) -> str:
    """Fill in the variables of a template in the folder templates/, and return the text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(  # C and XML need no HTML escaping
        loader=PackageLoader("vctune.firmware"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return templates.get_template(f"{name}.j2").render(variables)


def names_and_numbers(firmware: Firmware) -> dict[str, Any]:
    """Return the variables that describe a design in the templates, except for the equations."""
    double = firmware.precision == "double"
    # " * " begins each line of a C comment
    top = "\n".join(f" * {line}".rstrip() for text in statement(firmware) for line in comment(text) or [""])
    T, numbers = firmware.device.sample_time, (*astuple(firmware.coupling), *astuple(firmware.gains))
    # the keys in the order of `numbers`; a servo has no stated gains, so its gains of 0 have no key
    keys = [key for key in firmware.device.kind.stated if key.startswith("coupling")]
    keys += [key for key in firmware.device.kind.stated if key.startswith("gains")]
    stated = [
        (SYMBOLS[key], number, firmware.units.of(QUANTITIES[key])) for key, number in zip(keys, numbers, strict=False)
    ]
    stated.append(("T", T, "s"))
    command, reads = COMMANDS[firmware.parts.command], reads_of(firmware)
    design = [
        (name.upper(), firmware.coefficients[name], COEFFICIENTS[name].symbol, COEFFICIENTS[name].unit(firmware.units))
        for name in GAINS
        if name in firmware.coefficients
    ]
    constants = [
        (name.upper(), number, COEFFICIENTS[name].symbol, COEFFICIENTS[name].unit(firmware.units))
        for name, number in firmware.coefficients.items()
        if name not in GAINS and (name != "smoothing" or firmware.parts.low_passes)
    ]
    return {
        "top": top,
        "period": f"{round(T * 1e9)}",
        "sample_time": repr(T),
        "double": double,
        "real": "double" if double else "float",
        "zero": literal(0.0, firmware.precision),
        "one": literal(1.0, firmware.precision),
        "two": literal(2.0, firmware.precision),
        "problem_sha256": firmware.problem_sha256,
        "design_sha256": firmware.design_sha256,
        "proved": certified(firmware),
        "integrator": firmware.gains.position > 0,
        "force": not firmware.parts.spring,
        "units": firmware.units,
        "system": SYSTEM[firmware.device.units],
        "limited": limiting(firmware),
        "difference": firmware.parts.difference,
        "start_head": _start_head(firmware),
        "reads": reads,
        "reads_in_words": _listed([firmware.units.force_name if name == "force" else name for name in reads]),
        "columns": {_short(quantity): column for column, quantity in enumerate(INPUTS)},
        "command": firmware.parts.command,
        "command_unit": command.unit(firmware.units),
        "law_told": firmware.units.translated(_law_comment(firmware)),
        "design": [
            *(f"/* {name} = {number!r} {unit} */" for name, number, unit in stated),
            *_defined(firmware, design),
        ],
        "constants": _defined(firmware, constants),
    }


def _start_head(firmware: Firmware) -> str:
    """Return the head of the function vctune_start."""
    first = "vctune_real position, " if firmware.parts.difference else ""
    last = ", vctune_real limit" if limiting(firmware) else ""
    indent = " " * len("vctune_state vctune_start(")
    second_line = f"{indent}vctune_environment_function render, void *environment)"
    return f"vctune_state vctune_start({first}vctune_real reference{last},\n{second_line}"


def _law_comment(firmware: Firmware) -> str:
    """Return the comment on the last block of a step, which computes the command."""
    if not firmware.parts.limit:
        return f"The coupling, and the {firmware.parts.command} that the servo is to follow."
    return "The force against the coupling." if firmware.parts.spring else "The law on the velocity error."


def _listed(words: list[str]) -> str:
    """Return one or more words in the form "a, b and c"."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _defined(firmware: Firmware, constants: list[tuple[str, float, str, str]]) -> list[str]:
    """Return constants as aligned lines of the C preprocessor, each with its meaning and unit."""
    rows = [
        (f"#define VCTUNE_{name} ({literal(number, firmware.precision)})", meaning, unit)
        for name, number, meaning, unit in constants
    ]
    width = max((len(row[0]) for row in rows), default=0)
    return [f"{text:<{width}} /* {meaning}, {unit} */" for text, meaning, unit in rows]


def _code(firmware: Firmware) -> dict[str, Any]:
    """Return the variables of the templates that contain C: the equations, the fields of structs and the start
    values."""
    blocks, step = _blocks(firmware.parts), ("estimate", "drive", "law")
    kept = [name for name in state_names(firmware) if name != "desired"]
    names = _names(firmware, blocks)
    return {
        **{name: _lines(blocks[name], names, firmware) for name in step},
        "render": _lines(blocks["environment"], _environment_names(names), firmware),
        "measurement": _fields({_short(quantity): quantity for quantity in inputs_of(firmware)}, firmware.units),
        "built_in": _fields({name: (COEFFICIENTS | STATE)[name] for name in (*BUILT_IN, "inertia")}, firmware.units),
        "state": _fields(
            {name: (STATE | COEFFICIENTS)[name] for name in (*state_names(firmware), *limiting(firmware))},
            firmware.units,
        ),
        "start": [f"state.{name} = {_start_value(name, firmware)};" for name in state_names(firmware)],
        "remember": [f"state->{name} = {name};" for name in ("desired", *kept)],
    }


def state_names(firmware: Firmware) -> list[str]:
    """Return the names of a firmware's state variables."""
    return [name for name in equations.remembered(firmware.parts) if name != "inertia"]


def limiting(firmware: Firmware) -> tuple[str, ...]:
    """Return the names of the coefficients with which a firmware limits its force; empty for a servo."""
    if not firmware.parts.limit:
        return ()
    return LIMITING[:1] if firmware.parts.spring else LIMITING


def inputs_of(firmware: Firmware) -> list[Quantity]:
    """Return the inputs that a firmware's equations use."""
    used_names = _used(_blocks(firmware.parts))
    return [quantity for quantity in INPUTS if quantity.name in used_names]


def reads_of(firmware: Firmware) -> list[str]:
    """Return the names of the measurement's fields that a firmware reads."""
    return [_short(quantity) for quantity in inputs_of(firmware)]


def _blocks(parts: Parts) -> dict[str, list[Equation]]:
    """Return the equations of a firmware by the name of their block in `equations`."""
    return {name: list(getattr(equations, name)(parts)) for name in ("estimate", "drive", "law", "environment")}


def _used(blocks: dict[str, list[Equation]]) -> set[str]:
    """Return the names that occur on the right-hand sides of equations."""
    names, terms = set(), [equation.right for block in blocks.values() for equation in block]
    while terms:
        term = terms.pop()
        if isinstance(term, Symbol):
            names.add(term.name)
        else:
            terms += getattr(term, "operands", ())
    return names


def _short(quantity: Quantity) -> str:
    """Return the name of an input in C, such as "position" for `measured_position`."""
    return quantity.name.removeprefix("measured_")


def _start_value(name: str, firmware: Firmware) -> str:
    """Return the C expression of a state variable's start value: an argument of vctune_start, or 0."""
    return {"reference": "reference", "measured": "position"}.get(name, literal(0.0, firmware.precision))


def _fields(quantities: dict[str, Quantity], units: Units) -> list[str]:
    """Return quantities as fields of a struct, with aligned comments."""
    width = max(len(name) for name in quantities)
    return [
        f"vctune_real {name};{' ' * (width - len(name))} /* {_meaning(quantity, units)} */"
        for name, quantity in quantities.items()
    ]


def _meaning(quantity: Quantity, units: Units) -> str:
    return f"{quantity.symbol}, {quantity.unit(units)}: {units.translated(quantity.meaning)}"


def _names(firmware: Firmware, blocks: dict[str, list[Equation]]) -> dict[Symbol, str]:
    """Return the C names of symbols in vctune_step."""
    local = {Symbol(equation.quantity.name): equation.quantity.name for block in blocks.values() for equation in block}
    return {
        **{Symbol(name): f"VCTUNE_{name.upper()}" for name in firmware.coefficients},
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


def _lines(block: Iterable[Equation], names: dict[Symbol, str], firmware: Firmware) -> list[str]:
    """Return equations as declarations, each with a comment on its meaning."""
    lines = []
    for equation in block:
        quantity = equation.quantity
        line = f"const vctune_real {quantity.name} = {code(equation.right, names, firmware.precision)};"
        meaning = f"/* {_meaning(quantity, firmware.units)} */"
        lines += [f"{line} {meaning}"] if len(line) + len(meaning) + 5 <= WIDTH else [meaning, *_wrapped(line)]
    return lines


def _wrapped(line: str) -> list[str]:
    """Return a long line as two or more lines, broken before operators."""
    if len(line) + 4 <= WIDTH:
        return [line]
    places = [at for at in range(WIDTH // 4, WIDTH - 4) if line[at : at + 3] in (" + ", " - ", " ? ", " : ")]
    at = min(places, key=lambda at: (line[:at].count("(") - line[:at].count(")"), -at))  # only outside of parentheses
    return [line[:at], *_wrapped(f"    {line[at + 1 :]}")]
