"""What a user asks of a deck: limits of `QUESTIONS`, of stability, and expected values."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from taction.netlist_gen.scene.checks import Checks
from taction.netlist_gen.scene.mistakes import validated
from taction.system.errors import Complaint, InputError
from taction.system.quantities import parse
from taction.verification.studies.questions import QUESTIONS, share_of

SHARE = 1e-3  # default tolerance of an expected value
LISTED = 20  # nodes in a message
LARGEST = 100.0  # factor of a value up to which `stability.margin` searches
OSCILLATES = "oscillates"
OTHERS = {
    "stable": "stability", "stability": "stability", "margin": "stability",
    "agree": "engines_agree", "engines_agree": "engines_agree", OSCILLATES: OSCILLATES,
}  # fmt: skip
"""Words of checks that are no questions."""


class Expected(NamedTuple):
    """An expected voltage at rest."""

    node: str
    volts: float
    tolerance: float  # accepted deviation, V


@dataclass(frozen=True)
class Wanted:
    """What is to be checked.

    Attributes
    ----------
    tables : mapping of str to mapping
        Keys of the checks that scenes have, too, by their names.
    own : mapping of str to float
        Limits of the other questions, by their names.
    expected : tuple of Expected
        Voltages at rest.
    oscillates : bool
        Whether the circuit has to oscillate. Without this it has to be stable.
    """

    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    expected: tuple[Expected, ...] = ()
    own: Mapping[str, float] = field(default_factory=dict)
    oscillates: bool = False

    @cached_property
    def limits(self) -> Checks:
        """All limits, those of a scene without checks where nothing is asked."""
        return validated(Checks, self.tables, "--check")

    @property
    def names(self) -> tuple[str, ...]:
        """The checks that are asked for."""
        return (*self.tables, *self.own, *(() if self.oscillates else ("stability",)))

    def refuse_unknown(self, nodes: Collection[str]) -> None:
        """Refuse an expected value of a node that is not one of `nodes`."""
        for each in self.expected:
            if each.node not in nodes:
                text = f"the board has the nodes {', '.join([*nodes][:LISTED])}"
                raise InputError("--expect", Complaint(f"v({each.node})", "", text))

    @property
    def lowest(self) -> float | None:
        """Lowest frequency of the noise, Hz, where it was given."""
        return None if self.limits.noise is None else self.limits.noise.lowest


def wanted(checks: Iterable[str] = (), expect: Iterable[str] = ()) -> Wanted:
    """Read the texts of checks and expected values.

    Raises
    ------
    InputError
        A text that is no check; it says what is accepted.

    Examples
    --------
    >>> found = wanted(["settling=1ms@1%", "margin=2"], ["v(out)=1.25@0.1%"])
    >>> found.limits.settling_time.max, found.limits.stability.margin, found.expected
    (0.001, 2.0, (Expected(node='out', volts=1.25, tolerance=0.00125),))
    """
    tables: dict[str, dict[str, Any]] = {}
    for text in checks:
        name, keys = _check_of(text)
        known = tables.setdefault(name, {})
        if any(known.get(key, value) != value for key, value in keys.items()):
            raise InputError("--check", Complaint(name, repr(text), "two limits of one reading"))
        known.update(keys)
    oscillates = tables.pop(OSCILLATES, None) is not None
    own = {name: tables.pop(name)["limit"] for name in [*tables] if name in QUESTIONS
           and not QUESTIONS[name].is_of_scenes}  # fmt: skip
    found = Wanted(tables, tuple(map(_expected, expect)), own, oscillates)
    _ = found.limits  # a wrong one is refused here
    return found


def _check_of(text: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a check and the keys of its table."""
    word, _, value = (part.strip() for part in text.partition("="))
    value, _, extra = (part.strip() for part in value.partition("@"))
    for question in QUESTIONS.values():
        if word in (question.asked, question.name):
            return question.name, question.keys(value, extra)
    name = OTHERS.get(word)
    if name in (OSCILLATES, "stability") and not value and word != "margin":
        return name, {}
    if name == "stability":
        return name, {"margin": _factor(word, value)}
    if name == "engines_agree":
        return name, {"tolerance": share_of(value)}
    if name == OSCILLATES:
        raise InputError("--check", Complaint(word, repr(value), "expected no value"))
    known = ", ".join(f"{each.asked}={each.example}" for each in QUESTIONS.values())
    text = f"expected a check such as {known}, margin=2, stable, oscillates, agree=1e-3"
    raise InputError("--check", Complaint("check", repr(word), text))


