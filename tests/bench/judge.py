"""Whether a written board works on the bench: its deck's text is perturbed, and ngspice runs it.

Nothing of taction is imported: a deck, the limits of a scene and the figures of a data sheet are
text and numbers. The target follows from the normal equations of the problem.
"""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Sheet = Mapping[str, tuple[float, float]]
"""Mean and standard deviation over the parts of a type, V or A, by figure."""

RESISTOR = re.compile(r"^(R\S+) (\S+) (\S+) (\S+)$")
OPAMP = re.compile(r"^(X\S+) (\S+) (\S+) (\S+) (\S+)$")
TRAN = re.compile(r"^\.tran (\S+) (\S+) .*$", re.MULTILINE)
STEPS = re.compile(r"trtol=\S+")  # a deck may ask for steps that are finer than a bench needs
LONGER = 1.5  # times the record of the deck: what has not settled then never does
POINTS = (300, 500, 800)  # of a record, at least; ngspice may give up at one spacing


@dataclass(frozen=True, slots=True)
class Limits:
    """What the scene asks of a board, shares of the largest step; times in s."""

    steady: float
    band: float
    settling: float = math.inf
    overshoot: float = math.inf


@dataclass(frozen=True, slots=True)
class Board:
    """A written board: its deck, its target (N,), V, its limits, and what its parts vary by."""

    name: str
    deck: str
    target: Floats
    limits: Limits
    tolerance: float  # of the resistors, three standard deviations
    sheet: Sheet


