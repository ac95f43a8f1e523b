"""ngspice lists a deck, and waits for the deck of its transient."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from taction.system.errors import DidNotLoad, Killed, SimulationError, StepTooSmall, TimedOut
from taction.verification.engines.ngspice import listing
from taction.verification.engines.ngspice.executable import Simulator, find_simulator
from taction.verification.engines.ngspice.listing import expand, expand_and_wait
from taction.verification.engines.ngspice.process import simulate
from tests.support.processes import is_running, process_id
from tests.support.small_decks import TAU, transient, wrapped

LINES = (".param r=1k", "v1 in 0 1", "r1 in out {2*r}", "c1 out 0 1n")
FLAT = ("v1 in 0 1", "r1 in out 2.000000000000000e+03", "c1 out 0 1n")


@pytest.fixture(scope="session")
def simulator(ngspice: str) -> Simulator:
    return find_simulator(ngspice)


def test_the_run_that_listed_a_deck_has_the_record_of_a_run_of_its_own(
    simulator: Simulator,
) -> None:
    cards, run = expand_and_wait(LINES, simulator)
    assert cards == FLAT == expand(LINES, simulator)[0]
    assert run is not None
    deck = transient(step=1e-8, solver=simulator.solver_option)
    own = simulate(deck, simulator, timeout=30.0)
    time.sleep(0.05)  # its time begins with the deck
    found = run.go_on(deck, timeout=30.0, bound=1e6)
    np.testing.assert_array_equal(found.time, own.time)
    np.testing.assert_array_equal(found.values, own.values)
    assert float(np.abs(found["out"] + np.expm1(-found.time / TAU)).max()) < 4e-6
    assert (found.simulator, found.flags) == (own.simulator, ())
    assert 0.0 < found.cost.seconds < own.cost.seconds + 0.05
    assert not run.folder.exists()


def test_a_run_that_is_not_needed_ends_and_leaves_nothing(
    simulator: Simulator, tmp_path: Path
) -> None:
    fake = wrapped(simulator, tmp_path, f"echo $$ > {tmp_path}/pid")
    _, run = expand_and_wait(LINES, fake)
    assert run is not None
    folder, pid = run.folder, process_id(tmp_path / "pid")
    assert is_running(pid)
    del run
    assert not is_running(pid)
    assert not folder.exists()


def test_a_failure_leaves_a_folder_that_repeats_it(simulator: Simulator) -> None:
    _, run = expand_and_wait(LINES, simulator)
    assert run is not None
    deck = transient("B1 x 0 V=exp(1e3*v(x))", "R2 x 0 1")
    with pytest.raises(StepTooSmall) as caught:
        run.go_on(deck, timeout=30.0, bound=1e6)
    folder = caught.value.folder
    assert folder is not None
    assert (folder / "deck.cir").read_text() == deck.text
    again = subprocess.run(
        ["sh", "command.txt"], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert "imestep too small" in again.stderr


ENDINGS: dict[str, type[SimulationError]] = {
    "exit 1": DidNotLoad, "kill -9 $$": Killed, "exec sleep 1000": TimedOut
}  # fmt: skip


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_simulator_that_does_not_list_is_told_of(
    ending: str, simulator: Simulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "SECONDS", 0.3)
    with pytest.raises(ENDINGS[ending]):
        expand_and_wait(LINES, wrapped(simulator, tmp_path, ending))


def test_both_runs_of_a_listing_have_one_time_limit_and_little_memory(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, waiting = expand_and_wait(LINES, simulator)
    assert waiting is not None
    number = waiting._process._popen.pid
    assert resource.prlimit(number, resource.RLIMIT_AS) == (listing.MEMORY, listing.MEMORY)
    waiting.cancel()
    given = list[float]()

    def second(lines: object, simulator: object, *, seconds: float) -> list[tuple[str, ...]]:
        given.append(seconds)
        return [("r1 a 0 1",)]

    monkeypatch.setattr(listing, "expand", second)
    complaining = (*LINES, "r2 out 0 {nothing}")
    assert expand_and_wait(complaining, simulator) == (("r1 a 0 1",), None)
    assert 0.0 < given[0] < listing.SECONDS


def test_a_simulator_that_ends_before_it_gets_its_deck_is_told_of(
    simulator: Simulator, tmp_path: Path
) -> None:
    fake = wrapped(simulator, tmp_path, f"echo $$ > {tmp_path}/pid")
    _, run = expand_and_wait(LINES, fake)
    assert run is not None
    os.kill(process_id(tmp_path / "pid"), signal.SIGKILL)
    with pytest.raises(Killed):
        run.go_on(transient(), timeout=30.0, bound=1e6)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [((*LINES, "r2 out 0 {nothing}"), "nothing"), ((".subckt s a", *LINES, ".ends"), "no card")],
)
def test_a_deck_of_which_ngspice_complains_is_refused_as_without_waiting(
    wrong: tuple[str, ...], says: str, simulator: Simulator
) -> None:
    with pytest.raises(DidNotLoad) as alone:
        expand(wrong, simulator)
    with pytest.raises(DidNotLoad) as waiting:
        expand_and_wait(wrong, simulator)
    assert str(waiting.value).splitlines()[0] == str(alone.value).splitlines()[0]
    assert says in str(waiting.value)


def test_a_run_whose_listing_has_a_warning_does_not_wait(
    simulator: Simulator, tmp_path: Path
) -> None:
    """The warning would count as one of the transient."""
    cards, run = expand_and_wait(LINES, wrapped(simulator, tmp_path, "echo Warning >&2"))
    assert cards == FLAT
    assert run is None
