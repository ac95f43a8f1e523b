"""Poles of circuits without design sense: each within its bound, and none missing or invented."""

from __future__ import annotations

import math
import os
from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import output_noise
from taction.verification.engines.statespace.linearised.state_space import finite_poles
from taction.verification.stability.families import Family, find_edges, sensitivities
from taction.verification.stability.poles import Poles, poles
from tests.support.nodal_analysis import Pencil, exact_poles
from tests.support.random_circuits import random_cards

SEEDS = int(os.environ.get("TACTION_RANDOM_CIRCUITS", "60"))
EARLIER = (
    168, 484, 558, 563, 583, 1121, 1358, 1463, 1694, 1783, 2307, 2322, 2455, 2494, 2639, 2853, 2931,
    6236,
)  # fmt: skip
"""Seeds of which a pole was outside its bound, or one too many."""
REFUSED = (
    "closes a loop of ideal voltage sources", "stay undetermined", "cancel to the last digit",
    "form a loop without a solution", "det(s M - K) = 0",
)  # fmt: skip


def circuit(cards: list[str]) -> Circuit:
    return circuit_of(read_cards(cards), "random", ["in"])


def answered(cards: list[str]) -> Poles | None:
    """Return the poles, or None where the circuit is refused with a known reason."""
    try:
        return poles(circuit(cards))
    except EngineError as error:
        assert any(reason in str(error) for reason in REFUSED), str(error)  # noqa: PT017
        return None


def assert_within(found: Poles, true: list[complex]) -> None:
    assert len(found.poles) == len(true)
    left = list(true)
    pairs = zip(found.poles.tolist(), found.errors.tolist(), strict=True)
    for pole, bound in sorted(pairs, key=lambda pair: pair[1]):
        nearest = min(left, key=lambda each: abs(each - pole))
        left.remove(nearest)
        assert abs(nearest - pole) <= bound, f"{pole}, not {nearest} within {bound}"


@pytest.mark.parametrize("first", range(0, SEEDS, 20))
def test_poles_are_within_their_bounds(first: int) -> None:
    """Against the roots of the exact polynomial, with 100 digits."""
    count = 0
    for seed in range(first, min(first + 20, SEEDS)):
        cards = random_cards(seed)
        if (found := answered(cards)) is not None:
            count += 1
            assert_within(found, exact_poles(cards))
    assert count >= 5  # the others are refused: loops of sources, unknowns that nothing determines


@pytest.mark.parametrize("seed", EARLIER)
def test_poles_that_were_wrong_are_right_or_refused(seed: int) -> None:
    """Seed 1694: 1/20 kohm and 50 uS cancel to the last digit; 1358 and 1783 have a pole at 0."""
    cards = random_cards(seed)
    if (found := answered(cards)) is not None:
        assert_within(found, exact_poles(cards))


@pytest.mark.parametrize(
    ("cards", "count"),
    [
        (("r1 a 0 1", "c1 a b 1", "c2 b d 2", "c3 d a 3", "r2 d 0 1"), 2),  # they close a loop
        (("c1 a 0 0.1", "c2 a 0 0.2", "r1 a 0 1"), 1),
        (("c1 a b 1", "r1 a 0 1", "r2 b 0 1"), 1),  # it floats
        (("l1 a 0 1", "l2 a 0 2", "r1 a 0 1"), 2),  # a current that circles: a pole at 0
        (("c1 a 0 1", "r1 a 0 1", "g1 a 0 a 0 -1.0"), 1),  # an integrator
        (("c1 a 0 1", "f1 a 0 v1 -1.0", "c2 b d 1", "v1 d 0 0.0", "r1 a b 1"), 2),
        (("r1 a 0 1", "r2 a b 2", "r3 b 0 1"), 0),
    ],
)
def test_the_degree_is_counted_exactly(cards: tuple[str, ...], count: int) -> None:
    """Degrees by hand; the exact polynomial has them, too."""
    descriptor = LinearBoard(circuit(["i9 0 a 0.0", *cards])).descriptor
    assert finite_poles(descriptor, descriptor.dense.stiffness[:0, 0]) == count
    assert Pencil(cards).polynomial.degree() == count


