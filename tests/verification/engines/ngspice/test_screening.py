"""What must not reach ngspice, what must, and how ngspice lists a deck."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.netlist_gen.analysis import OperatingPoint
from taction.system.errors import DidNotLoad, Killed, SimulationError, SingularCircuit, TimedOut
from taction.verification.engines.ngspice.commands import MEMORY, expand
from taction.verification.engines.ngspice.executable import Simulator, find_simulator
from taction.verification.engines.ngspice.screening import screen
from tests.support.small_decks import SmallDeck, divider, transient, wrapped

REFUSED = {
    ".control": ".control\nshell touch it\n.endc",
    "indented, capital": "  .CONTROL",
    "command in a comment": "*# shell touch it",
    "script": "*ng_script",
    "library": ".lib /etc/passwd",
    "unknown include": ".include nowhere.inc",
    "include by path": '.include "../other.inc"',
    "absolute include": ".include /etc/passwd",
    "continued include": ".include\n+ /etc/passwd",
    "continued command": "R7 out 0 1.0\n+\n .control",
    "unknown option": ".options frobnicate=3",
    "resampling": ".options interp",
    "missing field": "R7 out 0",
    "bad number": "R7 out 0 1.2.3k",
    "no ohms": "R7 out 0 0.0",
    "no ohms, otherwise": "R7 out 0 0e-3k",
    "code model": "A1 [in] [out] model",
    "unknown subcircuit": "X1 in out nowhere",
    "control character": "R7 out 0 1.0\x0cx",
    "carriage return": "R7 out 0 1.0\r.control",
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str) -> None:
    with pytest.raises(DidNotLoad):
        screen(transient(REFUSED[case]))
    with pytest.raises(DidNotLoad):
        screen(transient(".include a.inc", files={"a.inc": REFUSED[case] + "\n"}))


@pytest.mark.parametrize(
    "name", ["../a", "/a", ".spiceinit", "a b", "a\nb", "", "-n", "deck.cir", "spinit"]
)
def test_refused_file_names(name: str) -> None:
    with pytest.raises(DidNotLoad, match="file name"):
        screen(transient(files={name: ""}))


@pytest.mark.parametrize(
    ("lines", "says"), [(".include a.inc\n", "within itself"), ("+ R7 out 0 1.0\n", "not accepted")]
)
def test_an_include_neither_includes_itself_nor_continues_a_line(lines: str, says: str) -> None:
    with pytest.raises(DidNotLoad, match=says):
        screen(transient(".include a.inc", files={"a.inc": lines}))


def test_a_script_in_place_of_a_title() -> None:
    deck = divider()
    for first in ("*ng_script", "*# shell touch it", ".control"):
        with pytest.raises(DidNotLoad):
            screen(SmallDeck(f"{first}\n{deck.text}", deck.saved, deck.analysis))


@pytest.mark.parametrize("saved", [(), ("out", "out"), ("out", "OUT")])
def test_saved_nodes_are_distinct(saved: tuple[str, ...]) -> None:
    with pytest.raises(DidNotLoad, match="distinct"):
        screen(SmallDeck(divider().text, saved, OperatingPoint()))


FLOATING = {
    "current source": "I1 0 f 1e-6",
    "sensed": "I1 0 f 1e-6\nE1 e 0 f 0 1.0\nR9 e 0 1.0",
    "transconductance": "G1 0 f out 0 1e-3",
    "behavioural current": "B1 0 f I = v(out)",
    "through a subcircuit": "I1 0 f 1e-6\nX1 f e\n+ buffer\nR9 e 0 1.0",
    "port that nothing holds": "X1 f e buffer\nR9 e 0 1.0",
}
BUFFER = ".subckt buffer a b\nE1 b 0 a 0 1.0\n.ends buffer"


@pytest.mark.parametrize("case", FLOATING)
def test_a_node_that_nothing_holds(case: str) -> None:
    # With KLU, ngspice 46 gives 0 V for node out, in place of 0.99 V, and exit status 0.
    with pytest.raises(SingularCircuit, match="'f'"):
        screen(transient(FLOATING[case], BUFFER))


ACCEPTED = {
    "a resistor holds it": "I1 0 f 1e-6\nR9 f 0 1.0",
    "a resistor holds it by its other end": "I1 0 f 1e-6\nR9 0 f 1.0",
    "a capacitor holds it": "I1 0 f 1e-6\nC9 f 0 1e-9",
    "its own conductance": "I1 0 f 1e-6\nG1 f 0 f 0 1e-3",
    "behavioural voltage": "I1 0 f 1e-6\nB1 f 0 V = v(out)",
    "a subcircuit holds it": "I1 0 f 1e-6\nX1 in f buffer",
    "within an include": "I1 0 f 1e-6\n.include a.inc",
    "suffixes": "R7 out 0 10k\nR8 out 0 1.5Meg\nR9 out 0 +.5e3ohm\nC9 out 0 10pF",
    "expressions": "R7 out 0 {2*3}\nE1 e 0 value={v(out)}\nE2 g 0 vol='v(out)'",
    "comment": "* .control would be a command",
    "quoted include": '.include "a.inc"',
}


@pytest.mark.parametrize("case", ACCEPTED)
def test_accepted(case: str) -> None:
    deck = transient(ACCEPTED[case], BUFFER, files={"a.inc": "R9 f 0 1.0\n"})
    assert screen(deck) is None  # what is not accepted raises


def test_a_title_is_no_device() -> None:
    deck = divider()
    for title in ("taction", ".title taction"):
        text = deck.text.replace("* taction", title, 1)
        assert screen(SmallDeck(text, deck.saved, deck.analysis)) is None


LINES = (".param r=1k", "v1 in 0 1", "r1 in out {2*r}", "c1 out 0 1n")
FLAT = ("v1 in 0 1", "r1 in out 2.000000000000000e+03", "c1 out 0 1n")


@pytest.fixture(scope="session")
def simulator(ngspice: str) -> Simulator:
    return find_simulator(ngspice)


def test_a_deck_is_listed_flat(simulator: Simulator) -> None:
    assert expand(LINES, simulator) == (FLAT,)


ENDINGS: dict[str, type[SimulationError]] = {
    "exit 1": DidNotLoad, "kill -9 $$": Killed, "exec sleep 1000": TimedOut
}  # fmt: skip


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_simulator_that_does_not_list_is_told_of(
    ending: str, simulator: Simulator, tmp_path: Path
) -> None:
    with pytest.raises(ENDINGS[ending]):
        expand(LINES, wrapped(simulator, tmp_path, ending), seconds=0.3)


def test_a_listing_has_little_memory(simulator: Simulator, tmp_path: Path) -> None:
    told = tmp_path / "kilobytes"
    expand(LINES, wrapped(simulator, tmp_path, f"sleep 0.2; ulimit -v > {told}"))
    assert int(told.read_text()) == MEMORY // 1024


@pytest.mark.parametrize(
    ("wrong", "says"),
    [((*LINES, "r2 out 0 {nothing}"), "nothing"), ((".subckt s a", *LINES, ".ends"), "no card")],
)
def test_a_deck_of_which_ngspice_complains_is_refused(
    wrong: tuple[str, ...], says: str, simulator: Simulator
) -> None:
    with pytest.raises(DidNotLoad, match=says):
        expand(wrong, simulator)
