"""Run many short decks in one ngspice process, which reads deck after deck.

Starting ngspice costs up to a fifth of a short run. A session starts one process with a loop of
commands instead of a deck; each deck arrives through a named pipe, and its result needs all the
evidence that a separate run needs (`evidence.accepted_waveforms`). After any failure (an error, a
missing point, no answer in time) the session's process ends, and the deck runs again in a separate
process (`process.start`), which decides; so a session itself never reports a failure.

No state of a deck reaches the next deck: a deck gives the same bytes at every position.
"""

from __future__ import annotations

import threading
import time
from collections import deque

from netlist_gen.analysis import Transient
from spice_models.errors import SimulationError
from verification.engines.ngspice.evidence import Ending, accepted_waveforms
from verification.engines.ngspice.executable import Simulator
from verification.engines.ngspice.parent_death import guard
from verification.engines.ngspice.process import Run, start
from verification.engines.ngspice.screening import Deck, screen
from verification.engines.ngspice.session_process import LARGEST, Loop, LostError
from verification.waveforms import Waveforms

LONGEST_DECK = 60_000  # bytes; a pipe holds 65536, so writing a deck never blocks
MOST_POINTS = 50_000  # of a transient; a longer run makes the start-up time unimportant
MOST_LOST = 3  # lost processes in succession, after which decks run separately
PATIENCE = 10.0  # s; a deck that takes longer gets a separate process with its own timeout


class Turn:
    """A deck that waits for its result from a session."""

    def __init__(self, session: Session, deck: Deck, *, timeout: float, bound: float) -> None:
        self.deck, self.timeout, self.bound = deck, timeout, bound
        self.started = 0.0
        self.waveforms: Waveforms | None = None
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
        self._session.wait_for(self)
        if self.waveforms is not None:
            return self.waveforms
        return start(
            self.deck, self._session.simulator, timeout=self.timeout, bound=self.bound
        ).result()

    def cancel(self) -> None:
        """Remove the deck from the session, unless the deck has ended."""
        self._session.remove(self)


class Session:
    """One ngspice process and its queue of decks."""

    def __init__(self, simulator: Simulator, guard: tuple[str, ...]) -> None:
        self.simulator = simulator
        self._guard = guard
        self._process: Loop | None = None
        self._turns: deque[Turn] = deque()  # the first one is running
        self._lost = 0  # processes in succession

    @property
    def unreliable(self) -> bool:
        """Whether so many processes were lost that a session only costs time."""
        return self._lost >= MOST_LOST

    def submit(self, deck: Deck, *, timeout: float, bound: float) -> Turn:
        """Screen a deck and append it to the queue.

        Raises
        ------
        DidNotLoad, SingularCircuit
            As `ngspice.start`.
        """
        screen(deck)
        turn = Turn(self, deck, timeout=timeout, bound=bound)
        self._turns.append(turn)
        if len(self._turns) == 1:
            self._send_next()
        return turn

    def wait_for(self, turn: Turn) -> None:
        """Wait until a deck has ended."""
        while turn in self._turns:
            self._collect()

    def remove(self, turn: Turn) -> None:
        """Remove a deck from the queue; if the deck is running, end the process."""
        if turn in self._turns:
            running = self._turns[0] is turn
            self._turns.remove(turn)
            if running:
                self.close()
                self._send_next()

    def close(self) -> None:
        """End the process; the next deck starts a new one."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _send_next(self) -> None:
        """Send the first deck of the queue."""
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

    def _collect(self) -> None:
        """Take the result of the running deck, and send the next one."""
        turn, process = self._turns[0], self._process
        try:
            if process is None:
                raise LostError
            process.wait(turn.started + min(PATIENCE, turn.timeout))
            seconds = time.perf_counter() - turn.started
            ending = Ending(0, False, turn.timeout, seconds, process.errors(), process.folder)
            engine = self.simulator.engine
            turn.waveforms = accepted_waveforms(turn.deck, ending, engine=engine, bound=turn.bound)
            process.clear()
            self._lost = 0
        except (LostError, OSError):
            self._lost += 1
            self.close()
        except SimulationError:
            self.close()
        except BaseException:  # Ctrl-C: all decks are cancelled
            self._turns.clear()
            self.close()
            raise
        self._turns.popleft()
        self._send_next()


class _Sessions(threading.local):
    """The sessions of one thread."""

    def __init__(self) -> None:
        self.open: dict[Simulator, Session] = {}


_sessions = _Sessions()


def submit(deck: Deck, simulator: Simulator, *, timeout: float, bound: float) -> Run | Turn:
    """Start a deck in this thread's session, or in a separate process if no session can run it.

    Raises
    ------
    SimulationError
        As `ngspice.start`.
    """
    words = guard()
    if words and fits_session(deck):
        session = _sessions.open.setdefault(simulator, Session(simulator, words))
        if not session.unreliable:
            return session.submit(deck, timeout=timeout, bound=bound)
    return start(deck, simulator, timeout=timeout, bound=bound)


def fits_session(deck: Deck) -> bool:
    """Whether a deck is a short transient without included files."""
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
