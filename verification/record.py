"""A transient on its own: simulated once and measured against the reference, nothing judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from netlist_gen.analysis import Transient
from netlist_gen.circuit import Circuit, Floats
from netlist_gen.problem import make_problem
from netlist_gen.scalings import make_scalings
from netlist_gen.scene import Scene
from netlist_gen.synthesis import synthesise
from verification.ideal import IdealAnswer, ideal_answer, ideal_network
from verification.lambda_rule import resolve_lambda
from verification.measures import Measurements, measure
from verification.plan import plan_transient
from verification.simulate import PHYSICAL_BOUND, begin, choose_engine, outputs
from verification.timescales import time_scales
from verification.waveforms import Waveforms


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Waveforms of one transient and what was measured on them."""

    circuit: Circuit
    transient: Transient
    waveforms: Waveforms
    measurements: Measurements


def record_transient(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> Record:
    """Simulate the transient of `scene` once, without a second look at another step.

    Raises
    ------
    InputError, NoVerdictError
        As `verification.verify.verify`.
    """
    progress("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene)
    circuit = synthesise(scene, problem)
    engine = choose_engine(scene)
    scales = time_scales(circuit, initial=scene.analysis.initial)
    transient = plan_transient(scene, scales, engine)
    progress("simulation")
    pending = begin(scene, circuit, transient, engine, second_look=False)
    ideal = ideal_answer(ideal_network(problem, make_scalings(scene), scene), scene)
    waveforms = pending.result().fine
    progress("measures")
    measurements, _ = measure_outputs(scene, circuit, ideal, waveforms, transient)
    return Record(circuit, transient, waveforms, measurements)


def measure_outputs(
    scene: Scene, circuit: Circuit, ideal: IdealAnswer, waveforms: Waveforms, transient: Transient
) -> tuple[Measurements, Floats]:
    """Measure `waveforms` against the reference; return the measures and u (P, N), V."""
    u = outputs(circuit, waveforms)
    found = measure(
        waveforms.time,
        u,
        ideal.target,
        ideal.start,
        band=scene.checks.settling_time.band,
        bound=PHYSICAL_BOUND * circuit.scalings.unit_voltage,
        expected_stop=transient.stop,
    )
    return found, u
