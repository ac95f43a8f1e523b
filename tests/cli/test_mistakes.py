"""Mistakes of a beginner: each message says what is wrong, where, and what to write instead."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from taction.cli.main import FAMILIES, RENAMED, SECTIONS
from tests.support.paths import SCENES
from tests.support.running import taction

BOARD = (SCENES / "paper-breadboard.toml").read_text(encoding="utf-8")
T = """1.20,-0.35,0.10,0.05
0.40,0.90,-0.20,0.15
-0.15,0.55,1.10,-0.30
0.05,-0.25,0.60,0.95
0.30,0.10,-0.40,0.70
"""
EPS = "0.9785\n0.0532\n0.2483\n0.6570\n0.2091\n"
NEVER = (
    "Input should be", "Traceback", "this is a bug", "Expected newline", "Cannot overwrite",
    "Error(", "pydantic", "NoneType",
)  # fmt: skip
BAD_INPUT = 2

# What is replaced in the paper's board, by what; words of the message: what, where, what instead.
# All mistakes in scenes: tests/netlist_gen/scene/test_places.py and test_mistakes.py.
SCENE: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "misspelt key": ('capacitance = "10pF"\nres', 'capacitence = "10pF"\nres',
        ("unknown key", "line 31, column 1", "did you mean 'capacitance'?")),
    "lower-case unit": ('capacitance = "10pF"\nres', 'capacitance = "10pf"\nres',
        ("the unit is 'f'", "line 31", "such as '10pF'")),
    "no quotes": ('capacitance = "10pF"\nres', "capacitance = 10pF\nres",
        ("capacitance", "line 31, column 17", 'need quotes on both sides, as "10pF"')),
    "milliohm": ('gain = "6.252Mohm"', 'gain = "6.252mohm"',
        ("6.252 mohm is what no board has", "line 33", "'M' is mega")),
    "percentage": ("tolerance = 1e-3", "tolerance = 10",
        ("must be below 1", "line 40, column 18", "10 % is 0.1")),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the paper's board, a matrix and a strain, in which commands run."""
    files = {"ok.toml": BOARD, "T.csv": T, "eps.csv": EPS, "there.toml": BOARD}
    rows = [row.split(",") for row in T.split()]
    files |= {
        "semicolon.csv": T.replace(",", ";"),
        "tabs.csv": T.replace(",", "\t").replace(".", ","),
        "ragged.csv": f"{T}1,2\n",
        "text.csv": T.replace("0.90", "many"),
        "three.csv": "1\n2\n3\n",
        "transposed.csv": "\n".join(map(",".join, zip(*rows, strict=True))),
        "header.csv": f"a,b,c,d\n{T}",
        "rc.cir": "rc\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(words: tuple[str, ...], expected: tuple[str, ...]) -> None:
    done = taction(*words)
    assert done.exit_code == BAD_INPUT, done.output
    assert done.stdout == ""
    text = " ".join(done.stderr.split())
    assert not [part for part in expected if part not in text], text
    assert not [part for part in NEVER if part in text]


@pytest.mark.parametrize("name", SCENE)
def test_a_mistake_in_a_scene(folder: Path, name: str) -> None:
    old, new, expected = SCENE[name]
    assert BOARD.count(old) == 1
    (folder / "x.toml").write_text(BOARD.replace(old, new), encoding="utf-8")
    refused(("verify", "x.toml"), ("x.toml", "^", *expected))


FRESH = ("new", "y.toml", "--strain", "eps.csv", "--matrix")
GOOD = ("new", "y.toml", "--matrix", "T.csv", "--strain", "eps.csv")
COMMANDS: dict[tuple[str, ...], tuple[str, ...]] = {
    ("verify", "bord.toml"): ("bord.toml", "No such file", "`taction new` writes one"),
    ("verify", "T.csv"): ("T.csv", "line 1, column 5", "`taction new` writes one"),
    ("verify", "empty"): ("empty", "holds no scene", "expected *.toml files"),
    ("verfy", "ok.toml"): ("No such command 'verfy'", "Did you mean 'verify'?"),
    ("verify",): ("Missing argument 'SCENE...'", "`taction new board.toml` writes one"),
    ("verify", "ok.toml", "--plots", "a.png"): ("No such option '--plots'", "'--plot'"),
    ("verify", "ok.toml", "--plot"): ("'--plot' requires an argument",),
    ("verify", "ok.toml", "--plot", "a.bmp"): ("--plot", "'a.bmp'", ".png, .svg, .pdf"),
    ("verify", "ok.toml", "--set", "c=12"): ("--set", "'c'", "did you mean 'C'?"),
    ("verify", "ok.toml", "--engine", "spice"): ("'--engine'", "'spice'", "mean 'ngspice'?"),
    ("verify", "ok.toml", "--plot="): ("--plot", "''", ".png"),
    ("verify", "ok.toml", "--set", "checks.overshoot.max=5%"): ("--set", "'5%'", "5% is 0.05"),
    ("sweep", "ok.toml", "--over", "cap=1p:1n:3"): ("--over", "'cap'", "known: C, R"),
    ("sweep", "ok.toml", "--over", "C", "1pF:1nF:3"): ("(1pF:1nF:3)", "--over C=1pF:1nF:3"),
    ("onset", "ok.toml"): ("Missing option '--over'", "Expected KEY"),
    ("regress", "empty"): ("Missing option '--baseline'", "Expected FILE"),
    ("diff", "ok.toml"): ("Missing argument 'B'", "two scene files"),
    ("netlist", "ok.toml", "--dialect", "pspice"): ("'--dialect'", "'pspice'", "'ltspice'"),
    ("kicad", "ok.toml", "-o", "k", "--channel", "9"): ("--channel", "9", "7 channels"),
    ("montecarlo", "ok.toml", "-n", "0"): ("'--samples'", "0", "1<=x"),
    ("models", "show", "tl704"): ("'tl704'", "did you mean 'tl084'?"),
    ("new", "there.toml"): ("there.toml", "the file exists", "--force"),
    ("new", "y.toml", "--matrix", "T.csv"): ("--strain", "belong together"),
    ("new", "y.toml", "--noise", "1%"): ("--noise", "needs --matrix"),
    ("new", "y.toml", "-o", "z.toml"): ("not both",),
    ("new", "y.toml", "--opamp", "tl704"): ("--opamp", "'tl704'", "did you mean 'tl084'?"),
    (*FRESH, "none.csv"): ("none.csv", "No such file", "separated by commas"),
    (*FRESH, "semicolon.csv"): ("semicolon.csv", "line 2, column 1", "separated by ';'"),
    (*FRESH, "tabs.csv"): ("tabs.csv", "line 1, column 2", "',' is a decimal comma"),
    (*FRESH, "ragged.csv"): ("ragged.csv", "line 6 has 2 values", "as many in every line"),
    (*FRESH, "text.csv"): ("text.csv", "line 2, column 2", "expected a number"),
    (*FRESH, "three.csv"): ("eps.csv", "3 rows", "5 values", "one value of strain for every row"),
    ("new", "y.toml", "--matrix", "eps.csv", "--strain", "T.csv"):
        ("T.csv", "shape 5 x 4", "a column of numbers"),
    (*GOOD, "--opamp", "TL074"): ("'TL074'", "did you mean 'tl074'?"),
    (*GOOD, "--supply", "12/-12"): ("12/-12", "'±15V'"),
    (*GOOD, "--noise", "10"): ("--noise", "SIGMA = 10", "the strain shows --noise"),
    (*GOOD, "--noise", "0.0001"): ("--noise", "SIGMA = 0.0001", "the strain shows --noise"),
    (*GOOD, "--noise", "much"): ("--noise", "'much'", "1% of the largest strain"),
    # start: new, verify, netlist, explore
    ("new", "none/y.toml"): ("FILE", "'none/y.toml'", "its folder does not exist"),
    ("new", "y.toml", "--from", "ok.toml", "--opamp", "tl704"): ("--opamp", "'tl704'", "'tl084'"),
    ("new", "y.toml", "--from", "none.toml"): ("none.toml", "No such file", "a scene file"),
    (*GOOD, "--lambda", "-1"): ("'--lambda'", "-1.0", "x>0"),
    (*GOOD, "--prune", "2"): ("'--prune'", "2.0", "0<=x<1"),
    ("new", "y.toml", "--matrix", "eps.csv", "--strain", "T.csv", "--any-part"):
        ("T.csv", "shape 5 x 4", "are matrix and strain swapped?"),
    ("verify", "ok.toml", "--set", "C"): ("--set", "'C'", "such as C=12pF"),
    ("verify", "ok.toml", "--set", "C=10"): ("--set", "10 F is what no board has", "'10pF'"),
    ("verify", "ok.toml", "--set", "gain=6mohm"): ("--set", "6 mohm", "'M' is mega"),
    ("verify", "ok.toml", "--set", "C=ten"): ("--set", "'ten'", "such as '10pF'"),
    ("verify", "ok.toml", "--set", "opamp=tl704"): ("--set", "'tl704'", "'tl084'"),
    ("verify", "ok.toml", "--plot", "ok.toml"): ("--plot", "'ok.toml'", ".png"),
    ("verify", "ok.toml", "--report", "none/a.html"): ("--report", "its folder does not exist"),
    ("verify", "ok.toml", "--jobs", "0"): ("'--jobs'", "0", "1<=x"),
    ("netlist", "ok.toml", "-o", "ok.toml"): ("-o", "an input of the same command", "another"),
    ("netlist", "ok.toml", "--dialect", "LTspice"): ("'LTspice'", "Did you mean 'ltspice'?"),
    ("netlist", "T.csv"): ("T.csv", "line 1, column 5", "`taction new` writes one"),
    ("explore", "none.toml"): ("none.toml", "No such file", "`taction new` writes one"),
    ("explore", "ok.toml", "--port", "abc"): ("'--port'", "'abc'", "a whole number in 0<=x"),
    ("explore", "ok.toml", "ok.toml"): ("extra argument (ok.toml)", "Expected no further word"),
    # design: design, onset, sweep, yield, build, export
    ("design", "tun", "ok.toml"): ("No such command 'tun'", "Did you mean 'tune'?"),
    ("design", "tune", "ok.toml", "--over", "gian=50k:500k"): ("--over", "'gian'", "'gain'?"),
    ("design", "tune", "ok.toml", "--over", "gain=500k:50k"):
        ("--over", "'500k:50k'", "LOW below HIGH", "are the two swapped?"),
    ("design", "tune", "ok.toml", "--over", "gain=50k:abc"): ("--over", "'abc'", "'1.8Mohm'"),
    ("design", "tune", "ok.toml", "--over", "opamp=ua741"):
        ("--over", "opamp.base=ua741'", "a key with numbers"),
    ("design", "choose", "ok.toml", "--settling", "abc"): ("--settling", "'abc'", "such as '5ms'"),
    ("design", "choose", "ok.toml", "--gain-range", "abc"): ("--gain-range", "'abc'", "'1.8Mohm'"),
    ("design", "choose", "ok.toml", "--c-range", "1n:1p"):
        ("--c-range", "'1n:1p'", "LOW below HIGH", "are the two swapped?"),
    ("design", "choose", "ok.toml", "--noise", "-1mV"): ("--noise", "'-1mV'", "above zero"),
    ("design", "choose", "ok.toml", "--margin", "0.5"): ("'--margin'", "0.5", "1<=x<=100"),
    ("design", "choose", "ok.toml", "--opamps", "tl704"): ("--opamps", "'tl704'", "'tl084'?"),
    ("onset", "ok.toml", "--over", "opamp"): ("--over", "'opamp'", "opamp=A,B,C"),
    ("onset", "ok.toml", "--over", "CC"): ("--over", "'CC'", "did you mean 'C'?"),
    ("onset", "ok.toml", "--over", "C=-1pF:1nF"): ("--over", "must be above zero", ":lin"),
    ("sweep", "ok.toml", "--over", "C=1pF:1nF:0"): ("--over", "'0' points", "from 2 to 100000"),
    ("sweep", "ok.toml", "--over", "C=1V:1nF:3"): ("--over", "the unit is 'V'", "'10pF'"),
    ("sweep", "ok.toml", "--over", "C=1pF:1nF:3", "--over", "C=1p,2p"):
        ("--over", "occurs twice", "all its values at once"),
    ("sweep", "ok.toml", "--over", "C=1pF:1nF:3", "--fix", "lamda"):
        ("--fix", "'lamda'", "did you mean 'lambda'?"),
    ("yield", "mc", "ok.toml"): ("No such command 'mc'", "one of montecarlo, corners"),
    ("design", "refine", "ok.toml"): ("No such command 'refine'", "withdrawn", "closed-loop.md"),
    ("yield", "montecarlo", "ok.toml", "-n", "abc"): ("'--samples'", "'abc'", "a whole number"),
    ("build", "ok.toml"): ("Missing option '-o'", "Expected FOLDER"),
    ("build", "ok.toml", "-o", "."): ("-o", "'T.csv'", "a new or empty folder"),
    ("design", "choose", "ok.toml", "-o", "."): ("-o", "is not empty", "give another name"),
    ("yield", "corners", "ok.toml", "--corner", "R=1"): ("--corner", "R:", "capacitor"),
    ("sweep", "ok.toml", "--over", "engine=ngspice,statespace"):
        ("--over", "analysis.engine", "sweep once with each"),
    ("export", "bom", "ok.toml", "-o", "none/p.csv"): ("-o", "its folder does not exist"),
    ("export", "bom", "ok.toml", "-o", "p.xlsx"): ("-o", "'p.xlsx'", "ends in .csv"),
    ("export", "waveforms", "ok.toml", "-o", "w.txt"): ("-o", "'w.txt'", ".csv, .parquet, .raw"),
    ("export", "waveform", "ok.toml"): ("'waveform'", "Did you mean 'waveforms'?"),
    # check: check, regress, diff, reproduce
    ("check",): ("Missing argument 'DECK'", "a SPICE deck, such as filter.cir"),
    ("check", "none.cir"): ("none.cir", "No such file", "a SPICE deck"),
    ("check", "ok.toml"): ("ok.toml", "a scene", "`taction verify` takes it"),
    ("check", "rc.cir", "--check", "settling=abc"):
        ("--check", "settling_time.max = 'abc'", "such as '5ms'"),
    ("check", "rc.cir", "--check", "margin=0.5"):
        ("--check", "margin = '0.5'", "expected a factor from 1 to 100"),
    ("check", "rc.cir", "--check", "foo=1"): ("--check", "'foo'", "settling=1ms@1%"),
    ("check", "rc.cir", "--check", "overshoot=nan"): ("--check", "'nan'", "such as 5% or 0.05"),
    ("check", "rc.cir", "--over", "R2"): ("--over", "'R2'", "one of R1, C1"),
    ("check", "rc.cir", "--output", "nowhere"): ("'nowhere'", "it has in, out"),
    ("check", "rc.cir", "--expect", "v(out)=abc"): ("--expect", "v(out)=abc", "v(out)=1.25@0.1%"),
    ("check", "rc.cir", "-o", "rc.cir"): ("-o", "an input of the same command"),
    ("regress", "none", "--baseline", "b.json"): ("none", "a folder with scene files"),
    ("regress", "empty", "--baseline", "T.csv"): ("T.csv", "no JSON", "`--update` writes"),
    ("diff", "ok.toml", "none.toml"): ("none.toml", "No such file", "`taction new` writes one"),
    ("diff", "ok.toml", "none.raw"): ("none.raw", "No such file", "of one transient"),
    ("diff", "ok.toml", "T.csv"): ("T.csv", "line 1, column 5", "`taction new` writes one"),
    ("diff", "ok.toml", "ok.toml", "--agree", "abc"): ("'--agree'", "'abc'", "a number in 0<x"),
    ("reproduce", "--quik"): ("'--quik'", "Did you mean '--quick'?"),
    ("reproduce", "all"): ("extra argument (all)", "Expected no further word"),
    # parts, self, demo, mcp
    ("parts", "list"): ("No such command 'list'", "one of import, show"),
    ("parts", "show"): ("Missing argument 'NAME'", "`taction parts` lists them"),
    ("parts", "show", "tl704"): ("parts show", "'tl704'", "did you mean 'tl084'?"),
    ("parts", "show", "ua741", "--plot", "a.bmp"): ("--plot", "'a.bmp'", ".png"),
    ("parts", "show", "ua741", "tl084"): ("extra argument (tl084)", "Expected no further word"),
    ("parts", "import"): ("Missing argument 'FILE'", "as a subcircuit"),
    ("parts", "import", "rc.cir"): ("Missing option '--subckt'", "the subcircuit in FILE"),
    ("parts", "import", "rc.cir", "--subckt", "X"): ("Missing option '--pins'", "inp, inn"),
    ("parts", "import", "none.lib", "--subckt", "X", "--pins", "inp,inn,vcc,vee,out"):
        ("none.lib", "No such file", "as a subcircuit"),
    ("self", "docter"): ("No such command 'docter'", "Did you mean 'doctor'?"),
    ("self", "accuracy", "none.toml"): ("none.toml", "No such file", "a scene file"),
    ("self", "stress", "--only", "loop"): ("--only", "'loop'", "did you mean 'loops'?"),
    ("self", "stress", "--jobs", "0"): ("'--jobs'", "0", "1<=x"),
    ("mcp", "none"): ("none", "No such file", "a folder with scene files"),
    ("mcp", "ok.toml"): ("ok.toml", "expected a folder"),
    ("demo", "-o", "a.txt"): ("-o", "'a.txt'", ".html"),
    ("demo", "now"): ("extra argument (now)", "Expected no further word"),
    ("teach",): ("No such command 'teach'", "one of new, verify"),
}  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_mistake_in_a_command(folder: Path, words: tuple[str, ...]) -> None:
    refused(words, COMMANDS[words])


def test_every_group_has_ten_mistakes() -> None:
    above = {short: family for family, (below, _) in FAMILIES.items() for short in below}
    groups = {name: title for title, names in SECTIONS.items() for name in names}
    groups |= {short: groups[family] for short, family in above.items()}
    groups |= {old: groups[new] for new, old in RENAMED.items() if new in groups}
    made = Counter(groups[words[0]] for words in COMMANDS if words[0] in groups)
    assert set(made) == set(SECTIONS)
    assert min(made.values()) >= 10, made
