"""A deck as parts, and its equations, from its text alone."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass

from flint import arb, arb_mat

GROUND = "0"
TERMINALS = {"R": 2, "C": 2, "I": 2, "V": 2, "B": 2, "G": 4, "E": 4}
IGNORED = (".title", "*", ".options", ".save", ".tran", ".op", ".end", ".ic")
READ = re.compile(r"V\((\w+)\)")
OUTPUT = re.compile(r"u_(\d+) = (-?)v\((\w+)\)")
Row = dict[Hashable, arb]  # coefficients: of a free node by its name, of a signal by `Signal`
DRIVERS = ("E", "V", "B")
INPUT = re.compile(r"V\(([\w.]+)\)")


@dataclass(frozen=True)
class Part:
    """One element: its kind is the first letter of its card; a B card has a text as value."""

    kind: str
    nodes: tuple[str, ...]
    value: float | str


@dataclass(frozen=True)
class DeckText:
    """A flat deck; `outputs` are pairs of a node and the sign of u at this node."""

    parts: tuple[Part, ...]
    outputs: tuple[tuple[str, int], ...]

    def of(self, *kinds: str) -> list[Part]:
        return [part for part in self.parts if part.kind in kinds]


def parse_deck(text: str) -> DeckText:
    """Expand the subcircuits of a deck; strain currents are taken at their final values."""
    cells: dict[str, tuple[list[str], list[str]]] = {}
    board: list[str] = []
    inside: list[str] | None = None
    saved: list[str] = []
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == ".subckt":
            inside = []
            cells[words[1]] = (words[2:], inside)
        elif words[0] == ".ends":
            inside = None
        elif words[0] == ".save":
            saved = [word[2:-1] for word in words[1:]]
        elif not line.startswith(IGNORED):
            (board if inside is None else inside).append(line)
    parts: list[Part] = []
    for line in board:
        words = line.split()
        if words[0].startswith("X"):
            ports, body = cells[words[-1]]
            names = dict(zip(ports, words[1:-1], strict=True))
            parts += [_part(card, names, f"{words[0]}.") for card in body]
        else:
            parts.append(_part(line, {}, ""))
    return DeckText(tuple(parts), _outputs(text, saved))


def _part(card: str, names: dict[str, str], prefix: str) -> Part:
    words = card.split()
    kind = words[0][0]
    count = TERMINALS[kind]

    def outside(node: str) -> str:
        return node if node == GROUND else names.get(node, prefix + node)

    nodes = tuple(outside(node) for node in words[1 : count + 1])
    if kind == "B":
        expression = re.split("[vV]=", card, maxsplit=1)[1]
        return Part(kind, nodes, READ.sub(lambda read: f"V({outside(read[1])})", expression))
    value = card.split(None, count + 1)[count + 1]
    if value.startswith("PWL("):
        value = value.rstrip(")").split()[-1]
    return Part("J" if kind == "I" and prefix else kind, nodes, float(value))


def _outputs(text: str, saved: list[str]) -> tuple[tuple[str, int], ...]:
    """Return the saved nodes with their signs; the header shows the sign of the first output."""
    shown = OUTPUT.search(text)
    assert shown is not None
    assert shown[3] == saved[0]
    sign = -1 if shown[2] else 1
    return tuple((node, sign) for node in saved)


@dataclass(frozen=True)
class Signal:
    """The signal s with this number: 0 constant, 1 strain, from 2 the behavioural sources."""

    number: int


@dataclass(frozen=True)
class StateEquations:
    """The equations of one part of a board; `outputs` are the numbers of its outputs."""

    A: arb_mat  # (n, n)
    B: arb_mat  # (n, 2 + m)
    C: arb_mat  # (k + m, n)
    D: arb_mat  # (k + m, 2 + m)
    outputs: tuple[int, ...]
    sources: tuple[Part, ...]


def state_equations(deck: DeckText) -> list[StateEquations]:
    """Return the equations of every part of the board; precision is that of Arb's context."""
    sources = {part.nodes[0]: part for part in deck.of("B")}
    voltages = _voltages(deck, {node: Signal(2 + i) for i, node in enumerate(sources)})
    free = [node for node, row in voltages.items() if set(row) == {node}]
    balance: dict[str, Row] = {node: defaultdict(arb) for node in free}
    charge: dict[str, Row] = {node: defaultdict(arb) for node in free}
    # What flows into a floating source flows out at its other end.
    floating = {p.nodes[0]: p.nodes[1] for p in deck.of(*DRIVERS) if p.nodes[1] != GROUND}
    for part in deck.of("R", "C", "G", "I", "J"):
        ends = tuple(floating.get(node, node) for node in part.nodes[:2])
        assert not floating.keys() & set(ends), "floating sources in series"
        _add_currents(part, ends, voltages, balance, charge)
    links = [set(row) | {node} for rows in (balance, charge) for node, row in rows.items()]
    links += [set(voltages[_input(p)]) | set(voltages[node]) for node, p in sources.items()]
    found = []
    for keys in _connected(links):
        nodes = [node for node in free if node in keys]
        own = [part for node, part in sources.items() if keys & set(voltages[node])]
        outputs = {
            k: {key: sign * value for key, value in voltages[node].items()}
            for k, (node, sign) in enumerate(deck.outputs)
            if keys & set(voltages[node])
        }
        rows = [(charge[node], balance[node]) for node in nodes]
        read = [*outputs.values(), *(voltages[_input(part)] for part in own)]
        signals = [Signal(0), Signal(1), *(key for p in own for key in voltages[p.nodes[0]])]
        matrices = _reduce(_Split(nodes, signals), rows, read)
        found.append(StateEquations(*matrices, tuple(outputs), tuple(own)))
    return found


