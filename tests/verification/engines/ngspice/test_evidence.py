"""Each point of evidence by itself, on raw files made for the purpose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from taction.system.errors import (
    BadEvidence,
    DidNotLoad,
    Killed,
    OutOfDisk,
    SimulationError,
    SingularCircuit,
    StepTooSmall,
)
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.ngspice.ending import LONGEST_LINE, Ending, important_lines
from taction.verification.engines.ngspice.evidence import accepted_waveforms
from taction.verification.engines.ngspice.raw_file import write_raw
from tests.support.small_decks import divider, transient

DECK = transient(saved=("out", "in"), stop=1e-6, step=1e-7)
TIME = np.linspace(0.0, 1e-6, 11)


def ending(folder: Path, *, status: int = 0, errors: str = "") -> Ending:
    return Ending(status, False, 1.0, 0.25, errors, folder)


def record(
    time: np.ndarray = TIME, nodes: tuple[str, ...] = ("out", "in"), value: float = 0.5
) -> Waveforms:
    values = np.full((len(time), len(nodes)), value) * np.arange(1.0, len(nodes) + 1.0)
    return Waveforms(time, nodes, values, "test", Cost(0.0, len(time)))


def judged(folder: Path, waveforms: Waveforms, **left: object) -> Waveforms:
    write_raw(folder / "out.raw", waveforms)
    return accepted_waveforms(DECK, ending(folder, **left), engine="ngspice-46", bound=1e6)  # type: ignore[arg-type]  # keywords of `ending`


def test_a_good_record_is_accepted(tmp_path: Path) -> None:
    got = judged(tmp_path, record())
    assert (got.engine, got.nodes, got.flags) == ("ngspice-46", ("out", "in"), ())
    assert got.cost == Cost(seconds=0.25, points=11)
    np.testing.assert_array_equal(got["out"], 0.5)
    np.testing.assert_array_equal(got["in"], 1.0)


def test_columns_in_another_order_are_put_right(tmp_path: Path) -> None:
    got = judged(tmp_path, record(nodes=("in", "out")))
    np.testing.assert_array_equal(got["in"], 0.5)
    np.testing.assert_array_equal(got["out"], 1.0)


REFUSED: dict[str, tuple[Callable[[], Waveforms], str]] = {
    "missing vector": (lambda: record(nodes=("out",)), r"missing: v\(in\)"),
    "extra vector": (lambda: record(nodes=("out", "in", "x")), r"not asked for: v\(x\)"),
    "cut short": (lambda: record(TIME[:-1]), "ends at"),
    "too long": (lambda: record(TIME * (1.0 + 1e-8)), "ends at"),
    "starts late": (lambda: record(TIME[2:]), "begins at"),
    "time stands still": (lambda: record(TIME[[0, 1, 2, 2, *range(3, 11)]]), "strictly"),
    "time goes back": (lambda: record(TIME[[0, 2, 1, *range(3, 11)]]), "strictly"),
    "time is no number": (lambda: record(np.where(TIME[4] == TIME, np.nan, TIME)), "strictly"),
    "no number": (lambda: record(value=np.nan), r"v\(out\) nan V"),
    "infinite": (lambda: record(value=-np.inf), r"v\(out\) inf V"),
    "clamped": (lambda: record(value=1e99), r"v\(out\) 1e\+99 V"),
    "below the negative bound": (lambda: record(value=-1.1e6), r"v\(in\) 2200000.0 V"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str, tmp_path: Path) -> None:
    make, message = REFUSED[case]
    with pytest.raises(BadEvidence, match=message) as caught:
        judged(tmp_path, make())
    assert caught.value.folder == tmp_path


def test_a_plot_of_another_analysis(tmp_path: Path) -> None:
    write_raw(tmp_path / "out.raw", record())
    with pytest.raises(BadEvidence, match="'Operating Point' was asked for"):
        accepted_waveforms(divider(), ending(tmp_path), engine="ngspice-46", bound=1e6)


LOGS: dict[str, tuple[str, type[SimulationError]]] = {
    "Warning: rawfile write error !!\nrun simulation interrupted": ("could not be", OutOfDisk),
    "Warning: singular matrix:  check node a\nError: The operating point could not be simulated"
    "\ndoAnalyses: TRAN:  Timestep too small": ("singular", SingularCircuit),
    "doAnalyses: TRAN:  Timestep too small; time = 1e-9": ("time step", StepTooSmall),
    "Warning: 'r1 in out' is not a valid resistor instance line, ignored!": (
        "as it is",
        DidNotLoad,
    ),
    "Warning: Unusual leading characters like '='": ("as it is", DidNotLoad),
    "Warning: Value of resistor r3 is too small, set to 1.000000e-12": ("as it is", DidNotLoad),
    "Warning: can't find model 'x'": ("as it is", DidNotLoad),
    "Error: there aren't any circuits loaded.": ("as it is", DidNotLoad),
    "run simulation(s) aborted": ("reported an error", BadEvidence),
    "a step that is too small": ("reported an error", BadEvidence),
    "Fatal error": ("reported an error", BadEvidence),
}


@pytest.mark.parametrize("log", LOGS)
def test_the_log_is_read_even_when_all_else_is_good(log: str, tmp_path: Path) -> None:
    message, kind = LOGS[log]
    with pytest.raises(SimulationError, match=message) as caught:
        judged(tmp_path, record(), errors=log)
    assert type(caught.value) is kind
    assert log.splitlines()[0] in caught.value.log


def test_an_exit_status_without_a_reason(tmp_path: Path) -> None:
    with pytest.raises(BadEvidence, match="exit status 3"):
        judged(tmp_path, record(), status=3)


def test_a_failure_brings_the_points_that_were_written(tmp_path: Path) -> None:
    with pytest.raises(Killed, match=r"SIGKILL.*memory") as caught:
        judged(tmp_path, record(TIME[:5]), status=-9)
    assert isinstance(caught.value.partial, Waveforms)
    np.testing.assert_array_equal(caught.value.partial.time, TIME[:5])


def test_what_ngspice_got_over_is_a_flag_once(tmp_path: Path) -> None:
    log = (
        "Note: Starting dynamic gmin stepping\n"
        "Warning: singular matrix:  check node f\n\n"
        "Warning: singular matrix:  check node f\n"
        "Warning: Dynamic gmin stepping failed\n"
        "Note: Dynamic gmin stepping completed\n"
    )
    assert judged(tmp_path, record(), errors=log).flags == (
        "Warning: singular matrix:  check node f",
        "Warning: Dynamic gmin stepping failed",
    )


def test_important_lines_are_few_and_each_once() -> None:
    log = "Note: x\n" + "".join(f"line {i}\nline {i}\n\n" for i in range(100))
    lines = important_lines(log).splitlines()
    assert len(lines) == 13
    assert (lines[0], lines[6], lines[-1]) == ("line 0", "... 88 lines", "line 99")
    assert important_lines("Note: x\n") == "Note: x"
    assert important_lines("x" * 10_000_000) == "x" * LONGEST_LINE
