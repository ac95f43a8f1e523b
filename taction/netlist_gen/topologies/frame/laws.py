"""What closed formulas say about a board of one loop, from its conductances and op-amps alone.

With op-amps of one pole, ``v' = wt (v+ - v-) - wp v``, ideal outputs and no capacitance, the
voltages at the inputs follow from those at the outputs: ``Y v_in = -F v``, where Y is the nodal
matrix of the inputs, which is diagonal without wires. So the board has a state matrix of one line,
``wt S - wp``, whose modes tell its time, and which second pole it bears. The state-space engine has
its own equations, of all parts; `verify` compares the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.wired_arrays import joined_resistors
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Complexes, Floats

MOST = 400  # op-amps, up to which the modes of S cost less than a second
ROUNDINGS = 8.0  # units in the last place of every element of K, at most
WITHOUT = 1e-9  # times gf: what is left of it where the proof is to hold for every gf


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


@dataclass(frozen=True, slots=True)
class Loops:
    """The inputs of all op-amps of a board as resistors join them to the outputs.

    Attributes
    ----------
    nodal : ndarray (I, I)
        Nodal matrix Y of the nodes that no output and no source holds, S.
    drives : ndarray (I, P)
        Nodal matrix F of these nodes and the outputs, S.
    signs : ndarray (P, I)
        E: with ``E v_in = v+ - v-``.
    """

    nodal: Floats
    drives: Floats
    signs: Floats

    @classmethod
    def of(cls, circuit: Circuit) -> Loops:
        """Return those of a board; it may have wires."""
        outputs = {cell.output: place for place, cell in enumerate(circuit.opamps)}
        held = {GROUND, *outputs, *(source.node for source in circuit.voltages)}
        joined = [each for each in joined_resistors(circuit) if math.isfinite(each[2])]
        nodes = dict.fromkeys(node for a, b, _ in joined for node in (a, b) if node not in held)
        free = {node: place for place, node in enumerate(nodes)}
        Y, F = np.zeros((len(free), len(free))), np.zeros((len(free), len(outputs)))
        for a, b, ohms in joined:
            for node, other in ((a, b), (b, a)):
                if node not in free:
                    continue
                Y[free[node], free[node]] += 1.0 / ohms
                if other in free:
                    Y[free[node], free[other]] -= 1.0 / ohms
                elif other in outputs:
                    F[free[node], outputs[other]] -= 1.0 / ohms
        E = np.zeros((len(outputs), len(free)))
        for row, cell in enumerate(circuit.opamps):
            for node, sign in ((cell.noninverting, 1.0), (cell.inverting, -1.0)):
                if node in free:
                    E[row, free[node]] += sign
        return cls(Y, F, E)

    @property
    def matrix(self) -> Floats:
        """S: the inputs' differences ``v+ - v-`` over the outputs of all op-amps, (P, P)."""
        return np.asarray(-self.signs @ np.linalg.solve(self.nodal, self.drives))

    @property
    def power(self) -> tuple[float, float]:
        """The largest eigenvalue of ``(K + K') / 2`` with its rounding, and the least of P, S.

        ``K = P S``, and ``P = (E Y^-1 E')^-1`` has the loads, where E has the mean of two inputs.
        With ``q' P q`` as energy of the states it grows by no more than ``wt`` times the first less
        ``1/A0`` times the second: below zero, ``P/wt`` is a Lyapunov matrix.
        """
        means = self.signs / np.sqrt(np.abs(self.signs).sum(axis=1, keepdims=True))
        P = np.linalg.inv(means @ np.linalg.solve(self.nodal, means.T))
        K = P @ self.matrix
        rounding = ROUNDINGS * len(K) * float(np.finfo(np.float64).eps * np.abs(K).max())
        largest = float(np.linalg.eigvalsh(0.5 * (K + K.T))[-1])
        return largest + rounding, float(np.linalg.eigvalsh(0.5 * (P + P.T))[0])


def modes_of(circuit: Circuit) -> Complexes:
    """Return the modes ``a + jb`` of -S; a board of one-pole op-amps is stable if all a > 0.

    Examples
    --------
    >>> import taction
    >>> modes = modes_of(taction.synthesise(taction.load_scene("scenes/inverse.toml")))
    >>> bool((modes.real > 0.0).all())
    True
    """
    return np.asarray(np.linalg.eigvals(-Loops.of(circuit).matrix), dtype=np.complex128)


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
        slowest = _least_second_pole(modes, model)
        text = "each mode a + jb needs a > wt t2 b²; 0: no mode rings"
        laws.append(Law("second_pole", "least second pole that is stable", slowest, "Hz", text))
    return tuple(laws)


def _least_second_pole(modes: Complexes, model: OpAmp) -> float:
    """Return the second pole, Hz, above which all modes a + jb decay.

    ``(s + wp)(1 + t2 s) + wt (a + jb) = 0`` decays if ``(1 + wp t2)² (wt a + wp) > t2 (wt b)²``:
    for A0 without limit ``a > wt t2 b²``.
    """
    wt = math.tau * model.gbw
    wp = wt / model.dc_gain
    gain, ring = wt * modes.real + wp, (wt * modes.imag) ** 2
    # (1 + wp t2)² gain = t2 ring, its smaller root; no root: stable for every t2
    half = 0.5 * ring - wp * gain
    square = half**2 - (wp * gain) ** 2
    edge = (half > 0.0) & (square > 0.0)
    lags = gain[edge] / (half[edge] + np.sqrt(square[edge]))
    return 1.0 / (math.tau * float(lags.min())) if len(lags) else 0.0


def energy_law(circuit: Circuit) -> tuple[Law, ...]:
    """Return the power into the states of a board of two arrays, which proves its stability.

    gf adds nothing positive to it, and to P what is positive: so it is taken without gf, and what
    it proves holds for every gf.
    """
    model = op_amp_of(circuit)
    if model is None:
        return ()
    power, load = Loops.of(circuit.turned("gf", WITHOUT * circuit.value("gf"))).power
    value = power - load / model.dc_gain
    means = (
        "below 0: P/wt is a Lyapunov matrix, so the board is stable for every gf with op-amps of"
        " one pole"
        if value < 0.0
        else "not below 0: this P proves nothing, the poles decide"
    )
    text = f"{means}; P has the loads of the inputs, K = P S"
    title = "largest eigenvalue of (K + K')/2 - P/A0 without gf"
    return (Law("stored_energy", title, value, "S", text),)


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
