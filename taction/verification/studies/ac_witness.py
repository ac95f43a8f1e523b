"""ngspice's small signal of the deck as it is, beside that of the linear circuit.

It is asked twice in one run: from the sources that step, and from currents of random size into
every node, which see every pole, also one that no source reaches. Two things are no disagreement,
and are said where they are more than the limit: what the rounding of all values does to a node, and
the currents that ngspice does not resolve. A node that only 1 nS holds rests within 1 uV of them,
and a junction there has a slope that is known within 4e-5.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.branches import Source
from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.characterise.operating_point import AT_ONCE, PROBE, DeckPoint
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict.checks import Check, Outcome, at_most

LIMIT = 1e-6  # relative difference
ROUNDING = 3e4  # times that of one value: some 30 act on a node, and pivots of ngspice are >= 1e-3
THERMAL = 0.0258  # V: no junction changes its slope faster than by e in so much
ASIDE = 1e-11  # of a frequency: no pole with a damping above 1e-5 sees it
SURE = 2.0  # times the largest difference of two answers, of all frequencies
NAMED = 4  # nodes in a reason
AGAIN = "ngspice does not find the operating point again"
POINTS = 40
LEAST, MOST = 1e-3, 1e10  # Hz
FAINT = 1e-6  # of the largest voltage at a frequency: smaller ones count as this
SHARP = 0.2  # damping below which frequencies about a pole are added


@dataclass(frozen=True, slots=True)
class AcComparison:
    """The largest relative difference from ngspice's ``.ac`` beyond what rounding makes.

    Attributes
    ----------
    worst : float or None
        None: nothing was compared.
    where : str
        Where it is, or why nothing was compared.
    band : tuple of float
        Lowest and highest frequency, Hz.
    hidden : tuple of str
        Nodes that differ by more than `LIMIT`, within what is not known of them.
    """

    worst: float | None
    where: str
    band: tuple[float, float] = (0.0, 0.0)
    hidden: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class AcWitness:
    """Compares the circuit of a deck with ngspice's ``.ac``."""

    point: DeckPoint
    sources: tuple[Source, ...]  # that step
    simulator: Simulator

    def check(self, board: LinearBoard, poles: Complexes) -> Check:
        """Return the check ``ac_agrees``."""
        found = self.compare(board, poles)
        if found.worst is None:
            text = f"ngspice's .ac was not compared: {found.where}"
            return Check("ac_agrees", Outcome.INCONCLUSIVE, None, None, LIMIT, None, "ratio", text)
        outcome, reason = at_most(found.worst, 0.0, LIMIT), f"largest at {found.where}"
        if found.hidden:
            more = f" and {len(found.hidden) - NAMED} more" * (len(found.hidden) > NAMED)
            names = ", ".join(found.hidden[:NAMED])
            reason += f"; {names}{more}: not resolved within the limit"
            if outcome is Outcome.PASS and {*found.hidden} & {*board.reported(None)}:
                outcome = Outcome.INCONCLUSIVE
        return Check("ac_agrees", outcome, found.worst, 0.0, LIMIT, None, "ratio", reason)

    def compare(
        self, board: LinearBoard, poles: Complexes, ports: Mapping[str, float] | None = None
    ) -> AcComparison:
        """Compare both responses at frequencies about the poles.

        Of some `ports` only, where they are given, each relative to what it has or to this value.
        """
        known = board.descriptor.names[: board.descriptor.node_count]
        nodes = [name for name in self.point.weights if name in known]
        names, hertz, theirs, said = self._asked(nodes, poles)
        if not len(hertz):
            return AcComparison(None, said)
        if ports is not None:
            theirs = theirs[:, :, [names.index(port) for port in ports]]
            names = list(ports)
        places = [board.descriptor.place(name) for name in names]
        ours, rounding = (each[:, :, places] for each in self._ours(board, hertz, nodes))
        largest = np.abs(theirs).max(axis=2, keepdims=True)
        least = FAINT * largest if ports is None else np.array([*ports.values()])
        floor = np.maximum(np.abs(theirs), least)
        floor = np.where(floor > 0.0, floor, 1.0)
        off = np.abs(ours - theirs) / floor
        off = np.where(np.isfinite(off), off, np.inf)
        beyond = np.maximum(off - rounding / floor, 0.0)
        if np.any(beyond > LIMIT):
            spread = self._spread(nodes, poles, names, theirs) / floor
            beyond = np.maximum(beyond - spread.max(axis=1, keepdims=True), 0.0)
        hides = np.any((off > LIMIT) & (beyond <= LIMIT), axis=(0, 1))
        hidden = tuple(name for name, hid in zip(names, hides, strict=True) if hid)
        off = beyond
        way, at, node = np.unravel_index(int(off.argmax()), off.shape)
        how = ("from the source", "from currents into every node")[int(way)]
        where = f"{names[int(node)]}, {hertz[int(at)]:.4g} Hz, {how}"
        band = float(hertz.min()), float(hertz.max())
        return AcComparison(float(off.max(initial=0.0)), where, band, hidden)

    def _spread(
        self, nodes: Sequence[str], poles: Complexes, names: Sequence[str], theirs: Complexes
    ) -> Floats:
        """Return how far ngspice's own rounding moves each response, (2, F, N), `SURE` times.

        At frequencies that are `ASIDE` its digits are rounded anew, and nothing else changes.
        """
        others, hertz, again, _ = self._asked(nodes, poles, 1.0 + ASIDE)
        if len(hertz) != theirs.shape[1]:
            return np.zeros(theirs.shape)
        again = again[:, :, [others.index(name) for name in names]]
        return np.asarray(SURE * np.abs(again - theirs))

    def _asked(
        self, nodes: Sequence[str], poles: Complexes, factor: float = 1.0
    ) -> tuple[list[str], Floats, Complexes, str]:
        """Return nodes, frequencies, both responses (2, F, N), and what ngspice said."""
        if not self.point.text:
            return [], np.zeros(0), np.zeros((2, 0, 0), complex), AGAIN
        steps = {f"{s.card[0].lower()}{s.card[1:]}": s.step for s in self.sources}
        excited = [
            card.split()[0] for card in self.point.cards if card[0] in "vi" and " ac" in card
        ]
        sweeps, commands = list(_sweeps(poles, factor)), [AT_ONCE, "save all"]
        for driven in (steps, {f"v{PROBE}": 1.0}):
            for sweep in sweeps:  # each from a new start: else rounding makes another point
                commands += ["reset", *(f"alter {n} acmag=0" for n in excited if n not in driven)]
                for name, size in driven.items():
                    commands += [f"alter {name} acmag={size!r}", f"alter {name} acphase=0"]
                commands += [sweep, f"write {RESULT}", "set appendwrite"]
        answers = run_commands(self.point.text, commands, self.simulator, mode=self.point.mode)
        if len(answers.plots) != 2 * len(sweeps):
            return [], np.zeros(0), np.zeros((2, 0, 0), complex), answers.complaint
        vectors = answers.plots[0][0]
        kept = {f"v({node})": node for node in nodes}
        columns = [k for k, name in enumerate(vectors) if name.lower() in kept]
        values = [np.concatenate([v for _, v in answers.plots[k * len(sweeps) :][: len(sweeps)]])
                  for k in range(2)]  # fmt: skip
        hertz = values[0][:, 0].real
        found = np.array([each[:, columns] for each in values])
        return [kept[vectors[k].lower()] for k in columns], hertz, found, ""

    def _ours(
        self, board: LinearBoard, hertz: Floats, nodes: Sequence[str]
    ) -> tuple[Complexes, Floats]:
        """Return both responses, (2, F, unknowns), and what is not known of them."""
        descriptor = board.descriptor
        M, K = descriptor.dense.mass, descriptor.dense.stiffness
        b = np.zeros((descriptor.size, 2))
        b[:, 0] = descriptor.switched
        rows = descriptor.balance_rows
        for node in nodes:
            row = rows[descriptor.place(node)]
            if row < descriptor.size:
                b[row, 1] += self.point.weights[node]
        found = np.empty((2, len(hertz), descriptor.size), complex)
        unknown, slopes = np.empty(found.shape), np.zeros(descriptor.size)
        for k, s in enumerate(2j * math.pi * hertz):
            x, error, inverse = _solved(s * M - K, b)
            found[:, k], unknown[:, k] = x.T, error.T
            if k == 0 and self.point.volts:
                places = [descriptor.place(node) for node in nodes]
                balances = rows[places]
                free = balances < descriptor.size  # not held by a source
                ohms = free * np.abs(inverse[places, np.where(free, balances, 0)])
                slopes[places] = self.point.unresolved * ohms / THERMAL
        return found, unknown + np.abs(found) * slopes


