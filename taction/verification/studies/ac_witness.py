"""ngspice's small signal of the deck as it is, beside that of the linear circuit.

It is asked twice in one run: from the sources that step, and from currents of random size into
every node, which see every pole, also one that no source reaches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.branches import Source
from taction.system.array_types import Complexes, Floats
from taction.verification.characterise.operating_point import AT_ONCE, DeckPoint
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.verdict.checks import Check, Outcome, at_most

TIGHT_LIMIT, LOOSE_LIMIT = 1e-6, 1e-4
LOOSER = tuple((f"reltol=1e-{k} abstol=1e-{k + 8} vntol=1e-{k + 2}", [AT_ONCE]) for k in (5, 4))
POINTS = 40
LEAST, MOST = 1e-3, 1e10  # Hz
FAINT = 1e-6  # of the largest voltage at a frequency: smaller ones count as this
PROBE = "taction_probe"
SHARP = 0.2  # damping below which frequencies about a pole are added


@dataclass(frozen=True, slots=True)
class AcComparison:
    """The largest relative difference from ngspice's ``.ac``, where it is, and between what, Hz.

    Without any, `worst` is None and `where` says why.
    """

    worst: float | None
    where: str
    band: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class AcWitness:
    """Compares the circuit of a deck with ngspice's ``.ac``."""

    point: DeckPoint
    sources: tuple[Source, ...]  # that step
    simulator: Simulator

    def check(self, board: LinearBoard, poles: Complexes) -> Check:
        """Return the check ``ac_agrees``."""
        limit = TIGHT_LIMIT if self.point.is_tight else LOOSE_LIMIT
        found = self.compare(board, poles)
        if found.worst is None:
            text = f"ngspice's .ac was not compared: {found.where}"
            return Check("ac_agrees", Outcome.INCONCLUSIVE, None, None, limit, None, "ratio", text)
        outcome, reason = at_most(found.worst, 0.0, limit), f"largest at {found.where}"
        if outcome is Outcome.FAIL and not self.point.is_tight:
            outcome = Outcome.INCONCLUSIVE
            reason += f"; ngspice finds its operating point with {self.point.limits} only"
        return Check("ac_agrees", outcome, found.worst, 0.0, limit, None, "ratio", reason)

    def compare(
        self, board: LinearBoard, poles: Complexes, ports: Mapping[str, float] | None = None
    ) -> AcComparison:
        """Compare both responses at frequencies about the poles.

        Of some `ports` only, where they are given, each relative to what it has or to this value.
        """
        nodes = [n for n in board.descriptor.names[: board.descriptor.node_count]
                 if n in self.point.volts or not self.point.volts]  # fmt: skip
        weights = _weights(len(nodes))
        names, hertz, theirs, said = self._asked(nodes, weights, poles)
        if not len(hertz):
            return AcComparison(None, said)
        if ports is not None:
            theirs = theirs[:, :, [names.index(port) for port in ports]]
            names = list(ports)
        places = [board.descriptor.place(name) for name in names]
        ours = self._ours(board, hertz, nodes, weights)[:, :, places]
        largest = np.abs(theirs).max(axis=2, keepdims=True)
        least = FAINT * largest if ports is None else np.array([*ports.values()])
        floor = np.maximum(np.abs(theirs), least)
        off = np.abs(ours - theirs) / np.where(floor > 0.0, floor, 1.0)
        off = np.where(np.isfinite(off), off, np.inf)
        way, at, node = np.unravel_index(int(off.argmax()), off.shape)
        how = ("from the source", "from currents into every node")[int(way)]
        where = f"{names[int(node)]}, {hertz[int(at)]:.4g} Hz, {how}"
        band = float(hertz.min()), float(hertz.max())
        return AcComparison(float(off.max(initial=0.0)), where, band)

    def _asked(
        self, nodes: Sequence[str], weights: Floats, poles: Complexes
    ) -> tuple[list[str], Floats, Complexes, str]:
        """Return nodes, frequencies, both responses (2, F, N), and what ngspice said."""
        probe = [f"v{PROBE} {PROBE} 0 dc 0 ac 0", f"r{PROBE} {PROBE} 0 1"]
        probe += [
            f"g{PROBE}{k} 0 {node} {PROBE} 0 {weight!r}"
            for k, (node, weight) in enumerate(zip(nodes, weights.tolist(), strict=True))
        ]
        stepping = {f"{s.card[0].lower()}{s.card[1:]}": s.step for s in self.sources}
        excited = [
            card.split()[0] for card in self.point.cards if card[0] in "vi" and " ac" in card
        ]
        sweeps = list(_sweeps(poles))
        commands = ["save all", *(f"alter {n} acmag=0" for n in excited if n not in stepping)]
        for name, step in stepping.items():
            commands += [f"alter {name} acmag={step!r}", f"alter {name} acphase=0"]
        for sweep in sweeps:
            commands += [sweep, f"write {RESULT}", "set appendwrite"]
        commands += [f"alter {name} acmag=0" for name in stepping]
        commands.append(f"alter v{PROBE} acmag=1")
        for sweep in sweeps:
            commands += [sweep, f"write {RESULT}"]
        # A transient to the operating point ends before it where something is slow: as a last way.
        for limits, ahead in ((self.point.limits, [AT_ONCE]), *LOOSER, (self.point.limits, [])):
            options = f".options {limits} {self.point.options}"
            cards = [*self.point.lines, *probe, options, *self.point.starts]
            answers = run_commands(cards, [*ahead, *commands], self.simulator, mode=self.point.mode)
            if len(answers.plots) == 2 * len(sweeps):
                break
        else:
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
        self, board: LinearBoard, hertz: Floats, nodes: Sequence[str], weights: Floats
    ) -> Complexes:
        """Return both responses of the circuit, (2, F, unknowns)."""
        descriptor = board.descriptor
        M, K = descriptor.dense.mass, descriptor.dense.stiffness
        b = np.zeros((descriptor.size, 2))
        b[:, 0] = descriptor.switched
        rows = descriptor.balance_rows
        for node, weight in zip(nodes, weights, strict=True):
            row = rows[descriptor.place(node)]
            if row < descriptor.size:
                b[row, 1] += weight
        found = np.empty((2, len(hertz), descriptor.size), complex)
        for k, s in enumerate(2j * math.pi * hertz):
            found[:, k] = _solved(s * M - K, b).T
        return found


