"""Yields: intervals in closed form, draws that nothing disturbs, stopping, sensitivities."""

from __future__ import annotations

import json
import math
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from scipy.stats import binom, binomtest

from taction.netlist_gen.board.variation import draw
from taction.verification.studies.running.pool import WorkerDiedError, Workers, local
from taction.verification.studies.tolerance import montecarlo as yield_report
from taction.verification.studies.tolerance.montecarlo import (
    SampleCollection,
    interval,
    run_samples,
    summarise_samples,
)
from taction.verification.studies.tolerance.varied_board import (
    BoardSample,
    VariedBoard,
    evaluate,
    prepare,
)
from tests.support.entries import make_sample
from tests.support.running import taction as command
from tests.support.studying import QUIET, one_thread, scene_file, small_scene, stored_samples

WORN = {"resistor": 0.05, "capacitor": 0.1}
HALF = {"steady_state": {"tolerance": 0.03}, "settling_time": {"band": 0.2, "max": "286.3us"}}
"""Checks that a part of the boards fails: causes are listed of what costs yield."""


def study(**tables: Any) -> VariedBoard:
    checks = {"steady_state": {"tolerance": 0.03}, "settling_time": {"band": 0.2, "max": "1s"}}
    tables = {"tolerances": WORN, "checks": checks} | tables
    return prepare(small_scene(**tables))


def drawn(asked: VariedBoard, count: int, workers: Workers, **more: Any) -> list[BoardSample]:
    tally = SampleCollection(count, **more)
    list(run_samples(asked, range(count), 5, workers, tally))
    return tally.samples


def taction(*arguments: str) -> Result:
    return command("montecarlo", *arguments)


@pytest.mark.parametrize(("passed", "samples"), [(0, 10), (10, 10), (3, 10), (970, 1000), (1, 2)])
def test_the_interval_is_clopper_and_pearson_s(passed: int, samples: int) -> None:
    assert interval(0, 0) == (0.0, 1.0)
    low, high = interval(passed, samples)
    expected = binomtest(passed, samples).proportion_ci(0.95, method="exact")
    assert (low, high) == pytest.approx((expected.low, expected.high), rel=1e-9)
    # By its definition each end makes what was seen, or more of it, a 2.5 % event.
    if passed:
        assert binom.sf(passed - 1, samples, low) == pytest.approx(0.025, rel=1e-9)
    if passed < samples:
        assert binom.cdf(passed, samples, high) == pytest.approx(0.025, rel=1e-9)


def test_a_sample_is_the_same_alone_in_a_batch_and_in_any_order() -> None:
    asked = study()
    with one_thread() as workers:
        batch = drawn(asked, 6, workers)
        tally = SampleCollection(6)
        backwards = list(run_samples(asked, [5, 3, 4, 0, 2, 1], 5, workers, tally))
    assert [sample.number for sample in batch] == list(range(6))
    assert sorted(backwards, key=lambda sample: sample.number) == batch
    z = draw(asked.scene.tolerances, asked.varied, 5, 4)
    assert evaluate(asked, 4, z) == batch[4]
    assert len({sample.value("steady_state") for sample in batch}) == 6


def test_processes_compute_the_same() -> None:
    asked = study()
    with one_thread() as workers:
        alone = drawn(asked, 8, workers)
    with local(2) as workers:
        assert drawn(asked, 8, workers) == alone


def test_the_yield_counts_what_the_checks_say() -> None:
    asked = study()
    with one_thread() as workers:
        samples = drawn(asked, 40, workers)
    found = summarise_samples(asked, samples, 5)
    values = [s.value("steady_state") for s in samples]
    errors = sorted(value for value in values if value is not None)
    within = sum(value <= 0.03 for value in errors)
    assert 0 < within < 40
    assert (found.samples, found.passed, found.failures) == (
        40,
        within,
        {"steady_state": 40 - within},
    )
    assert (found.low, found.high) == interval(within, 40)
    spread = next(each for each in found.quantities if each.name == "steady_state")
    assert (spread.at_most, spread.low, spread.median, spread.high) == (
        0.03,
        errors[1],
        errors[19],
        errors[37],
    )


def test_samples_without_verdict_count_as_not_passed() -> None:
    asked = study()
    samples = [
        make_sample(0, settling_time=1e-6),
        make_sample(1, "error", failure="Killed", reason="lost"),
    ]
    found = summarise_samples(
        asked, [*samples, make_sample(2, "fail", ("settling_time",), settling_time=None)], 1
    )
    assert (found.passed, found.without_verdict) == (1, 1)
    assert found.fraction == pytest.approx(1 / 3)
    assert found.reasons == {"lost": 1}
    settling = found.quantities[0]
    # Of the two with a verdict one never settles; the lost one is not among them.
    assert (settling.low, settling.high, settling.missing) == (1e-6, math.inf, 1)


