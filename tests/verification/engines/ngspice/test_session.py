"""One ngspice for many decks: the same bytes as alone, and a process of its own in any doubt."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from spice_models.errors import DidNotLoad, TimedOut
from tests.support.paths import ROOT
from tests.support.small_decks import SmallDeck, divider, endless, transient, wrapped
from verification.engines.ngspice import session
from verification.engines.ngspice.process import Run, Simulator, find_simulator, simulate
from verification.engines.ngspice.session import Session, Turn, end_session, submit
from verification.waveforms import Waveforms


@pytest.fixture
def simulator(ngspice: str) -> Iterator[Simulator]:
    if sys.platform != "linux":
        pytest.skip("nothing here ends a process with its parent")
    assert session.guard()
    yield find_simulator(ngspice)
    end_session()


def opened(simulator: Simulator) -> Session:
    return session._sessions.open[simulator]


def pid(simulator: Simulator) -> int | None:
    process = opened(simulator)._process
    return None if process is None else process.popen.pid


def ask(deck: SmallDeck, simulator: Simulator, timeout: float = 30.0) -> Waveforms:
    return submit(deck, simulator, timeout=timeout, bound=1e6).result()


def same(a: Waveforms, b: Waveforms) -> bool:
    alike = np.array_equal(a.values, b.values) and np.array_equal(a.time, b.time)
    return alike and (a.nodes, a.engine, a.flags) == (b.nodes, b.engine, b.flags)


def several(simulator: Simulator) -> list[SmallDeck]:
    """Decks that share little: solvers, sizes, names, options, nonlinear sources."""
    quick = simulator.solver_option
    gain = "B1 far 0 v = 0.5 * tanh(3.0 * v(out))"
    return [
        transient(solver=quick),
        transient(gain, "R9 far 0 1.0", saved=("far", "out"), solver=quick),
        transient("C2 out 0 3e-09", ".temp 85.0", solver="sparse"),
        transient("R2 out Other 10.0", "C3 Other 0 1e-10", saved=("Other",), step=3e-9),
        transient(".options reltol=1e-3", ".ic v(out)=0.25", stop=2e-5, solver=quick),
    ]


def test_a_deck_gives_the_same_bytes_wherever_it_stands(simulator: Simulator) -> None:
    decks = several(simulator)
    alone = [simulate(deck, simulator, timeout=30.0) for deck in decks]
    order = [0, 1, 2, 3, 4, 0, 2, 4, 1, 3, 3, 2, 1, 0]
    found = [ask(decks[0], simulator)]
    first = pid(simulator)
    found += [ask(decks[k], simulator) for k in order]
    assert all(same(one, alone[k]) for one, k in zip(found, [0, *order], strict=True))
    assert pid(simulator) == first is not None
    process = opened(simulator)._process
    assert process is not None
    assert not (process.folder / "out.raw").exists()  # nothing large stays if it is killed


def test_two_decks_at_a_time_take_turns(simulator: Simulator) -> None:
    decks = [transient(step=step, stop=1e-4) for step in (1e-8, 2e-8)]
    fine, coarse = (submit(deck, simulator, timeout=30.0, bound=1e6) for deck in decks)
    second = coarse.result()
    assert fine.result().cost.points > 1.9 * second.cost.points
    assert second.cost.seconds > 0.0


def test_a_failure_is_told_by_a_process_of_its_own(simulator: Simulator) -> None:
    ask(transient(), simulator)
    wrong = transient("R2 out nowhere 1.0", saved=("out", "missing"))
    with pytest.raises(Exception, match="missing") as alone:
        simulate(wrong, simulator, timeout=30.0)
    with pytest.raises(type(alone.value), match="missing") as found:
        ask(wrong, simulator)
    folder = found.value.folder  # type: ignore[attr-defined]
    assert {"deck.cir", "command.txt", "stderr.txt"} <= {file.name for file in folder.iterdir()}
    assert pid(simulator) is None
    assert same(ask(transient(), simulator), simulate(transient(), simulator, timeout=30.0))


def test_a_deck_that_does_not_pass_the_screening_is_not_sent(simulator: Simulator) -> None:
    with pytest.raises(DidNotLoad):
        submit(transient(".control"), simulator, timeout=30.0, bound=1e6)


def test_a_process_that_is_killed_costs_nothing_but_time(simulator: Simulator) -> None:
    ask(transient(), simulator)
    turns = [submit(transient(stop=2e-4), simulator, timeout=30.0, bound=1e6) for _ in range(3)]
    victim = pid(simulator)
    assert victim is not None
    os.kill(victim, signal.SIGKILL)
    expected = simulate(transient(stop=2e-4), simulator, timeout=30.0)
    assert all(same(turn.result(), expected) for turn in turns)
    assert pid(simulator) not in (None, victim)


def test_a_deck_that_takes_too_long_times_out(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "fits_session", lambda deck: True)
    with pytest.raises(TimedOut, match=r"0\.3 s"):
        ask(endless(), simulator, timeout=0.3)
    assert pid(simulator) is None


def test_a_turn_that_is_given_up_makes_room(
    simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "fits_session", lambda deck: True)
    with submit(endless(), simulator, timeout=60.0, bound=1e6):
        following = submit(transient(), simulator, timeout=30.0, bound=1e6)
        process = opened(simulator)._process
        assert process is not None
    assert process.popen.poll() is not None
    assert not process.folder.exists()
    assert following.result().cost.points > 400


def test_what_needs_a_process_of_its_own_gets_one(simulator: Simulator) -> None:
    include = transient(".include Load.inc", files={"Load.inc": "R2 out 0 1000.0\n"})
    for deck in (divider(), endless(), include):
        with submit(deck, simulator, timeout=30.0, bound=1e6) as run:
            assert isinstance(run, Run)
    with submit(transient(), simulator, timeout=30.0, bound=1e6) as turn:
        assert isinstance(turn, Turn)


def test_a_board_out_of_bounds_is_no_answer(simulator: Simulator) -> None:
    with pytest.raises(Exception, match=r"beyond 0\.5 V"):
        submit(transient(), simulator, timeout=30.0, bound=0.5).result()


def test_where_no_process_survives_decks_run_alone(simulator: Simulator, tmp_path: Path) -> None:
    short_lived = wrapped(simulator, tmp_path, 'case "$*" in *loop.cir) exit 0;; esac')
    expected = simulate(transient(), simulator, timeout=30.0)
    assert all(same(ask(transient(), short_lived), expected) for _ in range(3))
    assert opened(short_lived).unreliable
    with submit(transient(), short_lived, timeout=30.0, bound=1e6) as run:
        assert isinstance(run, Run)
        assert same(run.result(), expected)


def test_it_ends_with_its_parent(simulator: Simulator, tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import sys, time\n"
        "from tests.support.small_decks import transient\n"
        "from verification.engines.ngspice.process import find_simulator\n"
        "from verification.engines.ngspice import session\n"
        "one = find_simulator()\n"
        "session.submit(transient(), one, timeout=30.0, bound=1e6).result()\n"
        "print(session._sessions.open[one]._process.popen.pid, flush=True)\n"
        "time.sleep(60.0)\n"
    )
    with subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.kill()
    end = time.monotonic() + 20.0
    while Path(f"/proc/{child}").exists() and time.monotonic() < end:
        time.sleep(0.01)
    assert not Path(f"/proc/{child}").exists()
