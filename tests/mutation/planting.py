"""Faults, and how each is planted where its station hands on a value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit, Fact, without_wires
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import Topology, topology_of
from taction.system.array_types import Floats, Waveforms
from taction.system.reading_definitions import TIMES
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.measurements import ChannelMeasure, Measurements, summary
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.studies.regression.regress import compare_entry, observe
from taction.verification.verdict import simulation
from taction.verification.verdict.board import Board
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.simulation import Engine
from taction.verification.verdict.verify import Verdict, verify

CircuitChange = Callable[[Circuit], Circuit]
Plant = Callable[[Scene, pytest.MonkeyPatch], Verdict]


def _each(circuit: Circuit, kind: str, name: str, change: Callable[[Any], Any]) -> Circuit:
    """Change the parts of a `kind` whose names begin with `name`; there must be such a part."""
    found = getattr(circuit, kind)
    changed = tuple(change(part) if part.name.startswith(name) else part for part in found)
    assert changed != found
    return replace(circuit, **{kind: changed})


def scaled(kind: str, name: str, **factors: float) -> CircuitChange:
    """Multiply fields of the parts of a `kind` whose names begin with `name`."""

    def change(part: Any) -> Any:
        return replace(part, **{field: getattr(part, field) * x for field, x in factors.items()})

    return lambda circuit: _each(circuit, kind, name, change)


def figures(**changes: float) -> CircuitChange:
    """Change figures of every op-amp type."""
    return lambda circuit: replace(
        circuit, models={name: replace(m, **changes) for name, m in circuit.models.items()}
    )


def other_model(cell: str, preset: str) -> CircuitChange:
    """Give one cell the op-amp of a preset."""

    def change(circuit: Circuit) -> Circuit:
        models = {**circuit.models, preset: OPAMPS[preset]}
        changed = _each(circuit, "opamps", cell, lambda part: replace(part, model=preset))
        return replace(changed, models=models)

    return change


def swapped_inputs(cell: str) -> CircuitChange:
    """Swap the two inputs of one cell."""

    def swapped(part: Any) -> Any:
        return replace(part, noninverting=part.inverting, inverting=part.noninverting)

    return lambda circuit: _each(circuit, "opamps", cell, swapped)


def without_inverters(circuit: Circuit) -> Circuit:
    """Drive the feedback resistors of negative entries by w, without its inverter."""
    forward, feedback = circuit.matrices
    assert feedback.negative.any()
    return replace(circuit, matrices=(forward, replace(feedback, minus=feedback.plus)))


def without_bias(circuit: Circuit) -> Circuit:
    """Leave the bias source and its resistors out."""
    resistors = tuple(part for part in circuit.resistors if not part.name.startswith("bias_"))
    assert resistors != circuit.resistors
    return replace(circuit, voltages=(), resistors=resistors)


def without_feedback_resistor(circuit: Circuit) -> Circuit:
    """Leave the first resistor of the feedback plane out."""
    forward, feedback = circuit.matrices
    ohms = scaled_entry(feedback.ohms, (0, 0), np.inf)
    return replace(circuit, matrices=(forward, replace(feedback, ohms=ohms)))


def scaled_entry(values: Floats, place: Any, factor: float) -> Floats:
    """Multiply entries of an array, of which the first is neither 0 nor infinite."""
    found = np.array(values)
    assert np.isfinite(found[place]).all()
    assert (found[place] != 0.0).all()
    found[place] *= factor
    return found


def without_uncertainties(found: Measurements) -> Measurements:
    """Drop the uncertainties of all times."""

    def certain(channel: ChannelMeasure) -> ChannelMeasure:
        known = {name: channel.readings[name] for name in TIMES}
        times = {name: each and replace(each, uncertainty=0.0) for name, each in known.items()}
        return replace(channel, readings={**channel.readings, **times})

    channels = [certain(channel) for channel in found.channels]
    return summary(found.amplitude, found.band, found.modes, channels)


def nothing(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
    """Verify the scene without a fault."""
    return verify(scene)


def in_the_circuit(change: Callable[[Circuit], Circuit]) -> Plant:
    """Both engines get the changed circuit."""
    return lambda scene, patch: verify(scene, circuit=change(synthesise(scene)))


def in_the_problem_of_the_board(change: Callable[[InverseProblem], InverseProblem]) -> Plant:
    """The synthesis builds a board for the changed problem; the reference has the right one."""
    return lambda scene, patch: verify(
        scene, circuit=synthesise(scene, change(make_problem(scene)))
    )


def in_the_facts(changes: Mapping[str, float]) -> Plant:
    """The synthesis gets other numbers of the design: factors of facts by name."""

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        kind = type(topology_of(scene))
        stated = kind.facts

        def facts(topology: Topology, scene: Scene) -> dict[str, Fact]:
            right = stated(topology, scene)
            wrong = {
                name: replace(right[name], value=factor * right[name].value)
                for name, factor in changes.items()
            }
            return {**right, **wrong}

        patch.setattr(kind, "facts", facts)
        return verify(scene)

    return plant


def in_the_deck(change: Callable[[Circuit], Circuit]) -> Plant:
    """The deck is written from the changed circuit; the state-space engine has the right one."""

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        def write(circuit: Circuit, *rest: Any, **given: Any) -> Deck:
            return write_deck(change(circuit), *rest, **given)

        patch.setattr(simulation, "write_deck", write)
        return verify(scene)

    return plant


def _running(begin: Callable[[Engine, Board], Callable[[], Waveforms]]) -> Plant:
    engine = simulation.ENGINES["ngspice"]

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        other = replace(engine, begin=lambda design: begin(engine, design))
        patch.setitem(simulation.OWN, "ngspice", other)
        return verify(scene)

    return plant


def in_the_run(changes: Mapping[str, float | str]) -> Plant:
    """Ngspice runs another transient than the planned one: numbers are factors, texts values."""

    def begin(engine: Engine, design: Board) -> Callable[[], Waveforms]:
        planned = design.plan.transient
        fields = {
            name: value if isinstance(value, str) else value * getattr(planned, name)
            for name, value in changes.items()
        }
        plan = replace(design.plan, transient=replace(planned, **fields))
        return engine.begin(replace(design, plan=plan))

    return _running(begin)


def in_the_record(change: Callable[[Waveforms], Waveforms]) -> Plant:
    """The waveforms that ngspice returns are changed."""

    def begin(engine: Engine, design: Board) -> Callable[[], Waveforms]:
        wait = engine.begin(design)
        return lambda: change(wait())

    return _running(begin)


def in_the_answer(change: Callable[[IdealAnswer, Scene], IdealAnswer]) -> Plant:
    """The answer of the reference is changed."""

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        answer = ideal_answer(ideal_network(make_problem(scene), scene), scene)
        return verify(scene, ideal=change(answer, scene))

    return plant


def in_the_equations(change: Callable[[Circuit], Circuit]) -> Plant:
    """The state-space engine stamps the changed circuit; the deck has the right one."""

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        circuit = synthesise(scene)
        return verify(scene, circuit=LinearBoard(circuit, stamp(change(circuit))))

    return plant


def result(owner: Any, name: str) -> Callable[[Callable[[Any], Any]], Plant]:
    """What a function of a module, or a method or property of a class, returns is changed."""
    original = getattr(owner, name)
    get = {property: "fget", cached_property: "func"}.get(type(original))

    def wrap(change: Callable[[Any], Any]) -> Plant:
        def changed(*given: Any, **named: Any) -> Any:
            return change((getattr(original, get) if get else original)(*given, **named))

        def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
            patch.setattr(owner, name, property(changed) if get else changed)
            return verify(scene)

        return plant

    return wrap


def with_other_wires(**changes: Any) -> CircuitChange:
    """Change fields of the wires of every matrix."""

    def change(circuit: Circuit) -> Circuit:
        wired = [each for each in circuit.matrices if each.wires is not None]
        assert wired
        matrices = tuple(
            replace(each, wires=replace(each.wires, **changes)) if each.wires else each
            for each in circuit.matrices
        )
        return replace(circuit, matrices=matrices)

    return change


def uncompensated(circuit: Circuit) -> Circuit:
    """Give every matrix the resistors that it would have with ideal wires."""
    straight = without_wires(circuit).matrices
    pairs = zip(circuit.matrices, straight, strict=True)
    return replace(circuit, matrices=tuple(replace(a, ohms=b.ohms) for a, b in pairs))


def in_the_baseline(change: Callable[[Scene], Scene]) -> Plant:
    """The baseline is that of the changed scene; the check `regression` compares with it."""

    def plant(scene: Scene, patch: pytest.MonkeyPatch) -> Verdict:
        then, verdict = observe(verify(change(scene))), verify(scene)
        found = compare_entry(observe(verdict), then, scene.regression)
        outcome = Outcome.FAIL if any(each.beyond for each in found) else Outcome.PASS
        check = Check("regression", outcome, None, None, None, None, "", "")
        checks = (*verdict.checks, check)
        return replace(verdict, checks=checks)

    return plant
