"""Cards of a deck that nothing runs: what answers them, and the first values of ``.step``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from taction.netlist_gen.deck.foreign_deck import ForeignDeck
from taction.netlist_gen.deck.foreign_lines import Card

STEP = re.compile(r"^\.step (?:(?:lin|dec|oct) )?param (?:list )?([a-z_]\w*) (?:list )?(\S+)")
NOTHING = "nothing of check answers it yet"
ANSWERS = {
    ".ac": "poles, stability and the step response are found; gain, bandwidth and phase over"
    " frequency are not answered yet",
    ".noise": "the noise of the outputs is that over all frequencies (--check noise=1mV); spectra"
    " and the noise of an input are not answered yet",
    ".meas": "of the step response --check settling=, rise=, overshoot= and undershoot= answer, and"
    " --expect of a voltage at rest; other measures are not answered yet",
    ".pz": "the poles are found; zeros are not answered yet",
    ".sens": "what each part does to the rightmost pole is found; sensitivities of voltages are not"
    " answered yet",
    ".dc": "voltages are those at rest (--expect), at values of a part or a .param by --over;"
    " transfer curves are not answered yet",
    **dict.fromkeys((".tf", ".disto", ".four", ".sp", ".pss"), NOTHING),
}
SAME = {".measure": ".meas", ".fourier": ".four"}


def unanswered(deck: ForeignDeck) -> Iterator[str]:
    """Yield a sentence for each kind of card that is not answered as it stands."""
    words = dict.fromkeys(SAME.get(card.word, card.word) for card in deck.left)
    yield from (f"{word}: {ANSWERS[word]}" for word in words if word in ANSWERS)


def with_first_steps(deck: ForeignDeck) -> ForeignDeck:
    """Return a deck whose ``.step`` parameters without a ``.param`` have their first value."""
    cards = list[Card]()
    for card in deck.left:
        match = STEP.match(card.text) if card.word == ".step" else None
        if match and match[1] not in (*deck.parameters, *(c.text.split()[1] for c in cards)):
            cards.append(card.with_text(f".param {match[1]} = {match[2]}"))
    return replace(deck, cards=(*deck.cards, *cards)) if cards else deck
