"""Write the controller as C99: vctune_controller.h and vctune_controller.c."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

from vctune.firmware.firmware import Firmware, certified, comment, literal
from vctune.firmware.preamble import rendered, statement
from vctune.model.numbers.units import OF_KEYS

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
    "smoothing": ("a_f", ""),
}
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
    constants = [name for name in firmware.coefficients if name != "smoothing" or c.low_passes]
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
        "low_passes": c.low_passes,
        "start_head": _start_head(c.difference, limited),
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
    motion = [] if c.command != "force" else ["position", *([] if c.difference else ["velocity"])]
    return motion if c.spring else [*motion, "force"]


def _start_head(difference: bool, limited: bool) -> str:
    """Return the head of the function vctune_start."""
    first, last = "vctune_real position, " if difference else "", ", vctune_real limit" if limited else ""
    indent = " " * len("vctune_state vctune_start(")
    second_line = f"{indent}vctune_environment_function render, void *environment)"
    return f"vctune_state vctune_start({first}vctune_real reference{last},\n{second_line}"


def _stated(firmware: Firmware) -> list[str]:
    """Return the decimals of the design as comments. The gains of a servo, which are 0, are not stated."""
    keys = [key for part in ("coupling", "gains") for key in firmware.device.kind.stated if key.startswith(part)]
    kind = firmware.device.kind
    of_key = dict(zip(kind.keys, (*astuple(firmware.gains), *astuple(firmware.coupling)), strict=True))
    rows = [(kind.symbol(key), of_key[key], firmware.units.of(OF_KEYS[key])) for key in keys]
    return [
        f"/* {name} = {number!r} {unit} */" for name, number, unit in [*rows, ("T", firmware.device.sample_time, "s")]
    ]


def _defined(firmware: Firmware, names: list[str]) -> list[str]:
    """Return constants as aligned lines of the C preprocessor, each with its symbol and unit."""
    texts = [
        f"#define VCTUNE_{name.upper()} ({literal(firmware.coefficients[name], firmware.precision)})" for name in names
    ]
    told = [f"{symbol}, {firmware.units.of(of) or '1'}" for symbol, of in map(CONSTANTS.__getitem__, names)]
    width = max(map(len, texts), default=0)
    return [f"{text:<{width}} /* {meaning} */" for text, meaning in zip(texts, told, strict=True)]
