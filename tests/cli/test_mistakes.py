"""Mistakes of a beginner and unusual names of files: what each message says, and what helps.

Mistakes in scenes: `tests/netlist_gen/scene/test_mistakes.py`.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from lxml import etree

from tests.support.paths import SCENES
from tests.support.running import document, python, taction

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
SCENE = SCENES / "tuned-breadboard.toml"
NAME = os.fsdecode(b"board-\xff.toml")
ODD = "x\n::error file=a::y \x1b]0;t\x07"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the paper's board, a matrix and a strain, in which commands run."""
    files = {"ok.toml": BOARD, "T.csv": T, "eps.csv": EPS, "there.toml": BOARD}
    files |= {
        "semicolon.csv": T.replace(",", ";"),
        "ragged.csv": f"{T}1,2\n",
        "three.csv": "1\n2\n3\n",
        "rc.cir": "rc\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


FRESH = ("new", "y.toml", "--strain", "eps.csv", "--matrix")
OVER = ("--over", "C=50pF:100pF:3")
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
    ("verify", "ok.toml", "--engine", "spice"): ("analysis.engine = 'spice'", "'ngspice'"),
    ("verify", "ok.toml", "--set", "checks.overshoot.max=5%"): ("--set", "'5%'", "5% is 0.05"),
    ("sweep", "ok.toml", "--over", "cap=1p:1n:3"): ("--over", "'cap'", "known: C, R"),
    ("sweep", "ok.toml", "--over", "C", "1pF:1nF:3"): ("(1pF:1nF:3)", "--over C=1pF:1nF:3"),
    ("sweep", "ok.toml", *OVER, "--engine", "hybrid"):
        ("--engine ngspice compares every point with state space",),
    ("sweep", "ok.toml", *OVER, "--retry", "failed"):
        ("The same command computes points without a verdict again.",),
    ("sweep", "ok.toml", *OVER, "--export", "a.xls"): ("--export", "'a.xls'", ".csv, .parquet"),
    ("sweep", "ok.toml", *OVER, "--over", "R=1M,2M", "--over", "supply=9V,12V", "--plot", "a.png"):
        ("a picture has at most two",),
    ("sweep", "ok.toml", *OVER, "--keep-waveforms"): ("'taction export waveforms'",),
    ("montecarlo", "ok.toml", "--remedy"): ("Set a better grade in [tolerances]",),
    ("montecarlo", "ok.toml", "--no-remedy"): ("Leave it out",),
    ("verify", ".", "--exclude", "draft-*"): ("Name the scenes",),
    ("verify", "ok.toml", "there.toml", "--plot", "board.png"): ("shows one board",),
    ("onset", "ok.toml"): ("Missing option '--over'", "Expected KEY"),
    ("diff", "ok.toml"): ("Missing argument 'B'", "two scene files"),
    ("netlist", "ok.toml", "--dialect", "pspice"): ("'--dialect'", "'pspice'", "'ltspice'"),
    ("montecarlo", "ok.toml", "-n", "0"): ("'--samples'", "0", "1<=x"),
    ("montecarlo", "ok.toml", "--cluster", "none"): ("--cluster", "'none'", "dask scheduler"),
    ("models", "show", "tl704"): ("'tl704'", "did you mean 'tl084'?"),
    ("new", "there.toml"): ("there.toml", "the file exists", "--force"),
    ("new", "y.toml", "--matrix", "T.csv"): ("--strain", "belong together"),
    ("new", "y.toml", "--noise", "1%"): ("--noise", "needs --matrix"),
    ("new", "-o", "z.toml"): ("No such option", "taction new FILE"),
    (*FRESH, "semicolon.csv"): ("semicolon.csv", "row 1, column 1", "',' between them"),
    (*FRESH, "ragged.csv"): ("ragged.csv", "the number of columns changed", "at row 6"),
    (*FRESH, "three.csv"): ("eps.csv", "shape 5", "expected 3"),
    (*GOOD, "--supply", "12/-12"): ("12/-12", "'±15V'"),
    (*GOOD, "--noise", "10"): ("--noise", "SIGMA = 10", "a number between 0.0037 and 0.48"),
    ("new", "y.toml", "--from", "a.toml"): ("No such option", "taction scale SCENE -o FILE"),
    ("verify", "a.toml", "--solve"): ("No such option", "taction solve SCENE"),
    ("regress", "--annotate"): ("No such option", "--junit FILE"),
    (*GOOD, "--lambda", "-1"): ("'--lambda'", "-1.0", "x>0"),
    ("new", "y.toml", "--matrix", "eps.csv", "--strain", "T.csv"):
        ("T.csv", "shape 5 x 4", "expected 5"),
    ("verify", "ok.toml", "--set", "C"): ("--set", "'C'", "such as C=12pF"),
    ("verify", "ok.toml", "--set", "C=10"): ("--set", "10 F is what no board has", "'10pF'"),
    ("verify", "ok.toml", "--set", "opamp=tl704"): ("--set", "'tl704'", "'tl084'"),
    ("verify", "ok.toml", "--jobs", "0"): ("'--jobs'", "0", "1<=x"),
    ("explore", "none.toml"): ("none.toml", "No such file", "`taction new` writes one"),
    ("explore", "ok.toml", "--port", "abc"): ("'--port'", "'abc'", "a whole number in 0<=x"),
    ("design", "tune", "ok.toml", "--over", "gain=500k:50k"):
        ("--over", "'500k:50k'", "LOW below HIGH", "are the two swapped?"),
    ("design", "tune", "ok.toml", "--over", "opamp=ua741"):
        ("--over", "opamp.base=ua741'", "a key with numbers"),
    ("design", "choose", "ok.toml", "--settling", "abc"): ("--settling", "'abc'", "such as '5ms'"),
    ("design", "choose", "ok.toml", "--settling", "10"): ("--settling", "'10'", "'5ms', or '10s'"),
    ("design", "choose", "ok.toml", "--noise", "-1mV"): ("--noise", "'-1mV'", "above zero"),
    ("onset", "ok.toml", "--over", "opamp"): ("--over", "'opamp'", "opamp=A,B,C"),
    ("onset", "ok.toml", "--over", "C=-1pF:1nF"): ("--over", "must be above zero", ":lin"),
    ("design", "refine", "ok.toml"): ("No such command 'refine'", "withdrawn", "closed-loop.md"),
    ("yield", "montecarlo", "ok.toml", "-n", "abc"): ("'--samples'", "'abc'", "a whole number"),
    ("design", "choose", "ok.toml", "-o", "."): ("-o", "not written by this command"),
    ("yield", "corners", "ok.toml", "--corner", "R=1"): ("--corner", "R:", "capacitor"),
    ("sweep", "ok.toml", "--over", "engine=ngspice,statespace"):
        ("--over", "analysis.engine", "sweep once with each"),
    ("export", "bom", "ok.toml", "-o", "p.xlsx"): ("-o", "'p.xlsx'", "ends in .csv"),
    ("export", "waveforms", "ok.toml", "-o", "w.txt"): ("-o", "'w.txt'", ".csv, .parquet, .raw"),
    ("check",): ("Missing argument 'DECK'", "a SPICE deck, such as filter.cir"),
    ("check", "none.cir"): ("none.cir", "No such file", "a SPICE deck"),
    ("check", "rc.cir", "--check", "settling=abc"):
        ("--check", "settling_time.max = 'abc'", "such as '5ms'"),
    ("check", "rc.cir", "--check", "margin=0.5"):
        ("--check", "margin = '0.5'", "expected a factor from 1 to 100"),
    ("check", "rc.cir", "--check", "foo=1"): ("--check", "'foo'", "settling=1ms@1%"),
    ("check", "rc.cir", "--over", "R2"): ("--over", "'R2'", "one of R1, C1"),
    ("check", "rc.cir", "--output", "nowhere"): ("'nowhere'", "it has in, out"),
    ("check", "rc.cir", "--expect", "v(out)=abc"): ("--expect", "v(out)=abc", "v(out)=1.25@0.1%"),
    ("diff", "ok.toml", "none.raw"): ("none.raw", "No such file", "of one transient"),
    ("diff", "ok.toml", "ok.toml", "--agree", "abc"): ("'--agree'", "'abc'", "a number in 0<x"),
    ("reproduce", "--quick"): ("'--quick'", "Leave it out"),
    ("parts", "list"): ("No such command 'list'", "one of import, show"),
    ("parts", "show"): ("Missing argument 'NAME'", "`taction parts` lists them"),
    ("parts", "import"): ("Missing argument 'FILE'", "as a subcircuit"),
    ("parts", "import", "rc.cir"): ("Missing option '--subckt'", "the subcircuit in FILE"),
    ("parts", "import", "none.lib", "--subckt", "X", "--pins", "inp,inn,vcc,vee,out"):
        ("none.lib", "No such file", "as a subcircuit"),
    ("self", "stress", "--only", "loop"): ("--only", "'loop'", "did you mean 'loops'?"),
    ("mcp", "ok.toml"): ("ok.toml", "expected a folder"),
    ("demo", "-o", "a.txt"): ("-o", "'a.txt'", ".html"),
    ("teach",): ("No such command 'teach'", "one of new, verify"),
    ("netlist", "ok.toml", "more"): ("extra argument (more)", "Expected no further word"),
}  # fmt: skip


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_mistake_in_a_command(words: tuple[str, ...]) -> None:
    done = taction(*words)
    assert (done.exit_code, done.stdout) == (BAD_INPUT, ""), done.output
    text = " ".join(done.stderr.split())
    assert [part for part in COMMANDS[words] if part not in text] == [], text
    assert [part for part in NEVER if part in text] == [], text


