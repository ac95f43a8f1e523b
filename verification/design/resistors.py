"""G0 and s, so that every resistor of a board can be bought and lambda is exact.

R and s are values of the scene's series (E24 if it names none), and G0 takes up the rounding:
``lambda = 1 / (R s G0²)``, and the like for other amplifiers.
"""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.board.buyable_values import buyable
from taction.netlist_gen.board.part_warnings import LEAST_OHMS, MOST_OHMS
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError
from taction.verification.reference import lambda_times_resistance
from taction.verification.reference.ideal_answer import IdealAnswer

MIDDLE = 1e5  # ohm: geometric mean of the largest and the smallest matrix resistor


def scaled_resistors(
    scene: Scene, problem: InverseProblem, answer: IdealAnswer, factor: float, notes: list[str]
) -> dict[str, float]:
    """Return s and G0 by their paths; R, which follows from lambda, is in the series, too.

    Parameters
    ----------
    factor : float
        Of s, times the value that balances constraint plane and outputs.
    notes : list of str
        Receives what could not be reached.

    Raises
    ------
    InputError
        T or lambda need resistors out of the range that can be bought.
    """
    sizes = np.abs(problem.matrix[problem.matrix != 0.0])
    smallest, largest = float(sizes.min()), float(sizes.max())
    pruned = sizes[sizes >= scene.design.prune * largest]
    smallest = float(pruned.min())
    if largest / smallest > MOST_OHMS / LEAST_OHMS:
        ratio = LEAST_OHMS / MOST_OHMS
        text = (
            f"the entries of T differ by the factor {largest / smallest:.3g}, and resistors that"
            f" can be bought by {1 / ratio:.3g}; leave out small entries with design.prune ="
            f" {ratio:.1g} or more"
        )
        raise InputError(scene.file, Complaint("problem", "", text))
    unit = 1.0 / (MIDDLE * math.sqrt(largest * smallest))
    unit = min(max(unit, 1.0 / (MOST_OHMS * smallest)), 1.0 / (LEAST_OHMS * largest))
    lam, product = answer.network.lam, _product(scene, unit)
    strain = float(np.abs(problem.strain).max(initial=0.0))
    drive = float(np.abs(answer.solution.u).max(initial=0.0))
    balanced = drive / (unit * strain) if strain and drive else math.sqrt(product / lam)
    low, high = product / lam / MOST_OHMS, product / lam / LEAST_OHMS
    low, high = max(low, LEAST_OHMS), min(high, MOST_OHMS)
    if low > high:
        text = (
            f"no s and R between {LEAST_OHMS:g} and {MOST_OHMS:g} ohm have this lambda; expected"
            f" about {product / MOST_OHMS**2:.1g} to {product / LEAST_OHMS**2:.1g}"
        )
        raise InputError(scene.file, Complaint("design.lambda", f"{lam:g}", text))
    series = scene.design.resistor_series
    series = "E24" if series == "exact" else series
    gain = buyable(min(max(factor * balanced, low), high), series)
    resistance = buyable(product / (lam * gain), series)
    if not low <= balanced <= high:
        notes.append("s is not balanced with the outputs: R would be out of its range")
    unit *= math.sqrt(product / (lam * gain * resistance))
    return {"design.gain": gain, "design.unit_conductance": unit}


def _product(scene: Scene, unit: float) -> float:
    """Return lambda R s, ohm²."""
    design = scene.design
    slope = design.exponential_slope or 1.0
    return lambda_times_resistance(
        design.amplifier, s=1.0, G0=unit, U0=design.unit_voltage, Ve=slope
    )
