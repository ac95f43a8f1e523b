"""Every chapter of the reproduction, quick and whole: the verdicts are those of the table."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.linalg import toeplitz

from taction.verification.evidence.paper.conditioning import asymptotic, condition_number
from taction.verification.evidence.paper.findings import ClaimOutcome, load_claims
from taction.verification.evidence.paper.reproduce import CHAPTERS
from taction.verification.evidence.paper.speed import tikhonov
from taction.verification.evidence.paper.tactile import Geometry

WITH_NGSPICE = ("breadboard", "console", "hardware", "closed-loops")
SHORTENED = ("reconstruction", "console", "simnon", "energy", "conditioning")
BY_CLOCK = {"digital-impossible", "digital-quadratic"}  # as fast as the machine is today


WHOLE = pytest.mark.nightly  # up to a minute; with every commit these chapters run shortened


@pytest.mark.parametrize(
    ("name", "quick"),
    [
        *(pytest.param(n, False, marks=[WHOLE] * (n in SHORTENED)) for n in CHAPTERS),
        *((name, True) for name in SHORTENED),
    ],
)
def test_the_verdicts_are_the_expected_ones(
    name: str, quick: bool, request: pytest.FixtureRequest
) -> None:
    if name in WITH_NGSPICE:
        request.getfixturevalue("ngspice")
    found = {finding.id: finding for finding in CHAPTERS[name][1](quick).findings}
    asked = [claim for claim in load_claims() if claim.chapter == name]
    wanted = {claim.id: claim.expected for claim in asked if claim.quick or not quick}
    assert found.keys() == wanted.keys()
    judged = found.keys() - BY_CLOCK
    assert {id_: found[id_].outcome for id_ in judged} == {id_: wanted[id_] for id_ in judged}
    for finding in found.values():
        assert finding.run
        assert ("Condition:" in finding.ours) is (finding.outcome is ClaimOutcome.CONDITION)
        assert ("Fitted:" in finding.ours) is (finding.outcome is ClaimOutcome.FITTED)
        assert all(np.isfinite(list(finding.values.values())))


def test_a_large_condition_number_is_that_of_mpmath() -> None:
    """Eigenvalues at 60 digits; N = 41 over 4 depths."""
    N = 41
    with mp.workdps(60):
        row = [(1 - mp.mpf(k * k) / 100) / (1 + mp.mpf(k * k) / 100) ** 2 for k in range(N)]
        T = mp.matrix(N, N)
        for i in range(N):
            for j in range(N):
                T[i, j] = row[abs(i - j)]
        values = mp.eigsy(T, eigvals_only=True)
        expected = float(values[N - 1] / values[0])
    assert expected > 1e10
    assert condition_number(10.0, 4.0) == pytest.approx(expected, rel=1e-4)


def test_a_solution_by_conjugate_gradients_is_that_of_the_whole_matrix() -> None:
    rng, column = np.random.default_rng(5), Geometry(61, 6.0).matrix[0]
    T, strain = toeplitz(column), rng.normal(size=61)
    wanted = np.linalg.solve(T @ T + 0.1 * np.eye(61), T @ strain)
    assert tikhonov(column, strain, 0.1) == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


def test_the_asymptotic_formula_is_the_ratio_of_the_sampled_spectrum() -> None:
    """3/2 w exp(-w) at w = 1 over its two aliases at the Nyquist frequency, r = 12."""
    nyquist = np.pi * 12.0
    expected = np.exp(-1.0) / (2.0 * nyquist * np.exp(-nyquist))
    assert asymptotic(12.0) == pytest.approx(expected, rel=1e-12)
