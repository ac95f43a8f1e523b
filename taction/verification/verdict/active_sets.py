"""The active sets that a board of piecewise linear amplifiers visits, each with its own stability.

While its amplifiers keep their straight pieces such a board is linear. A set that is visited on the
way may be less stable than the one at rest, so it has a rightmost pole and a margin of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.stepped import SteppedCurve, simulate
from taction.verification.stability.margin import find_margin, first_knob
from taction.verification.stability.poles import poles
from taction.verification.verdict.run import Run

MOST = 12  # active sets, those of the longest stay


@dataclass(frozen=True, slots=True)
class VisitedSet:
    """An active set that a transient visits."""

    active: str  # the straight piece of each channel's amplifier, counted from the left: ``"0110"``
    begin: Annotated[float, "s"]  # when it is first entered, s
    stay: Annotated[float, "s"]  # how long the board is in it, in all, s
    visits: int  # how often it is entered
    rightmost: Annotated[float, "1/s"]  # real part of its rightmost pole, 1/s
    margin: float  # by what the first knob with a margin can move to instability; 0: is unstable
    words: str  # the margin in words


def visited_sets(run: Run) -> tuple[VisitedSet, ...]:
    """Return the active sets of a transient, at most `MOST`, in the order of their entry."""
    board, transient = run.board.linear, run.board.transient
    if board.circuit.is_linear or board.descriptor.is_large or not all(board.broken):
        return ()
    curve = run.waveforms.curve
    if not isinstance(curve, SteppedCurve):
        curve = simulate(board, transient, times=np.array([0.0, transient.stop])).curve
    if not isinstance(curve, SteppedCurve):
        return ()
    switches = curve.dense.switches
    begins = np.array([switch.time for switch in switches])
    lengths = np.diff(np.append(begins, min(curve.dense.ends[-1], curve.task.stop)))
    keys = [switch.segments for switch in switches]
    stays = {key: float(lengths[[k == key for k in keys]].sum()) for key in keys}
    kept = sorted(stays, key=stays.__getitem__, reverse=True)[:MOST]
    rest, name, found = np.zeros((1, board.descriptor.devices.count)), first_knob(board.circuit), []
    for key in (key for key in stays if key in kept):
        slopes = curve.reported.amplifiers.slopes_along(rest, np.array([key]))[0]
        point = Equilibrium(board.descriptor, np.zeros(board.descriptor.size), slopes, 0.0)
        alone = LinearBoard(board.circuit, point=point)
        own, margin = poles(alone), None
        if name and own.known_stable:
            margin = find_margin(alone, name, found=own)
        words = "unstable" if not own.known_stable else margin.text if margin else ""
        factor = 0.0 if margin is None else margin.factor
        begin, visits = float(begins[keys.index(key)]), keys.count(key)
        text, lead = "".join(map(str, key)), own.rightmost.real
        found.append(VisitedSet(text, begin, stays[key], visits, lead, factor, words))
    return tuple(found)