def test_a_capacitance_that_nothing_determines_is_refused() -> None:
    descriptor = LinearBoard(circuit(["i9 0 a 0.0", "c1 b d 1", "r1 a 0 1"])).descriptor
    with pytest.raises(EngineError, match=r"det\(s M - K\) = 0"):
        finite_poles(descriptor, descriptor.dense.stiffness[:0, 0])


@pytest.mark.parametrize("ohms", [1e4, 26293.9, 8555.6, 12281.2, 86905.6, 63892.1, 37008.8])
def test_parts_that_cancel_to_the_last_digit_are_refused(ohms: float) -> None:
    """A load and a source of the opposite conductance: whether node a has one is rounding.

    A sum of the rounded values in more digits is another number, which is no pole either.
    """
    cards = ["v1 in 0 1.0", f"r1 a 0 {3.0 * ohms!r}", f"r2 a 0 {1.5 * ohms!r}",
             f"g1 a 0 a 0 {-1.0 / ohms!r}", "r3 in b 1k", "c1 b a 1n", "g2 b 0 a 0 1m"]  # fmt: skip
    with pytest.raises(EngineError):
        poles(circuit(cards))


FLOATING = [
    "v1 in 0 1", "r1 in a 1e3", "c1 a 0 1e-9", "e1 b a a 0 1.0", "r2 b m 1e3", "c2 m 0 1e-9",
    "r3 b 0 1e3", "r4 m 0 1e4", "g1 0 a m 0 3e-3",
]  # fmt: skip


@pytest.mark.parametrize("name", ["R2", "R3", "R1", "C1"])
def test_edges_of_an_active_circuit_are_those_of_its_poles(name: str) -> None:
    """A real pole crosses at 0 with more of a conductance than the circuit has: R3 = 22/47 kohm.

    At rest v_a (1/R1 + 2/R3) + (2 v_a - v_m)/R2 = g v_m and (v_m - 2 v_a)/R2 + v_m/R4 = 0.
    """
    board = LinearBoard(circuit(FLOATING))
    knob, own = board.circuit.knob(name), board.circuit.value(name)
    family = Family.of(board, knob)
    found = [edge.value for edge in find_edges(family, own / 100.0, own * 100.0).edges]
    scanned = Family(family.board, own).scan(np.geomspace(own / 100.0, own * 100.0, 41).tolist())
    assert found == pytest.approx([edge.value for edge in scanned.edges], rel=1e-6)
    if name == "R3":
        assert found == pytest.approx([22e3 / 47.0], rel=1e-9)


def test_sensitivities_by_ports_are_those_by_differences() -> None:
    board = LinearBoard(circuit(FLOATING))
    families = {knob.name: Family.of(board, knob) for knob in board.circuit.knobs}
    found = poles(board)
    differences = {name: replace(family, ports=None) for name, family in families.items()}
    by_ports, by_differences = (sensitivities(board, found, f) for f in (families, differences))
    assert by_ports == pytest.approx(by_differences, rel=1e-6)


def test_noise_of_a_part_at_a_floating_source_counts() -> None:
    """V2 floats on a node with C: R2 behind it is parallel to R1, and kT/C is left."""
    cards = ["v1 in 0 1", "r1 in a 1e3", "v2 a b 0.0", "r2 b 0 3e3", "c1 a 0 1e-9"]
    rms, _ = output_noise(LinearBoard(circuit_of(read_cards(cards), "kT/C", ["a"])))
    assert rms[0] == pytest.approx(math.sqrt(1.380649e-23 * 300.15 / 1e-9), rel=1e-5)


