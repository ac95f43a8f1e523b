"""C, gain and lambda as parameters of a deck, and the values that follow from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit

ROUNDING = 1e-12  # relative: above it a value of the board is not what its expression gives


@dataclass(frozen=True, slots=True)
class Parameters:
    """The head of a deck with parameters, and the expressions of its parts.

    Attributes
    ----------
    lines : tuple of str
        Cards ``.param`` and comments, in the words of ngspice.
    expressions : dict of str to str
        Expression in the place of the number, by the name of the card.
    """

    lines: tuple[str, ...]
    expressions: Mapping[str, str]


NO_PARAMETERS = Parameters((), {})


def parameters_of(circuit: Circuit, *, fixed_lambda: bool = False) -> Parameters:
    """Return C, gain and lambda of `circuit` as parameters.

    ``R = 1 / (lambda s G0²)`` for linear amplifiers (eq (21) corrected), and
    ``R = 2 Ve / (lambda s G0² U0)`` for others (eqs (16) and (8) in the board's units). The
    passive topology has ``1 / (1/R - load)`` at each channel.

    Parameters
    ----------
    fixed_lambda : bool
        Whether lambda stays the number that it is, for a deck whose measures hold for it alone.

    Raises
    ------
    ValueError
        A part of the board has another value than its expression.

    Examples
    --------
    >>> import taction
    >>> found = parameters_of(taction.synthesise(taction.load_scene("scenes/known-readings.toml")))
    >>> found.lines[1:4]
    ('.param C=1.5e-11', '.param gain=1000000.0', '.param lambda=0.05')
    >>> found.expressions["Rs_1"], found.expressions["Cc_1"], found.expressions["Rr_1"]
    ('gain', 'C', 'R')
    """
    s = circuit.scalings
    product = 1.0 / s.unit_conductance**2
    if circuit.has_nonlinear_amplifiers:
        product *= 2.0 * s.exponential_slope / s.unit_voltage
    resistance = product / (s.lam * s.gain)
    share = f"{product / s.lam!r}/gain" if fixed_lambda else f"{product!r}/(lambda*gain)"
    lines = [
        "* edit these numbers; the values of all other parts stay as they are",
        f".param C={s.capacitance!r}",
        f".param gain={s.gain!r}",
        *([] if fixed_lambda else [f".param lambda={s.lam!r}"]),
        f".param R={{{share}}}",
        "* the stop time and the steps hold for the numbers that taction wrote",
    ]
    expressions: dict[str, str] = {}
    for name, node, ohms in ((r.name, r.a, r.ohms) for r in circuit.resistors):
        kind = name.partition("_")[0]
        if kind == "s":
            expressions[f"R{name}"] = _checked(name, "gain", s.gain, ohms)
        elif kind == "bias" or (kind == "r" and circuit.topology == "integrator"):
            expressions[f"R{name}"] = _checked(name, "R", resistance, ohms)
        elif kind == "r":
            load = _load(circuit, node)
            value = 1.0 / (1.0 / resistance - load)
            expressions[f"R{name}"] = _checked(name, f"1/(1/R-{load!r})", value, ohms)
    for part in circuit.capacitors:
        if part.name.startswith("c_"):
            expressions[f"C{part.name}"] = _checked(part.name, "C", s.capacitance, part.farads)
    return Parameters(tuple(lines), expressions)


def _load(circuit: Circuit, node: str) -> float:
    """Return the conductance of the feedback resistors at a node of the passive topology, S."""
    feedback = circuit.matrices[1]
    return float(np.sum(1.0 / feedback.ohms[:, feedback.sinks.index(node)]))


def _checked(name: str, expression: str, value: float, actual: float) -> str:
    if not math.isclose(value, actual, rel_tol=ROUNDING):
        raise ValueError(f"{name} is {actual!r}, but its expression {expression} gives {value!r}")
    return expression