def _voltages(deck: DeckText, sources: dict[str, Signal]) -> dict[str, Row]:
    """Return every node's voltage in terms of free nodes and signals."""
    drivers = {part.nodes[0]: part for part in deck.of(*DRIVERS)}
    assert len(drivers) == len(deck.of(*DRIVERS)), "two sources drive one node"
    known: dict[str, Row] = {GROUND: {}}

    def voltage(node: str) -> Row:
        if node not in known:
            part = drivers.get(node)
            if part is None:
                known[node] = {node: arb(1)}
            elif part.kind == "E":
                known[node] = _controlled(part, voltage)
            elif part.kind == "V":
                known[node] = _sum(voltage(part.nodes[1]), {Signal(0): arb(part.value)})
            else:
                known[node] = _sum(voltage(part.nodes[1]), {sources[node]: arb(1)})
        return known[node]

    for part in deck.parts:
        for node in part.nodes:
            voltage(node)
    return known


def _sum(one: Row, other: Row) -> Row:
    keys = {**one, **other}
    return {key: one.get(key, arb(0)) + other.get(key, arb(0)) for key in keys}


def _controlled(part: Part, voltage: Callable[[str], Row]) -> Row:
    """Return the voltage of a controlled source, which may control itself."""
    node, base, *controls = part.nodes
    gain, own, row = arb(part.value), arb(0), defaultdict[Hashable, arb](arb, voltage(base))
    for control, sign in zip(controls, (1, -1), strict=True):
        if control == node:
            own += sign * gain
        else:
            for key, value in voltage(control).items():
                row[key] += sign * gain * value
    return {key: value / (1 - own) for key, value in row.items()}


def _add_currents(
    part: Part,
    nodes: tuple[str, ...],
    voltages: dict[str, Row],
    balance: dict[str, Row],
    charge: dict[str, Row],
) -> None:
    """Add the currents, or charges, of an element to the free nodes out of which they flow."""
    ends = tuple(zip(nodes, (1, -1), strict=True))
    rows = charge if part.kind == "C" else balance
    value = 1 / arb(part.value) if part.kind == "R" else arb(part.value)
    controls = tuple(zip(part.nodes[2:] or part.nodes, (1, -1), strict=True))
    for node, sign in ends:
        if node not in rows:
            continue
        if part.kind in ("I", "J"):
            rows[node][Signal(1 if part.kind == "I" else 0)] += sign * value
            continue
        for control, side in controls:
            for key, share in voltages[control].items():
                rows[node][key] += sign * side * value * share


