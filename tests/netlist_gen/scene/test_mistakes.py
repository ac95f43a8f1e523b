"""A scene broken in every way: file, key, value, what is accepted; soon, and without numpy."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
from click.testing import Result

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Key, all_keys
from taction.netlist_gen.scene.scene import load_scene, parse_scene
from taction.system.errors import InputError
from tests.support.making import write_matrix_scene
from tests.support.paths import SCENES
from tests.support.running import taction as command

TACTILE = '[problem]\nkind = "tactile"\n'


def run(scene: Path, *options: str) -> Result:
    return command("netlist", str(scene), *options)


@pytest.mark.parametrize(
    ("text", "key", "value", "accepted"),
    [
        (TACTILE + "[design]\ncapacitanc = 1", "design.capacitanc", "1", "mean 'capacitance'?"),
        (TACTILE + "chanels = 7", "problem.chanels", "7", "mean 'channels'?"),
        (TACTILE + "load = {forse = 1.0}", "problem.load.forse", "1.0", "mean 'force'?"),
        (TACTILE + "[desing]\nx = 1", "desing", "{'x': 1}", "mean 'design'?"),
        (TACTILE + "[checks]\novershot = {max = 1}", "checks.overshot", "", "mean 'overshoot'?"),
        (TACTILE + "[design]\nlam = 1.0", "design.lam", "1.0", "mean 'lambda'?"),
        (TACTILE + "channels = 0", "problem.channels", "0", "must be 1 or more"),
        (TACTILE + "channels = 2.5", "problem.channels", "2.5", "whole number"),
        (TACTILE + 'channels = "7"', "problem.channels", "'7'", "without quotes"),
        (TACTILE + "channels = true", "problem.channels", "True", "plain whole number"),
        (TACTILE + "poisson = 0.6", "problem.poisson", "0.6", "must be 0.5 or less"),
        (TACTILE + "span = inf", "problem.span", "inf", "finite number"),
        (TACTILE + "noise = {variance = nan}", "problem.noise.variance", "nan", "finite number"),
        (TACTILE + "load = {normalised = 1}", "problem.load.normalised", "1", "true or false"),
        (TACTILE + 'load = {kind = "cyl"}', "problem.load.kind", "'cyl'", "mean 'cylinder'?"),
        (TACTILE + 'load = {kind = "csv"}', "problem.load.file", "", "y and stress"),
        (TACTILE + "load = 3", "problem.load", "3", "expected a table"),
        (TACTILE + 'kernel = "shear"', "problem.kernel", "'shear'", "'normal' or 'tangential'"),
        ('[problem]\nkind = "tactil"', "problem.kind", "'tactil'", "mean 'tactile'?"),
        ("[problem]\nchannels = 7", "problem.kind", "", "'tactile' or 'matrix'"),
        ("problem = 3", "problem", "3", "expected a table"),
        ("", "problem", "", "required"),
        ('[problem]\nkind = "matrix"', "problem.matrix", "", "required; M rows"),
        (TACTILE + '[design]\ngain = "-1ohm"', "design.gain", "'-1ohm'", "above zero"),
        (TACTILE + "[design]\ncapacitance = 0", "design.capacitance", "0", "above zero"),
        (TACTILE + "[design]\ncapacitance = nan", "design.capacitance", "nan", "'10pF'"),
        (TACTILE + '[design]\ncapacitance = "10 V"', "design.capacitance", "'10 V'", "'10pF'"),
        (TACTILE + '[design]\ncapacitance = "1,5pF"', "design.capacitance", "'1,5pF'", "a comma"),
        (TACTILE + "[design]\ncapacitance = 2020-01-01", "design.capacitance", "", "'10pF'"),
        (TACTILE + "[design]\nstray_capacitance = -1", "design.stray_capacitance", "-1", "zero or"),
        (TACTILE + "[design]\nlambda = 1\nresistance = 2", "design.lambda", "1", "'resistance'"),
        (TACTILE + "[design]\nbias = true", "design.bias", "True", "exponential"),
        (TACTILE + '[design]\nopamp = "ua74"', "design.opamp", "'ua74'", "mean 'ua741'?"),
        (TACTILE + "[design.opamp]\ndc_gain = 0.5", "design.opamp", "0.5", "above 1"),
        (
            TACTILE + "[design.opamp]\nphase_margin = 60\nsecond_pole = 1e6",
            "design.opamp", "60.0", "one of the two",
        ),
        (TACTILE + "[design]\ngain = 1e30\nlambda = 1e100", "design", "1e+100", "out of range"),
        (TACTILE + "[design]\nunit_conductance = 1e-200", "design.unit_conductance", "1e-200", "S"),
        (TACTILE + "[design]\nunit_conductance = 1e200", "design.unit_conductance", "1e+200", "S"),
        (TACTILE + "[design]\nunit_voltage = 1e-305", "design.unit_voltage", "1e-305", "range"),
        (TACTILE + '[analysis]\nstop = "fast"', "analysis.stop", "'fast'", "or 'auto'"),
        (TACTILE + "[analysis]\nstop = -1", "analysis.stop", "-1", "above zero"),
        (TACTILE + '[analysis]\nengine = "spice"', "analysis.engine", "'spice'", "'ngspice'"),
        (TACTILE + "[checks.settling_time]\nband = 2.5", "checks.settling_time.band", "2.5", "1"),
        (TACTILE + "[checks]\novershoot = {}", "checks.overshoot.max", "", "required; fraction"),
        ("design = 3\n" + TACTILE, "design", "3", "expected a table"),
        ('name = "a b"\n' + TACTILE, "name", "'a b'", "letters, digits"),
        ('name = "a\\n.control"\n' + TACTILE, "name", "", "letters, digits"),
        ('name = "a\\n"\n' + TACTILE, "name", "", "letters, digits"),
        ("this is not TOML", "TOML", "", "line 1"),
        ("x = " + "[" * 20_000, "TOML", "", "nested too deeply"),
    ],
)  # fmt: skip
def test_a_mistake_is_named(tmp_path: Path, text: str, key: str, value: str, accepted: str) -> None:
    scene = tmp_path / "broken.toml"
    scene.write_text(text, encoding="utf-8")
    found = run(scene, "--json")
    assert found.exit_code == 2
    assert str(scene) in found.stderr
    document = json.loads(found.stdout)
    assert document["outcome"] == "bad input"
    assert document["error"]["file"] == str(scene)
    complaint = next(c for c in document["error"]["complaints"] if c["key"] == key)
    assert value in complaint["value"]
    assert accepted in complaint["accepted"]
    for part in (key, value, accepted):
        assert part in found.stderr


def test_all_mistakes_come_at_once() -> None:
    data = {
        "problem": {"kind": "tactile", "channels": 0, "noise": {"variance": -1.0}},
        "design": {"capacitance": -1, "opamp": "ua74", "lambda": 1, "resistance": 2, "bias": True},
        "check": {},
    }
    with pytest.raises(InputError) as caught:
        parse_scene(data, "s.toml")
    assert {c.key for c in caught.value.complaints} == {
        "problem.channels",
        "problem.noise.variance",
        "design.capacitance",
        "design.opamp",
        "design.lambda",
        "design.bias",
        "check",
    }
    assert str(caught.value).count("s.toml: ") == 7


def test_files_that_are_no_scene(tmp_path: Path) -> None:
    huge = tmp_path / "huge.toml"
    huge.write_bytes(b"#" * 1_000_001)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    for path, says in (
        (tmp_path / "missing.toml", "No such file"),
        (tmp_path, "not a regular file"),
        (Path("/dev/zero"), "not a regular file"),
        (huge, "over 1 MB"),
        (binary, "is not UTF-8"),
    ):
        result = run(path, "--json")
        assert result.exit_code == 2
        assert says in json.loads(result.stdout)["error"]["message"]
        assert "taction new" in result.stderr


def test_a_file_of_another_encoding_is_named_by_its_line(tmp_path: Path) -> None:
    scene = tmp_path / "a.toml"
    scene.write_bytes("[problem]\nkind = 'tactile'  # groß\n".encode("latin-1"))
    assert "line 2 is not UTF-8 (byte 0xdf); save the file as UTF-8" in run(scene).stderr
    table = write_matrix_scene(tmp_path, [[1.0]], [1.0])
    (tmp_path / "T.csv").write_bytes("# µ\n1.0\n".encode("latin-1"))
    assert "line 1 is not UTF-8 (byte 0xb5)" in run(table).stderr


@pytest.mark.parametrize("name", ["missing.csv", "a\\u0000b.csv", "."])
def test_a_table_that_cannot_be_opened(tmp_path: Path, name: str) -> None:
    scene = write_matrix_scene(tmp_path, [[1.0]], [1.0])
    scene.write_text(scene.read_text().replace("T.csv", name))
    result = run(scene)
    assert result.exit_code == 2
    assert "problem.matrix" in result.stderr
    assert "expected numbers separated by commas" in result.stderr


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text("\ufeff" + TACTILE, encoding="utf-8")
    assert load_scene(path).problem.kind == "tactile"


MANY = "9" * 5000
HOSTILE_SCENES = {
    "digits": (f"channels = {MANY}", "", "TOML"),
    "digits of a quantity": ("", f'gain = "{MANY}"', "design.gain"),
    "digits of lambda": ("", f"lambda = 1{'0' * 400}", "design.lambda"),
    "text of lambda": ("", f'lambda = "1{"0" * 400}"', "design.lambda"),
    "gain": ("", "gain = 1e300", "design.gain"),
    "capacitance": ("", 'capacitance = "1e-300"', "design.capacitance"),
    "depth": ("depth = 1e-300", "", "problem.depth"),
    "depth and span": ("depth = 1e-99\nspan = 1e99", "", "T"),
    "span": ("span = 1e308", "", "problem.span"),
    "modulus": ("modulus = 1e-308", "", "problem.modulus"),
    "force": ('load = { kind = "cylinder", force = 1e99, half_width = 1e-99 }', "", "the strain"),
    "noise": ("noise = { variance = 1e308 }", "", "problem.noise.variance"),
    "channels": ("channels = 20000", "", "problem.channels"),
    "dotted keys": ("", "a" + ".a" * 20_000 + " = 1", "a key of over 50 parts"),
    "quoted keys": ("", '"a"' + " . 'a'" * 20_000 + " = 1", "a key of over 50 parts"),
    "deep arrays": ("", f"a = {'[' * 3000}{']' * 3000}", "nested too deeply"),
    "deep values": ("", f"a = {'[' * 300}{']' * 300}", "unknown key"),
}


@pytest.mark.parametrize("name", HOSTILE_SCENES)
def test_the_message_names_the_key(name: str, tmp_path: Path) -> None:
    problem, design, says = HOSTILE_SCENES[name]
    file = tmp_path / "scene.toml"
    file.write_text(f'[problem]\nkind = "tactile"\n{problem}\n[design]\n{design}\n')
    began = time.process_time()
    with pytest.raises(InputError) as caught:
        make_problem(load_scene(file))
    assert says in str(caught.value)
    assert str(file) in str(caught.value)
    # With the line, of which 76 characters are shown; the folder of a test has any length.
    assert len(str(caught.value).replace(str(tmp_path), "")) < 640
    assert time.process_time() - began < 10.0  # tomllib alone takes minutes for dotted keys


def test_large_arrays_are_refused_by_their_entries(tmp_path: Path) -> None:
    for entry in (1e308, 1e-308):
        (tmp_path / "T.csv").write_text(f"{entry!r},{entry!r}\n")
        (tmp_path / "eps.csv").write_text("1.0\n")
        file = tmp_path / "scene.toml"
        file.write_text('[problem]\nkind = "matrix"\nmatrix = "T.csv"\nstrain = "eps.csv"\n')
        with pytest.raises(InputError, match=re.escape(f"largest entry of T is {entry:g};")):
            make_problem(load_scene(file))


def test_comments_and_texts_with_dots_are_no_keys(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(f"# {'. ' * 100}{'...' * 100}\n[problem]\nkind = 'tactile'\nspan = 6.25\n")
    assert load_scene(file).problem.kind == "tactile"


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
