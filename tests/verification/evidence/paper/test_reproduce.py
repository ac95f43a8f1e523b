"""The chapters of the paper and their claims."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import toeplitz

import taction
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import load_scene
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.evidence import demonstration
from taction.verification.evidence.demonstration import Demonstration
from taction.verification.evidence.paper.boards import stage_step
from taction.verification.evidence.paper.findings import (
    Chapter,
    ClaimOutcome,
    Finding,
    load_claims,
    paper_scene,
)
from taction.verification.evidence.paper.network import tikhonov
from taction.verification.evidence.paper.reproduce import CHAPTERS, Reproduction
from taction.verification.evidence.paper.sensing import FINE, Geometry, by_transform, gradient_flow
from taction.verification.verdict.checks import Outcome
from tests.support.paths import SCENES

WITH_NGSPICE = ("breadboard", "console", "hardware")
SLOW = ("breadboard", "speed", "reconstruction", "console", "simnon", "energy")
BY_CLOCK = {"digital-impossible", "digital-quadratic"}  # as fast as the machine is today
NIGHTLY = pytest.mark.nightly  # `.ci/run` has all chapters: step reproduce


def test_every_claim_has_a_chapter_and_its_own_name() -> None:
    claims = load_claims()
    assert {claim.chapter for claim in claims} == set(CHAPTERS)
    assert len({claim.id for claim in claims}) == len(claims)
    assert all(claim.claim and claim.place for claim in claims)
    assert all(claim.expected is not ClaimOutcome.NOT_RUN for claim in claims)


def reproduction(*outcomes: ClaimOutcome) -> Reproduction:
    claim = replace(load_claims()[0], expected=ClaimOutcome.HOLDS)
    found = tuple(Finding(claim, "run", "ours", each) for each in outcomes)
    return Reproduction((Chapter(found),), 0.0)


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ((ClaimOutcome.HOLDS, ClaimOutcome.HOLDS), "pass"),
        ((ClaimOutcome.HOLDS, ClaimOutcome.FAILS), "fail"),
        ((ClaimOutcome.HOLDS, ClaimOutcome.NOT_RUN), "inconclusive"),
        ((ClaimOutcome.NOT_RUN, ClaimOutcome.CONDITION), "fail"),
    ],
)
def test_an_unexpected_verdict_fails(outcomes: tuple[ClaimOutcome, ...], expected: str) -> None:
    assert reproduction(*outcomes).outcome == expected


def test_the_gradient_flow_obeys_its_equation() -> None:
    """du/dt = -T'(Tu - eps), by a difference; it starts at 0 and rests at the exact solution."""
    T, strain, step = FINE.matrix, FINE.strain(1), 1e-4
    unit = 1.0 / float(np.linalg.norm(T, 2)) ** 2
    start, before, u, after = (gradient_flow(T, t, strain) for t in (0.0, 3 - step, 3.0, 3 + step))
    assert np.abs(start).max() == 0.0
    expected = -T.T @ (T @ u - strain)
    slope = (after - before) / (2.0 * step * unit)
    np.testing.assert_allclose(slope, expected, atol=1e-6 * np.abs(expected).max())
    rest = gradient_flow(T[:9, :9], np.inf, strain[:9])
    np.testing.assert_allclose(T[:9, :9] @ rest, strain[:9], atol=1e-9)


def test_the_fourier_transform_inverts_a_circular_convolution() -> None:
    offset = FINE.spacing * np.fft.fftfreq(FINE.channels, 1.0 / FINE.channels)
    row = 1.5 / np.pi * (1.0 - offset**2) / (1.0 + offset**2) ** 2  # eq (19), x = E = 1
    rng = np.random.default_rng(7)
    stress = rng.normal(size=FINE.channels)
    place = np.arange(FINE.channels)
    circulant = row[(place[:, None] - place[None, :]) % FINE.channels]
    found = by_transform(FINE, circulant @ stress)
    np.testing.assert_allclose(found, stress, atol=1e-6)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[NIGHTLY] * (n in SLOW)) for n in CHAPTERS])
