"""Call a compiled controller through ctypes. `make shared` builds its shared library from an export."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_size_t, c_void_p
from pathlib import Path

import numpy as np

from vctune.document.text.errors import InputError
from vctune.model.numbers.arithmetic import Floats
from vctune.simulation.firmware.controller import encoded
from vctune.simulation.firmware.operations import FLOATS
from vctune.simulation.firmware.stepped import Precision
from vctune.simulation.scene import Scene, equilibrium

LIBRARY = "vctune_controller.so"
MOST_BYTES = 1_000_000  # Greatest memory of a controller in bytes

PRECISIONS: dict[int, Precision] = {4: "single", 8: "double"}  # Precision of numbers, by their size in bytes


class CompiledController:
    """A controller in a shared library."""

    def __init__(self, path: Path) -> None:
        """Load a library."""
        place = path / LIBRARY if path.is_dir() else path
        if not place.is_file():
            raise InputError.of(
                str(place), "no-controller", "no such file; build it by `make shared` in the exported folder"
            )
        self.path = place
        try:
            library = ctypes.CDLL(str(place.resolve()))
            size, problem, real = (getattr(library, f"vctune_bridge_{name}") for name in ("size", "problem", "real"))
            self._start, self._step = library.vctune_bridge_start, library.vctune_bridge_step
        except OSError as error:
            raise InputError.of(str(place), "no-controller", f"cannot be loaded: {error}") from None
        except AttributeError as error:
            message = f"is no controller of `vctune export`: {error}; link it with vctune_bridge.c"
            raise InputError.of(str(place), "no-controller", message) from None
        size.restype, problem.restype, real.restype = c_size_t, c_char_p, c_size_t
        self._start.argtypes, self._start.restype = (c_void_p, POINTER(c_double)), None
        self._step.argtypes, self._step.restype = (c_void_p, POINTER(c_double), POINTER(c_double)), None
        if not 0 < size() <= MOST_BYTES:
            raise InputError.of(
                str(place), "no-controller", f"says that it needs {size()} bytes; that is no controller"
            )
        if real() not in PRECISIONS:
            raise InputError.of(str(place), "no-controller", f"calculates in numbers of {real()} bytes, not of 4 or 8")
        self.precision = PRECISIONS[real()]
        self.problem_sha256 = (problem() or b"").decode("ascii", "replace")
        self._memory = ctypes.create_string_buffer(size())
        self._answer = (c_double * 4)()

    def start(self, scene: Scene) -> None:
        """Begin a run of a scene."""
        begin, law = equilibrium(scene), scene.law
        rendered = law.environment
        position = encoded(law, begin.position, FLOATS)
        setting = [position, begin.reference, law.limit or 0.0]  # 0 means no limit
        setting += [rendered.mass, rendered.damping, rendered.stiffness, rendered.zero]
        setting += [float(rendered.wall), float(rendered.rule == "trapezoid")]
        self._start(self._memory, (c_double * len(setting))(*setting))

    def step(self, measured: Floats) -> Floats:
        """Return x_e [m], v_e [m/s], f_e [N] and u [N, or m/s or m for a servo], given position [m], velocity [m/s] and
        force [N]."""
        self._step(self._memory, (c_double * 3)(*measured), self._answer)
        return np.array(self._answer)
