"""The runner with a real ngspice, the search for ngspice, run folders, and how a deck is listed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from taction.system import errors
from taction.system.array_types import Waveforms
from taction.verification.engines.ngspice.commands import MEMORY, Answers, expand, listed_cards
from taction.verification.engines.ngspice.process import (
    Simulation,
    Simulator,
    environment,
    find_simulator,
    simulate,
)
from tests.support.running import is_running, process_id
from tests.support.small_decks import TAU, SmallDeck, divider, endless, transient, wrapped


@pytest.fixture(autouse=True)
def own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run folders are made in the folder of the test."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))


@pytest.fixture(scope="session")
def simulator(ngspice: str) -> Simulator:
    return find_simulator(ngspice)


def largest_error(waveforms: Waveforms) -> float:
    """Against the closed form of an RC step, V."""
    exact = -np.expm1(-waveforms.time / TAU)
    return float(np.abs(waveforms["out"] - exact).max())


def test_rc_step_has_the_closed_form_and_converges_at_second_order(simulator: Simulator) -> None:
    coarse, fine = (
        simulate(transient(step=step, solver=simulator.solver_option), simulator, timeout=30.0)
        for step in (1e-8, 5e-9)
    )
    # The trapezoidal rule errs by (h/tau)^2/12 max(t/tau exp(-t/tau)) = 1e-4/12/e = 3.07e-6.
    assert largest_error(coarse) == pytest.approx(3.07e-6, rel=0.1)
    assert largest_error(coarse) / largest_error(fine) == pytest.approx(4.0, rel=0.05)
    solver = "KLU" if simulator.klu else "Sparse"
    assert coarse.simulator == f"ngspice-{simulator.version}, {solver}, trapezoidal"
    assert coarse.cost.points == len(coarse.time)
    assert 0.0 < coarse.cost.seconds < 30.0


def test_operating_point_is_one_point_and_capital_letters_are_kept(simulator: Simulator) -> None:
    waveforms = simulate(divider(), simulator, timeout=30.0)
    assert waveforms.time.tolist() == [0.0]
    assert waveforms["out"][0] == pytest.approx(0.75, rel=1e-12)
    assert waveforms.nodes == ("out", "in")
    deck = transient("R2 out Other 1.0", saved=("Other", "out"))
    waveforms = simulate(deck, simulator, timeout=30.0)
    assert waveforms.nodes == ("Other", "out")
    np.testing.assert_allclose(waveforms["Other"], waveforms["out"], rtol=1e-6, atol=1e-12)


def test_the_command_repeats_the_run(simulator: Simulator, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with Simulation(transient(), simulator, timeout=30.0) as run:
        assert run.folder.stat().st_mode & 0o077 == 0
        run.accept(lambda deck, ending: shutil.copytree(ending.folder, folder))
    assert not run.folder.exists()
    assert (folder / "deck.cir").read_text() == transient().text
    first = (folder / "out.raw").read_bytes().partition(b"Binary:")[2]
    (folder / "out.raw").unlink()
    subprocess.run(
        ["sh", "command.txt"], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, check=True
    )
    assert (folder / "out.raw").read_bytes().partition(b"Binary:")[2] == first


@pytest.mark.parametrize("cancelled", [True, False])
def test_a_run_that_nobody_waits_for_ends_and_leaves_nothing(
    simulator: Simulator, tmp_path: Path, cancelled: bool
) -> None:
    """It is cancelled at the end of its block, or goes with its object."""
    fake = wrapped(simulator, tmp_path, f"echo $$ > {tmp_path}/pid")
    run = Simulation(endless(), fake, timeout=60.0)
    pid, folder = process_id(tmp_path / "pid"), run.folder
    if cancelled:
        with run:
            pass
        with pytest.raises(errors.SimulationError, match="cancelled"):
            run.result()
    del run
    assert not is_running(pid)
    assert not folder.exists()


def test_nothing_of_the_users_surroundings_reaches_the_process(
    simulator: Simulator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ".spiceinit").write_text("set filetype=ascii\n")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SPICE_ASCIIRAWFILE", "1")
    monkeypatch.chdir(tmp_path)
    assert simulate(transient(), simulator, timeout=30.0).time[-1] == pytest.approx(5e-6)
    monkeypatch.setenv("LD_LIBRARY_PATH", "/opt/lib")
    monkeypatch.setenv("SPICE_LIB_DIR", "/elsewhere")
    own = {"LC_ALL": "C", "HOME": str(tmp_path), "SPICE_SCRIPTS": ".", "OMP_NUM_THREADS": "1"}
    assert environment(str(tmp_path)) == own | {"LD_LIBRARY_PATH": "/opt/lib"}


LOAD, HUGE = "R9 x 0 1.0", "B1 x 0 V = exp(1e6*v(out))"
NEITHER = "B1 x 0 V = v(x) > 0.5 ? 0 : 1"
LOOPED = SmallDeck(
    divider().text.replace("R2", "V2 in 0 2.0\nR2"), ("out", "in"), divider().analysis
)
FAILURES: dict[str, tuple[SmallDeck, str, str]] = {
    "unknown model": (transient("D1 out 0 nowhere"), "DidNotLoad", "d1 out 0 nowhere"),
    "bad value": (transient("R2 out 0 {1.0 +}"), "DidNotLoad", "netlist line no."),
    "sources": (transient("V2 in 0 2.0", start=""), "SingularCircuit", "check node v1#branch"),
    "sources at an operating point": (LOOPED, "SingularCircuit", "check node"),
    "no solution": (transient(NEITHER, LOAD), "StepTooSmall", 'trouble with node "x"'),
    "missing node": (transient(saved=("out", "none")), "BadEvidence", "missing: v(none)"),
    "overflow": (transient(HUGE, LOAD, saved=("out", "x")), "BadEvidence", "v(x) "),
}


@pytest.mark.parametrize("case", FAILURES)
def test_a_failure_has_type_log_and_folder(case: str, simulator: Simulator, tmp_path: Path) -> None:
    deck, name, text = FAILURES[case]
    kind = getattr(errors, name)
    with pytest.raises(kind) as caught:
        simulate(deck, simulator, timeout=30.0)
    assert type(caught.value) is kind
    assert text.lower() in str(caught.value).lower()
    assert caught.value.folder is not None
    assert caught.value.folder.parent == tmp_path
    left = {path.name for path in caught.value.folder.iterdir()}
    assert left >= {"deck.cir", "command.txt", "stdout.txt", "stderr.txt"}


def test_a_floating_node_is_flagged(simulator: Simulator) -> None:
    # Node f hangs on a capacitor alone, so it has no operating point; ngspice goes on.
    deck = transient("C2 in f 1e-09", saved=("out", "f"), start="")
    waveforms = simulate(deck, simulator, timeout=30.0)
    assert "Warning: singular matrix:  check node f" in waveforms.flags
    assert simulate(transient(), simulator, timeout=30.0).flags == ()


DISKS = {
    "limit, signal": "ulimit -f 16",
    "limit, silent": "trap '' XFSZ; ulimit -f 16",
    "full device": "ln -s /dev/full out.raw",
}


@pytest.mark.parametrize("case", DISKS)
def test_out_of_disk(case: str, simulator: Simulator, tmp_path: Path) -> None:
    fake = wrapped(simulator, tmp_path, DISKS[case])
    with pytest.raises(errors.OutOfDisk) as caught:
        simulate(transient(stop=1e-4), fake, timeout=30.0)
    partial = caught.value.partial
    assert (partial is None) == (case == "full device")
    if isinstance(partial, Waveforms):
        assert 0.0 < partial.time[-1] < 1e-4


def test_timeout_ends_the_group_and_keeps_the_result(simulator: Simulator, tmp_path: Path) -> None:
    fake = wrapped(simulator, tmp_path, "sleep 1000 & echo $! > child")
    with pytest.raises(errors.TimedOut, match=r"0\.5 s") as caught:
        simulate(endless(), fake, timeout=0.5)
    partial = caught.value.partial
    assert isinstance(partial, Waveforms)
    assert 0.0 < partial.time[-1] < 1.0
    assert largest_error(partial) < 1e-6
    assert caught.value.folder is not None
    assert not is_running(int((caught.value.folder / "child").read_text()))


def fake(folder: Path, answer: str) -> str:
    path = folder / "ngspice"
    path.write_text(f"#!/bin/sh\necho x >> {folder}/calls\necho '{answer}'\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("answer", "version", "option"),
    [
        ("** ngspice-39.3 : Circuit level simulation program", 39, "noopiter"),
        ("** ngspice-46 : x\n** Compiled with KLU Direct Linear Solver", 46, "klu"),
        ("** ngspice-46+ : x", 46, "noopiter"),
    ],
)
def test_version_and_solver(answer: str, version: int, option: str, tmp_path: Path) -> None:
    simulator = find_simulator(fake(tmp_path, answer))
    assert (simulator.version, simulator.solver_option) == (version, option)
    for asked in ("klu", "noopiter"):
        right = "KLU" if asked == option == "klu" else "Sparse"
        assert simulator.solver_of(f"* title\n.options {asked}\n.end\n") == right


def test_a_source_whose_card_may_be_listed_without_its_end_is_named() -> None:
    with pytest.raises(errors.DidNotLoad, match="E1: too many terms"):
        listed_cards(f" 1 : e1 out 0 {'v(in) ' * 800}")


def test_a_signal_that_ended_the_question_for_the_version_is_named(tmp_path: Path) -> None:
    with pytest.raises(errors.SimulatorNotFound, match="was ended by SIGTERM"):
        find_simulator(fake(tmp_path, "'; kill -TERM $$; '"))


def test_variable_overrides_the_path_and_an_argument_overrides_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setenv("PATH", str(tmp_path))
        patch.delenv("TACTION_NGSPICE", raising=False)
        with pytest.raises(errors.SimulatorNotFound, match="TACTION_NGSPICE"):
            find_simulator()
    for version in (41, 42):
        (tmp_path / str(version)).mkdir()
    named = fake(tmp_path / "41", "** ngspice-41 : x")
    given = fake(tmp_path / "42", "** ngspice-42 : x")
    monkeypatch.setenv("TACTION_NGSPICE", named)
    assert find_simulator().version == 41
    assert find_simulator(given).version == 42


LINES = (".param r=1k", "v1 in 0 1", "r1 in out {2*r}", "c1 out 0 1n")
FLAT = ("v1 in 0 1", "r1 in out 2.000000000000000e+03", "c1 out 0 1n")


def test_a_deck_is_listed_flat_with_little_memory(simulator: Simulator, tmp_path: Path) -> None:
    assert expand(LINES, simulator) == (FLAT,)
    told = tmp_path / "kilobytes"
    expand(LINES, wrapped(simulator, tmp_path, f"sleep 0.2; ulimit -v > {told}"))
    assert int(told.read_text()) == MEMORY // 1024


ENDINGS: dict[str, type[errors.SimulationError]] = {
    "exit 1": errors.DidNotLoad, "kill -9 $$": errors.Killed, "exec sleep 1000": errors.TimedOut
}  # fmt: skip


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failure_to_list_is_told_of(ending: str, simulator: Simulator, tmp_path: Path) -> None:
    with pytest.raises(ENDINGS[ending]):
        expand(LINES, wrapped(simulator, tmp_path, ending), seconds=0.3)
    failure = ENDINGS[ending]("it ended\nin the folder /tmp")
    assert Answers(failure=failure, said="no\n").complaint == "error: it ended"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [((*LINES, "r2 out 0 {nothing}"), "nothing"), ((".subckt s a", *LINES, ".ends"), "no card")],
)
def test_a_bad_deck_is_refused(wrong: tuple[str, ...], says: str, simulator: Simulator) -> None:
    with pytest.raises(errors.DidNotLoad, match=says):
        expand(wrong, simulator)
