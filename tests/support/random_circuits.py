"""Random circuits without design sense, and loops with parts of 30 decades, as flat cards."""

from __future__ import annotations

import random

ROUND = (1.0, 2.0, 5.0, 10.0, -1.0, 0.5)
SCALES = {"r": 1e4, "c": 1e-9, "l": 1e-3, "g": 1e-4, "h": 1e4, "e": 1.0, "f": 1.0}


def random_cards(seed: int) -> list[str]:
    """Return the flat cards of one circuit; many have no solution, or no dynamics."""
    draw = random.Random(seed)  # noqa: S311 - no secret
    count = draw.randint(2, 7)
    nodes = ["0", "in", *(f"n{k}" for k in range(count))]

    def two() -> tuple[str, str]:
        a, b = draw.sample(nodes, 2)
        return a, b

    def value(kind: str) -> str:
        scale = SCALES[kind]
        if draw.random() < 0.5:
            number = scale * draw.choice(ROUND)
        else:
            number = scale * 10.0 ** draw.uniform(-3.0, 3.0) * draw.choice((1, 1, 1, -1))
        return repr(number if kind in "gefh" else abs(number))

    cards = ["v1 in 0 1.0"]
    for k, node in enumerate(nodes[2:]):  # a path to ground for most nodes
        if draw.random() < 0.9:
            cards.append(f"r0{k} {node} {draw.choice(nodes[: k + 2])} {value('r')}")
    kinds = draw.choices("rclgefh", weights=(4, 6, 2, 3, 2, 1, 1), k=draw.randint(3, 12))
    sensors = 0
    for k, kind in enumerate(kinds):
        a, b = two()
        if kind in "eg":
            c, d = two()
            cards.append(f"{kind}{k} {a} {b} {c} {d} {value(kind)}")
        elif kind in "fh":
            c, d = two()
            sensors += 1
            cards.append(f"vs{sensors} {c} {d} 0.0")
            cards.append(f"{kind}{k} {a} {b} vs{sensors} {value(kind)}")
        else:
            cards.append(f"{kind}{k} {a} {b} {value(kind)}")
    return cards


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
