"""The oracle's readings in the form that the catalogue of stress cases stores."""

from __future__ import annotations

import hashlib
from dataclasses import asdict

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from taction.system.reading_definitions import READINGS
from taction.verification.evidence.stress.catalogue import Case
from taction.verification.evidence.stress.true_values import TrueValues
from taction.verification.reference.ideal_answer import resolve_lambda
from tests.support.deck_text import parse_deck
from tests.support.true_margin import true_margin
from tests.support.true_readings import board_of, true_readings

LINEAR = "modes of the deck in Arb, 320 bits; suprema and crossings by interval bounds"
NONLINEAR = "equilibrium and poles in Arb; transient by SciPy's Radau and LSODA, which differ by"


def true_values(scene: Scene) -> TrueValues:
    """Return the true readings of the board that `scene` describes."""
    found = true_readings(resolve_lambda(scene))
    channels = [
        {
            name: value
            for name in (*READINGS, "final")
            if (value := asdict(channel)[name]) is not None
        }
        for channel in found.channels
    ]
    asked = scene.checks.stability.margin > 1.0
    linear = board_of(resolve_lambda(scene)).is_linear
    return TrueValues(
        amplitude=found.amplitude,
        rightmost=(found.rightmost.real, found.rightmost.imag),
        steady_state=found.steady_state if found.amplitude else 0.0,
        channels=tuple(channels),
        error=found.error,
        arrives=found.arrives,
        readable=found.readable,
        margin=true_margin(scene) if asked and len(channels) == 1 else None,
        by=LINEAR if linear else f"{NONLINEAR} {found.error:.1g}",
    )


def deck_digest(case: Case) -> str | None:
    """Return a digest of the deck's parts, for which the true values hold; None: no deck.

    The last digits of the values are left out: they differ between processors.
    """
    try:
        text = write_deck(board_of(resolve_lambda(case.scene())), OperatingPoint()).text
    except InputError:
        return None
    deck = parse_deck(text)
    lines = [f"{part.kind} {part.nodes} {_rounded(part.value)}" for part in deck.parts]
    return hashlib.sha256("\n".join([*lines, str(deck.outputs)]).encode()).hexdigest()[:16]


def _rounded(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.11g}"
