"""One ngspice for many short decks: a process that reads deck after deck, for studies of points.

To start ngspice costs as much as a fifth of a short run. A session starts it once, with a loop of
commands in place of a deck; each deck comes through a named pipe, and what it answers counts only
with all the evidence that a run of its own must show (`evidence.judge`). Whatever is in doubt, an
error, a missing point, no answer in time, ends the session, and the deck gets a process of its own
(`ngspice.start`), whose word is final; so a session never reports a failure.

A deck leaves nothing behind for the next: the same deck gives the same bytes wherever it stands.
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
import threading
import time
from collections import deque

from netlist_gen.analysis import Transient
from spice_models.errors import SimulationError
from verification.engines.ngspice.evidence import Ending, judge
from verification.engines.ngspice.executable import Simulator
from verification.engines.ngspice.process import Run, start
from verification.engines.ngspice.screening import Deck, screen
from verification.engines.ngspice.session_process import DEATH, LARGEST, Loop, LostError
from verification.waveforms import Waveforms

LONGEST_DECK = 60_000  # bytes; a pipe holds 65536, so writing a deck never waits
MOST_POINTS = 50_000  # of a transient whose start is worth saving
HOPELESS = 3  # lost processes in a row, after which decks run alone
PATIENCE = 10.0  # s; a deck that takes longer gets a process, and a timeout, of its own


class Turn:
    """A deck's turn in a session."""

    def __init__(self, session: Session, deck: Deck, *, timeout: float, bound: float) -> None:
        self.deck, self.timeout, self.bound = deck, timeout, bound
        self.started = 0.0
        self.answer: Waveforms | None = None
        self._session = session

    def __enter__(self) -> Turn:
        return self

    def __exit__(self, *error: object) -> None:
        self.cancel()

    def result(self) -> Waveforms:
        """Wait for the end and return the waveforms.

        Raises
        ------
        SimulationError
            As `ngspice.Run.result`.
        """
        self._session.reach(self)
        if self.answer is not None:
            return self.answer
        return start(
            self.deck, self._session.simulator, timeout=self.timeout, bound=self.bound
        ).result()

    def cancel(self) -> None:
        """Give up the turn, unless it is over."""
        self._session.drop(self)


class Session:
    """One ngspice, the decks that wait for it, and the one that it has."""

    def __init__(self, simulator: Simulator, guard: str) -> None:
        self.simulator = simulator
        self._guard = guard
        self._process: Loop | None = None
        self._turns: deque[Turn] = deque()  # the first is under way
        self._lost = 0  # processes in a row

    @property
    def hopeless(self) -> bool:
        """Whether processes get lost here again and again; then a session only costs time."""
        return self._lost >= HOPELESS

    def submit(self, deck: Deck, *, timeout: float, bound: float) -> Turn:
        """Screen a deck and let it wait for its turn.

        Raises
        ------
        DidNotLoad, SingularCircuit
            As `ngspice.start`.
        """
        screen(deck)
        turn = Turn(self, deck, timeout=timeout, bound=bound)
        self._turns.append(turn)
        if len(self._turns) == 1:
            self._begin()
        return turn

    def reach(self, turn: Turn) -> None:
        """Wait until a turn is over."""
        while turn in self._turns:
            self._finish()

    def drop(self, turn: Turn) -> None:
        """Take a turn out; where it is under way, the process ends."""
        if turn in self._turns:
            under_way = self._turns[0] is turn
            self._turns.remove(turn)
            if under_way:
                self.close()
                self._begin()

    def close(self) -> None:
        """End the process; the next deck starts another."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _begin(self) -> None:
        """Hand over the deck whose turn it is."""
        while self._turns:
            turn = self._turns[0]
            turn.started = time.perf_counter()
            try:
                if self._process is None:
                    self._process = Loop(self.simulator, self._guard)
                self._process.send(turn.deck.text.encode(), turn.started + PATIENCE)
                return
            except (LostError, OSError):
                self._lost += 1
                self._turns.popleft()
                self.close()

    def _finish(self) -> None:
        """Take the answer of the deck whose turn it is, and begin with the next."""
        turn, process = self._turns[0], self._process
        try:
            if process is None:
                raise LostError
            process.wait(turn.started + min(PATIENCE, turn.timeout))
            seconds = time.perf_counter() - turn.started
            ending = Ending(0, False, turn.timeout, seconds, process.errors(), process.folder)
            engine = self.simulator.engine
            turn.answer = judge(turn.deck, ending, engine=engine, bound=turn.bound)
            process.clear()
            self._lost = 0
        except (LostError, OSError):
            self._lost += 1
            self.close()
        except SimulationError:
            self.close()
        except BaseException:  # Ctrl-C: nothing goes on
            self._turns.clear()
            self.close()
            raise
        self._turns.popleft()
        self._begin()


class _Sessions(threading.local):
    """Every thread has a session of its own."""

    def __init__(self) -> None:
        self.open: dict[Simulator, Session] = {}


_sessions = _Sessions()


def submit(deck: Deck, simulator: Simulator, *, timeout: float, bound: float) -> Run | Turn:
    """Start a deck in this thread's session, or in a process of its own where it has to.

    Raises
    ------
    SimulationError
        As `ngspice.start`.
    """
    guard = _guard()
    if guard is None or not suits(deck):
        return start(deck, simulator, timeout=timeout, bound=bound)
    session = _sessions.open.setdefault(simulator, Session(simulator, guard))
    if session.hopeless:
        return start(deck, simulator, timeout=timeout, bound=bound)
    return session.submit(deck, timeout=timeout, bound=bound)


def suits(deck: Deck) -> bool:
    """Whether a deck is short enough for a session, and complete in itself."""
    analysis = deck.analysis
    if deck.files or not isinstance(analysis, Transient):
        return False
    points = analysis.stop / analysis.max_step
    size = 8.0 * points * (1 + len(deck.saved))
    return len(deck.text) <= LONGEST_DECK and points <= MOST_POINTS and size <= 0.5 * LARGEST


def end_session() -> None:
    """End this thread's session."""
    for session in _sessions.open.values():
        session.close()
    _sessions.open.clear()


@functools.cache
def _guard() -> str | None:
    """Return what ends a process with its parent: Linux has it; elsewhere there is no session."""
    found = shutil.which("setpriv") if sys.platform == "linux" else None
    if found is None:
        return None
    trial = subprocess.run([found, *DEATH, "true"], capture_output=True, check=False)
    return found if trial.returncode == 0 else None
