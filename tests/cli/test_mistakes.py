"""Mistakes of a beginner: each message says what is wrong, where, and what to write instead."""

from __future__ import annotations

from pathlib import Path

import pytest

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
    ("verify", "ok.toml", "--engine", "spice"): ("'--engine'", "'spice'", "'statespace'"),
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
}  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_mistake_in_a_command(folder: Path, words: tuple[str, ...]) -> None:
    refused(words, COMMANDS[words])


# What could be meant is asked about, and goes on.
ASKED: dict[str, tuple[str, str, str]] = {
    "large capacitor": ('capacitance = "10pF"\nres', 'capacitance = "10mF"\nres',
        "design.capacitance = 10 mF is not between"),
    "overshoot in percent": ("max = 0.235", "max = 23.5", "23.5 % is 0.235"),
    "time without a unit": ('max = "5ms"', "max = 5", "has no unit and is 5 s; is that meant?"),
}  # fmt: skip


@pytest.mark.parametrize("name", ASKED)
def test_what_could_be_meant_is_asked_about(folder: Path, name: str) -> None:
    old, new, question = ASKED[name]
    assert BOARD.count(old) == 1
    (folder / "x.toml").write_text(BOARD.replace(old, new), encoding="utf-8")
    done = taction("netlist", "x.toml", "-o", "x.cir")
    assert done.exit_code == 0, done.output
    assert question in done.stderr


@pytest.mark.parametrize("name", ["header.csv", "transposed.csv"])
def test_what_can_be_recognised_is_no_mistake(folder: Path, name: str) -> None:
    done = taction(*FRESH, name, "--noise", "10%", "--any-part")
    assert done.exit_code in {0, 1}, done.output
    assert "noise 0.0979, 10% of the largest strain" in done.stdout
