"""The closed formulas of a topology, compared with the poles of the state-space engine.

A formula holds for a board of fewer parts: op-amps of one pole, or of two, without capacitance and
output resistance. The engine gets that board, whose equations it makes from all its parts, so both
must agree to rounding. What is left out of the board of the scene is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.topologies.frame.laws import Law
from taction.system.errors import TactionError
from taction.system.quantities import show, show_rate
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.families import Family
from taction.verification.stability.poles import Poles, poles

SAME = 1e-9  # of the fastest pole: rounding of the formula, besides that of the engine's poles
BESIDE = 1e-5  # relative distance of the boards on both sides of an edge
FAR = 1e3  # factor of gf, either way, of the boards whose stability is proved
MOST = 64  # op-amps, up to which a search for an edge costs less than a second
LEFT_OUT: dict[str, dict[str, Any]] = {
    "second pole": {"second_pole": math.inf},
    "input impedance": {
        "input_resistance": math.inf,
        "differential_capacitance": 0.0,
        "input_capacitance": 0.0,
    },
    "output resistance": {"output_resistance": 0.0},
}
Comparison = Callable[[Circuit, Law], dict[str, Any]]
NAMES = tuple(each.name for each in fields(Law))
NEVER: dict[str, Any] = {"large_signal": False, "limits_current": False, "input_errors": False}


@dataclass(frozen=True, slots=True)
class CheckedLaw(Law):
    """A closed formula, and what the state-space engine has in its place.

    Attributes
    ----------
    engine : float or None
        The same number by the engine's poles; None where these only confirm or refute it.
    agrees : bool or None
        Whether the engine says the same; None if they are not compared, or if rounding decides.
    compared : str
        How they are compared, or why they are not.
    left_out : str
        What the formula, and the board of the engine, do not have of the board of the scene.
    """

    engine: float | None = None
    agrees: bool | None = None
    compared: str = ""
    left_out: str = ""

    @property
    def contradiction(self) -> str:
        """The two numbers in words, or the sentence about the board that the engine refutes."""
        given = f"{self.title}: the formula gives {show(self.value, self.unit)}, the engine"
        if self.engine is None:
            return f"{given} does not confirm: {self.compared}"
        return f"{given} {show(self.engine, self.unit)}"


def checked_laws(circuit: Circuit, laws: Iterable[Law]) -> tuple[CheckedLaw, ...]:
    """Compare closed formulas of a board with the engine, but those that it only estimates.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.topologies.frame.table import topology_of
    >>> scene = taction.load_scene("scenes/ridge.toml")
    >>> board = taction.synthesise(scene)
    >>> laws = checked_laws(board, topology_of(scene).laws(board))
    >>> [(law.name, law.agrees) for law in laws[:3]]
    [('rightmost_pole', True), ('second_pole', True), ('stored_energy', True)]
    """
    return tuple(_checked(COMPARED, circuit, law) for law in laws)


def with_estimates(circuit: Circuit, laws: Iterable[CheckedLaw]) -> tuple[CheckedLaw, ...]:
    """Set beside formulas that need not hold exactly what the engine has: a search for each."""
    return tuple(
        _checked(ESTIMATED, circuit, law) if law.name in ESTIMATED else law for law in laws
    )


def bare(circuit: Circuit, *, second_pole: float = math.inf) -> tuple[Circuit, str]:
    """Return the board for which the formulas hold, and in words what it leaves out."""
    left, models = list[str](), dict(circuit.models)
    for name, model in circuit.models.items():
        for words, figures in LEFT_OUT.items():
            kept = words == "second pole" and second_pole == model.second_pole
            if not kept and any(getattr(model, key) != value for key, value in figures.items()):
                left.append(words)
            models[name] = replace(models[name], **figures)
        models[name] = replace(models[name], **NEVER, second_pole=second_pole)
    if circuit.capacitors:
        left.append("stray capacitance")
    return replace(circuit, models=models, capacitors=()), ", ".join(dict.fromkeys(left))


def _checked(kinds: Mapping[str, Comparison], circuit: Circuit, law: Law) -> CheckedLaw:
    compare, stated = kinds.get(law.name), {name: getattr(law, name) for name in NAMES}
    if compare is None:
        return CheckedLaw(**stated, compared="an estimate, which is not compared")
    try:
        return CheckedLaw(**stated, **compare(circuit, law))
    except TactionError as error:
        return CheckedLaw(**stated, compared=f"the engine has no result: {error}")


def _rightmost(circuit: Circuit, law: Law) -> dict[str, Any]:
    """Compare the pole; the formula's modes are those of the same matrix, and round as much."""
    board, left = bare(circuit)
    found = poles(board)
    allowed = 2.0 * found.resolution + SAME * float(abs(found.poles).max())
    value = found.rightmost.real
    return {"engine": value, "agrees": abs(value - law.value) <= allowed, "left_out": left}


def _second_pole(circuit: Circuit, law: Law) -> dict[str, Any]:
    """Compare the stability beside the edge; without one, that of a very low second pole."""

    def there(hertz: float) -> tuple[Poles, str]:
        board, left = bare(circuit, second_pole=hertz)
        return poles(board), left

    if law.value == 0.0:
        low = min(model.gbw / model.dc_gain for model in circuit.models.values())
        found, left = there(low)
        agrees, words = _all_so((found, True)), f"stable with {show(low, 'Hz')}"
    else:
        (above, left), (below, _) = (there(law.value * by) for by in (1.0 + BESIDE, 1.0 - BESIDE))
        agrees = _all_so((above, True), (below, False))
        words = f"stable {BESIDE:g} above, unstable as far below"
    return {"agrees": agrees, "compared": words, "left_out": left}


def _all_so(*boards: tuple[Poles, bool]) -> bool | None:
    """Whether boards are stable, or not, as stated; None where rounding decides it for one."""
    if any(found.known_unstable if stable else found.known_stable for found, stable in boards):
        return False
    return True if all(found.certain for found, _ in boards) else None


def _energy(circuit: Circuit, law: Law) -> dict[str, Any]:
    if law.value >= 0.0:
        return {"compared": "nothing is proved"}
    board, left = bare(circuit)
    gf = board.value("gf")
    found = [poles(board.turned("gf", gf * by)) for by in (1.0 / FAR, 1.0, FAR)]
    worst = max(each.rightmost.real for each in found)
    words = f"at gf/{FAR:g}, gf and {FAR:g} gf poles are at most {show_rate(worst)}"
    agrees = _all_so(*((each, True) for each in found))
    return {"agrees": agrees, "compared": words, "left_out": left}


def _least_gf(circuit: Circuit, law: Law) -> dict[str, Any]:
    """Find the engine's edge; the law has mean loads, so the two need not be equal."""
    if len(circuit.opamps) > MOST:
        return {"compared": f"not compared beyond {MOST} op-amps"}
    (model,) = circuit.models.values()
    board, left = bare(circuit, second_pole=model.second_pole)
    family = Family.of(LinearBoard(board), board.knob("gf"))
    edges = family.edges(min(law.value, family.own) / FAR, max(law.value, family.own) * FAR)
    found = max((edge.value for edge in edges.edges), default=None)
    words = "the formula has the mean of unequal loads"
    return {"engine": found, "compared": words, "left_out": left}


COMPARED: dict[str, Comparison] = {
    "rightmost_pole": _rightmost,
    "second_pole": _second_pole,
    "stored_energy": _energy,
}
"""How the number of each formula is compared, by its name: fields of a `CheckedLaw`."""
ESTIMATED: dict[str, Comparison] = {"least_gf": _least_gf}
"""The same of formulas that need not hold exactly."""
