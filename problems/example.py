"""vctune from Python: state a device, design it, doubt the design. `python problems/example.py`, a few seconds."""

from __future__ import annotations

import numpy as np

from vctune import Device, InputError, check, problem, simulate, solve, sweep

# A device is three numbers; here the position gain has a least value, which rejects friction. As in a problem file.
wheel = problem(
    {
        "name": "friction wheel",
        "device": Device(mass=0.4, damping=2.0, sample_time=1e-3),  # kg, N s/m, s
        "gains": {"position": {"min": 3000.0, "max": 1e5}},  # N/m
        "transparency": {"band_hz": [0.5, 30.0], "reference_impedance": 10.0},  # Hz, N s/m
        "stability": {"band_hz": [0.5, 100.0]},  # Hz
        "experiment": [{"name": "spring", "environment": {"stiffness": 200.0}}],  # N/m
    }
)

# The most transparent gains that are proved stable, and the band on which they are.
solved = solve(wheel)
best = solved.judgement
if best is None:
    raise SystemExit(f"no design: {solved.reason}")
print(f"{solved.status}: error {best.error:.4f}, {best.certificate.verdict} with {best.certificate.boxes} boxes")
print(f"K_v = {best.gains.velocity:.5g} N s/m, K_p = {best.gains.position:.5g} N/m")

# Would the same gains do on a device that is half as heavy again?
heavy = problem({**wheel.document, "device": Device(mass=0.6, damping=2.0, sample_time=1e-3)})
print(f"with 0.6 kg: {check(heavy, best.gains, best.coupling).message}")

# What damping costs: a design at each of five values, as a table.
table = sweep(wheel, {"device.damping": np.geomspace(0.5, 8.0, 5)}).table
for damping, error in zip(table.axes["device.damping"], table.numbers["error"], strict=True):
    print(f"damping {damping:.3g} N s/m: error {error:.4f}")

# What the hand feels of a spring of 200 N/m, simulated.
spring = simulate(wheel, best.gains, best.coupling).experiments[0].design
print(f"{len(spring.traces.time)} samples, greatest force {spring.traces.force.max():.3g} N")
if spring.metrics is not None:  # None if the run diverged
    felt = spring.metrics.fits["stiffness"]
    print(f"felt: {felt.value:.2f} N/m of {felt.asked:g} N/m")

# What is wrong with a number is said with the number.
try:
    Device(mass=-0.4, damping=2.0, sample_time=1e-3)
except InputError as error:
    print(f"refused: {error}")
