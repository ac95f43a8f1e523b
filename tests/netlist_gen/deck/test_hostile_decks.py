"""Decks that would hang, grow without limit or end in a traceback: refused at once, with why."""

from __future__ import annotations

import time
from itertools import combinations
from pathlib import Path

import pytest

from taction.netlist_gen.deck.foreign_lines import (
    LONGEST,
    Card,
    logical_lines,
)
from taction.system.errors import InputError
from tests.support.paths import ROOT
from tests.support.running import taction

CASES = ROOT / "tests" / "data" / "cases"
RC = "V1 in 0 AC 1\nR1 in out 1k\nC1 out 0 1n\n"
SECONDS = 15.0  # of this process: a bound for a slow machine, where a fault takes 40 s and more


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
    assert logical_lines(card).cards == [Card(1, card)]
    with pytest.raises(InputError, match=r"line 1: 20,001 characters"):
        logical_lines(f"{card}1")
