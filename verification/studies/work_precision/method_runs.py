"""How each method of a work-precision study is run, and how its cost is taken."""

from __future__ import annotations

import re
import shutil
import tempfile
import time as clock
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.deck.deck import Deck, write_deck
from spice_models.array_types import Floats
from spice_models.errors import EngineError, TimedOut
from verification.engines.ngspice import process
from verification.engines.ngspice.executable import Simulator, find_simulator
from verification.engines.ngspice.process import PHYSICAL_BOUND
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients import amplified, structured_radau
from verification.engines.statespace.transients.exact import ENGINE, exact_solution
from verification.pipeline.simulation import outputs
from verification.pipeline.transient_plan import coarser
from verification.reference import IdealNetwork
from verification.reference.dynamics import ScaledNetwork
from verification.waveforms import Cost, Waveforms

BASE_POINTS = 125.0  # points per period of `Task.transient`
MAX_INSTANTS = 4000  # of a record that are compared with the reference,
MAX_VALUES = 60_000  # or fewer where there are many channels,
MIN_INSTANTS = 500  # but no fewer
IDEAL_STOP = 10.0  # times R C: the slowest mode has decayed to 5e-5
_COUNT = {
    "steps": re.compile(r"^Accepted timepoints = (\d+)", re.MULTILINE),
    "factorisations": re.compile(r"^Total iterations = (\d+)", re.MULTILINE),
}


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What every method is given.

    Attributes
    ----------
    circuit : Circuit
        The board.
    transient : Transient
        Of the study's stop time, with `BASE_POINTS` on the period of the fastest ringing.
    network : IdealNetwork
        The same scene with ideal op-amps.
    v0 : ndarray (N,)
        Signal-node voltages of the ideal network at t = 0, V.
    """

    circuit: Circuit
    transient: Transient
    network: IdealNetwork
    v0: Floats

    @property
    def ideal_stop(self) -> float:
        """How long the ideal network is followed, s."""
        return IDEAL_STOP * self.network.R * self.network.C


@dataclass(frozen=True, slots=True, eq=False)
class MethodRun:
    """One run of one method.

    Attributes
    ----------
    time, u : ndarray (P,) and (P, N)
        Evenly chosen points of the record (`stride`), s and V.
    seconds : float
        Wall time; of ngspice its process, of the others the computation with its output.
    steps : int
        Accepted; 0 of a method that has none.
    factorisations : int or None
        Of matrices (ngspice: one an iteration of Newton's); None where it is not known.
    """

    time: Floats
    u: Floats
    seconds: float
    steps: int
    factorisations: int | None


def load_integrators() -> None:
    """Import what takes long to import, so that no measurement holds it."""
    import scipy.integrate  # noqa: F401


def any_board(circuit: Circuit) -> str:
    """Return why a board is not for a method, here never: an empty string."""
    return ""


def linear_board(circuit: Circuit) -> str:
    """Return why a method for linear boards does not take this one, or nothing."""
    return "the board's amplifiers are not linear" if circuit.amplifiers else ""


def small_board(circuit: Circuit) -> str:
    """Return why a method with dense matrices of all states does not take this one, or nothing."""
    large = LinearBoard(circuit).descriptor.is_large
    return "too many unknowns for dense matrices" if large else ""


def small_linear_board(circuit: Circuit) -> str:
    """Return why a dense method for linear boards does not take this one, or nothing."""
    return linear_board(circuit) or small_board(circuit)


def trapezoidal(task: Task, points: float, timeout: float = np.inf) -> MethodRun:
    """Run ngspice's trapezoidal rule with `points` points on a ringing period."""
    return _ngspice(task, points, timeout, "trapezoidal")


def gear(task: Task, points: float, timeout: float = np.inf) -> MethodRun:
    """Run ngspice's Gear method with `points` points on a ringing period."""
    return _ngspice(task, points, timeout, "gear")


def exact(task: Task, _: float) -> MethodRun:
    """Run the exact engine, recording `BASE_POINTS` on a ringing period."""
    began = clock.perf_counter()
    transient = task.transient
    found = exact_solution(task.circuit, initial=transient.initial, stop=transient.stop)
    time = amplified.record_times(transient, transient.stop)
    values = found.uniform(float(time[1]), len(time))
    cost = Cost(clock.perf_counter() - began, 0, 1)
    return _thin(task, Waveforms(time, found.nodes, values, ENGINE, cost))


def structured(task: Task, tolerance: float) -> MethodRun:
    """Run the engine for large linear boards, which never forms a dense matrix of all states."""
    return _thin(task, structured_radau.simulate(task.circuit, task.transient, tolerance=tolerance))


def implicit(task: Task, tolerance: float) -> MethodRun:
    """Run the adaptive implicit engine, also on a linear board."""
    found = amplified.simulate(task.circuit, task.transient, tolerance=tolerance)
    return _thin(task, found)


def radau(task: Task, tolerance: float) -> MethodRun:
    """Run SciPy's Radau IIA of order 5 on the ideal network."""
    return _scipy(task, tolerance, "Radau")


def bdf(task: Task, tolerance: float) -> MethodRun:
    """Run SciPy's backward differentiation formulas on the ideal network."""
    return _scipy(task, tolerance, "BDF")


def lsoda(task: Task, tolerance: float) -> MethodRun:
    """Run ODEPACK's LSODA (Adams, or backward differentiation where stiff) on the ideal network."""
    return _scipy(task, tolerance, "LSODA")


def _ngspice(
    task: Task, points: float, timeout: float, method: Literal["trapezoidal", "gear"]
) -> MethodRun:
    """Raise TimeoutError where `timeout` s do not suffice."""
    simulator = find_simulator()
    transient = replace(coarser(task.transient, BASE_POINTS / points), method=method)
    deck = write_deck(task.circuit, transient, solver=simulator.solver_option)
    # acct: ngspice tells its steps and iterations at the end
    deck = replace(deck, text=deck.text.replace("\n.options ", "\n.options acct ", 1))
    place = Path(tempfile.mkdtemp(prefix="taction-"))
    bound = PHYSICAL_BOUND * task.circuit.scalings.unit_voltage
    try:
        return _told(task, deck, simulator, place, timeout=timeout, bound=bound)
    except TimedOut as error:
        raise TimeoutError(str(error).splitlines()[0]) from None
    finally:
        shutil.rmtree(place)


def _told(
    task: Task,
    deck: Deck,
    simulator: Simulator,
    place: Path,
    *,
    timeout: float,
    bound: float,
) -> MethodRun:
    found = process.simulate(
        deck, simulator, timeout=min(timeout, 1e9), folder=place, keep=True, bound=bound
    )
    text = (place / "stdout.txt").read_text(encoding="utf-8", errors="replace")
    told = {name: pattern.search(text) for name, pattern in _COUNT.items()}
    steps, factorisations = told["steps"], told["factorisations"]
    return replace(
        _thin(task, found),
        steps=int(steps[1]) if steps else found.cost.points,
        factorisations=int(factorisations[1]) if factorisations else None,
    )


def _scipy(task: Task, tolerance: float, method: Literal["Radau", "BDF", "LSODA"]) -> MethodRun:
    """Integrate the ideal network; its record is at the ends of the integrator's own steps."""
    from scipy.integrate import solve_ivp

    network, scaled = task.network, ScaledNetwork(task.network)
    unit = network.R * network.C
    began = clock.perf_counter()
    with np.errstate(all="ignore"):
        found = solve_ivp(
            scaled.slope, (0.0, task.ideal_stop / unit), task.v0 / network.unit, method,
            jac=scaled.jacobian, rtol=tolerance, atol=tolerance,
        )  # fmt: skip
        u = network.U0 * scaled.g.g(found.y).T
    seconds = clock.perf_counter() - began
    # LSODA has been seen to report success with values that are not numbers.
    if not found.success or not np.all(np.isfinite(u)):
        message = f"{method} gave up: {found.message}"
        raise EngineError(message)
    shown = stride(*u.shape)
    return MethodRun(found.t[shown] * unit, u[shown], seconds, len(found.t) - 1, int(found.nlu))


def stride(count: int, channels: int) -> NDArray[np.intp]:
    """Return the places of a record's points that are compared: evenly, and the last one."""
    most = min(max(MAX_VALUES // channels, MIN_INSTANTS), MAX_INSTANTS)
    every = max(-(-count // most), 1)
    return np.unique(np.append(np.arange(0, count, every), count - 1))


def _thin(task: Task, found: Waveforms) -> MethodRun:
    shown = stride(len(found.time), len(task.circuit.outputs))
    u = outputs(task.circuit, found)[shown]
    cost = found.cost
    return MethodRun(found.time[shown], u, cost.seconds, cost.points, cost.factorisations)