def sheet_of(
    figures: Mapping[str, float], most: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of offset, bias and offset current by a data sheet.

    The largest size is three standard deviations; without one, half of the parts are within the
    typical size. Bias currents of one type have one sign.
    """
    found = {}
    for name in ("offset_voltage", "offset_current", "bias_current"):
        typical = figures.get(name, 0.0)
        sigma = most[name] / 3.0 if name in most else abs(typical) / 0.6745
        mean = 0.0
        if name == "bias_current" and name in most:
            mean, sigma = typical, abs(abs(most[name]) - abs(typical)) / 3.0
        found[name] = (mean, sigma)
    return found


def drawn(board: Board, rng: np.random.Generator) -> str:
    """Return the deck with every resistor within its tolerance and every op-amp with own errors."""
    head, kinds, inside = [], dict[str, list[str]](), ""
    for line in board.deck.splitlines():
        if line.startswith(".subckt"):
            inside = line.split()[1]
            kinds[inside] = []
        if inside:
            kinds[inside].append(line)
            inside = "" if line.startswith(".ends") else inside
        else:
            head.append(line)
    lines: list[str] = []
    for line in head:
        if found := RESISTOR.match(line):
            name, a, b, ohms = found.groups()
            factor = 1.0 + board.tolerance / 3.0 * rng.standard_normal()
            lines.append(f"{name} {a} {b} {float(ohms) * factor!r}")
        elif (found := OPAMP.match(line)) and found[5] in kinds:
            own = f"{found[5]}_{found[1]}"
            lines.append(line[: found.start(5)] + own)
            lines += _with_errors(kinds[found[5]], found[5], own, board.sheet, rng)
        else:
            lines.append(line)
    return "\n".join([*lines, ""])


def _with_errors(
    cards: list[str], kind: str, own: str, sheet: Sheet, rng: np.random.Generator
) -> list[str]:
    """Return the subcircuit of one op-amp; its non-inverting input is at ground on these boards."""
    draws = {name: mean + sigma * rng.standard_normal() for name, (mean, sigma) in sheet.items()}
    inverting = draws["bias_current"] - 0.5 * draws["offset_current"]
    found = []
    for card in cards:
        words = card.split()
        if words[0] in (".subckt", ".ends"):
            card = card.replace(kind, own, 1)
        elif words[0] == "Vos":
            card = " ".join([*words[:3], repr(draws["offset_voltage"])])
        elif words[0] == "Ibn":
            card = " ".join([*words[:3], repr(inverting)])
        elif words[0].startswith("Ec"):  # the common-mode error, of either sign
            card = " ".join([*words[:-1], repr(float(words[-1]) * float(rng.choice((-1.0, 1.0))))])
        found.append(card)
    return found


def simulated(deck: str, ngspice: str) -> tuple[Floats, Floats]:
    """Return time (K,), s, and the saved voltages (K, N), V, in the order of the ``.save`` card.

    Raises
    ------
    RuntimeError
        ngspice fails, or its record ends early, with each of `POINTS`.
    """
    for points in POINTS:
        try:
            return _simulated(deck, ngspice, points)
        except RuntimeError as error:
            failure = error
    raise failure


def _simulated(deck: str, ngspice: str, points: int) -> tuple[Floats, Floats]:
    tran = TRAN.search(deck)
    if tran is None:
        raise RuntimeError("the deck has no .tran card")
    stop = LONGER * float(tran[2])
    longer = f".tran {stop / points!r} {stop!r} 0 {stop / points!r} uic"
    deck = STEPS.sub("trtol=1", deck[: tran.start()]) + longer + deck[tran.end() :]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "deck.cir").write_text(deck, encoding="utf-8")
        command = [ngspice, "-b", "-n", "-r", "out.raw", "deck.cir"]
        run = subprocess.run(command, cwd=place, capture_output=True, timeout=120, check=False)
        raw = (place / "out.raw").read_bytes() if (place / "out.raw").exists() else b""
    head, _, data = raw.partition(b"Binary:\n")
    lines = head.decode().splitlines()
    names = [line.split()[1].lower() for line in lines if re.match(r"^\t\d+\t", line)]
    if run.returncode or not names:
        raise RuntimeError(run.stderr.decode(errors="replace")[-300:] or "no record")
    values = np.frombuffer(data, dtype=np.float64).reshape(-1, len(names))
    if not (len(values) and np.isfinite(values).all() and values[-1, 0] >= stop * (1.0 - 1e-6)):
        raise RuntimeError("the record is cut short")
    saved = next(line for line in deck.splitlines() if line.startswith(".save")).split()[1:]
    return values[:, 0], values[:, [names.index(name.lower()) for name in saved]]


def fault(board: Board, time: Floats, volts: Floats) -> str:
    """Return which limit a record breaks, in a word with its value; empty if none."""
    limits, target = board.limits, board.target
    step = float(np.abs(target).max())
    away = np.abs(volts - target) / step
    rest = float(away[-1].max())
    if rest > limits.steady:
        return f"rests {rest:.3g} of the step away"
    outside = np.flatnonzero((away > limits.band).any(axis=1))
    settled = 0.0 if not len(outside) else float(time[min(outside[-1] + 1, len(time) - 1)])
    if len(outside) and outside[-1] >= len(time) - 2:
        return "never settles"
    if settled > limits.settling:
        return f"settles after {settled:.3g} s"
    over = float(((volts - target) * np.sign(target)).max() / step)
    return f"overshoots by {over:.3g}" if over > limits.overshoot else ""


@dataclass(frozen=True, slots=True)
class Judgement:
    """What ngspice says about a board as written, and about the drawn ones."""

    name: str
    as_written: str  # the limit that the board as written breaks; empty if none
    faults: tuple[str, ...]  # of the drawn boards, empty texts where all is kept

    @property
    def passing(self) -> float:
        """Share of the drawn boards that keep all limits."""
        return sum(not text for text in self.faults) / len(self.faults)

    @property
    def good(self) -> bool:
        """Whether a PASS of this board is right."""
        return not self.as_written and self.passing >= 0.95


def judged(board: Board, ngspice: str, draws: int, seed: int) -> Judgement:
    """Return what ngspice says about a board and `draws` drawn ones."""

    def said(deck: str) -> str:
        try:
            return fault(board, *simulated(deck, ngspice))
        except (RuntimeError, subprocess.TimeoutExpired) as error:
            return f"no record: {error}"

    rng = np.random.default_rng(seed)
    faults = tuple(said(drawn(board, rng)) for _ in range(draws))
    return Judgement(board.name, said(board.deck), faults)
