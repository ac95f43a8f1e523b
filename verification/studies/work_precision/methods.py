"""What a work-precision study compares: one entry of `METHODS` an integration method.

To add a method is to add an entry, and its function to
`verification.studies.work_precision.method_runs`. Orders are those of
the largest error over time as a function of the mean step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from netlist_gen.board.circuit import Circuit
from verification.studies.work_precision import method_runs
from verification.studies.work_precision.method_runs import MethodRun

TOLERANCES = tuple(10.0**-k for k in range(2, 12))
STEPPED = (1e-3, 1e-4, 1e-6, 1e-7, 1e-9)  # it doubles its step: tolerances between change nothing
POINTS = (16.0, 32.0, 64.0, 125.0, 250.0, 500.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Method:
    """One integration method of one engine.

    Attributes
    ----------
    name, engine : str
        What it is called; who runs it (``"ngspice"``, ``"statespace"`` or ``"scipy"``).
    solver : str
        Who integrates; a reference by the same solver would be no reference.
    problem : str
        ``"board"``: the whole circuit; ``"ideal"``: the network with ideal op-amps.
    setting : str
        What the ladder changes; empty for a method without a step.
    ladder : tuple of float
        Coarse to fine.
    run : callable
        ``(task, setting) -> MethodRun``; ngspice takes a time limit in s as third argument.
    order : float or None
        Theoretical order; None where the method has none or varies it.
    theory : str
        The same in words.
    refuses : callable
        ``circuit -> reason``: why the method is not for this board; empty if it is.
    """

    name: str
    engine: Literal["ngspice", "statespace", "scipy"]
    solver: str
    problem: Literal["board", "ideal"]
    setting: str
    ladder: tuple[float, ...]
    run: Callable[..., MethodRun]
    order: float | None
    theory: str
    refuses: Callable[[Circuit], str] = method_runs.any_board


VARIES = "1 to 5, chosen by the integrator"

METHODS: tuple[Method, ...] = (
    Method(
        "ngspice trapezoidal", "ngspice", "trapezoidal", "board", "points per period", POINTS,
        method_runs.trapezoidal, 2.0, "2",
    ),
    Method(
        "ngspice Gear", "ngspice", "Gear", "board", "points per period", POINTS,
        method_runs.gear, 2.0, "2 (ngspice's default maximum order)",
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
        STEPPED, method_runs.structured, 8.0,
        "8 (dense output of seven Radau IIA stages; 13 at the ends of steps)",
        method_runs.linear_board,
    ),
    Method(
        "ideal network, Radau", "scipy", "Radau", "ideal", "tolerance", TOLERANCES,
        method_runs.radau, 5.0, "5",
    ),
    Method(
        "ideal network, BDF", "scipy", "BDF", "ideal", "tolerance", TOLERANCES,
        method_runs.bdf, None, VARIES,
    ),
    Method(
        "ideal network, LSODA", "scipy", "LSODA", "ideal", "tolerance", TOLERANCES,
        method_runs.lsoda, None, "1 to 12, chosen by the integrator",
    ),
)  # fmt: skip
