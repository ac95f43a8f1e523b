"""Hostile decks: nothing in them runs, nothing outside of their folder is read, no traceback."""

from __future__ import annotations

import math
import os
import subprocess
from pathlib import Path

import pytest

from taction import check
from taction.netlist_gen.deck.flat_cards import source_of
from taction.netlist_gen.deck.foreign_deck import read_deck
from taction.system.errors import InputError, TactionError
from taction.verification.engines.ngspice import commands
from taction.verification.studies.decks.foreign_board import read_board

RC = "V1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "deck"
    made.mkdir()
    return made


def written(folder: Path, text: str, name: str = "deck.cir") -> Path:
    place = folder / name
    place.write_text(text)
    return place


COMMANDS = (
    ".control\nshell touch {mark}\n.endc\n",
    ".control\nshell touch {mark}\n.endc\n.control\nsystem touch {mark}\n.endc\n",
    "*#shell touch {mark}\n",
    "*ng_script\n*#shell touch {mark}\n",
    "* comment\r\n.control\r\nshell touch {mark}\r\n.endc\r\n",
    RC.replace("1", "2") + " \t.CONTROL\nshell touch {mark}\n",
    "R2 out 0 1k\n+\n.control\nwrite {mark}\n.endc\n",
)


@pytest.mark.parametrize("text", COMMANDS)
def test_commands_do_not_run(text: str, folder: Path, ngspice: str) -> None:
    mark = folder / "ran"
    board = read_board(written(folder, "title\n" + text.format(mark=mark) + RC + ".end\n"))
    assert not mark.exists()
    assert board.circuit.resistors


@pytest.mark.parametrize(
    "card",
    [
        ".shell touch {mark}", ".exec touch {mark}", ".pre_osdi {mark}", ".csparams x=1",
        ".spiceinit", "A1 in out filesource", ".hdl x.va", ".codemodel x.cm",
        ".verilog x.v", ".save all\x0b.control", "R9 in out `touch {mark}`",
        "R9 in out \"1k\"", "N1 in out model", "Y1 in out model", "P1 in out 3",
    ],
)  # fmt: skip
def test_other_cards_are_refused_by_name(card: str, folder: Path, ngspice: str) -> None:
    mark = folder / "ran"
    place = written(folder, f"t\n{RC}{card.format(mark=mark)}\n.end\n")
    with pytest.raises(InputError) as error:
        read_board(place)
    assert "deck.cir" in str(error.value)
    assert "line 5" in str(error.value)
    assert not mark.exists()


@pytest.mark.parametrize(
    "name", ["../secret.lib", "/etc/passwd", "link.lib", "sub/../../secret.lib", "..\\secret.lib"]
)
@pytest.mark.parametrize("card", [".include", ".lib", ".inc", ".INCLUDE"])
def test_no_file_outside_of_the_folder_is_read(card: str, name: str, folder: Path) -> None:
    secret = folder.parent / "secret.lib"
    secret.write_text("Rsecret a b 4711\n")
    (folder / "link.lib").symlink_to(secret)
    place = written(folder, f't\n{RC}{card} "{name}"\n.end\n')
    with pytest.raises(InputError, match=r"outside the deck's folder|no such file") as error:
        read_deck(place)
    assert "4711" not in str(error.value)


def test_files_inside_the_folder_are_read(folder: Path, ngspice: str) -> None:
    (folder / "lib").mkdir()
    written(
        folder / "lib", ".lib fast\nR7 out 0 7k\n.endl\n.lib slow\nR7 out 0 8k\n.endl\n", "a.lib"
    )
    written(folder / "lib", "R8 out 0 1\xb5\n", "b.inc")
    place = written(folder, f"t\n{RC}.lib 'lib/a.lib' slow\n.include lib/B.INC\n.end\n")
    board = read_board(place)
    assert {part.card: part.ohms for part in board.circuit.resistors} == {
        "R1": 1e3, "R7": 8e3, "R8": 1e-6
    }  # fmt: skip