def test_the_verdicts_are_the_expected_ones(name: str, request: pytest.FixtureRequest) -> None:
    if name in WITH_NGSPICE:
        request.getfixturevalue("ngspice")
    found = {finding.claim.id: finding for finding in CHAPTERS[name][1]().findings}
    asked = [claim for claim in load_claims() if claim.chapter == name]
    wanted = {claim.id: claim.expected for claim in asked}
    assert found.keys() == wanted.keys()
    judged = found.keys() - BY_CLOCK
    assert {id_: found[id_].outcome for id_ in judged} == {id_: wanted[id_] for id_ in judged}
    for finding in found.values():
        assert finding.run
        assert ("Condition:" in finding.ours) is (finding.outcome is ClaimOutcome.CONDITION)
        assert ("Fitted:" in finding.ours) is (finding.outcome is ClaimOutcome.FITTED)
        assert all(np.isfinite(list(finding.values.values())))


def test_a_solution_by_conjugate_gradients_is_that_of_the_whole_matrix() -> None:
    rng, column = np.random.default_rng(5), Geometry(61, 6.0).matrix[0]
    T, strain = toeplitz(column), rng.normal(size=61)
    wanted = np.linalg.solve(T @ T + 0.1 * np.eye(61), T @ strain)
    assert tikhonov(column, strain, 0.1) == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


@pytest.fixture
def circuit():
    return synthesise(load_scene(SCENES / "paper-breadboard.toml"))


def with_models(circuit, **figures):
    models = {name: replace(model, **figures) for name, model in circuit.models.items()}
    return replace(circuit, models=models)


def noise_gain(circuit):
    """Of the stage with the largest load: the least resistance at its summing node."""
    return 1.0 + circuit.value("gain") * np.sum(1.0 / circuit.forward.ohms, axis=1).max()


def test_one_pole_rises_in_its_closed_loop_time_constant(circuit):
    """Without a second pole the stage is a lag of noise gain / (2 pi GBW), but for 1/A0."""
    single = with_models(circuit, second_pole=np.inf, output_resistance=0.0)
    lag = noise_gain(circuit) / (2 * np.pi * 718e3)
    assert stage_step(single, loaded=False)[0] == pytest.approx(np.log(9) * lag, rel=1e-4)


def test_the_stage_with_its_capacitance_is_a_second_order_system(circuit):
    """One pole w = 2 pi GBW and C at the node: p² C s/w + p (noise gain)/w + 1, by SciPy."""
    single = with_models(circuit, second_pole=np.inf, output_resistance=0.0, dc_gain=1e9)
    w, s = 2 * np.pi * 718e3, circuit.value("gain")
    poles = [13e-12 * s / w, noise_gain(circuit) / w, 1.0]
    time, step = signal.step(([1.0], poles), T=np.linspace(0.0, 1e-4, 200_001))
    early, late = (time[np.argmax(step > level)] for level in (0.1, 0.9))
    rise, overshoot = stage_step(single, loaded=True)
    assert rise == pytest.approx(late - early, rel=1e-3)
    assert overshoot == pytest.approx(step.max() - 1.0, rel=1e-3)


@pytest.fixture(scope="module")
def told() -> Iterator[Demonstration]:
    """The story by the state-space engine; `tests/users` runs it as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            demonstration, "paper_scene", lambda name: paper_scene(name).with_engine("statespace")
        )
        yield taction.demo(None)


def test_the_boards_behave_as_told(told: Demonstration) -> None:
    assert told.outcome == "pass"
    assert [step.verdict.outcome.value for step in told.steps] == ["pass", "fail", "pass"]
    surprise = dataclasses.replace(told.steps[0], expected=Outcome.FAIL)
    assert dataclasses.replace(told, steps=(surprise, *told.steps[1:])).outcome == "fail"


def test_the_numbers_of_the_story_are_those_of_the_boards(told: Demonstration) -> None:
    """Frequency: of the rightmost eigenvalue by LAPACK; the others stand in the verdicts."""
    works, oscillates, settles = (step.text for step in told.steps)
    eigenvalues = np.linalg.eigvals(LinearBoard(told.steps[1].verdict.circuit).state_space.A)
    rightmost = eigenvalues[eigenvalues.real.argmax()]
    assert rightmost.real > 0.0
    assert f"oscillates at {abs(rightmost.imag) / 2e3 / np.pi:.1f} kHz" in oscillates
    assert "7 sensors" in works
    assert all("2.42 ms" in text for text in (works, settles))
    lam = {round(step.verdict.circuit.value("lambda"), 12) for step in told.steps}
    assert len(lam) == 1