def _solved(A: Complexes, b: Floats) -> Complexes:
    """Solve with rows and columns scaled, and refine once; infinite where A is singular."""
    rows = 1.0 / np.maximum(np.abs(A).max(axis=1), 1e-300)
    B = A * rows[:, None]
    columns = 1.0 / np.maximum(np.abs(B).max(axis=0), 1e-300)
    B = B * columns
    try:
        inverse = np.linalg.inv(B)
    except np.linalg.LinAlgError:
        return np.full((len(A), b.shape[1]), np.inf, complex)
    wanted = rows[:, None] * b
    x = inverse @ wanted
    for _ in range(2):
        x = x + inverse @ (wanted - B @ x)
    return np.asarray(x * columns[:, None])


def _weights(count: int) -> Floats:
    drawn = np.random.default_rng(3)
    return drawn.choice([-1.0, 1.0], count) * drawn.uniform(0.5, 1.0, count)


def _sweeps(poles: Complexes) -> Iterator[str]:
    """Yield sweeps of frequency: a decade about all poles, and close to the sharpest one."""
    sizes = np.abs(poles) / math.tau
    sizes = sizes[(sizes > LEAST) & (sizes < MOST)]
    low, high = (1.0, 1e9) if not len(sizes) else (sizes.min() / 10.0, 10.0 * sizes.max())
    low, high = max(float(low), LEAST), min(float(high), MOST)
    decades = max(math.log10(high / low), 1.0)
    yield f"ac dec {max(round(POINTS / decades), 1)} {low!r} {high!r}"
    sharp = [p for p in poles.tolist() if p.imag > 0.0 and abs(p.real) < SHARP * abs(p)]
    sharp = [p for p in sharp if LEAST < abs(p) / math.tau < MOST]
    if sharp:
        hertz = min((abs(p.real) / abs(p), abs(p)) for p in sharp)[1] / math.tau
        yield f"ac lin 5 {0.98 * hertz!r} {1.02 * hertz!r}"


def stepping(parts: Sequence[object]) -> tuple[Source, ...]:
    """Return the sources that step."""
    return tuple(part for part in parts if isinstance(part, Source) and part.step)
