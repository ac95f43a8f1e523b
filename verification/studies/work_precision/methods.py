"""The table `METHODS` of the integration methods that a work-precision study compares.

A new method needs an entry here and a function in
`verification.studies.work_precision.method_runs`. The order is that of the largest error over time
as a function of the mean step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from taction.netlist_gen.board.circuit import Circuit
from taction.verification.studies.work_precision import method_runs
from taction.verification.studies.work_precision.method_runs import MethodRun

TOLERANCES = tuple(10.0**-k for k in range(2, 12))
STRUCTURED_TOLERANCES = (
    1e-3,
    1e-4,
    1e-6,
    1e-7,
    1e-9,
)  # steps are doubled: others give the same runs
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine."""

    name: str
    engine: Literal["ngspice", "statespace", "scipy"]
    solver: str  # the integrator; the reference of a run must be by another solver
    problem: Literal["board", "ideal"]  # the whole circuit, or the network with ideal op-amps
    setting: str  # name of the ladder's quantity; empty for a method without a step
    ladder: tuple[float, ...]  # coarse to fine
    run: Callable[..., MethodRun]  # of task and setting; of ngspice also of a time limit in s
    order: float | None  # in theory; None for a method without an order or of variable order
    theory: str  # the order in words
    refuses: Callable[[Circuit], str] = method_runs.any_board  # why not for a board, or empty


VARIES = "1 to 5, chosen by the integrator"

METHODS: tuple[Method, ...] = (
    Method(
        "ngspice trapezoidal", "ngspice", "trapezoidal", "board", "points per period", POINTS,
        partial(method_runs.ngspice, method="trapezoidal"), 2.0, "2",
    ),
    Method(
        "ngspice Gear", "ngspice", "Gear", "board", "points per period", POINTS,
        partial(method_runs.ngspice, method="gear"), 2.0, "2 (ngspice's default maximum order)",
    ),
    Method(
        "state space, exact", "statespace", "modes", "board", "", (0.0,),
        method_runs.exact, None, "no step: rounding alone", method_runs.small_linear_board,
    ),
    Method(
        "state space, implicit", "statespace", "Radau IIA, 5 stages", "board", "tolerance",
        TOLERANCES[:-1], method_runs.implicit, 6.0,
        "6 (dense output of five Radau IIA stages; 9 at the ends of steps)",
    ),
    Method(
        "state space, structured", "statespace", "Radau IIA, 7 stages", "board", "tolerance",
        STRUCTURED_TOLERANCES, method_runs.structured, 8.0,
        "8 (dense output of seven Radau IIA stages; 13 at the ends of steps)",
        method_runs.linear_board,
    ),
    Method(
        "ideal network, Radau", "scipy", "Radau", "ideal", "tolerance", TOLERANCES,
        partial(method_runs.scipy_run, method="Radau"), 5.0, "5",
    ),
    Method(
        "ideal network, BDF", "scipy", "BDF", "ideal", "tolerance", TOLERANCES,
        partial(method_runs.scipy_run, method="BDF"), None, VARIES,
    ),
    Method(
        "ideal network, LSODA", "scipy", "LSODA", "ideal", "tolerance", TOLERANCES,
        partial(method_runs.scipy_run, method="LSODA"), None, "1 to 12, chosen by the integrator",
    ),
)  # fmt: skip
