"""Provide the commands as functions: `from vctune import ...`.

A command reads its options, calls one of these functions and prints the result. Every function that takes a problem
accepts the path of its file, its tables as a dict, a `Problem`, or the `ProblemFile` that `problem` makes of any of
these. A fault in the input raises an `InputError`, which is a `ValueError`.

>>> from vctune import check, problem, solve
>>> wheel = problem({"name": "wheel", "device": {"mass": 0.4, "damping": 2.0, "sample_time": 1e-3},
...                  "gains": {"position": {"min": 3000.0, "max": 1e5}}})
>>> solved = solve(wheel)
>>> solved.status.value
'certified'
>>> best = solved.judgement
>>> best.certificate.verdict.value
'proved'
>>> check(wheel, best.gains, best.coupling).result.value
'passed'
"""