class _Failing(Executor):
    """Every third sample goes wrong, and with it the call that computes it."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def submit(self, fn: Any, /, *arguments: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        _, number, _ = arguments
        if number % 3:
            future.set_result(make_sample(number))
        else:
            future.set_exception(self.error)
        return future


def test_a_lost_worker_costs_its_sample_only() -> None:
    workers = Workers(_Failing(WorkerDiedError("gone")), 2)
    samples = drawn(study(), 9, workers)
    assert [s.number for s in samples if s.undecided] == [0, 3, 6]
    assert samples[0].lost == "its worker was killed: gone"


def test_until_stops_at_the_first_narrow_interval_in_order_of_the_numbers() -> None:
    outcomes = np.random.default_rng(1).random(400) < 0.9
    samples = [
        make_sample(k, "pass" if good else "fail") for k, good in enumerate(outcomes.tolist())
    ]
    expected = next(
        n
        for n in range(yield_report.MIN_SAMPLES, 401)
        if np.subtract(*interval(int(outcomes[:n].sum()), n)[::-1]) <= 2 * 0.05
    )
    assert 100 < expected < 300
    for order in (range(400), np.random.default_rng(2).permutation(400).tolist()):
        tally = SampleCollection(400, 0.05)
        for number in order:
            tally.add(samples[number])
        assert (tally.enough, tally.samples) == (True, samples[:expected])


def test_what_varies_explains_the_variance_and_nothing_else_does() -> None:
    # The steady state does not depend on C, the settling time does; nothing else varies.
    asked = study(tolerances=QUIET | {"capacitor": 0.1}, checks=HALF)
    with one_thread() as workers:
        found = summarise_samples(asked, drawn(asked, 100, workers), 5)
    settling = [each for each in found.sensitivities if each.quantity == "settling_time"]
    assert {each.parameter for each in settling} == {"Cc_1", "Cc_2"}
    assert sum(each.correlation**2 for each in settling) > 0.5  # the slower channel decides
    assert all(each.correlation > 0 for each in settling)
    assert not [each for each in found.sensitivities if each.quantity == "steady_state"]


def test_causes_belong_to_quantities_with_limits_and_the_costliest_check_comes_first() -> None:
    limits = {"settling_time": {"band": 0.5, "max": "1us"}, "steady_state": {"tolerance": 0.02}}
    varied = study(tolerances=QUIET | {"capacitor": 0.1, "resistor": 0.05}, checks=limits)
    with one_thread() as workers:
        samples = drawn(varied, 100, workers)
        found = summarise_samples(varied, samples, 5).sensitivities
        free = study(tolerances=QUIET | {"capacitor": 0.1})  # no limit of the overshoot
        other = summarise_samples(free, drawn(free, 40, workers), 5).sensitivities
    names = {each.quantity: each.lost for each in found}
    checks = {"growth_rate": "stability"}
    for name, lost in names.items():
        failed = [checks.get(name, name) in sample.failed for sample in samples]
        assert lost == sum(failed) / len(samples)
    order = [(-each.lost, -abs(each.correlation)) for each in found]
    assert order == sorted(order)
    assert len(set(names.values())) > 1
    assert "overshoot" not in names | {each.quantity: 0.0 for each in other}


def test_the_smallest_yield_decides_the_exit_status(tmp_path: Path) -> None:
    scene, file = scene_file(tmp_path), str(tmp_path / "s.sqlite")
    found = json.loads(taction(scene, "-n", "12", "--jobs", "1", "-o", file, "--json").stdout)
    assert 0 < found["low"] < found["fraction"]
    for wanted, status in ((0.9 * found["low"], 0), (found["fraction"], 3)):
        again = taction(scene, "-n", "12", "-o", file, "--min-yield", repr(wanted))
        assert again.exit_code == status
    strict = tmp_path / "strict"
    strict.mkdir()
    hard = scene_file(strict, "[tolerances]\nresistor = 0.5\n")
    assert taction(hard, "-n", "12", "--jobs", "1", "--min-yield", "1").exit_code == 1


def test_ngspice_takes_the_same_way(tmp_path: Path, ngspice: str) -> None:
    scene = scene_file(tmp_path)
    found = {}
    for engine in ("ngspice", "statespace"):
        file = tmp_path / f"{engine}.sqlite"
        arguments = ["-n", "3", "--jobs", "1", "--engine", engine, "-o", str(file)]
        assert taction(scene, *arguments).exit_code == 0
        found[engine] = stored_samples(file)
    for one, other in zip(found["ngspice"], found["statespace"], strict=True):
        assert one["outcome"] == other["outcome"]
        assert one["settling_time"] == pytest.approx(other["settling_time"], rel=1e-3)
        assert one["steady_state_error"] == pytest.approx(other["steady_state_error"], abs=1e-5)