LONG = "n" * 300
PINS = "--subckt FET100 --pins inp,inn,vcc,vee,out"
NAMES = [
    "verify {long}.toml", "verify loop.toml", "verify ok.toml --report {long}.html",
    "check {long}.cir", "check rc.cir --tolerances {long}.toml", "netlist ok.toml -o loop.cir",
    "new x.toml --matrix {long}.csv --strain e.csv", "build ok.toml -o {long}",
    "diff {long} ok.toml", "regress {long} --baseline b.json",
    f"parts import {{long}}.lib {PINS}", "export bom ok.toml -o {long}.csv",
    "sweep ok.toml --over C=1pF -o {long}.csv", "mcp loop.cir",
]  # fmt: skip


@pytest.mark.parametrize("line", NAMES)
def test_a_name_that_no_file_can_have(line: str, folder: Path) -> None:
    for ending in (".toml", ".cir"):
        (folder / f"loop{ending}").symlink_to(folder / f"other{ending}")
        (folder / f"other{ending}").symlink_to(folder / f"loop{ending}")
    result = taction(*line.format(long=LONG).split())
    assert result.exit_code == BAD_INPUT, result.output
    assert "Traceback" not in result.output
    said = " ".join(result.stderr.split())
    assert "n" * 50 in said or "loop" in said
    assert "expected" in said or "Too many levels" in said or "too long" in said


