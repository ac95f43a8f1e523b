"""Cards of public decks in other dialects: read as what they stand for, by closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.deck.ltspice import missing_cards, plain_cards
from taction.system.errors import InputError
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.foreign_board import read_board
from tests.support.paths import ROOT

CASES = ROOT / "tests" / "data" / "cases"
RC = "V1 in 0 1\nR1 in out 1k\nC1 out 0 1n\n"


def inverting(gain: float, tau: float, r1: float, r2: float, c: float) -> float:
    """The slowest pole of an inverting amplifier, ``(1 + s tau) (R1 + Zf) + A R1 = 0``."""
    first = np.polymul([tau, 1.0], [r1 * r2 * c, r1 + r2])
    return float(np.roots(np.polyadd(first, [gain * r1 * r2 * c, gain * r1])).real.max())


def transformer() -> float:
    """The slowest pole of an op-amp that drives three coils of 10 mH, all coupled by 1."""
    share = 1.0 / (1 / 10 + 2 / 1000)  # v(fb) = (v(d) / 10 - i) share, 10 mH i' = v(fb)
    tau = 1e3 * 15.9e-6
    back = np.array([share / 10, -share])
    return float(np.linalg.eigvals([(-1e5 * back - [1.0, 0.0]) / tau, back / 10e-3]).real.max())


POLES = {
    "agauss-random.cir": inverting(1e5, 1e3 * 15.9e-6, 10e3, 100e3, 100e-12),
    "kicad-nested-subckt.cir": -1.009e6,  # with the inner subcircuit written outside
    "linearise-model-comma.cir": -13.41e6,  # with blanks for the commas
    "param-override.cir": -62.8 * (1 + 1e5 / 2 * 20e3 / 20.01e3),
    "refused-k-one.net": transformer(),
    "refused-level2.net": -2e7 * np.pi / 11,
    "refused-orcad-tc.cir": -4.543e3,  # without TC=
    "refused-portnum-ac.cir": -1e5 * (1 + 11 / 1e5),
    "refused-rkm-4r7.cir": -(1 + 1e5 * 4.7 / 51.7) / (1e3 * 1.5e-6),
    "refused-tc-pair.cir": -1e5 * (1 + 11 / 1e5),
    "pz2-rl.cir": -1.060594e7,  # -R/L of the last of four stages
    "t-abs.cir": -(1 + 1e5 / 2 * 20e3 / 20.075e3) / (1e8 * 53e-12),
}
WITHIN = {"refused-k-one.net": 1e-4, "refused-level2.net": 1e-4}


@pytest.mark.parametrize("name", POLES)
def test_the_slowest_pole_is_that_of_the_cards(name: str, ngspice: str) -> None:
    board = read_board(CASES / name)
    found = poles(board.circuit).rightmost.real
    assert found == pytest.approx(POLES[name], rel=WITHIN.get(name, 5e-4))


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("agauss-random.cir", "agauss(): a drawn value counts with its nominal one"),
        ("agauss-random.cir", "gauss(): a drawn value counts with its nominal one"),
        ("t-abs.cir", ".model dx: T_ABS does not count"),
        ("refused-portnum-ac.cir", "r2: its AC value ac= does not count"),
    ],
)
def test_what_does_not_count_is_said(name: str, note: str, ngspice: str) -> None:
    assert any(each.startswith(note) for each in read_board(CASES / name).notes)


@pytest.mark.parametrize(
    ("value", "ohms"),
    [
        ("{agauss(2k,100,3)}", 2e3), ("{2*gauss(1k,0.1,3)}", 2e3), ("{aunif(2k,1k)}", 2e3),
        ("{unif(2k, 0.5)}", 2e3), ("{limit(2k,1k)}", 2e3), ("{limit(5k,1k,2k)}", 2e3),
        ("{limit(0,3k,2k)}", 2e3), ("{mc(2k,0.1)}", 2e3), ("4R7", 4.7), ("2k tc=1m,2u", 2e3),
        ("2k TC = 0, 0", 2e3), ("2k tc1=1m tc2=2u", 2e3), ("2k ac=1", 2e3), ("R=2k ac={1+1}", 2e3),
    ],
)  # fmt: skip
def test_the_value_of_a_resistor(value: str, ohms: float, tmp_path: Path, ngspice: str) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}R2 out 0 {value}\n.end\n")
    found = {part.card: part.ohms for part in read_board(place).circuit.resistors}
    assert found["R2"] == pytest.approx(ohms, rel=1e-12)


@pytest.mark.parametrize(
    ("card", "ohms"),
    [
        ("R2 out 0 mod\n.model mod r (r=2k)", 2e3),
        ("R2 out 0 mod l=10u w=1u\n.model mod r (rsh=200)", 2e3),
        ("R2 out 0 mod 1k\n.model mod r (r=2k)", 1e3),
        ("R2 out 0 mod 1k\n.model mod r (tnom=50 tc1=1m)", 977.0),  # at 27 degrees C
        ("R2 out 0 r={2k+0*v(out)*v(out)} tc1=1m", 2e3),
    ],
)
def test_a_resistor_with_its_value_elsewhere_is_measured(
    card: str, ohms: float, tmp_path: Path, ngspice: str
) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}{card}\n.end\n")
    rate = -(1.0 / 1e3 + 1.0 / ohms) / 1e-9
    assert poles(read_board(place).circuit).rightmost.real == pytest.approx(rate, rel=1e-9)


def test_a_function_of_the_deck_counts(tmp_path: Path, ngspice: str) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}.func agauss(x,y,z) {{x+y}}\nR2 out 0 {{agauss(1k,2,3)}}\n.end\n")
    board = read_board(place)
    assert {part.card: part.ohms for part in board.circuit.resistors}["R2"] == 1002.0
    assert not [note for note in board.notes if "drawn" in note]
    assert missing_cards([".param limit=3", "r1 a b {limit}"]) == ([], [])


@pytest.mark.parametrize(
    ("given", "ohms"), [(" z0 75", "75"), ("", "50"), (" z0 75 pwr 1m freq 2.3e9 phase=0", "75")]
)
def test_the_resistance_of_a_port_is_a_part(given: str, ohms: str) -> None:
    *_, part = plain_cards(f"v1 in 0 ac 1 portnum 1{given}")
    assert part == f"rser_v1 in in_taction_v1_1 {ohms}"


def test_calls_with_parameters_have_their_own_models(tmp_path: Path, ngspice: str) -> None:
    """Two op-amps of one subcircuit, with poles of 10 Hz and of 40 Hz."""
    text = (CASES / "param-override.cir").read_text()
    second = "X2 in n vp vn b genop params: GAIN = 100k POLE={2*20}\nR3 n 0 10k\nR4 b n 10k\n.tran"
    place = tmp_path / "deck.cir"
    place.write_text(text.replace(".tran", second))
    found = np.sort(poles(read_board(place).circuit).poles.real)
    slow = POLES["param-override.cir"]
    assert found[-2:] == pytest.approx([4.0 * slow, slow], rel=5e-4)


def test_subcircuits_of_one_name_within_others(tmp_path: Path, ngspice: str) -> None:
    inner = ".subckt part a\nR1 a 0 {r}k\n.ends\n"
    wrapper = ".subckt w{k} a\n{inner}X1 a part\n.ends\n"
    calls = "X1 out w1\nX2 out w2\n"
    place = tmp_path / "deck.cir"
    same, other = inner.format(r=1), inner.format(r=2)
    place.write_text(f"t\n{RC}{wrapper.format(k=1, inner=same)}{wrapper.format(k=2, inner=same)}"
                     f"{calls}.end\n")  # fmt: skip
    assert poles(read_board(place).circuit).rightmost.real == pytest.approx(-3e6, rel=1e-9)
    place.write_text(f"t\n{RC}{wrapper.format(k=1, inner=same)}{wrapper.format(k=2, inner=other)}"
                     f"{calls}.end\n")  # fmt: skip
    with pytest.raises(InputError, match=r"line 12 .*second subcircuit of this name"):
        read_board(place)
