"""The sensing problem of the paper: kernel, load, equations as printed; the recovered stress.

Cylinder load (18), kernel (19), white noise on the strain. The paper prints neither the number of
channels nor the range of y, so there are two geometries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import cylinder_stress, grid, kernel, make_problem
from taction.netlist_gen.scene.problem_keys import CylinderLoad
from taction.system.array_types import Floats
from taction.system.charts import Axis, Chart, Curve
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    weigh,
)
from taction.verification.evidence.paper.ideal_flow import linear_outputs
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve

VARIANCE = 0.1


@dataclass(frozen=True, slots=True)
class Geometry:
    """A grid of `channels` points over `span` depths, at depth 1."""

    channels: int
    span: float

    @property
    def y(self) -> Floats:
        """Positions (N,)."""
        return grid(self.channels, self.span)

    @property
    def spacing(self) -> float:
        """Distance of neighbours over the depth."""
        return self.span / (self.channels - 1)

    @property
    def matrix(self) -> Floats:
        """Matrix (N, N) of eq (19), without weights, as the paper prints eq (4)."""
        return kernel(self.y[:, None] - self.y[None, :], depth=1.0, modulus=1.0, poisson=0.5)

    @property
    def stress(self) -> Floats:
        """Stress (N,) of eq (18) with p = 3, a = 1."""
        return cylinder_stress(self.y, CylinderLoad())

    def strain(self, seed: int, variance: float = VARIANCE) -> Floats:
        """Return the strain (N,) with noise."""
        clean = self.matrix @ self.stress
        noise = np.random.default_rng(seed).normal(0.0, np.sqrt(variance), clean.shape)
        return np.asarray(clean + noise)


COARSE = Geometry(21, 16.0)
FINE = Geometry(51, 6.0)


def entropy(T: Floats, strain: Floats, lam: float) -> Floats:
    """Return the minimiser (N,) of eq (8)."""
    return solve(Problem(T, strain, lam, "exponential", True)).u


def unit_network(
    T: Floats, strain: Floats, mu: float, amplifier: str = "exponential"
) -> IdealNetwork:
    """Return the ideal network with unit U0 and Ve whose times count in R C.

    `mu` is ``1 / (s R)``: lambda for linear amplifiers, half of lambda for exponential ones.
    """
    regulariser = REGULARISERS[amplifier]
    lam = mu / regulariser.weight
    return IdealNetwork(T, strain, lam, RC=1.0, amplifier=amplifier, bias=regulariser.biased)


def difference(a: Floats, b: Floats) -> float:
    """Return the largest difference of two arrays over the largest entry of the second."""
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def by_transform(geometry: Geometry, strain: Floats) -> Floats:
    """Deconvolve (..., N) by the discrete Fourier transform: divide by the kernel's spectrum."""
    N = geometry.channels
    offset = np.asarray(geometry.spacing * np.fft.fftfreq(N, 1.0 / N), dtype=np.float64)
    spectrum = np.fft.fft(kernel(offset, depth=1.0, modulus=1.0, poisson=0.5))
    return np.asarray(np.fft.ifft(np.fft.fft(strain) / spectrum).real)


def gradient_flow(T: Floats, time: float, strain: Floats) -> Floats:
    """Return the outputs (..., N) of ``du/dt = -Tᵀ(Tu - eps)`` from zero, exact in the modes of T.

    `time` is in time constants of the fastest mode, and infinity is the rest.
    """
    U, sigma, Vt = np.linalg.svd(T)
    share = -np.expm1(-((sigma / sigma[0]) ** 2) * time) / sigma
    return np.asarray((strain @ U * share) @ Vt)


POISSON = (0.1, 0.3, 0.5)
SAME, CLOSE = 1e-12, 1e-9
OFFSETS = np.linspace(-4.0, 4.0, 161)
SIZES = (26, 51, 101, 201)
FAR = 1e4  # half of a wide range for the mean of the kernel
GEOMETRY = Geometry(9, 4.0)
R, S = 0.25, 3.0  # neither is 1, so that a missing factor shows

corrected = partial(kernel, depth=1.0, modulus=1.0)


def kernels() -> Chapter:
    """Judge the printed kernels and load."""
    return Chapter((*_strain(), *_matrix(), _load(), _mean()))


