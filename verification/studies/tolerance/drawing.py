"""Samples of a study drawn until there are enough, kept in a file where there is one."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from spice_models.errors import Complaint, InputError
from verification.pipeline.clock import Progress
from verification.studies.running.executors import Workers
from verification.studies.tolerance.sample_file import SampleFile
from verification.studies.tolerance.varied_board import Study
from verification.studies.tolerance.yield_report import Tally, run_samples


def draw_samples(
    study: Study,
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
        Entered only if a sample is missing.
    output : path, optional
        A sample file; samples that it holds are not drawn again.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        See `SampleFile` and `verification.studies.tolerance.yield_report.run_samples`.
    """
    with ExitStack() as opened:
        kept = None
        if output is not None:
            kept = opened.enter_context(SampleFile(str(output), study, seed))
            for sample in kept.samples.values():
                tally.add(sample)
        known = set() if kept is None else set(kept.samples)
        missing = (number for number in range(tally.wanted) if number not in known)
        if tally.enough:
            return
        for sample in run_samples(study, missing, seed, opened.enter_context(workers), tally):
            if kept is not None:
                kept.append(sample)
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
