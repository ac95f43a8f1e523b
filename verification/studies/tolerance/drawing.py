"""Draw the samples of a Monte Carlo study until there are enough."""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from taction.system.errors import Complaint, InputError
from taction.verification.studies.running.pace import Pace
from taction.verification.studies.running.workers import Workers
from taction.verification.studies.sweep.store import Store
from taction.verification.studies.tolerance.sample_store import SampleStore
from taction.verification.studies.tolerance.varied_board import VariedBoard
from taction.verification.studies.tolerance.yield_report import SampleCollection, run_samples
from taction.verification.verdict.clock import Progress


def draw_samples(
    board: VariedBoard,
    seed: int,
    collection: SampleCollection,
    workers: AbstractContextManager[Workers],
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> None:
    """Draw samples into `collection` until it has enough; an interruption keeps those it has.

    Parameters
    ----------
    workers : context manager
        Starts its processes with the first sample that has to be computed.
    output : path, optional
        A database; samples that it holds are not computed again.

    Raises
    ------
    InputError, NoVerdictError, OutOfDisk
        See `SampleStore` and `taction.verification.studies.tolerance.yield_report.run_samples`.
    """
    with ExitStack() as stack:
        store = None
        if output is not None:
            store = SampleStore(stack.enter_context(Store(str(output))), board, seed)
        ready = stack.enter_context(workers)
        pace = Pace()
        for _ in run_samples(board, range(collection.limit), seed, ready, collection, store):
            count = f"{len(collection.samples)} of {collection.limit} samples"
            left = pace.ended(collection.limit - len(collection.samples))
            progress(f"{count}, {collection.passed} pass{left}")


def half_width(until: str | float | None) -> float | None:
    """Return the requested half width of the confidence interval, from ``"1%"`` or 0.01.

    Raises
    ------
    InputError
        The half width is not between 0 and 0.5.
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
