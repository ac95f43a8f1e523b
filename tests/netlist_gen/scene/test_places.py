"""Each mistake in a scene file: what, where, what instead, in plain words; without numpy."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.netlist_gen.scene.keys import Key, all_keys
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import parse_scene
from taction.system.errors import InputError
from tests.support.paths import SCENES

BOARD = (SCENES / "paper-breadboard.toml").read_text(encoding="utf-8")
NEVER = ("Input should be", "Traceback", "this is a bug", "Expected newline", "Cannot overwrite")
EVERY = parse_scene(
    {
        "problem": {"kind": "tactile"},
        "checks": {"overshoot": 0.5, "undershoot": 0.5, "rise_time": "1us", "noise": "1mV"},
    },
    "every.toml",
)
KEYS = tuple(all_keys(EVERY))


def refusal(folder: Path, text: str) -> InputError:
    file = folder / "board.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scene(file)
    assert caught.value.file == str(file)
    assert str(file) in str(caught.value)
    assert not [words for words in NEVER if words in str(caught.value)]
    return caught.value


@pytest.mark.parametrize(
    ("old", "new", "key", "value", "instead", "underlined"),
    [
        ('min = "9.5us"', 'min = "11us"', "checks.rise_time.min", "11us", "at most 10.5 us", "min"),
        ('min = "9.5us", max = "10.5us"', 'min = "10.5us", max = "9.5us"', "checks.rise_time.min",
         "10.5us", "are they swapped?", "min"),
        ('tolerance = 1e-3', 'tolerance = "0.1%"', "checks.steady_state.tolerance", "0.1%",
         "0.1 % is 0.001", "tolerance"),
        ('amplifier = "linear"', 'amplifier = "exp"', "design.amplifier", "exp", "'exponential'",
         "amplifier"),
        ('= "10pF"\nres', '= "10ohm"\nres', "design.capacitance", "10ohm", "in F", "capacitance"),
        ("channel = 4", "channel = 8", "checks.rise_time.channel", "8", "1 to 7", "channel"),
        ("tolerance = 1e-3", "tolerance = 10", "checks.steady_state.tolerance", "10", "10 % is 0.1",
         "tolerance"),
        ('= "10pF"\nres', '= "10pf"\nres', "design.capacitance", "10pf", "'10pF'", "capacitance"),
        ("depth = 1.0", 'depth = 1.0\ngain = "1ohm"', "problem.gain", "1ohm", "'channels'", "gain"),
        ("[design]", "[desing]", "desing", "linear", "'design'?", "desing"),
        ("force = 3.0", "forse = 3.0", "problem.load.forse", "3.0", "'force'?", "forse"),
        ('kind = "tactile"\n', "", "problem.kind", "", "'tactile' or 'matrix'", "problem"),
        ('= "10pF"\nres', '= 10pF\nres', "capacitance", "10pF", "need quotes", "p"),
        ('= "10pF"\nres', '= pF\nres', "capacitance", "pF", "in straight quotes", "p"),
        ('= "10pF"\nres', '= “10pF”\nres', "capacitance", "10pF", "straight quotes", "“"),
        ('= "10pF"\nres', '= 1,5\nres', "capacitance", "1,5", "with a point", ","),
        ('= "10pF"\nres', '= "10pF\nres', "capacitance", "10pF", "a quote is missing", ""),
        ('= "10pF"\nres', '= "1pF"\ncapacitance = "2pF"\nres', "capacitance", "2pF", "given twice",
         "c"),
        ("[design]", "[problem]", "TOML", "", "given twice", "]"),
        ("[design]", "[design", "TOML", "", "']' of a table is missing", ""),
        ("[design]", "design", "TOML", "", "expected 'key = value'", ""),
        ("max = 0.235 }", "max = 0.235, max = 1 }", "overshoot", "max", "given twice", " "),
    ],
)  # fmt: skip
def test_a_slip_in_the_papers_board(
    tmp_path: Path, old: str, new: str, key: str, value: str, instead: str, underlined: str
) -> None:
    assert old in BOARD
    text = BOARD.replace(old, new, 1)
    found = next(c for c in refusal(tmp_path, text).complaints if c.key == key)
    assert value in found.value
    assert instead in found.accepted
    head, line, caret = found.place.split("\n")
    row, column = (int(word.rstrip(",")) for word in head.split()[1::2])
    source = text.split("\n")[row - 1]
    assert line == "  " + source
    start = caret.index("^")
    assert start == column - 1 + 2
    marked = line[start : start + caret.count("^")]
    assert marked == underlined or (underlined == "" and marked in {"", "\n"})


WRONG = {
    "type": lambda key: (key.path, '[{ x = "wrong" }]'),
    "range": lambda key: (key.path, "-1e300" if key.kind == "real" else "-1"),
    "unit": lambda key: (key.path, '"10parsec"'),
    "name": lambda key: (f"{key.path}x", "1"),
}


@pytest.mark.parametrize("key", KEYS, ids=[key.path for key in KEYS])
def test_every_key_with_every_kind_of_mistake(tmp_path: Path, key: Key) -> None:
    for kind, written in WRONG.items():
        if (key.path == "name" or key.path.endswith(".file")) and kind == "unit":
            continue  # any text
        path, value = written(key)
        if kind == "range" and path == "checks.stability.margin":
            value = "0.5"
        kind_of_problem = "" if path == "problem.kind" else 'problem.kind = "tactile"\n'
        line = f"{path} = {value}"
        error = refusal(tmp_path, f"{kind_of_problem}{line}\n")
        found = [c for c in error.complaints if c.key in {path, path.rpartition(".")[0]}]
        assert found, (kind, str(error))
        assert found[0].accepted
        assert f"  {line}" in found[0].place, (kind, str(error))