def _connected(links: list[set[Hashable]]) -> Iterator[set[Hashable]]:
    """Yield the keys of every connected part; constants and strain connect nothing."""
    parent: dict[Hashable, Hashable] = {}

    def root(key: Hashable) -> Hashable:
        while parent.setdefault(key, key) != key:
            parent[key] = key = parent[parent[key]]
        return key

    for link in links:
        first, *others = sorted(link - {Signal(0), Signal(1)}, key=str)
        for key in (first, *others):
            parent[root(key)] = root(first)
    groups = defaultdict[Hashable, set[Hashable]](set)
    for key in parent:
        groups[root(key)].add(key)
    yield from groups.values()


def _input(source: Part) -> str:
    """Return the one node that a behavioural source reads."""
    (name,) = set(INPUT.findall(str(source.value)))
    return str(name)


class _Split:
    """Rows as matrices: coefficients of the nodes y and of the signals s."""

    def __init__(self, nodes: list[str], signals: list[Hashable]) -> None:
        self.places = {key: i for i, key in enumerate([*nodes, *signals])}
        self.size, self.signals = len(nodes), len(signals)

    def __call__(self, rows: list[Row]) -> tuple[arb_mat, arb_mat]:
        found = arb_mat(len(rows), self.size), arb_mat(len(rows), self.signals)
        for i, row in enumerate(rows):
            for key, value in row.items():
                place = self.places[key]
                found[place >= self.size][i, place - self.size * (place >= self.size)] = value
        return found


def _reduce(
    split: _Split, rows: list[tuple[Row, Row]], read: list[Row]
) -> tuple[arb_mat, arb_mat, arb_mat, arb_mat]:
    """Return A, B, C, D of ``charge' + balance = 0`` of every node."""
    dynamic, static = _dynamic_and_static(rows)
    n, size, signals = len(dynamic), split.size, split.signals
    q, q_s = split([charge for charge, _ in dynamic])
    law, law_s = split([balance for _, balance in static])
    assert all(q_s[i, j] == 0 for i in range(n) for j in range(2, signals)), "a voltage jumps"
    # q y + q_s s = z and law y + law_s s = 0
    left = _stack(q, law)
    right = arb_mat(size, n + signals)
    for i in range(size):
        if i < n:
            right[i, i] = arb(1)
        for j in range(signals):
            right[i, n + j] = -(q_s[i, j] if i < n else law_s[i - n, j])
    y = left.solve(right)
    flow, flow_s = split([balance for _, balance in dynamic])
    out, out_s = split(read)
    M, Y = flow * y, out * y
    A, B = _columns(-M, 0, n), _columns(-M, n, n + signals) - flow_s
    return A, B, _columns(Y, 0, n), _columns(Y, n, n + signals) + out_s


def _dynamic_and_static(
    rows: list[tuple[Row, Row]],
) -> tuple[list[tuple[Row, Row]], list[tuple[Row, Row]]]:
    """Eliminate charges from rows until the charges of the rows with charge are independent."""
    left = [(dict(q), dict(r)) for q, r in rows]
    dynamic, static = [], []
    while left:
        left.sort(key=lambda row: sum(isinstance(key, str) for key in row[0]))
        charge, balance = left.pop(0)
        nodes = [key for key in charge if isinstance(key, str)]
        if not nodes:
            static.append((charge, balance))
            continue
        dynamic.append((charge, balance))
        pivot = max(nodes, key=lambda key: float(abs(charge[key])))
        for other, currents in left:
            if pivot in other:
                share = other[pivot] / charge[pivot]
                for target, source in ((other, charge), (currents, balance)):
                    for key, value in source.items():
                        target[key] = target.get(key, arb(0)) - share * value
                        if target[key].contains(0):
                            del target[key]
                other.pop(pivot, None)
    return dynamic, static


def _stack(upper: arb_mat, lower: arb_mat) -> arb_mat:
    return arb_mat(upper.tolist() + lower.tolist())


def _columns(matrix: arb_mat, begin: int, end: int) -> arb_mat:
    rows = [row[begin:end] for row in matrix.tolist()]
    return arb_mat(matrix.nrows(), end - begin, [value for row in rows for value in row])
