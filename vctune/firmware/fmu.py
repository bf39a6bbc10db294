"""Write the controller as an FMU: FMI 2.0 for co-simulation, with C sources and a binary for 64-bit Linux."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any
from uuid import UUID
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from vctune.document.text.errors import InputError, printable
from vctune.firmware.c_source import c_source, names_and_numbers, rendered_template
from vctune.firmware.firmware import Firmware, certified
from vctune.firmware.preamble import not_proved, statement
from vctune.simulation.firmware.equations import COMMANDS
from vctune.version import __version__

COMPILERS = ("cc", "gcc", "clang")  # Names of C compilers
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")  # Options of the compiler
EPOCH = (1980, 1, 1, 0, 0, 0)  # Date of every file in the archive
# The names of the variables that the FMU of a servo lacks: the motor's motion and the limit of its force
ABSENT_OF_SERVO = ("position", "velocity", "limit", "start_position")
# The real variables: name, kind of quantity (`vctune.model.numbers.units`), causality and meaning, in the words of a
# linear device
REALS = (
    ("position", "position", "input", "position of the motor"),
    ("velocity", "speed", "input", "velocity of the motor"),
    ("force", "force", "input", "sensed force of the hand"),
    ("command", "", "output", ""),
    ("environment_force", "force", "output", "force of the environment"),
    ("limit", "force", "parameter", "greatest force; 0 for none"),
    ("environment_mass", "mass", "parameter", "mass of the environment"),
    ("environment_damping", "damping", "parameter", "damping of the environment"),
    ("environment_stiffness", "stiffness", "parameter", "stiffness of the environment"),
    ("environment_zero", "position", "parameter", "where the environment's spring is without force"),
    ("start_position", "position", "parameter", "where the motor starts"),
    ("start_reference", "position", "parameter", "where the environment starts"),
)
# The dimension of each quantity's unit as attributes of FMI's BaseUnit, for a linear and for a rotary device
DIMENSIONS = {
    "linear": {
        "position": 'm="1"',
        "speed": 'm="1" s="-1"',
        "force": 'kg="1" m="1" s="-2"',
        "mass": 'kg="1"',
        "damping": 'kg="1" s="-1"',
        "stiffness": 'kg="1" s="-2"',
    },
    "rotary": {
        "position": 'rad="1"',
        "speed": 's="-1" rad="1"',
        "force": 'kg="1" m="2" s="-2"',
        "mass": 'kg="1" m="2"',
        "damping": 'kg="1" m="2" s="-1" rad="-1"',
        "stiffness": 'kg="1" m="2" s="-2" rad="-1"',
    },
}
# The Boolean variables, all parameters: name and meaning
BOOLEANS = (
    ("wall", "whether damping and stiffness only push, towards negative positions"),
    ("trapezoidal", "whether the environment follows the trapezoidal rule, not backward Euler; then it is no wall"),
)
# Functions that the standard requires but that a controller does not use, with their arguments
ABSENT = {
    "fmi2GetInteger": "fmi2Component c, const fmi2ValueReference at[], size_t count, fmi2Integer value[]",
    "fmi2SetInteger": "fmi2Component c, const fmi2ValueReference at[], size_t count, const fmi2Integer value[]",
    "fmi2GetString": "fmi2Component c, const fmi2ValueReference at[], size_t count, fmi2String value[]",
    "fmi2SetString": "fmi2Component c, const fmi2ValueReference at[], size_t count, const fmi2String value[]",
    "fmi2GetFMUstate": "fmi2Component c, fmi2FMUstate *state",
    "fmi2SetFMUstate": "fmi2Component c, fmi2FMUstate state",
    "fmi2FreeFMUstate": "fmi2Component c, fmi2FMUstate *state",
    "fmi2SerializedFMUstateSize": "fmi2Component c, fmi2FMUstate state, size_t *size",
    "fmi2SerializeFMUstate": "fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size",
    "fmi2DeSerializeFMUstate": "fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state",
    "fmi2GetDirectionalDerivative": "fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, "
    "const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[], fmi2Real derivative[]",
    "fmi2SetRealInputDerivatives": "fmi2Component c, const fmi2ValueReference at[], size_t count, "
    "const fmi2Integer order[], const fmi2Real value[]",
    "fmi2GetRealOutputDerivatives": "fmi2Component c, const fmi2ValueReference at[], size_t count, "
    "const fmi2Integer order[], fmi2Real value[]",
    "fmi2CancelStep": "fmi2Component c",
    "fmi2GetStatus": "fmi2Component c, const fmi2StatusKind kind, fmi2Status *value",
    "fmi2GetRealStatus": "fmi2Component c, const fmi2StatusKind kind, fmi2Real *value",
    "fmi2GetIntegerStatus": "fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value",
    "fmi2GetBooleanStatus": "fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value",
    "fmi2GetStringStatus": "fmi2Component c, const fmi2StatusKind kind, fmi2String *value",
}


def fmu(firmware: Firmware) -> bytes:
    """Return the FMU of a design as a zip archive. The same design and compiler give the same bytes."""
    sources = {**c_source(firmware), "vctune_fmu.c": rendered_template("vctune_fmu.c", _given(firmware))}
    packed: dict[str, str | bytes] = {
        "modelDescription.xml": rendered_template("modelDescription.xml", _described(firmware)),
        **{f"sources/{name}": text for name, text in sources.items()},
        "binaries/linux64/vctune_fmu.so": _compiled(sources),
    }
    archive = BytesIO()
    with ZipFile(archive, "w", ZIP_DEFLATED) as packing:
        for name, content in packed.items():
            entry = ZipInfo(name, EPOCH)
            entry.external_attr = 0o755 << 16  # permissions: systems may load the library and read the files
            packing.writestr(entry, content, ZIP_DEFLATED)
    return archive.getvalue()


def _reals(firmware: Firmware) -> list[tuple[str, str, str, str]]:
    """Return the real variables of a controller: name, quantity, causality and meaning."""
    quantity, servo = COMMANDS[firmware.parts.command], firmware.parts.command != "force"
    variables_of_command = [real for real in REALS if not (servo and real[0] in ABSENT_OF_SERVO)]
    command = ("command", quantity.of, "output", quantity.meaning)
    return [command if real[0] == "command" else real for real in variables_of_command]


def _guid(firmware: Firmware) -> str:
    """Return the FMU's identifier. The identifier depends only on problem, design, precision and version."""
    content = f"{firmware.design_sha256} {firmware.precision} {__version__}"
    return f"{{{UUID(bytes=sha256(content.encode()).digest()[:16])}}}"