def test_decks_of_pspice_schematics_are_read(folder: Path, ngspice: str) -> None:
    """Nodes without a name begin with a dollar, and a list of aliases is no list of parts."""
    parts = "R_R1 $N_0001 $N_0002 1k\nC_C1 0 $N_0002 1n\nV_V1 $N_0001 0 DC 0 AC 1\n"
    written(folder, parts, "a.net")
    written(folder, ".ALIASES\nR_R1 R1(1=$N_0001 2=$N_0002 )\n.ENDALIASES\n", "a.als")
    place = written(folder, '* t\n.lib "nom.lib"\n.INC "A.NET"\n.INC "a.als"\n.probe\n.END\n')
    found = check(place, outputs="n__0002")
    assert [pole.real for pole in found.poles.poles] == pytest.approx([-1e6], rel=1e-9)
    assert any("nom.lib: a library of LTspice or PSpice" in note for note in found.notes)
    written(folder, parts.replace("0 $N_0002", "0 N__0002"), "a.net")
    with pytest.raises(InputError, match="nodes of both names"):
        read_board(place)


def test_subcircuits_may_follow_the_end_and_parts_may_not(folder: Path, ngspice: str) -> None:
    """ngspice reads on: of 1 kohm to 1 V and 1 kohm to ground after .end it finds 0.5 V."""
    divider = ".subckt half a b\nR1 a b 1k\nR2 b 0 1k\n.ends\n"
    place = written(folder, f"t\nV1 in 0 1\nX1 in out half\n.end\n{divider}.end\n")
    rest = check(place, outputs="out", ngspice=False).outputs[0].rest
    assert rest == pytest.approx(0.5, rel=1e-9)
    place = written(folder, f"t\n{RC}.end\n\nR9 out 0 1k\n")
    with pytest.raises(InputError, match=r"line 7 = 'r9 .*after the \.end of line 5"):
        read_deck(place)


def test_a_file_that_includes_itself_is_refused(folder: Path) -> None:
    place = written(folder, f"t\n{RC}.include deck.cir\n")
    with pytest.raises(InputError, match="within one another"):
        read_deck(place)


@pytest.mark.parametrize(
    "text",
    [
        "", "t\n", "t\n.end\n", "\x00\x00", "t\nR1\n", "t\nR1 a b\n", "t\nR1 a 0 1.2.3k\n",
        "t\nR1 a 0 0\n", "t\nC1 a 0 {x}\n", "t\nX1 a b c nothing\n", "t\n.subckt a b\n",
        "t\n.ends\nR1 a 0 1\n", "t\nE1 a 0 poly(2) b 0 c 0 0 1 1\nR1 a 0 1\n",
        "t\nD1 a 0 dm\nR1 a 0 1k\n", "t\nB1 a 0 V=v(nowhere)^2\nR1 a 0 1\n",
        "t\nM1 a b c d nm\nR1 a 0 1\n", "t\nF1 a 0 V9 2\nR1 a 0 1k\n",
        "t\nK1 L1 L2 0.5\nR1 a 0 1\n",
        "t\nA1 a 0 gain\nR1 a 0 1\n.model gain gain\n", "t\nV1 a 0 AM(1 0 1 1 1)\nR1 a 0 1\n",
        "t\nL1 a 0 -1m\nR1 a 0 1\n", "t\n.subckt s a\nX1 a s\n.ends\nX1 a s\nR1 a 0 1\n",
        "t\nR1 a 0 1e999\n", "t\nR1 a 0 1k m=0\n", "t\nJ1 a b c jm\nR1 a 0 1\n", "+ x\n+ y\n",
        "t\nV1 a 0 PULSE()\nR1 a 0 1\n", "t\nV1 a 0 PWL(0)\nR1 a 0 1\n", "t\nK1 L1\nR1 a 0 1\n",
    ],
)  # fmt: skip
def test_what_is_no_linear_deck_is_refused_without_a_traceback(
    text: str, folder: Path, ngspice: str
) -> None:
    from taction.verification.stability.poles import poles

    place = written(folder, text)
    with pytest.raises(TactionError) as error:
        poles(read_board(place).circuit)
    assert "bug" not in str(error.value)


