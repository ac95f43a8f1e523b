"""Nothing but names and finite numbers gets into a deck; hostile decks are refused, with why."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit, Omission
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.deck.flat_cards import circuit_of, read_cards
from taction.netlist_gen.deck.foreign_cards import Card
from taction.netlist_gen.deck.foreign_deck import LONGEST, logical_lines
from taction.system.errors import InputError
from taction.verification.studies.decks.board_sweep import read_tolerances
from tests.support.making import make_scene, matrix_problem
from tests.support.paths import ROOT
from tests.support.running import taction

EVIL = "x\n.control\nshell true\n.endc\n*"
TRANSIENT = Transient(1e-3, 1e-6)
CASES = ROOT / "tests" / "data" / "cases"
RC = "V1 in 0 AC 1\nR1 in out 1k\nC1 out 0 1n\n"
SECONDS = 15.0  # of this process: a bound for a slow machine, where a fault takes 40 s and more


def small(**design: Any) -> Circuit:
    design = {"amplifier": "exponential", "stray_capacitance": "1pF", **design}
    return synthesise(make_scene(design=design), matrix_problem([[1.0, -1.0]], [1.0]))


def changed(circuit: Circuit, kind: str, **fields: Any) -> Circuit:
    first, *rest = getattr(circuit, kind)
    return replace(circuit, **{kind: (replace(first, **fields), *rest)})


def test_the_board_itself_passes() -> None:
    assert write_deck(small(), TRANSIENT).text.startswith(".title taction board\n")


@pytest.mark.parametrize("text", [EVIL, "a b", "1x", "", "a;b", "a$b", "a=1", "µ", "x\n"])
@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("opamps", "name"),
        ("opamps", "model"),
        ("opamps", "inverting"),
        ("resistors", "name"),
        ("resistors", "a"),
        ("capacitors", "b"),
        ("currents", "node"),
        ("voltages", "name"),
        ("amplifiers", "name"),
        ("amplifiers", "output"),
    ],
)
def test_a_name_that_is_no_name_is_refused(kind: str, field: str, text: str) -> None:
    with pytest.raises(ValueError, match="is not a valid name in a deck"):
        write_deck(changed(small(), kind, **{field: text}), TRANSIENT)


@pytest.mark.parametrize("kind", ["resistors", "capacitors", "opamps", "currents"])
def test_two_parts_of_one_name_are_refused(kind: str) -> None:
    parts = getattr(small(), kind)
    with pytest.raises(ValueError, match=f"two {kind} have the name {parts[0].name!r}"):
        write_deck(replace(small(), **{kind: (*parts, parts[0])}), TRANSIENT)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, -1.0])
@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("resistors", "ohms"),
        ("capacitors", "farads"),
        ("amplifiers", "u_scale"),
        ("amplifiers", "v_scale"),
    ],
)
def test_a_value_that_no_part_has_is_refused(kind: str, field: str, value: float) -> None:
    with pytest.raises(ValueError, match="must be finite and above zero"):
        write_deck(changed(small(), kind, **{field: value}), TRANSIENT)


@pytest.mark.parametrize("value", [float("nan"), 0.0, -1.0])
def test_a_matrix_holds_resistors_only(value: float) -> None:
    circuit = small()
    matrix = replace(circuit.forward, ohms=np.array([[1.0, value]]))
    with pytest.raises(ValueError, match="not above zero"):
        write_deck(replace(circuit, matrices=(matrix, circuit.feedback)), TRANSIENT)


@pytest.mark.parametrize(
    "fields",
    [
        {"name": EVIL},
        {"name": "a b"},
        {"amplifier": EVIL},
        {"topology": EVIL},
        {"omissions": (Omission(EVIL, "why"),)},
        {"omissions": (Omission("what", "why\nR1 a b 1"),)},
    ],
)
def test_the_header_holds_no_line_of_its_own(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"not a valid name|comment line"):
        write_deck(replace(small(), **fields), TRANSIENT)


@pytest.mark.parametrize(
    "changes",
    [
        {"analysis": Transient(float("nan"), 1e-6)},
        {"analysis": Transient(1e-3, float("inf"))},
        {"analysis": Transient(-1e-3, 1e-6)},
        {"analysis": Transient(1e-3, 1e-6, voltages={EVIL: 1.0})},
        {"analysis": Transient(1e-3, 1e-6, voltages={"v_1": float("nan")})},
        {"saved": [EVIL]},
        {"saved": ["v_1) v(2"]},
        {"solver": EVIL},
    ],
)
def test_what_a_deck_asks_for_is_checked_too(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"not a valid name|finite"):
        write_deck(small(), **{"analysis": TRANSIENT, **changes})


CARDS = (
    "v1 in 0 1", "r1 in a 1k", "rf a out 1k", "c1 out 0 1n", "l1 out 0 1u", "l2 a 0 1u",
    "k1 l1 l2 0.5", "e1 b 0 a 0 2", "r.x1.rin a 0 1meg", "c.x1.c1 a 0 1p", "c.x2.c1 out 0 1p",
)  # fmt: skip


@pytest.fixture(scope="module")
def circuit() -> Circuit:
    return circuit_of(read_cards(CARDS), "deck", ["out"])


def tolerances(text: str, circuit: Circuit, folder: Path) -> dict[str, float]:
    place = folder / "parts.toml"
    place.write_text(text)
    return read_tolerances(place, circuit).parts


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('resistor = "1%"', {"R1": 0.01, "Rf": 0.01}),
        ("[tolerances]\ncapacitor = 0.05", {"C1": 0.05}),
        ('coil = "2 %"\ngain = 0.1', {"L1": 0.02, "L2": 0.02, "E1": 0.1}),
        ('coupling = "1%"', {"K1": 0.01}),
        ('[parts]\n"x*.c1" = "30%"', {"x1.C1": 0.3, "x2.C1": 0.3}),
        ('resistor = "1%"\n[parts]\nRF = 0', {"R1": 0.01}),
        ('[parts]\n"x1.*" = 0.2\n"x1.Rin" = 0.5', {"x1.Rin": 0.5, "x1.C1": 0.2}),
    ],
)
def test_tolerances(text: str, parts: dict[str, float], circuit: Circuit, tmp_path: Path) -> None:
    """A kind counts outside of subcircuits; a later name overrides an earlier one."""
    assert tolerances(text, circuit, tmp_path) == parts


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("resistors = 0.01", ("resistors", "'resistor'")),
        ('resistor = "1k"', ("resistor", "'1k'", '"5%"')),
        ("resistor = true", ("resistor", "True")),
        ("resistor = -0.1", ("resistor", "-0.1")),
        ("resistor = nan", ("resistor", "nan")),
        ("resistor = 1e300", ("resistor", "1e+300")),
        ("parts = 3", ("parts", "table")),
        ("[parts]\nR9 = 0.1", ("parts.R9", "the nearest is")),
        ("[parts]\nK9 = 0.1", ("parts.K9", "no part")),
        ("coupling = 1", ("K1", "reaches 1")),
        ('distribution = "flat"', ("distribution", "'normal' or 'uniform'")),
        ("", ("nothing varies", "[parts]")),
        ("resistor 1", ("line 1",)),
        ("tolerances = 3", ("tolerances", "TOML")),
    ],
)
def test_mistakes_name_key_value_and_what_is_accepted(
    text: str, words: tuple[str, ...], circuit: Circuit, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as error:
        tolerances(text, circuit, tmp_path)
    for word in ("parts.toml", *words):
        assert word in str(error.value)


def refused(file: Path, *, status: int = 2) -> str:
    """What ``taction check`` says of a deck that it refuses at once."""
    before = time.process_time()
    result = taction("check", str(file), "--no-ngspice")
    assert time.process_time() - before < SECONDS
    assert result.exit_code == status, result.output
    assert "Traceback" not in result.output
    assert file.name in result.stderr
    return " ".join(result.stderr.split())


def coupled(count: int) -> str:
    """Coils that are all coupled."""
    coils = "".join(f"L{k} out {k} 1m\nR1{k} {k} 0 1k\n" for k in range(count))
    pairs = enumerate(combinations(range(count), 2))
    return coils + "".join(f"K{n} L{i} L{j} 0.01\n" for n, (i, j) in pairs)


LINES = {
    "blanks": (
        f"R2 out 0 1k{' ' * 100_000}x\n",
        "line 5: ",
        "100,012 characters in a line; at most 20,000 are read",
    ),
    "include": (
        f".include {'a' * 50_000} b c\n",
        "line 5: ",
        "50,013 characters in a line; at most 20,000 are read",
    ),
    "shorter blanks": (f"R2 out 0 1k{' ' * 19_000}x\n", "r2 out 0 1k x", "unknown parameter (x)"),
    "shorter include": (f".include {'a' * 19_000} b c\n", "line 5", "not accepted"),
    "blank include": (f".include {' ' * 19_000};\n", "line 5", "no file ';'"),
    "continuations": (
        "R2 out 0 1k\n" + "+ 1\n" * 20_000,
        "line 5",
        "characters in a line with its continuations; at most 20,000 are read",
    ),
    "comments": ("*\n" * 150_000, "line 100001", "150,006 lines; at most 100,000 are read"),
    "resistors": (
        "".join(f"R{k} out 0 1k\n" for k in range(2, 19_000)),
        "the deck has 19000 parts; up to 3000 are read",
    ),
    "cards": (
        "".join(f"R{k} out 0 1k\n" for k in range(2, 30_000)),
        "line 20002 = 'r19999 out 0 1k'",
        "20,001 cards; at most 20,000 are read",
    ),
    "nested": (
        ".subckt s a\n" * 40 + "R2 a 0 1k\n" + ".ends\n" * 40,
        "line 35 = '.subckt s a': 31 levels of subcircuits within one another; at most 30 are read",
    ),
    "transistors": (
        ".model n npn(rb=10 re=1)\n" + "".join(f"Q{k} out {k} 0 n\n" for k in range(1, 300)),
        "the deck has 899 nodes; up to 600 are read",
    ),
    "coils": (coupled(80), "the deck has 3322 parts; up to 3000 are read"),
    "one coupling": (f"K9 {'a b ' * 4900}1\n", "line 5 = 'k9", "more than 200 couplings"),
    "functions": (
        ".func f0() = {1}\n"
        + "".join(f".func f{k}() = {{f{k - 1}()+f{k - 1}()}}\n" for k in range(1, 40))
        + "R2 out 0 {f39()}\n",
        "levels of functions within one another; at most 30 are read",
    ),
    "doubled functions": (
        ".func f0() = {1}\n"
        + "".join(f".func f{k}() = {{f{k - 1}()+f{k - 1}()}}\n" for k in range(1, 20))
        + "R2 out 0 {f19()}\n",
        "line 19 = '{f13()+f13()}'",
        "cards with every function expanded; at most 20,000 are read",
    ),
    "a function of itself": (
        ".func f(x) {g(x)}\n.func g(x) {f(x)}\nR2 out 0 {f(1)}\n",
        "line ",
        "a function that calls itself",
    ),
    "terms": (f"B1 x 0 v={'+'.join(['v(out)'] * 2500)}\n", "B1", "too many terms"),
    "degree": (
        f"E1 x 0 poly(1) out 0 0 {'1 ' * 9000}\n",
        "line 5 = 'e1 x 0 poly(1)",
        "at most 20,000 are read",
    ),
    "second degree": (
        f"E1 x 0 poly(2000) {'out 0 ' * 2000}{'1 ' * 2500}\n",
        "line 5 = 'e1 x 0 poly(2000)",
        "at most 20,000 are read",
    ),
    "digits": (f"R2 out 0 {'1' * 19_000}!\n", "R2: '1111", "deck.cir: deck"),
}


@pytest.mark.parametrize("name", LINES)
def test_a_hostile_line_is_refused_at_once(name: str, tmp_path: Path, ngspice: str) -> None:
    text, *said = LINES[name]
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}{text}.end\n")
    message = refused(place)
    assert [each for each in said if each not in message] == [], message


FILES = {
    "laugh9x10.cir": "cards with every subcircuit expanded; at most 20,000 are read",
    "nest500.cir": "31 levels of subcircuits within one another; at most 30 are read",
    "xeq-IndexError.cir": "line 5 = 'x=1': the deck has no subcircuit",
    "polybig.cir": "line 5 = 'e1 a 0 poly(999",
    "pins.cir": "line 5 = 'e_taction_pins_0 z 0 in out 1': names that begin with e_taction_",
    "dot-name.cir": "R.1: expected two nodes and one number",
}


@pytest.mark.parametrize("name", FILES)
def test_a_deck_that_ended_in_a_traceback_or_never(name: str, ngspice: str) -> None:
    assert FILES[name] in refused(CASES / name)


def test_a_dot_in_a_name_is_a_name(tmp_path: Path, ngspice: str) -> None:
    """Poles of R1 parallel to R.1 with C1: -1/(500 * 1n)."""
    place = tmp_path / "deck.cir"
    place.write_text(f"t\n{RC}R.1 out 0 1k\n.end\n")
    result = taction("check", str(place), "--no-ngspice")
    assert result.exit_code == 0, result.output
    assert "-2 M/s" in result.stdout
    assert "R.1" in result.stdout


def test_files_that_are_included_are_counted(tmp_path: Path) -> None:
    """Nine levels, each 100 times the next one, all without a card: 10^18 files."""
    for k in range(1, 9):
        (tmp_path / f"i{k}.inc").write_text(f".include i{k + 1}.inc\n" * 100)
    (tmp_path / "i9.inc").write_text("* nothing\n")
    deck = tmp_path / "deck.cir"
    deck.write_text(f"t\n{RC}X1 out s\n.subckt s a\nR1 a 0 1k\n.include i1.inc\n.ends\n.end\n")
    result = taction("check", str(deck))
    assert result.exit_code == 2
    assert "i8.inc: line " in result.stderr
    assert "501 files that are included; at most 500 are read" in " ".join(result.stderr.split())


def test_bytes_of_all_files_are_counted(tmp_path: Path) -> None:
    (tmp_path / "a.inc").write_text(f"* {'a' * 18_000}\n" * 300)
    deck = tmp_path / "deck.cir"
    include = ".subckt s{k} a\n.include a.inc\nR1 a 0 1\n.ends\n"
    deck.write_text(f"t\n{RC}" + "".join(include.format(k=k) for k in range(3)) + ".end\n")
    message = refused(deck)
    assert "bytes of the deck with its files; at most 8,000,000 are read" in message
    assert "line 10" in message


IMPORTED = {
    "blanks": (f"R2 p 0 1k{' ' * 100_000}x\n", "line 2: 100,010 characters in a line"),
    "braces": (f"C9 p 0 {'{' * 19_000}\n", "ngspice does not expand"),
    "levels": (
        "X1 p s0\n.ends\n"
        + "".join(f".subckt s{k} a\nX1 a s{k + 1}\nX2 a s{k + 1}\n.ends\n" for k in range(20))
        + ".subckt s20 a\nR1 a 0 1k\n",
        "cards with every subcircuit expanded",
    ),
}


@pytest.mark.parametrize("name", IMPORTED)
def test_a_hostile_netlist_of_a_vendor_is_refused_at_once(name: str, tmp_path: Path) -> None:
    body, said = IMPORTED[name]
    place = tmp_path / "amp.lib"
    place.write_text(f".subckt amp p n v+ v- out\n{body}.ends\n")
    pins = ("--subckt", "amp", "--pins", "inp,inn,vcc,vee,out")
    before = time.process_time()
    result = taction("parts", "import", str(place), *pins)
    assert time.process_time() - before < SECONDS
    assert result.exit_code == 2, result.output
    assert said in " ".join(result.stderr.split())


def test_a_section_that_calls_a_section_of_its_file(ngspice: str) -> None:
    """An inverting amplifier of gain 1e5, R and C from two sections: (1 + 1.1e-4) / (10k * 1n)."""
    result = taction("check", str(CASES / "refused-lib-section.cir"), "--no-ngspice")
    assert result.exit_code == 0, result.output
    assert "-100.01 k/s" in result.stdout


def test_lengths_at_the_limit_are_read() -> None:
    card = f"r1 a b {'1' * (LONGEST - 7)}"
    assert logical_lines(card)[0] == [Card(1, card)]
    with pytest.raises(InputError, match=r"line 1: 20,001 characters"):
        logical_lines(f"{card}1")
