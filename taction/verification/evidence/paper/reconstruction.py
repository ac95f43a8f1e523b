"""Figures 5 to 9: the stress from noisy strain, by the network and by the Fourier transform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import Floats
from taction.system.charts import SERIES, Axis, Chart, Curve
from taction.verification.evidence.paper.findings import Chapter, Finding, chart, finding, weigh
from taction.verification.evidence.paper.tactile import (
    COARSE,
    FINE,
    Geometry,
    by_transform,
    entropy,
    gradient_flow,
    unit_network,
)
from taction.verification.reference.ideal_answer import ScaledNetwork

PRINTED = (0.1, 10.0, 100.0)  # the paper's lambdas
LAMBDAS = tuple(np.geomspace(0.01, 300.0, 13).tolist())
STOP = 10.0  # time constants of the fastest mode at which figure 5's flow is stopped
PICTURE_SEED = 3
ACCURATE = 0.1  # of the squared error of the answer 0: the limit of "accurately"
MOST = 0.9  # share of the seeds for which a claim that holds must be true


@dataclass(frozen=True, slots=True, eq=False)
class _Trials:
    """Squared errors (eq 20) over S seeds on one geometry.

    `flow` (S, 2): stopped and converged, `transform` (S, 1), `printed` (S, 3) and `scanned` (S, 13)
    by lambda; `least` (S, 2): the least outputs of the stopped flow and at lambda = 0.1.
    """

    geometry: Geometry
    flow: Floats
    transform: Floats
    printed: Floats
    scanned: Floats
    least: Floats

    @property
    def better(self) -> Floats:
        """Shares (2,) of seeds for which each flow is better than the transform."""
        return np.asarray(np.mean(self.flow < self.transform, axis=0))

    @property
    def ten_wins(self) -> float:
        """Share of seeds for which 10 is the best of the three printed values."""
        return float(np.mean(np.argmin(self.printed, axis=1) == 1))

    @property
    def over_zero(self) -> tuple[float, float]:
        """Median errors at lambda = 10 and at the best lambda over that of the answer 0."""
        of_zero = float(np.mean(self.geometry.stress**2))
        each = (self.printed[:, 1], self.scanned.min(axis=1))
        ten, best = (float(np.median(errors)) / of_zero for errors in each)
        return ten, best


def reconstruction(quick: bool) -> Chapter:
    """Judge section 4.2 over many seeds of the noise, on a coarse wide and a fine narrow grid."""
    seeds = range(1, 21 if quick else 301)
    both = (_trials(COARSE, seeds), _trials(FINE, seeds))
    findings = (*_unregularised(*both), *_regularised(*both))
    return Chapter(findings, (*_figures(), *(_errors(trials) for trials in both)))


def _trials(geometry: Geometry, seeds: range) -> _Trials:
    T, strains = geometry.matrix, np.array([geometry.strain(seed) for seed in seeds])
    flows = [gradient_flow(T, time, strains) for time in (STOP, np.inf)]
    solved = [
        np.array([entropy(T, strain, lam) for strain in strains]) for lam in (*PRINTED, *LAMBDAS)
    ]
    u = np.array([*flows, by_transform(geometry, strains), *solved])
    errors = np.mean((u - geometry.stress) ** 2, axis=2).T
    least = u[[0, 3]].min(axis=2).T
    flow, transform, printed, scanned = np.split(errors, [2, 3, 6], axis=1)
    return _Trials(geometry, flow, transform, printed, scanned, least)


def _unregularised(coarse: _Trials, fine: _Trials) -> tuple[Finding, ...]:
    """Judge figures 5 and 6, and search for an output below zero of exponential amplifiers."""
    both, seeds = (coarse, fine), len(fine.flow)
    negative = min(float(np.mean(t.least[:, 0] < 0.0)) for t in both)
    ratio = float(np.divide(*np.median(fine.flow, axis=0)))
    strain = FINE.strain(PICTURE_SEED)
    scaled = ScaledNetwork(unit_network(FINE.matrix, strain, mu=1e-6))
    least = float(scaled.g.g(np.linspace(-700.0, 0.0, 1401)).min())
    least_u = float(entropy(FINE.matrix, strain, 0.01).min())
    stopped, converged = np.transpose([t.better for t in both]).tolist()
    condition = [float(np.linalg.cond(t.geometry.matrix)) for t in both]
    at_rest = min(converged) >= MOST
    positive = weigh(min(least, least_u) <= 0.0)
    early = {"negative_share": negative, "stopped_over_converged": ratio, "stop": STOP}
    return (
        finding("figure-5", weigh(False, negative >= MOST and ratio < 0.01), **early, seeds=seeds),
        finding("figure-5-exponential", positive, least_output=least, least_u=least_u),
        finding("figure-6", weigh(at_rest, min(stopped) >= MOST), **_pair(stopped), seeds=seeds),
        finding("figure-6-converged", weigh(at_rest), **_pair(converged), condition=condition),
    )


def _regularised(coarse: _Trials, fine: _Trials) -> tuple[Finding, ...]:
    """Judge figures 7 to 9, and how near the best answer is to the true one."""
    both, seeds = (coarse, fine), len(fine.flow)
    positive = min(float(np.mean(t.least[:, 1] > 0.0)) for t in both)
    weak = [float(np.mean(t.printed[:, 0] > 2.0 * t.scanned.min(axis=1))) for t in both]
    truths = [t.geometry.stress for t in both]
    strong = [entropy(t.geometry.matrix, t.geometry.strain(PICTURE_SEED), PRINTED[2]) for t in both]
    peaks = [float(u.max() / truth.max()) for u, truth in zip(strong, truths, strict=True)]
    floors = [float(u[truth == 0.0].min()) for u, truth in zip(strong, truths, strict=True)]
    ten, best = zip(*(t.over_zero for t in both), strict=True)
    everywhere, wins = positive == 1.0, [t.ten_wins for t in both]
    too_weak = weigh(everywhere and min(weak) >= 0.5, everywhere and max(weak) >= 0.5)
    too_strong = weigh(max(peaks) < 0.6 and min(floors) > 0.1)
    medians = [np.median(t.printed, axis=0).tolist() for t in both]
    lambdas = [np.median(np.array(LAMBDAS)[t.scanned.argmin(axis=1)]) for t in both]
    shown = {"medians": medians, "best": lambdas, "seeds": seeds}
    accurate = weigh(max(ten) <= ACCURATE, min(best) <= ACCURATE)
    errors = _pair(ten, "ten_") | _pair(best, "best_")
    return (
        finding("figure-7", too_weak, positive=positive, **_pair(weak), seeds=seeds),
        finding("figure-8", too_strong, **_pair(peaks, "peak_"), floor=min(floors), floors=floors),
        finding("figure-9", weigh(min(wins) >= MOST, wins[0] >= 0.8), **_pair(wins), **shown),
        finding("noise-immunity", accurate, **errors, seeds=seeds),
    )


def _pair(values: Sequence[float], before: str = "") -> dict[str, float]:
    """Return the values on the two geometries with their names."""
    return dict(zip((f"{before}coarse", f"{before}fine"), values, strict=True))


def _figures() -> list[Chart]:
    """Return figures 5 to 9 on the fine grid."""
    T, strain = FINE.matrix, FINE.strain(PICTURE_SEED)
    answers = {
        "Fig 5: lambda = 0, stopped flow": gradient_flow(T, STOP, strain),
        "Fig 6: Fourier transform": by_transform(FINE, strain),
        "Fig 7: lambda = 0.1": entropy(T, strain, 0.1),
        "Fig 8: lambda = 100": entropy(T, strain, 100.0),
        "Fig 9: lambda = 10": entropy(T, strain, 10.0),
        "best of 13: lambda = 0.31": entropy(T, strain, 0.31),
    }
    text = "Figures 5 to 9 again: N = 51 over y = -3 to 3, noise variance 0.1, one seed."
    axes = Axis("y (in depths)"), Axis("stress")
    truth = Curve(FINE.y, FINE.stress, "true", "ink", "dash")
    return [
        chart(title, text, *axes, truth, Curve(FINE.y, u, "recovered"))
        for title, u in answers.items()
    ]


def _errors(trials: _Trials) -> Chart:
    low, middle, high = np.quantile(trials.scanned, (0.1, 0.5, 0.9), axis=0)
    printed = np.median(trials.printed, axis=0)
    return chart(
        f"N = {trials.geometry.channels} over {trials.geometry.span:g} depths",
        "Which lambda is best depends on the grid, which the paper does not give.",
        Axis("lambda", scale="log"),
        Axis("mean squared error, eq (20)", scale="log"),
        Curve(LAMBDAS, middle, "median of the seeds", mark="circle"),
        Curve(LAMBDAS, low, "10 and 90 %", line="dot"),
        Curve(LAMBDAS, high, line="dot"),
        Curve(PRINTED, printed, "the paper's three", SERIES[3], "", "square"),
    )
