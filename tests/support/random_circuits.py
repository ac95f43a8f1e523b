"""Random linear circuits without design sense, as flat cards: all kinds of cards, few nodes.

Values span six decades; half of them are round, so that parts cancel exactly.
"""

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