def _printed(offset: Floats, nu: float) -> Floats:
    """Return the kernel of eq (2) as printed, with x = E = 1."""
    return np.asarray(
        2.0 * ((1 - nu) ** 2 - nu * (nu + 1) * offset**2) / (np.pi * (1 + offset**2) ** 2)
    )


def _plane_strain(offset: Floats, nu: float) -> Floats:
    """Return the strain under a line force, from its stresses (Flamant) and Hooke's law."""
    r4 = (1.0 + offset**2) ** 2
    along, across = 2.0 / (np.pi * r4), 2.0 * offset**2 / (np.pi * r4)
    return np.asarray((1.0 - nu**2) * along - nu * (1.0 + nu) * across)


def _off(expected: Floats, printed: Floats, right: Floats) -> dict[str, float]:
    """Return how far the printed and the corrected kernel are from `expected`."""
    return {"printed": difference(printed, expected), "corrected": difference(right, expected)}


def _strain() -> tuple[Finding, ...]:
    """Judge the kernels for normal and tangential stress, and that for nu = 0.5."""
    y = OFFSETS
    each = [_off(_plane_strain(y, nu), _printed(y, nu), corrected(y, poisson=nu)) for nu in POISSON]
    normal = {name: max(off[name] for off in each) for name in each[0]}
    wrong = [off["printed"] for off in each]
    known = 1.5 / np.pi * (1 - y**2) / (1 + y**2) ** 2
    special = _off(known, _printed(y, 0.5), corrected(y, poisson=0.5))
    right = corrected(y, poisson=0.5, tangential=True)
    tangential = _off(y * _plane_strain(y, 0.5), y * _printed(y, 0.5), right)
    return (
        finding("eq-2", weigh(normal["printed"] <= SAME), **normal, nu=POISSON, wrong=wrong),
        finding("eq-19", weigh(special["corrected"] <= SAME), **special),
        finding("eq-3", weigh(tangential["printed"] <= SAME), **tangential),
    )


def _matrix() -> tuple[Finding, ...]:
    """Judge the discretisation, the symmetry of the kernel, and the resistors of a board."""
    y = GEOMETRY.y
    T = corrected(y[:, None] - y[None, :], poisson=0.5, tangential=True)
    sigma, skew = np.linalg.svd(T, compute_uv=False), difference(T, -T.T)
    least = float(sigma[-1] / sigma[0])
    grids = [Geometry(N, 6.0) for N in SIZES]
    norms = [float(np.linalg.norm(grid.matrix, 2)) for grid in grids]
    weighted = [norm * grid.spacing for norm, grid in zip(norms, grids, strict=True)]
    spread = max(weighted) / min(weighted) - 1.0
    found = {"first": norms[0], "last": norms[-1], "weighted_spread": spread}
    lists = {"sizes": SIZES, "norms": norms, "weighted": weighted}
    scene = paper_scene("paper-breadboard")
    absent = float(np.sum(~np.isfinite(synthesise(scene, make_problem(scene)).forward_ohms)))
    symmetric = weigh(skew > 0.1, skew <= SAME)
    return (
        finding("kernel-symmetric", symmetric, skew=skew, least_singular_value=least),
        finding("eq-4", weigh(norms[-1] < 1.5 * norms[0], spread < 0.05), **found, **lists),
        finding("resistors", weigh(absent == 0, absent == 12), absent=absent),
    )


def _load() -> Finding:
    # y = a sin(theta) makes the integrand smooth, so the trapezoidal rule is exact.
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 201)
    printed, hertz = (
        float(np.trapezoid(cylinder_stress(np.sin(theta), load) * np.cos(theta), theta))
        for load in (
            CylinderLoad(kind="cylinder", force=3.0, half_width=1.0, normalised=normalised)
            for normalised in (False, True)
        )
    )
    return finding("eq-18", weigh(abs(printed - 3.0) <= CLOSE), printed=printed, hertz=hertz)


def _mean() -> Finding:
    """Integrate eq (19) over a range; 1.5/pi y/(1 + y²) is primitive."""
    closed, tail = (3.0 / np.pi * edge / (1.0 + edge**2) for edge in (40.0, FAR))
    fine = np.linspace(-40.0, 40.0, 400_001)
    numeric = float(np.trapezoid(corrected(fine, poisson=0.5), fine))
    outcome = weigh(tail > 1e-2, abs(numeric - closed) < 1e-6)
    return finding("kernel-mean", outcome, at_40=numeric, closed_form=closed, tail=tail)


