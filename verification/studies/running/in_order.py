"""One call for each of several files, in this process or in several, with results in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from taction.verification.studies.running.collecting import collected
from taction.verification.studies.running.executors import cores, local

R = TypeVar("R")


def for_each_file(
    function: Callable[..., R],
    files: Sequence[Path],
    arguments: Sequence[tuple[Any, ...]],
    *,
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> list[R | BaseException | None]:
    """Return ``function(file, *arguments[i])`` of each file, in the order of `files`.

    Parameters
    ----------
    function : callable
        With several processes it can be pickled, as its arguments and its results. It raises no
        exception of one file.
    arguments : sequence of tuple
        The further arguments for each file.
    jobs : int, optional
        Number of processes; by default one for each core. One file, or one job, is computed in
        this process.

    Returns
    -------
    list
        An exception where a call killed its process again and again; None where Ctrl-C came before
        the result.

    Raises
    ------
    NoVerdictError
        The processes do not start.

    Examples
    --------
    >>> files = [Path("b.toml"), Path("a.toml")]
    >>> for_each_file(lambda path, more: path.stem + more, files, [("1",), ("2",)], jobs=1)
    ['b1', 'a2']
    """
    results: list[R | BaseException | None] = [None] * len(files)
    processes = min(jobs or cores(), len(files))
    try:
        if processes <= 1:
            for number, path in enumerate(files):
                progress(f"{number + 1} of {len(files)}: {path.stem}")
                results[number] = function(path, *arguments[number])
            return results
        calls = ((k, (path, *arguments[k])) for k, path in enumerate(files))
        with local(processes) as workers:
            progress(f"{len(files)} files in {processes} processes")
            for done, (number, result) in enumerate(collected(workers, function, calls), 1):
                results[number] = result
                progress(f"{done} of {len(files)} done: {files[number].stem}")
    except KeyboardInterrupt:
        pass
    return results
