"""Random loops of one or two op-amps whose parts span 30 decades, as flat cards."""

from __future__ import annotations

import random


def wide_cards(seed: int) -> list[str]:
    """Return the cards of a deck; its poles are up to 1e23 /s."""
    draw = random.Random(seed)  # noqa: S311 - no secret
    cards, nodes = ["v1 in 0 1.0"], ["a", "b", "m", "out"]

    def ten(low: float, high: float) -> str:
        return repr(10.0 ** draw.uniform(low, high))

    def ohms() -> str:
        return ten(1, 8) if draw.random() < 0.8 else ten(-2, 10)

    def farads() -> str:
        return ten(-13, -6) if draw.random() < 0.8 else ten(-17, -4)

    gain = 10.0 ** draw.uniform(3, 8)
    if draw.random() < 0.4:
        cards.append(f"e1 b1 0 0 m {gain!r}")
    else:
        load = 10.0 ** draw.uniform(5, 8.5)
        cards += [f"g1 0 x1 0 m {gain / load!r}", f"rx1 x1 0 {load!r}", f"cx1 x1 0 {ten(-13, -9)}"]
        cards.append("e1 b1 0 x1 0 1.0")
    cards.append(f"ro1 b1 out {ten(0, 2.5)}")
    buffer = draw.choice((1, -1)) * 10.0 ** draw.uniform(-1, 1.5)
    cards += [f"e5 q 0 out 0 {buffer!r}", f"c9 q a {farads()}", f"r1 in a {ohms()}"]
    cards += [f"r2 a b {ohms()}", f"r3 b m {ohms()}", f"r4 out m {ohms()}", f"c2 b 0 {farads()}"]
    cards += [f"c7 out m {farads()}"] * (draw.random() < 0.7)
    cards += [f"c8 b out {farads()}"] * (draw.random() < 0.7)
    for k in range(draw.randint(0, 2)):
        one, other = draw.sample([*nodes, "q", "0"], 2)
        cards += [f"l{k}1 {one} w{k} {ten(-9, -1)}", f"r{k}1 w{k} {other} {ten(-1, 4)}"]
    return cards