SWEEP = ("sweep", "a.toml", "--over", "C=10p", "--engine", "ngspice", "--jobs", "1", "-o", "a.db")


@pytest.mark.usefixtures("ngspice")
def test_a_temporary_folder_has_any_name(boards: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = boards / "a'quote, a line\nbreak, $HOME;`x` {\\"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    monkeypatch.setattr(tempfile, "tempdir", None)
    done = taction("verify", "a.toml", "--engine", "ngspice")
    assert done.exit_code == 0, done.stderr
    done = taction(*SWEEP, "--json")
    assert done.exit_code == 0, done.stderr
    assert "error" not in document(done)["outcomes"]
    assert not list(place.iterdir())


@pytest.mark.usefixtures("ngspice")
def test_a_temporary_folder_that_is_missing_is_named_and_no_point_is_stored(boards: Path) -> None:
    done = python("-m", "taction", *SWEEP, cwd=boards, env={"TMPDIR": "/missing"})
    assert done.returncode == 3
    assert "no folder can be made in /missing (TMPDIR)" in done.stderr
    assert document(taction(*SWEEP, "--json"))["ran"] == 1


def test_a_regression_with_a_name_that_is_no_text(tmp_path: Path) -> None:
    shutil.copy(SCENE, tmp_path / NAME)
    baseline, junit, markdown = (tmp_path / f"{NAME}.{kind}" for kind in ("json", "xml", "md"))
    words = ("regress", str(tmp_path), "--baseline", str(baseline))
    files = ("--junit", str(junit), "--markdown", str(markdown))
    first = taction(*words, *files, "--update", "--jobs", "1")
    assert first.exit_code == 0, first.stderr
    second = taction(*words, *files, "--json", "--jobs", "1")
    assert second.exit_code == 0, second.stderr
    assert [scene["file"] for scene in document(second)["scenes"]] == ["board-\\udcff.toml"]
    assert r"board-\udcff" in etree.fromstring(junit.read_bytes()).xpath("//testsuite/@name")[0]
    assert r"board-\udcff" in markdown.read_text(encoding="utf-8")


def unseen(text: str) -> None:
    """No line is a command, and no character moves a terminal."""
    for line in text.splitlines():
        assert not line.lstrip().startswith("::")
    assert "\x1b" not in text
    assert "\x07" not in text


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "{}.toml"),
        ("verify", "none{}.toml"),
        ("verify", "plain.toml", "--plot", "{}"),
        ("verify", "plain.toml", "--set", "{}=1"),
        ("verify", "plain.toml", "--{}"),
        ("{}",),
        ("diff", "{}.json", "plain.toml"),
        ("regress", ".", "--baseline", "{}.json", "--update"),
        ("models", "import", "{}.lib"),
        ("sweep", "{}.toml", "--over", "C=50p,60p", "--jobs", "1", "-o", "{}.sqlite"),
    ],
    ids=" ".join,
)
def test_names_are_shown_and_never_obeyed(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = SCENE.read_text().replace('engine = "auto"', 'engine = "statespace"')
    for name in (ODD, "plain"):
        (tmp_path / f"{name}.toml").write_text(scene)
    monkeypatch.chdir(tmp_path)
    done = taction(*(word.replace("{}", ODD) for word in words))
    assert done.exit_code in (0, 2)
    unseen(done.stdout)
    unseen(done.stderr)
    assert "Traceback" not in done.output
    for file in tmp_path.glob("*.html"):
        unseen(file.read_text().partition("<style>")[0])


def test_a_name_with_a_command_in_every_medium() -> None:
    from taction.verification.report.blocks import Facts, Notes, Page, Section, Table, cell
    from taction.verification.report.junit import JUnitTest, junit_suite, junit_text
    from taction.verification.report.renderers.page import page_html
    from taction.verification.report.renderers.terminal import card, markdown, page_text

    table = Table(ODD, (ODD,), ((cell(ODD),),), ODD)
    blocks = (table, Facts(ODD, ((ODD, ODD),)), Notes(ODD, (ODD,)))
    media = "terminal page notebook"
    page = Page(ODD, ODD, "", ODD, (ODD,), (Section(ODD, blocks, ODD, media),), (ODD,))
    suite = junit_suite(ODD, [JUnitTest(ODD, "failure", ODD, ODD)], simulator=ODD)
    text = page_text(page) + markdown(page, "a") + card(page) + junit_text("demo", [suite])
    text += page_html(page).partition("<style>")[0] + page_html(page).rpartition("</header>")[2]
    assert text.count("::error file=a::y") > 20  # shown as a text
    unseen(text)