@pytest.mark.nightly  # 15 s
def test_an_edge_beside_a_pole_that_stays_at_zero_is_in_doubt() -> None:
    """The exact count of unstable poles is 3 on both sides of what the loci take for an edge."""
    cards = random_cards(193)
    board = LinearBoard(circuit(cards))
    family = Family.of(board, board.circuit.knob("R01"))
    own = family.own
    found = find_edges(family, 0.01 * own, 100.0 * own)
    for edge in found.edges:
        counts = set()
        for side in (1.0 - 1e-6, 1.0 + 1e-6):
            text = f"r01 n1 0 {edge.value * side!r}"
            moved = [text if card.startswith("r01 ") else card for card in cards]
            counts.add(sum(pole.real > 0.0 for pole in exact_poles(moved)))
        assert len(counts) == 2 or edge.value in found.near
    # The pole at zero leaves every count open, so the range is in doubt as a whole.
    assert min(found.near) <= found.low
    assert max(found.near) >= found.high


COUPLED = """\
vcc vcc 0 15|vin in 0 1|rs in s 600|c1 s b1 4.7e-6|r1 vcc b1 1e5|r2 b1 0 2.2e4|rc1 vcc c1 6800
re1 e1 0 1500|ce1 e1 0 4.7e-5|c3 c1 b2 4.7e-6|r3 vcc b2 6.8e4|r4 b2 0 1.5e4|rc2 vcc c2 3300
re2 e2 0 820|ce2 e2 0 1e-4|reo eo 0 2200|c4 eo out 1e-4|rl out 0 600|rq1 b1 i1 100|rq2 b2 i2 100
rq3 c2 i3 100|g100 c1 e1 c1 e1 1.53e-5|g101 c1 e1 i1 e1 0.0496|g111 i1 e1 i1 e1 0.000237
cq10 c1 i1 1.67e-12|cq11 c1 e1 2.3e-15|cq12 i1 e1 2.1e-11|g200 c2 e2 c2 e2 2.72e-5
g201 c2 e2 i2 e2 0.0892|g211 i2 e2 i2 e2 0.000421|cq20 c2 i2 1.55e-12|cq21 c2 e2 4e-15
cq22 i2 e2 3.3e-11|g300 vcc eo vcc eo 3.44e-5|g301 vcc eo i3 eo 0.1165|g311 i3 eo i3 eo 0.00053
cq30 vcc i3 1.35e-12|cq31 vcc eo 5.2e-15|cq32 i3 eo 4.1e-11"""


def test_slow_poles_of_an_amplifier_with_coupling_capacitors_are_decided() -> None:
    """Three transistors, linear, and poles from 11 /s to 2e10 /s: each has a bound of its own."""
    cards = [card for line in COUPLED.split("\n") for card in line.split("|")]
    found = answered(cards)
    assert found is not None
    assert_within(found, exact_poles(cards))
    assert found.known_stable
    size = np.abs(found.poles)
    assert size.max() > 1e9 * size.min()
    assert np.all(found.errors < 1e-6 * size)


def test_charges_choose_the_unknowns_where_equations_lose_them() -> None:
    """The input stage of a JFET op-amp, whose common mode reaches its offset at once.

    Of unknowns that equations without charge choose rounding leaves no pole.
    """
    cards = [
        *("r1 0 x3 1e12", "r2 x3 out 1e12", "c4 0 x6 1.99e-13", "e1 x7 0 x16 0 1.0"),
        *("g4 0 x16 x3 0 1e-8", "l2 0 x17 0.531", "r13 x17 x16 1000.0", "r16 0 out 20.0"),
        *("g5 0 x4 out x4 5e-5", "g6 out x4 out x4 1.16e-9", "g7 x6 x4 x7 x4 5e-5"),
    ]
    found = poles(circuit(cards))
    assert_within(found, exact_poles(cards))
    assert np.all(found.errors <= 0.5 * np.abs(found.poles))
