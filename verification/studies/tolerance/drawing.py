"""Samples of a study drawn until there are enough, kept in a file where there is one."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from spice_models.errors import Complaint, InputError
from verification.pipeline.clock import Progress
from verification.studies.running.executors import Workers
from verification.studies.sweep.store import Store
from verification.studies.tolerance.sample_store import SampleStore
from verification.studies.tolerance.varied_board import VariedBoard
from verification.studies.tolerance.yield_report import Tally, run_samples


def draw_samples(
    study: VariedBoard,
    seed: int,
    tally: Tally,
    workers: AbstractContextManager[Workers],
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> None:
    """Draw samples into `tally` until it has enough; what was counted stays after an interruption.

    Parameters
    ----------
    workers : context manager
        Starts its processes with the first sample that is missing.
    output : path, optional
        A database; samples that it holds are not drawn again.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        See `SampleStore` and `verification.studies.tolerance.yield_report.run_samples`.
    """
    with ExitStack() as opened:
        kept = None
        if output is not None:
            kept = SampleStore(opened.enter_context(Store(str(output))), study, seed)
        ready = opened.enter_context(workers)
        for _ in run_samples(study, range(tally.wanted), seed, ready, tally, kept):
            progress(f"{len(tally.samples)} of {tally.wanted} samples, {tally.passed} pass")


def half_width(until: str | float | None) -> float | None:
    """Return the half width of an interval that is narrow enough, from ``"1%"`` or 0.01.

    Raises
    ------
    InputError
        It is not between 0 and 0.5.
    """
    if until is None:
        return None
    text = str(until)
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = 0.0
    if not 0 < value < 0.5:
        accepted = "expected a half width such as 1% or 0.01"
        raise InputError("--until", Complaint("WIDTH", repr(until), accepted))
    return value