def _given(firmware: Firmware) -> dict[str, Any]:
    """Return the variables of the template of vctune_fmu.c."""
    absent = [
        {
            "name": name,
            "takes": takes,
            "unused": [word.split()[-1].strip("*[]") for word in takes.split(",")],
            "answer": "fmi2Discard" if name.endswith("Status") else "fmi2Error",
        }
        for name, takes in ABSENT.items()
    ]
    return {
        **names_and_numbers(firmware),
        "reals": [name.upper() for name, *_ in _reals(firmware)],
        "guid": _guid(firmware),
        "absent": absent,
    }


def _described(firmware: Firmware) -> dict[str, Any]:
    """Return the variables of the template of modelDescription.xml."""
    units = firmware.units
    variables = [
        {
            "name": name,
            "reference": reference,
            "causality": causality,
            "variability": "fixed" if causality == "parameter" else "discrete",
            "meaning": units.translated(meaning),
            "type": f'<Real unit="{_dotted(units.of(quantity))}" start="0"/>',
        }
        for reference, (name, quantity, causality, meaning) in enumerate(_reals(firmware))
    ]
    outputs = [number for number, variable in enumerate(variables, 1) if variable["causality"] == "output"]
    variables += [
        {
            "name": name,
            "reference": reference,
            "causality": "parameter",
            "variability": "fixed",
            "meaning": meaning,
            "type": '<Boolean start="false"/>',
        }
        for reference, (name, meaning) in enumerate(BOOLEANS)
    ]
    return {
        "name": printable(firmware.name),
        "guid": _guid(firmware),
        "version": __version__,
        "description": printable(" ".join(line for line in statement(firmware) if line)),
        "doubt": "" if certified(firmware) else printable(not_proved(firmware)).replace("--", "- -"),
        "sample_time": repr(firmware.device.sample_time),
        "units": [(_dotted(units.of(quantity)), of) for quantity, of in DIMENSIONS[firmware.device.units].items()],
        "variables": variables,
        "outputs": outputs,
    }


def _dotted(unit: str) -> str:
    """Return a unit in the notation of FMI."""
    return unit.replace(" ", ".")


def _compiled(sources: dict[str, str]) -> bytes:
    """Return the shared library compiled from sources."""
    compiler = next((path for name in COMPILERS if (path := shutil.which(name))), None)
    if compiler is None or (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        message = "an FMU is built by a C compiler on 64-bit Linux: install gcc or clang there, or take --to c"
        raise InputError.of("fmu", "no-compiler", message)
    with tempfile.TemporaryDirectory() as place:
        for name, text in sources.items():
            (Path(place) / name).write_text(text)
        command = [compiler, *OPTIONS, "-o", "out.so", "vctune_fmu.c", "-lm"]
        completed = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        if completed.returncode != 0:
            complaint = (completed.stderr.strip().splitlines() or ["says nothing"])[0]
            raise InputError.of(
                "fmu", "no-compiler", f"{compiler} cannot compile it: {complaint}; take another compiler"
            )
        return (Path(place) / "out.so").read_bytes()
