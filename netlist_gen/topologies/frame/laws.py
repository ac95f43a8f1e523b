"""What closed formulas say about a board of one loop, from its conductances and op-amps alone.

With op-amps of one pole, ``v' = wt (v+ - v-) - wp v``, ideal outputs and no capacitance, the
voltage at an input is the mean of all that ends there, weighted with the conductances. So the board
has a state matrix of one line, ``wt S - wp``, whose modes tell its time, and which second pole it
bears. The state-space engine has its own equations, of all parts; `verify` shows both numbers.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.wired_arrays import joined_resistors
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Complexes, Floats

MOST = 400  # op-amps, up to which the modes of S cost less than a second


@dataclass(frozen=True, slots=True)
class Law:
    """A number that a closed formula gives.

    Attributes
    ----------
    name : str
        In a document: ``"rightmost_pole"``.
    title : str
        What it is, in some words.
    value : float
        SI base unit.
    unit : str
        Its unit.
    sentence : str
        What follows from it, and for which boards it holds.
    """

    name: str
    title: str
    value: float
    unit: str
    sentence: str


def op_amp_of(circuit: Circuit) -> OpAmp | None:
    """Return the op-amp of a board whose op-amps are all alike and have a pole; else None."""
    models = list(circuit.models.values())
    alike = len(models) == 1 and math.isfinite(models[0].gbw) and models[0].imported is None
    return models[0] if alike and len(circuit.opamps) <= MOST else None


def one_pole_matrix(circuit: Circuit) -> Floats:
    """Return S: the inputs' differences ``v+ - v-`` over the outputs of all op-amps, (P, P)."""
    places = {cell.output: place for place, cell in enumerate(circuit.opamps)}
    weights: defaultdict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    for a, b, ohms in joined_resistors(circuit):
        for node, other in ((a, b), (b, a)):
            weights[node][other] += 1.0 / ohms
    S = np.zeros((len(places), len(places)))
    for row, cell in enumerate(circuit.opamps):
        for node, sign in ((cell.noninverting, 1.0), (cell.inverting, -1.0)):
            total = math.fsum(weights[node].values()) if node in weights else 0.0
            for other, siemens in weights[node].items():
                if other in places:
                    S[row, places[other]] += sign * siemens / total
    return S


def modes_of(circuit: Circuit) -> Complexes:
    """Return the modes ``a + jb`` of -S; a board of one-pole op-amps is stable if all a > 0.

    Examples
    --------
    >>> import taction
    >>> modes = modes_of(taction.synthesise(taction.load_scene("scenes/inverse.toml")))
    >>> bool((modes.real > 0.0).all())
    True
    """
    return np.asarray(np.linalg.eigvals(-one_pole_matrix(circuit)), dtype=np.complex128)


def loop_laws(circuit: Circuit) -> tuple[Law, ...]:
    """Return the rightmost pole with one-pole op-amps, and the least second pole that is stable."""
    model = op_amp_of(circuit)
    if model is None:
        return ()
    modes = modes_of(circuit)
    least = float(modes.real.min())
    rate = -math.tau * model.gbw * (least + 1.0 / model.dc_gain)
    known = "op-amps of one pole without capacitance at their inputs and outputs"
    laws = [
        Law(
            "rightmost_pole", "rightmost pole, by the modes of the conductances", rate, "1/s",
            f"with {known}: -wt (a + 1/A0) of the least mode a",
        )
    ]  # fmt: skip
    if least > 0.0:
        slowest = float((modes.imag**2 / modes.real).max()) * model.gbw
        text = "each mode a + jb needs a > wt t2 b²; 0: no mode rings"
        laws.append(Law("second_pole", "least second pole that is stable", slowest, "Hz", text))
    return tuple(laws)


def feedback_laws(circuit: Circuit, X: Floats) -> tuple[Law, ...]:
    """Return the gf that is fastest, and the least one with the second pole of the op-amps.

    Parameters
    ----------
    X : ndarray (M, N)
        Conductances of both arrays with their signs, S.

    Notes
    -----
    With the mean loads r + gf of the rows and l of the columns, a singular value sigma has the
    modes ``s² + wt gf d s + wt² c d sigma² = 0``, d = 1/(r + gf), c = 1/l. They are fastest at
    ``gf = 2 sigma_min sqrt(c/d)``, and bear a lag t2 while
    ``c sigma_max² < gf/(2 wt t2) + gf² d/4``.
    """
    model = op_amp_of(circuit)
    if model is None:
        return ()
    plus, minus = np.maximum(X, 0.0), np.maximum(-X, 0.0)
    rows = float(np.maximum(plus.sum(axis=1), minus.sum(axis=1)).mean())
    columns = float(np.maximum(plus.sum(axis=0), minus.sum(axis=0)).mean())
    sigma = np.linalg.svd(X, compute_uv=False)
    far = float(sigma[-1]) ** 2 / columns
    # gf² = 4 sigma² (r + gf) / l
    best = 2.0 * far + 2.0 * math.sqrt(far * far + far * rows)
    laws = [
        Law(
            "fastest_gf", "gf of the fastest board", best, "S",
            "2 sigma_min sqrt(c/d), with mean loads and op-amps of one pole",
        )
    ]  # fmt: skip
    if math.isfinite(model.second_pole):
        wanted = float(sigma[0]) ** 2 / columns
        half = model.second_pole / (2.0 * model.gbw)  # 1/(2 wt t2)
        low, high = 0.0, wanted / half
        for _ in range(200):
            gf = 0.5 * (low + high)
            enough = gf * half + gf * gf / (4.0 * (rows + gf)) > wanted
            low, high = (low, gf) if enough else (gf, high)
        text = "c sigma_max² < gf/(2 wt t2) + gf² d/4, with mean loads; capacitances ask for more"
        laws.append(Law("least_gf", "least gf that is stable", high, "S", text))
    return tuple(laws)