def test_a_bomb_of_subcircuits_ends(
    folder: Path, ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """30 levels of two calls each: a thousand million parts."""
    monkeypatch.setattr(commands, "SECONDS", 2.0)
    levels = [f".subckt s{k} a\nX1 a s{k + 1}\nX2 a s{k + 1}\n.ends\n" for k in range(30)]
    text = "t\nX1 a s0\n" + "".join(levels) + ".subckt s30 a\nR1 a 0 1k\n.ends\n.end\n"
    place = written(folder, text)
    with pytest.raises(TactionError):
        read_board(place)


def test_lines_that_ngspice_takes_for_comments_are_left_out(folder: Path, ngspice: str) -> None:
    """A model of several lines often ends so; ngspice says "will be replaced with '*'"."""
    text = "title\n" + RC + ".csparam half={0.5}\n.model d d (\n+ is=1f\n)\n, R2 out 0 1\n.end\n"
    deck = read_deck(written(folder, text))
    assert deck.lines[-1] == ".model d d ( is=1f"
    (remark,) = deck.remarks
    assert remark.startswith("deck.cir: line 8 and 1 more: begins with no letter")
    assert len(read_board(deck.file).circuit.resistors) == 1


def test_what_ltspice_defines_and_ngspice_does_not(folder: Path, ngspice: str) -> None:
    text = (
        "title\nV1 in 0 1\nR1 in out {mc(1k, 0.05)}\nC1 out 0 {1/(2*pi*1k)}\n.step param x 1 2 1\n"
    )
    board = read_board(written(folder, text))
    assert board.circuit.value("C1") == pytest.approx(1.0 / (2.0 * math.pi * 1e3), rel=1e-9)
    assert board.circuit.value("R1") == 1e3
    assert board.deck.parameters == ("x",)
    assert any(".step param x 1 2 1: does not run; --over" in note for note in board.notes)
    own = read_board(written(folder, text + ".param pi=3\n"))
    assert own.circuit.value("C1") == pytest.approx(1.0 / 6e3, rel=1e-9)


def test_a_charge_that_does_not_count_is_said(folder: Path, ngspice: str) -> None:
    text = "title\n" + RC.replace("1n\n", "1n IC=0.5\n") + ".tran 1n 10u uic\n.end\n"
    found = check(written(folder, text))
    assert "initial charges (ic=, .ic) do not count" in found.notes


def test_other_files_are_refused(folder: Path) -> None:
    for name in ("board.asc", "missing.cir"):
        with pytest.raises(InputError):
            read_deck(folder / name)
    os.mkfifo(folder / "pipe.cir")
    with pytest.raises(InputError, match="not a regular file"):
        read_deck(folder / "pipe.cir")


def test_ltspice_writes_utf_16_and_micro(folder: Path) -> None:
    place = folder / "ltspice.net"
    place.write_bytes(
        "* t\nR1 in out 1k\nC1 out 0 2\N{MICRO SIGN}\n.backanno\n.end\n".encode("utf-16")
    )
    assert read_deck(place).lines == ("r1 in out 1k", "c1 out 0 2u")


@pytest.mark.parametrize(
    ("text", "before", "after", "at"),
    [
        ("5", 5.0, 5.0, 0.0), ("dc 2 ac 1 90", 2.0, 2.0, 0.0), ("ac 1", 0.0, 0.0, 0.0),
        ("pulse(1 2 3u)", 1.0, 2.0, 3e-6), ("dc 7 pwl(0 1 1n 1 2n 4)", 1.0, 4.0, 1e-9),
        ("sin(0.5 1 1k)", 0.5, 0.5, 0.0), ("exp(0 3 1u)", 0.0, 3.0, 1e-6), ("", 0.0, 0.0, 0.0),
        ("pulse 0 1meg 0", 0.0, 1e6, 0.0), ("ac ( 1 0 )", 0.0, 0.0, 0.0),
        ("ac=1 dc=3", 3.0, 3.0, 0.0),
        ("dc 2 ac 1 distof1 0 distof2 0 1", 2.0, 2.0, 0.0),
        ("ac 1 sin 2 1 1k 0 0 distof1 0 distof2 0", 2.0, 2.0, 0.0),
        ("sffm(2 1 1k 5 10)", 2.0, 2.0, 0.0),
        ("dc 2 trnoise(20n 1n 0 0)", 2.0, 2.0, 0.0), ("trnoise(20n 1n 0 0)", 0.0, 0.0, 0.0),
        ("pwl(0 1 1n 2 3n 4) td=1u", 1.0, 4.0, 1e-6), ("pwl(0 1 1n 3) r=-1", 1.0, 3.0, 0.0),
    ],
)  # fmt: skip
def test_what_a_source_does(text: str, before: float, after: float, at: float) -> None:
    found = source_of("v1", f"a 0 {text}")
    assert (found.before, found.value, found.at) == (before, after, at)


def test_a_capacitor_of_nothing_is_left_out(folder: Path, ngspice: str) -> None:
    board = read_board(written(folder, f"t\n{RC}C2 out 0 0\nC3 in out {{0*1n}}\n.end\n"))
    assert [part.card for part in board.circuit.capacitors] == ["C1"]
    assert "less than 1e-23 F, so left out: C2, C3" in board.notes
    assert [knob.name for knob in board.circuit.knobs] == ["R1", "C1"]


@pytest.mark.parametrize(
    ("card", "said"),
    [(".temp 77", True), (".options reltol=1m temp=77", True), (".option tnom = 50", True),
     (".temp 27", False), (".options reltol=1m", False)],
)  # fmt: skip
def test_another_temperature_is_told_of(card: str, said: bool, folder: Path, ngspice: str) -> None:
    board = read_board(written(folder, f"t\n{RC}{card}\n.end\n"))
    assert any("27 degrees" in note for note in board.notes) == said


@pytest.mark.parametrize(("chosen", "ohms"), [(1, 2e3), (2, 3e3), (7, 4e3)])
def test_a_choice_of_cards(chosen: int, ohms: float, folder: Path, ngspice: str) -> None:
    cards = (
        f".param n={chosen}\n.if (n==1)\nR2 out 0 2k\n.elseif (n==2)\nR2 out 0 3k\n.else\n"
        "R2 out 0 4k\n.endif\n"
    )
    board = read_board(written(folder, f"t\n{RC}{cards}.end\n"))
    assert board.circuit.value("R2") == ohms
    (other,) = board.at("n", [2.0])
    assert not isinstance(other, InputError)
    assert other.value("R2") == 3e3


def test_a_table_is_its_slope(folder: Path, ngspice: str) -> None:
    """Before the step the input is in the middle of the table: 2 V a volt."""
    card = "E1 x 0 TABLE {v(out)} = (-1,-2) (1,2)\nR2 x 0 1k\n"
    board = read_board(written(folder, f"t\n{RC}{card}.end\n"))
    (gain,) = [part.value for part in board.circuit.branches if part.card.startswith("Ebe1#g")]
    assert gain == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize(
    ("card", "name"),
    [
        ("V2 a 0 PWL file=x", "file="), ("V2 a 0 PWL(FILE = x)", "file="),
        ("I2 a 0 pwl file x", "pwl"), (".model f filesource(file=x)", "file="),
        (".model f d_source(input_file=x)", "input_file="),
        (".model f d_state(state_file=x)", "state_file="),
        (".model f d_process(process_file=x)", "process_file="),
        (".model f d_cosim(simulation=x)", "simulation="),
        (".model f d_cosim(lib_args=x)", "lib_args="),
        ("R2 a 0 1k\n+ lib_args=x", "lib_args="),
        ("B2 a 0 V=V(in)+1g*TIME", "time"), ("E2 a 0 value={sin(6*time)}", "time"),
        ("G2 a 0 cur='V(in)*time'", "time"), ("R2 a 0 r={1k*(1+time)}", "time"),
        (".func f(x) {x*time}", "time"),
    ],
)  # fmt: skip
def test_a_card_with_a_file_or_with_time_is_refused_before_ngspice(
    card: str, name: str, folder: Path
) -> None:
    """The reader refuses, which starts no process; ngspice reads time as 0 at rest."""
    with pytest.raises(InputError, match=f"line 5 .*: {name}"):
        read_deck(written(folder, f"t\n{RC}{card}\n.end\n"))


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("trrandom(2 10m 0 1 5)", "trrandom"), ("dc 2 trrandom(1 10m 0 1 5)", "trrandom"),
        ("dc 3 trnoise(20n 1n 0 0)", "trnoise"), ("pwl(0 0.5 1u 1 2u 0.5) r=0", "r="),
        ("dc 3 pwl(0 1 1u 2) td=1u r=0", "r="),
    ],
)  # fmt: skip
def test_a_source_over_time_rests_where_ngspice_rests(
    source: str, said: str, folder: Path, ngspice: str
) -> None:
    """Beside ngspice's own operating point of the deck's text; a note says what does not count."""
    text = f"t\nV1 in 0 {source}\nR1 in out 1k\nC1 out 0 1n\n"
    board = read_board(written(folder, f"{text}.end\n"))
    commands = ".control\nop\nprint v(in)\nquit\n.endc\n.end\n"
    answer = subprocess.run(
        [ngspice, "-b"], input=text + commands, capture_output=True, text=True, check=False
    )
    volts = float(answer.stdout.split("v(in) =")[1].split()[0])
    (found,) = board.flat.sources
    assert found.value == pytest.approx(volts, rel=1e-6)
    assert any(said in note for note in board.notes)
