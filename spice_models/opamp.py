"""The op-amp macromodel as data: finite gain, two poles, input and output impedances."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OpAmp:
    """Small-signal figures of one op-amp type, SI base units.

    The open-loop gain is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0`` and
    ``p2 = 2 pi second_pole``. Zero or infinite figures mean that the element is left out.

    Attributes
    ----------
    name : str
        Matches ``^[A-Za-z][A-Za-z0-9_]*$``; it becomes the subcircuit's name.
    dc_gain : float
        A0, V/V.
    gbw : float
        Gain-bandwidth product, Hz; infinite: no first pole.
    second_pole : float
        Hz; infinite: no second pole.
    input_resistance : float
        Differential, ohm; infinite: none.
    differential_capacitance : float
        Between the inputs, F; 0: none.
    input_capacitance : float
        From each input to ground, F; 0: none.
    output_resistance : float
        Open loop, ohm; 0: none.
    source : str
        Where the figures were published.
    """

    name: str
    dc_gain: float
    gbw: float = math.inf
    second_pole: float = math.inf
    input_resistance: float = math.inf
    differential_capacitance: float = 0.0
    input_capacitance: float = 0.0
    output_resistance: float = 0.0
    source: str = ""
