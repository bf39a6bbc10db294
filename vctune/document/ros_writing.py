"""Write the parameter file of a ROS 2 admittance_controller, which `vctune.document.ros` reads."""

from __future__ import annotations

from collections.abc import Sequence

from vctune.document.ros import AXES, AdmittanceFile

CONTROLLER = "admittance_controller"  # Name of the controller in the file


def admittance_text(given: AdmittanceFile, comments: Sequence[str]) -> str:
    """Return the YAML text of a parameter file."""
    first, named = given.axes[0], {axis.axis: axis for axis in given.axes}
    axes = [named.get(name, first) for name in AXES]
    selected = ", ".join(str(name in named).lower() for name in AXES)
    lists = {name: [getattr(axis, name) for axis in axes] for name in ("mass", "damping_ratio", "stiffness")}
    lines = [f"# {line}".rstrip() for line in comments]
    lines += [f"{CONTROLLER}:", "  ros__parameters:", "    ft_sensor:"]
    lines += [f"      filter_coefficient: {_number(given.filter_coefficient)}", "    admittance:"]
    lines += [f"      # {', '.join(AXES)}", f"      selected_axes: [{selected}]"]
    lines += [f"      {name}: [{', '.join(map(_number, numbers))}]" for name, numbers in lists.items()]
    lines += [f"      joint_damping: {_number(first.joint_damping)}"]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return a number in its shortest exact decimals, with a decimal point."""
    text = repr(float(value))
    mantissa, exponent, power = text.partition("e")
    return text if "." in mantissa else f"{mantissa}.0{exponent}{power}"