def equations() -> Chapter:
    """Judge what the printed equations say of the network's rest."""
    T, strain = GEOMETRY.matrix, GEOMETRY.strain(1, 0.01)
    printed = _gradient(2.0 / S, T, strain, bias=False)  # eq (9), without R and bias current
    off = {f"at_{k}": _gradient(k / (S * R), T, strain) for k in (1, 2, 4)}
    right, others = off["at_2"], min(off["at_1"], off["at_4"])
    network = unit_network(T, strain, 1.0 / (S * R), "linear")
    rest = linear_outputs(network)[1][-1]
    ridges = [T.T @ T + factor / (S * R) * np.eye(len(rest)) for factor in (2.0, 1.0)]
    twice, once = (difference(np.asarray(np.linalg.solve(A, T.T @ strain)), rest) for A in ridges)
    findings = (
        finding("eq-9", weigh(printed <= CLOSE), printed=printed, corrected=right, R=R, s=S),
        finding("eq-16", weigh(right <= CLOSE and others > 0.01), **off),
        finding("eq-21", weigh(twice <= CLOSE), printed=twice, corrected=once),
        _path(T, strain),
    )
    return Chapter(findings)


def _gradient(lam: float, T: Floats, strain: Floats, *, bias: bool = True) -> float:
    """Return ``‖∂P/∂u‖`` of eq (16) over its largest term at the minimum of eq (8) with `lam`."""
    u = solve(Problem(T, strain, lam, "exponential", bias)).u
    terms = (np.log(u) + 1.0) / R
    return float(np.max(np.abs(S * T.T @ (T @ u - strain) + terms)) / np.max(np.abs(terms)))


def _path(T: Floats, strain: Floats) -> Finding:
    """Integrate the currents round a closed rectangle, over v and over u = exp(v)."""
    points, weights = np.polynomial.legendre.leggauss(20)
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    over_v = over_u = size = 0.0
    for a, b in pairwise(corners):
        for point, weight in zip(points.tolist(), weights.tolist(), strict=True):
            v, along = np.zeros((2, GEOMETRY.channels))
            v[:2] = a + 0.5 * (1.0 + point) * (b - a)
            along[:2] = 0.5 * weight * (b - a)
            current = -(v + 1.0) / R - S * T.T @ (T @ np.exp(v) - strain)
            over_v += float(current @ along)
            over_u += float(current @ (np.exp(v) * along))
            size += abs(float(current @ along))
    in_v, in_u = abs(over_v) / size, abs(over_u) / size
    return finding("eq-10", weigh(in_v <= CLOSE), over_v=in_v, over_u=in_u)


PRINTED = (0.1, 10.0, 100.0)  # the paper's lambdas
LAMBDAS = tuple(np.geomspace(0.01, 300.0, 13).tolist())
STOP = 10.0  # time constants of the fastest mode at which figure 5's flow is stopped
PICTURE_SEED, SEEDS = 3, 100
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


def reconstruction() -> Chapter:
    """Judge section 4.2 over many seeds of the noise, on a coarse wide and a fine narrow grid."""
    both = (_trials(COARSE), _trials(FINE))
    findings = (*_unregularised(*both), *_regularised(*both))
    return Chapter(findings, tuple(_figures()))


def _trials(geometry: Geometry) -> _Trials:
    strains = np.array([geometry.strain(seed) for seed in range(1, 1 + SEEDS)])
    T = geometry.matrix
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
    least = float(REGULARISERS["exponential"].g(np.linspace(-700.0, 0.0, 1401)).min())
    least_u = float(entropy(FINE.matrix, strain, 0.01).min())
    better = [np.mean(t.flow < t.transform, axis=0) for t in both]  # than the transform
    stopped, converged = np.transpose(better).tolist()
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
    zero = [float(np.mean(truth**2)) for truth in truths]  # error of the answer 0
    ten, best = (
        [float(np.median(errors)) / size for errors, size in zip(each, zero, strict=True)]
        for each in ([t.printed[:, 1] for t in both], [t.scanned.min(axis=1) for t in both])
    )
    wins = [float(np.mean(np.argmin(t.printed, axis=1) == 1)) for t in both]  # 10 is the best
    everywhere = positive == 1.0
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
        Chart(title, *axes, (truth, Curve(FINE.y, u, "recovered")), text)
        for title, u in answers.items()
    ]
