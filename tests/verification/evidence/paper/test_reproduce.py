"""The paper's claims: a table without holes, scenes as published, verdicts and pages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.scene.loading import load_scene
from taction.system.errors import SimulatorNotFound
from taction.verification.evidence.paper import findings
from taction.verification.evidence.paper import reproduce as module
from taction.verification.evidence.paper.findings import (
    Chapter,
    ClaimOutcome,
    Finding,
    Sentence,
    load_claims,
    weigh,
)
from taction.verification.evidence.paper.reproduce import (
    CHAPTERS,
    Judged,
    PaperSection,
    Reproduction,
    _run,
)
from taction.verification.evidence.paper.tactile import FINE, GradientFlow, by_transform
from tests.support.paths import SCENES


def test_every_claim_has_a_chapter_and_its_own_name() -> None:
    claims = load_claims()
    assert {claim.chapter for claim in claims} == set(CHAPTERS)
    assert len({claim.id for claim in claims}) == len(claims)
    assert all(claim.claim and claim.place for claim in claims)
    assert all(claim.expected is not ClaimOutcome.NOT_RUN for claim in claims)


def test_the_paper_uses_the_scenes_of_the_scenes_folder() -> None:
    assert findings.SCENES.resolve() == SCENES.resolve()
    scene = findings.paper_scene("paper-breadboard")
    assert scene.file.resolve() == SCENES / "paper-breadboard.toml"
    assert scene.model_dump() == load_scene(SCENES / "paper-breadboard.toml").model_dump()


def test_a_claim_that_holds_only_under_its_condition_says_so() -> None:
    assert weigh(True) is ClaimOutcome.HOLDS
    assert weigh(False, True) is ClaimOutcome.CONDITION
    assert weigh(False) is ClaimOutcome.FAILS
    assert weigh(True, fitted=True) is ClaimOutcome.FITTED
    assert weigh(False, fitted=True) is ClaimOutcome.FAILS


@pytest.mark.parametrize(
    ("template", "text"),
    [
        ("{x:.2g}", "0.12"),
        ("{x:.3g%}", "12.3 %"),
        ("{both:.3g%} of the seeds", "12.3, 50 % of the seeds"),
        ("{t:s}, {t:s.2}", "1.234 us, 1.2 us"),
        ("{both[1]:.1f} {word}", "0.5 yes"),
    ],
)
def test_sentences_are_filled_with_numbers_lists_and_quantities(template: str, text: str) -> None:
    values = {"x": 0.1234, "both": [0.1234, 0.5], "t": 1.234e-6, "word": "yes"}
    assert Sentence().format(template, **values) == text


def reproduction(*outcomes: ClaimOutcome) -> Reproduction:
    claim = replace(load_claims()[0], expected=ClaimOutcome.HOLDS)
    judged = tuple(Judged(claim, Finding(claim.id, "run", "ours", each)) for each in outcomes)
    return Reproduction((PaperSection("title", judged, (), 0.0),), (), True, 0.0)


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ((ClaimOutcome.HOLDS, ClaimOutcome.HOLDS), "pass"),
        ((ClaimOutcome.HOLDS, ClaimOutcome.FAILS), "fail"),
        ((ClaimOutcome.HOLDS, ClaimOutcome.NOT_RUN), "inconclusive"),
        ((ClaimOutcome.NOT_RUN, ClaimOutcome.CONDITION), "fail"),
    ],
)
def test_another_verdict_than_the_expected_one_fails(
    outcomes: tuple[ClaimOutcome, ...], expected: str
) -> None:
    assert reproduction(*outcomes).outcome == expected


def test_what_could_not_be_run_is_said_for_each_of_its_claims() -> None:
    def without_simulator(quick: bool) -> Chapter:
        raise SimulatorNotFound("no executable 'ngspice'")

    claims = list(load_claims()[:2])
    chapter = _run(without_simulator, claims, quick=True)
    assert [finding.id for finding in chapter.findings] == [claim.id for claim in claims]
    assert {finding.outcome for finding in chapter.findings} == {ClaimOutcome.NOT_RUN}
    assert "no executable" in chapter.findings[0].ours


def test_a_run_says_how_long_it_takes_and_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def chapter(quick: bool) -> Chapter:
        return Chapter(
            tuple(Finding(c.id, "", "", c.expected) for c in load_claims() if c.quick or not quick)
        )

    names = sorted({claim.chapter for claim in load_claims()})
    monkeypatch.setattr(module, "CHAPTERS", {name: (name, chapter) for name in names})
    for quick, seconds in ((False, module.WHOLE), (True, module.SHORT)):
        lines: list[str] = []
        result = module.reproduce(quick=quick, progress=lines.append)
        assert result.outcome == "pass"
        claims, chapters = len(result.judged), len(names)
        assert lines[0] == f"{claims} claims in {chapters} chapters: about {seconds} s"
        assert lines[1] == f"{names[0]} (1 of {chapters})"
        assert [line.split(" (")[0] for line in lines[1:]] == names


def test_the_gradient_flow_obeys_its_equation() -> None:
    """du/dt = -T'(Tu - eps), by a difference; and it starts at 0."""
    flow, strain = GradientFlow(FINE.matrix), FINE.strain(1)
    unit = 1.0 / float(np.linalg.norm(FINE.matrix, 2)) ** 2
    assert np.abs(flow.at(0.0, strain)).max() == 0.0
    step = 1e-4
    slope = (flow.at(3.0 + step, strain) - flow.at(3.0 - step, strain)) / (2.0 * step * unit)
    u = flow.at(3.0, strain)
    expected = -FINE.matrix.T @ (FINE.matrix @ u - strain)
    np.testing.assert_allclose(slope, expected, atol=1e-6 * np.abs(expected).max())


def test_the_fourier_transform_inverts_a_circular_convolution() -> None:
    offset = FINE.spacing * np.fft.fftfreq(FINE.channels, 1.0 / FINE.channels)
    row = 1.5 / np.pi * (1.0 - offset**2) / (1.0 + offset**2) ** 2  # eq (19), x = E = 1
    rng = np.random.default_rng(7)
    stress = rng.normal(size=FINE.channels)
    place = np.arange(FINE.channels)
    circulant = row[(place[:, None] - place[None, :]) % FINE.channels]
    found = by_transform(FINE, circulant @ stress)
    np.testing.assert_allclose(found, stress, atol=1e-6)
