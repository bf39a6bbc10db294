"""Write the controller as C99: vctune_controller.h and vctune_controller.c."""

from __future__ import annotations

from dataclasses import astuple
from functools import partial
from typing import Any

from vctune.firmware.firmware import FILTERS, Firmware, certified, comment, literal
from vctune.firmware.preamble import rendered, statement
from vctune.model.numbers.matrices import nothing
from vctune.model.numbers.units import OF_KEYS
from vctune.simulation.controller import memory_of

# Symbol and quantity of each coefficient that is a constant of the C code
CONSTANTS = {
    "velocity_gain": ("K_v", "damping"),
    "position_gain": ("K_p", "stiffness"),
    "sample_time": ("T", "time"),
    "half_sample_time": ("T/2", "time"),
    "coupling_step": ("b_c/(1 + a)", "damping"),
    "coupling_decay": ("(1 - a)/(1 + a)", ""),
    "coupling_stiffness": ("k_c", "stiffness"),
    "coupling_damping": ("b_c", "damping"),
    "resistance": ("R_v", "damping"),
    "own_stiffness": ("k_s", "stiffness"),
}
# Symbol of each coefficient of a section
OF_SECTION = {"now": "b_0", "before": "b_1", "earlier": "b_2", "again": "a_2"}
COMMANDED = {"force": "force", "velocity": "speed", "position": "position"}  # Quantity of each command
# The remark on units in the head of the C header, for a linear and for a rotary device
SYSTEM = {
    "linear": "SI units; of a rotary device kg m^2, N m and rad in place of\n * kg, N and m.",
    "rotary": "SI units of a rotary device: kg m2, N m and rad; its\n * force is a torque, its mass an inertia.",
}


def c_source(firmware: Firmware) -> dict[str, str]:
    """Return the texts of vctune_controller.h and vctune_controller.c."""
    given = variables(firmware)
    return {name: rendered_template(name, given) for name in ("vctune_controller.h", "vctune_controller.c")}


def rendered_template(name: str, given: dict[str, Any]) -> str:
    """Fill in the variables of a template in the folder templates/, and return the text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(  # C needs no HTML escaping
        loader=PackageLoader("vctune.firmware"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return templates.get_template(f"{name}.j2").render(given)


def variables(firmware: Firmware) -> dict[str, Any]:
    """Return the variables of the templates."""
    c, units, device, precision = firmware.controller, firmware.units, firmware.device, firmware.precision
    # " * " begins each line of a C comment
    top = "\n".join(f" * {line}".rstrip() for text in statement(firmware) for line in comment(text) or [""])
    T, limited = device.sample_time, c.command == "force"
    reads = reads_of(firmware)
    words = [units.force_name if name == "force" else name for name in reads]
    constants = list(firmware.coefficients)
    gains = [name for name in constants if name.endswith("_gain")]
    return {
        "top": top,
        "period": f"{round(T * 1e9)}",
        "sample_time": repr(T),
        "double": precision == "double",
        "real": "double" if precision == "double" else "float",
        **{name: literal(number, precision) for name, number in (("zero", 0.0), ("one", 1.0), ("two", 2.0))},
        "problem_sha256": firmware.problem_sha256,
        "design_sha256": firmware.design_sha256,
        "proved": certified(firmware),
        **{name: "\n".join(f" * {line}" for line in comment(text)) for name, text in rendered(firmware).items()},
        "units": units,
        "system": SYSTEM[device.units],
        "limited": limited,
        "law": limited and not c.spring,
        "integrator": firmware.gains.position > 0,
        "spring": c.spring,
        "euler": c.euler,
        "difference": c.difference,
        "filters": {name: [one.low_pass for one in getattr(c, name)] for name in FILTERS if getattr(c, name)},
        "memory": {name: sum(map(memory_of, getattr(c, name))) for name in FILTERS},
        "terms": partial(_terms, firmware),
        "own_spring": c.own_stiffness > 0,
        "started": started_with(firmware),
        "start_head": _start_head(firmware),
        "reads": reads,
        "reads_in_words": " and ".join([*([", ".join(words[:-1])] if words[1:] else []), words[-1]]),
        "columns": {"position": 0, "velocity": 1, "force": 2},
        "command": c.command,
        "command_unit": units.of(COMMANDED[c.command]),
        "design": [*_stated(firmware), *_defined(firmware, gains)],
        "constants": _defined(firmware, [name for name in constants if name not in gains]),
    }


def reads_of(firmware: Firmware) -> list[str]:
    """Return the names of the measurement's fields that a firmware reads."""
    c = firmware.controller
    motion = ["position", *([] if c.difference else ["velocity"])]
    if c.command != "force":
        motion = ["position"] if c.own_stiffness > 0 else []
    return motion if c.spring else [*motion, "force"]


def _terms(firmware: Firmware, name: str, place: int) -> str:
    """Return what a section adds to a low-pass, in C, in the order of the simulation."""
    section = getattr(firmware.controller, name)[place]
    of = {"before": "(memory[2] - y)", "earlier": "(memory[3] - y)", "again": "(y - memory[1])"}
    each = (key for key in of if not nothing(getattr(section, key)))
    return " + ".join(f"VCTUNE_{name.upper()}_{place}_{key.upper()} * {of[key]}" for key in each)


def started_with(firmware: Firmware) -> list[str]:
    """Return the names of the numbers with which the function vctune_start is called."""
    c = firmware.controller
    position = ["position"] if c.difference or c.own_stiffness > 0 else []
    force = ["force"] if c.force_filter else []
    return [*position, "reference", *force, *(["limit"] if c.command == "force" else [])]


def _start_head(firmware: Firmware) -> str:
    """Return the head of the function vctune_start."""
    numbers = ", ".join(f"vctune_real {name}" for name in started_with(firmware))
    indent = " " * len("vctune_state vctune_start(")
    second_line = f"{indent}vctune_environment_function render, void *environment)"
    return f"vctune_state vctune_start({numbers},\n{second_line}"


def _stated(firmware: Firmware) -> list[str]:
    """Return the decimals of the design as comments. The gains of a servo, which are 0, are not stated."""
    keys = [key for part in ("coupling", "gains") for key in firmware.device.kind.stated if key.startswith(part)]
    kind = firmware.device.kind
    of_key = dict(zip(kind.keys, (*astuple(firmware.gains), *astuple(firmware.coupling)), strict=True))
    rows = [(kind.symbol(key), of_key[key], firmware.units.of(OF_KEYS[key])) for key in keys]
    return [
        f"/* {name} = {number!r} {unit} */" for name, number, unit in [*rows, ("T", firmware.device.sample_time, "s")]
    ]


def _meaning(name: str) -> tuple[str, str]:
    """Return the symbol and the quantity of a constant."""
    return CONSTANTS.get(name) or (OF_SECTION[name.rpartition("_")[-1]], "")


def _defined(firmware: Firmware, names: list[str]) -> list[str]:
    """Return constants as aligned lines of the C preprocessor, each with its symbol and unit."""
    texts = [
        f"#define VCTUNE_{name.upper()} ({literal(firmware.coefficients[name], firmware.precision)})" for name in names
    ]
    told = [f"{symbol}, {firmware.units.of(of) or '1'}" for symbol, of in map(_meaning, names)]
    width = max(map(len, texts), default=0)
    return [f"{text:<{width}} /* {meaning} */" for text, meaning in zip(texts, told, strict=True)]