def _solved(A: Complexes, b: Floats) -> tuple[Complexes, Floats, Complexes]:
    """Solve with rows and columns scaled, and refine; infinite where A is singular.

    With it the change of each unknown where every value of A and b has an error of `ROUNDING`, and
    the inverse.
    """
    rows = 1.0 / np.maximum(np.abs(A).max(axis=1), 1e-300)
    B = A * rows[:, None]
    columns = 1.0 / np.maximum(np.abs(B).max(axis=0), 1e-300)
    B = B * columns
    try:
        inverse = np.linalg.inv(B)
    except np.linalg.LinAlgError:
        lost = np.full((len(A), b.shape[1]), np.inf)
        return lost.astype(complex), np.zeros(lost.shape), np.zeros(A.shape, complex)
    wanted = rows[:, None] * b
    x = inverse @ wanted
    for _ in range(2):
        x = x + inverse @ (wanted - B @ x)
    sizes = np.abs(B) @ np.abs(x) + np.abs(wanted)
    error = ROUNDING * EPS * (np.abs(inverse) @ sizes)
    whole = columns[:, None] * inverse * rows
    return np.asarray(x * columns[:, None]), np.asarray(error * columns[:, None]), whole


def _sweeps(poles: Complexes, factor: float) -> Iterator[str]:
    """Yield sweeps: a decade about all poles, and close to the sharpest one, times a factor."""
    sizes = np.abs(poles) / math.tau
    sizes = sizes[(sizes > LEAST) & (sizes < MOST)]
    low, high = (1.0, 1e9) if not len(sizes) else (sizes.min() / 10.0, 10.0 * sizes.max())
    low, high = max(float(low), LEAST), min(float(high), MOST)
    decades = max(math.log10(high / low), 1.0)
    yield f"ac dec {max(round(POINTS / decades), 1)} {low * factor!r} {high * factor!r}"
    sharp = [p for p in poles.tolist() if p.imag > 0.0 and abs(p.real) < SHARP * abs(p)]
    sharp = [p for p in sharp if LEAST < abs(p) / math.tau < MOST]
    if sharp:
        hertz = min((abs(p.real) / abs(p), abs(p)) for p in sharp)[1] / math.tau
        yield f"ac lin 5 {0.98 * factor * hertz!r} {1.02 * factor * hertz!r}"


def stepping(parts: Sequence[object]) -> tuple[Source, ...]:
    """Return the sources that step."""
    return tuple(part for part in parts if isinstance(part, Source) and part.step)
