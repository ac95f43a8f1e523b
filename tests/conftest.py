"""Fixtures that any test may ask for, and settings that make every run the same."""

from __future__ import annotations

import gc
import os
import shutil
import signal
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator
    from pathlib import Path

    import numpy as np

# Before anything imports numpy or matplotlib: one thread a process, and no display.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

# A run in the background, or below nohup, ignores these signals, and so would every process that
# the tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# The same examples in every run, and no verdict that depends on how busy the machine is.
settings.register_profile("taction", derandomize=True, deadline=None)
settings.load_profile("taction")

# Rooms that are collected only where `make` gives them what they need.
collect_ignore_glob = [
    f"{room}/*"
    for room in ("install", "kicad", "browser")
    if not os.environ.get(f"TACTION_{room.upper()}")
]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "nightly: only in `make nightly`, step long-tests")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes too long for every commit, unless the step of `make nightly` runs."""
    if os.environ.get("TACTION_NIGHTLY"):
        return
    left_out = [item for item in items if item.get_closest_marker("nightly")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let the collector of garbage look through tests and modules once: they stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def strict(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step after a result that fails is a mistake, which a test must see."""
    from taction.system import progress as after_result

    monkeypatch.setattr(after_result, "FAILURES", ())


@pytest.fixture(scope="session", autouse=True)
def one_job_here() -> Iterator[None]:
    """A study of one job runs in a thread of this process; two or more have theirs, as always."""
    from taction.verification.studies.running import study
    from tests.support.studying import one_thread

    local = study.local
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            study, "local", lambda jobs=None: one_thread() if jobs in (None, 1) else local(jobs)
        )
        yield


@pytest.fixture(scope="session")
def ngspice() -> str:
    """Path of the ngspice executable; without one the test skips, in CI it fails."""
    return _program(os.environ.get("TACTION_NGSPICE") or "ngspice", "make setup")


@pytest.fixture(scope="session")
def gnucap() -> str:
    """Path of gnucap, a simulator that is not ngspice; without it as for `ngspice`."""
    return _program("gnucap", "make test")


def _program(name: str, command: str) -> str:
    path = shutil.which(name)
    if path is None:
        reason = f"{name} is not on the PATH; `{command}` installs it where it may"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return path


@pytest.fixture
def quick_stories(monkeypatch: pytest.MonkeyPatch) -> None:
    """`demo` by the state-space engine; of `reproduce` and `accuracy` what takes no time."""
    from taction.verification.evidence import demonstration
    from taction.verification.evidence.paper import findings, reproduce
    from taction.verification.studies import work_precision as study

    few = tuple(replace(method, ladder=method.ladder[:2]) for method in study.METHODS[::3])
    monkeypatch.setattr(study, "REPEATS", 1)
    monkeypatch.setattr(study, "METHODS", few)
    quick = {name: reproduce.CHAPTERS[name] for name in ("kernels", "equations")}
    monkeypatch.setattr(reproduce, "CHAPTERS", quick)
    monkeypatch.setattr(
        demonstration,
        "paper_scene",
        lambda name: findings.paper_scene(name).with_engine("statespace"),
    )


@pytest.fixture
def rng() -> np.random.Generator:
    """A random generator that starts from the same seed in every test."""
    import numpy as np

    return np.random.default_rng(1993)


@pytest.fixture
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Path]]:
    """Install a package until the test ends: ``plugin("acme", {group: {name: at}}, source)``.

    The function returns its folder, for the environment of a new process.
    """
    from tests.support.packages import install, installed

    with ExitStack() as stack:

        def add(package: str, groups: dict[str, dict[str, str]], source: str, **kw: str) -> Path:
            folder = install(tmp_path_factory.mktemp("site"), package, groups, source, **kw)
            stack.enter_context(installed(folder))
            return folder

        yield add