def _factor(word: str, text: str) -> float:
    try:
        factor = float(text)
        if not 1.0 <= factor <= LARGEST:
            raise ValueError("margins are searched up to this factor")
        return factor
    except ValueError:
        accepted = f"expected a factor from 1 to {LARGEST:g}, such as {word}=2"
        raise InputError("--check", Complaint(word, repr(text), accepted)) from None


def _expected(text: str) -> Expected:
    name, _, value = (part.strip() for part in text.partition("="))
    value, at, tolerance = (part.strip() for part in value.partition("@"))
    node = name.lower().removeprefix("v(").removesuffix(")")
    try:
        volts = parse(value, "V")
        if not at or tolerance.endswith("%"):
            share = share_of(tolerance, "--expect") if at else SHARE
            accepted = share * abs(volts)
        else:
            accepted = parse(tolerance, "V")
        if not 0.0 <= accepted < math.inf:
            raise ValueError("a tolerance is finite and not negative")
        return Expected(node, volts, accepted)
    except ValueError as error:
        usual = f"{error}; expected v(NODE)=VALUE@TOLERANCE, such as v(out)=1.25@0.1%"
        raise InputError("--expect", Complaint("value", repr(text), usual)) from None


def reference_values(
    nodes: Sequence[str],
    matrix: str | Path,
    strain: str | Path,
    lam: float = 0.0,
    unit: str = "1V",
    accept: str = "0.1%",
) -> tuple[tuple[Expected, ...], tuple[str, ...]]:
    """Return the expected voltages of nodes, one of every channel, and what is to be said.

    A deck that recovers u from ``eps = T u + noise`` should show the regularised optimum.

    Parameters
    ----------
    matrix, strain : path
        T (M, N) and eps (M,): .csv or .npy.
    lam : float
        Weight of ``|u|^2``; 0 for least squares.
    unit : str
        Voltage of ``u = 1``; negative for outputs that are inverted.
    accept : str
        Accepted deviation of an output, as a share of the largest one.

    Raises
    ------
    InputError
        A file or a value cannot be used, the numbers of channels and of nodes differ, or the
        problem has no certain solution.
    """
    from taction.netlist_gen.scene.problem_tables import problem_tables
    from taction.verification.reference.problem import Problem
    from taction.verification.reference.solve import solve

    T, eps = problem_tables(Path(matrix), Path(strain))
    channels = T.values.shape[1]
    if len(nodes) != channels:
        text = (
            f"the matrix has {channels} columns, and {len(nodes)} outputs are looked at"
            f" ({', '.join(nodes[:20])}); give one --output for each column, in their order"
        )
        raise InputError(matrix, Complaint("--matrix", "", text))
    try:
        volts = parse(unit, "V")
    except ValueError as error:
        raise InputError("--unit", Complaint("VOLTS", repr(unit), str(error))) from None
    found = solve(Problem(T.values, eps.values, lam))
    if not found.trusted:
        text = f"the optimum is not certain: {found.reason}; give a larger --lambda"
        raise InputError(matrix, Complaint("--lambda", f"{lam:g}", text))
    wanted = volts * found.u
    largest = float(abs(wanted).max(initial=0.0))
    tolerance = share_of(accept, "--accept") * largest - abs(volts) * found.error_bound
    notes = tuple(f"{each.path.name}: {each.changed}" for each in (T, eps) if each.changed)
    every = zip(nodes, wanted.tolist(), strict=True)
    return tuple(Expected(node, value, tolerance) for node, value in every), notes
