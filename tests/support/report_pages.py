"""Reports of every command on small boards, made in this process."""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import taction
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import Axis, Chart, Curve
from taction.system.errors import InputError
from taction.verification.design.choose import (
    CAPACITANCE,
    GAIN,
    BestDesign,
    Choice,
    best_designs,
    choice_plan,
    designs,
)
from taction.verification.design.trials import SearchRange
from taction.verification.design.tune import Tuned
from taction.verification.report.blocks import (
    PAGE,
    Bar,
    Bars,
    Cell,
    Code,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.views import comparison_view as regression
from taction.verification.report.views import design_view as design
from taction.verification.report.views import evidence_view as evidence
from taction.verification.report.views import stability_view as onset
from taction.verification.report.views import tolerance_view as tolerance
from taction.verification.report.views.sweep_view import view as sweep_report
from taction.verification.report.views.verdict_view import view as verdict_report
from taction.verification.studies.regression.regress import RegressionReport, SceneResult, Status
from taction.verification.studies.running.store import Store
from taction.verification.studies.running.study import HERE
from taction.verification.studies.sweep import SweepResult, grid_points
from taction.verification.studies.tolerance.corners import worst_of
from taction.verification.studies.tolerance.montecarlo import (
    YieldReport,
    prepare,
    run_samples,
    summarise_samples,
)
from taction.verification.studies.work_precision import (
    METHODS,
    Method,
    SettingResult,
    WorkPrecisionStudy,
)
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import Difference, Record
from taction.verification.verdict.verify import Verdict, verify
from tests.support.entries import entry, grid_plan, make_record, make_trial, store_records
from tests.support.making import make_scene
from tests.support.studying import one_thread, small_scene

HOSTILE = '<script>window.hacked = 1</script><img src=x onerror="window.hacked = 2">\'"&</style>'
STATESPACE: dict[str, Any] = {"engine": "statespace"}
WORN = {"resistor": 0.05, "capacitor": 0.1}


def from_matrix(T: Any, eps: Any, **values: Any) -> Verdict:
    """Verify a matrix by the state-space engine."""
    return verify(Scene.from_arrays(T, eps, **STATESPACE, **values))


@functools.cache
def verdicts() -> dict[str, Verdict]:
    """Verdicts that pass, fail, oscillate and are exponential, of 1 to 64 channels."""
    three = {"channels": 3, "span": 2.0}
    calm = {"capacitance": "100pF", "gain": "100kohm"}
    matrix = [[1.0, 0.2], [-0.3, 0.8], [0.0, 0.5]]
    wide = [[1.0 / (1 + 4 * abs(k - n)) for n in range(64)] for k in range(64)]
    stress = {"unit_conductance": "2uS", "capacitance": "1nF", "gain": "100kohm"}
    limited = {"settling_time": {"band": 0.01, "max": "1ns"}, "overshoot": {"max": 1e-9}}
    return {
        "passing": verify(make_scene(three, design=calm, analysis=STATESPACE)),
        "failing": verify(make_scene(three, design=calm, analysis=STATESPACE, checks=limited)),
        "oscillating": from_matrix([[2.0]], [1.0], capacitance="10pF"),
        "exponential": from_matrix(
            matrix, [0.4, 0.2, 0.1], amplifier="exponential", capacitance="1nF", gain="100kohm"
        ),
        "passive": from_matrix(
            matrix, [0.4, 0.2, 0.1], topology="passive", unit_conductance="2uS", lam=5.0
        ),
        "one channel": from_matrix([[2.0]], [1.0], capacitance="1nF", gain="10kohm"),
        "64 channels": from_matrix(wide, [1.0] * 64, **stress),
    }


def varied() -> YieldReport:
    """Return the yield of a scene with 60 samples."""
    checks = {"steady_state": {"tolerance": 0.03}, "settling_time": {"band": 0.2}}
    board = prepare(small_scene(tolerances=WORN, checks=checks))
    return summarise_samples(board, [*run_samples(board, 60, 5, HERE)], 5)


def _corners() -> Page:
    scene = small_scene(tolerances=WORN | {"distribution": "uniform"})
    with one_thread() as workers:
        return tolerance.corner_view(worst_of(prepare(scene, full_margin=True), workers))


def _onset() -> Page:
    scene = make_scene({"channels": 3, "span": 2.0}, analysis=STATESPACE)
    return onset.onset_view(taction.onset(scene, over="C=1pF:100pF:13", transients=False))


def tuned() -> Tuned:
    """Return a tuning."""
    verdict = verdicts()["passing"]
    before = make_trial({"design.gain": 1e5, "design.capacitance": 1e-10}, 2e-4, 0.09)
    after = make_trial({"design.gain": 3e5, "design.capacitance": 1e-10}, 3e-5, 0.09)
    ranges = (
        SearchRange("design.gain", "ohm", 1e5, 1e4, 1e6, "E24"),
        SearchRange("design.capacitance", "F", 1e-10, 1e-11, 1e-9, "E24"),
    )
    return Tuned(before, after, verdict.scene, 57, 0.1, 1.2, ranges, verdict, (before, after))


def _sweep(*over: str) -> Page:
    result = swept(*over)
    with result.store:
        found = sweep_report(result)
        made = tuple(replace(each, blocks=each.made(PAGE)) for each in found.sections)
        return replace(found, sections=made)


def swept(*over: str) -> SweepResult:
    """Return the points of a sweep with every outcome, in an open store."""
    plan = grid_plan(*over)
    outcomes = ("pass", "fail", "inconclusive", "error")
    stored = {
        place: make_record(
            outcome=outcomes[place % 4],
            settling_time=1e-6 * (1 + place),
            growth_rate=-1e4 + 3e3 * place,
            reason=HOSTILE if place % 4 else "",
        )
        for place in range(plan.points)
    }
    store = Store(":memory:")
    store_records(plan, store, stored)
    counted = Counter(record.outcome for record in stored.values())
    return SweepResult(plan, store, 0, counted)


def _choice(settling: str = "1ms") -> Page:
    limits = {"checks.settling_time.max": settling, "checks.noise.max": "1V"}
    names, ranges = ["ua741", "ideal", "tl084"], {CAPACITANCE: "100pF:1nF", GAIN: "50k:200k"}
    asked = verdicts()["passing"].scene
    plan = choice_plan(asked, names, ranges, 3, limits)
    with Store(":memory:") as store:
        for _, values, key in grid_points(plan):
            try:
                result = Record.of(verify(with_values(plan.scene, values)))
            except InputError as error:
                result = Record.without_verdict(error, "statespace")
            store.put(key, result)
        ranked = designs(plan, store)
    best = best_designs(ranked)
    said = [BestDesign(one, asked, Outcome.PASS) for one in best[:1]]
    said += [BestDesign(one, asked, None, HOSTILE) for one in best[1:]]
    return design.choice_view(Choice(asked, ranked, said))


def _setting(method: Method, setting: float, k: int) -> SettingResult:
    seconds = 0.01 * 2.0**k
    return SettingResult(
        method, setting, "done", seconds, 100 * 2**k, 1e-2 * 0.25**k, "another",
        HOSTILE if k else "",
    )  # fmt: skip


def work_precision() -> WorkPrecisionStudy:
    """Return a study with four settings of each method."""
    points = [_setting(m, s, k) for m in METHODS for k, s in enumerate(m.ladder[:4])]
    return WorkPrecisionStudy(
        scene=small_scene(),
        points=tuple(points),
        references=(HOSTILE,),
        floor=1e-7,
        amplitude=1.0,
        transient=Transient(1e-3, 1e-6),
        period=1e-5,
        omissions=(HOSTILE,),
        machine={},
        seconds=2.0,
    )


def _regression() -> Page:
    check = Check("settling_time", Outcome.FAIL, 2e-3, 1e-6, 1e-3, None, "s", HOSTILE)
    change = Difference("channels", "final", 1, 1.0, 1.5, "V", 0.5, 0.01, 50.0, HOSTILE)
    results = (
        SceneResult("same.toml", Status.SAME, (check,), (), (), "", entry(), entry()),
        SceneResult("a.toml", Status.BROKEN, (check,), (change,), (HOSTILE,), "", entry(), entry()),
        SceneResult("gone.toml", Status.MISSING, reason=HOSTILE, baseline=entry()),
    )
    return regression.regression_view(
        RegressionReport(HOSTILE, "baseline.json", results, updated=False)
    )


def hostile() -> Page:
    """Return a report in which every text is markup."""
    curve = Curve([0.0, 1.0], [0.0, 1.0], HOSTILE)
    blocks = (
        Bars(HOSTILE, (Bar(HOSTILE, "fail", 2.0, 0.5, HOSTILE, HOSTILE, HOSTILE),), HOSTILE),
        Table(HOSTILE, (HOSTILE,), ((Cell(HOSTILE),),), HOSTILE),
        Chart(HOSTILE, Axis(HOSTILE), Axis(HOSTILE), (curve,), HOSTILE),
        Facts(HOSTILE, ((HOSTILE, HOSTILE),)),
        Code(HOSTILE, HOSTILE, HOSTILE),
        Notes(HOSTILE, (HOSTILE,)),
    )
    section = Section(HOSTILE, blocks, HOSTILE, media="page")
    return Page(HOSTILE, HOSTILE, "fail", HOSTILE, (HOSTILE,), (section,))


STUDIES: dict[str, Callable[[], Page]] = {
    "montecarlo": lambda: tolerance.yield_view(varied()),
    "corners": _corners,
    "onset": _onset,
    "tune": lambda: design.tuning_view(tuned()),
    "sweep, a map": lambda: _sweep("C=10pF:100pF:4", "gain=10k:100k:3"),
    "sweep, a curve": lambda: _sweep("C=10pF:100pF:8"),
    "sweep, three axes": lambda: _sweep(
        "C=10pF:100pF:3", "gain=10k:100k:2", "stray_capacitance=1pF:9pF:2"
    ),
    "sweep, only op-amps": lambda: _sweep("opamp.base=ua741,op27,tl084"),
    "sweep, op-amps": lambda: _sweep("opamp.base=ua741,op27", "C=10pF:100pF:3"),
    "accuracy": lambda: evidence.accuracy_view(work_precision()),
    "regress": _regression,
    "choose": _choice,
    "choose, none passes": lambda: _choice("1ns"),
}
VERDICTS = (
    "passing", "failing", "oscillating", "exponential", "passive", "one channel", "64 channels"
)  # fmt: skip


@functools.cache
def page(name: str) -> Page:
    """Return a report by its name in `STUDIES` or `VERDICTS`."""
    return STUDIES[name]() if name in STUDIES else verdict_report(verdicts()[name])
