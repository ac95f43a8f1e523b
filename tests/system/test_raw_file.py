"""Raw files: round trip, ngspice's own, the way back into ngspice, and every refusal."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taction.system.array_types import Cost, Floats, Waveforms
from taction.system.errors import BadEvidence, InputError, OutOfDisk
from taction.system.raw_file import read_raw, read_transient, write_raw

TIME = np.array([0.0, 1e-6, 3e-6, 4e-6])
VOLTS = np.array([[0.0, 1.0], [0.5, -2.0], [0.25, 3.5], [0.125, 0.75]])  # exact in single precision
HEAD = "Title: * other\nDate: Mon\nPlotname: Transient Analysis\nFlags: {}\n"
VARIABLES = "\t0\ttime\ttime\n\t1\tV(out)\tvoltage\n\t2\tI(R1)\tcurrent\n\t3\tV(b)\tvoltage\n"


def record(points: int, nodes: int = 2, seed: int = 7) -> Waveforms:
    rng = np.random.default_rng(seed)
    return Waveforms(
        time=np.cumsum(rng.uniform(0.1, 1.0, points)),
        nodes=tuple(f"n{index}" for index in range(nodes)),
        values=rng.normal(size=(points, nodes)),
        engine="test",
        cost=Cost(0.0, points),
    )


@given(points=st.integers(1, 40), nodes=st.integers(1, 12), seed=st.integers(0, 9))
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, points: int, nodes: int, seed: int
) -> None:
    path = tmp_path_factory.mktemp("raw") / "a.raw"
    written = record(points, nodes, seed)
    if nodes % 2:  # values that do not lie side by side
        written = replace(written, values=np.asfortranarray(written.values))
    write_raw(path, written, title="a title: with a colon")
    plot = read_raw(path)
    path.unlink()  # a map outlives its file
    assert plot.name == "Transient Analysis"
    assert plot.vectors == ("time", *(f"v({node})" for node in written.nodes))
    np.testing.assert_array_equal(plot.data[:, 0], written.time)
    np.testing.assert_array_equal(plot.data[:, 1:], written.values)


def test_ngspice_loads_what_is_written(ngspice: str, tmp_path: Path) -> None:
    waveforms = record(4)
    write_raw(tmp_path / "a.raw", waveforms)
    commands = ["load a.raw", "set numdgt=16", "set wr_singlescale", "wrdata b.txt v(n1) v(n0)"]
    script = "\n".join(["*ng_script", ".control", *commands, "quit 0", ".endc", ""])
    (tmp_path / "load.cir").write_text(script)
    quiet = {"stdin": subprocess.DEVNULL, "capture_output": True, "timeout": 30.0}
    subprocess.run([ngspice, "-n", "-b", "load.cir"], cwd=tmp_path, check=False, **quiet)
    expected = np.column_stack([waveforms.time, waveforms["n1"], waveforms["n0"]])
    # 17 digits name a double exactly.
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "b.txt"), expected)


def raw_bytes(tmp_path: Path, points: int = 3) -> bytes:
    write_raw(tmp_path / "good.raw", record(points))
    return (tmp_path / "good.raw").read_bytes()


REFUSED = {
    "complex": (b"Flags: real", b"Flags: complex", "complex"),
    "padded": (b"Flags: real", b"Flags: real padded", "padded"),
    "no flags": (b"Flags: real\n", b"", "missing"),
    "text": (b"Binary:", b"Values:", "are text"),
    "negative": (b"No. Points: 3", b"No. Points: -3", "no. points"),
    "fewer names": (b"\t2\tv(n1)\tvoltage\n", b"", "announced"),
    "wrong index": (b"\t2\tv(n1)", b"\t3\tv(n1)", "bad vector line"),
    "another file": (b"Title:", b"Title", "not a raw file"),
    "more points": (b"No. Points: 3", b"No. Points: 2", "48"),
    "5,000 digits": (b"No. Points: 3", b"No. Points: 3" + b"0" * 5000, "'no. points' is '30000.*a"),
    "no points": (b"No. Points: 3", b"No. Points: 0", "no points"),
    "two plots": (b"Title:", None, "several plots"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str, tmp_path: Path) -> None:
    old, new, message = REFUSED[case]
    good = raw_bytes(tmp_path)
    assert old in good
    bad = good + good if new is None else good.replace(old, new, 1)
    if case == "no points":
        bad = bad.partition(b"Binary:")[0] + b"Binary:\n"
    (tmp_path / "bad.raw").write_bytes(bad)
    with pytest.raises(BadEvidence, match=message):
        read_raw(tmp_path / "bad.raw")
    with pytest.raises(BadEvidence, match="never written"):
        read_raw(tmp_path / "nowhere.raw")


def test_a_file_that_was_not_written_to_its_end_is_a_full_disk(tmp_path: Path) -> None:
    """On a full disk ngspice loses whole blocks, or the number of points, which it writes last."""
    good, path = raw_bytes(tmp_path), tmp_path / "cut.raw"
    header = good.partition(b"Binary:")[0]
    cuts = [good[:size] for size in (0, header.index(b"No. Points"), len(header) - 9, len(header))]
    for content, message in (
        *((cut, "the header has no end.*Free space") for cut in cuts),
        (good.replace(b"No. Points: 3", b"No. Points: 0"), "72 bytes .* never written.*Free space"),
        (good[:-1], "71 of 72 bytes"),
    ):
        path.write_bytes(content)
        with pytest.raises(OutOfDisk, match=message):
            read_raw(path)
    plot = read_raw(path, partial=True)
    np.testing.assert_array_equal(plot.data[:, 0], record(3).time[:2])


def header(flags: str, points: int = len(TIME)) -> str:
    return (
        HEAD.format(flags)
        + f"No. Variables: 4\nNo. Points: {points}\nOffset: 0.0\nCommand: other\nVariables:\n"
        + VARIABLES
    )


def binary(time: Floats = TIME, volts: Floats = VOLTS) -> bytes:
    """As ngspice writes it."""
    table = np.column_stack([time, volts[:, 0], np.full(len(time), 7.0), volts[:, 1]])
    return (header("real") + "Binary:\n").encode() + table.tobytes()


def ltspice(kind: str = "<f4") -> bytes:
    """As LTspice writes it: a header in UTF-16, doubles for time, and single precision."""
    double = " double" if kind == "<f8" else ""
    fields = [("t", "<f8"), ("out", kind), ("i", kind), ("b", kind)]
    table = np.zeros(len(TIME), np.dtype(fields))
    table["t"], table["out"], table["b"] = TIME, *VOLTS.T
    table["t"][2] *= -1.0  # a point that compression marked
    return (header(f"real forward{double}") + "Binary:\n").encode("utf-16-le") + table.tobytes()


@pytest.mark.parametrize("content", [binary(), ltspice(), ltspice("<f8")])
def test_forms_of_other_programs_give_the_same_waveforms(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.raw").write_bytes(content)
    found = read_transient(tmp_path / "a.raw")
    assert found.nodes == ("out", "b")
    assert found.time.tolist() == TIME.tolist()
    assert found.values.tolist() == VOLTS.tolist()


def test_of_equal_instants_the_last_counts(tmp_path: Path) -> None:
    time = np.array([0.0, 1e-6, 1e-6, 4e-6])
    write_raw(tmp_path / "a.raw", Waveforms(time, ("out", "b"), VOLTS, "other", Cost(0.0, 4)))
    found = read_transient(tmp_path / "a.raw")
    assert found.time.tolist() == [0.0, 1e-6, 4e-6]
    assert found.values.tolist() == VOLTS[[0, 2, 3]].tolist()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "does not begin with 'Title:'"),
        (b"PK\x03\x04 something else", "does not begin with 'Title:'"),
        (header("real").encode() + b"Values:\n 0\t0.0\n", "a binary raw file is needed"),
        (binary(TIME[::-1]), "time decreases: several runs in one file"),
        (ltspice()[:-3], "Not enough data"),
        (ltspice("<f8")[:-30], "Not enough data"),
        (header("real").encode() + b"Binary:\n" + b"\0" * 100, "100 of 128 bytes"),
        (binary().replace(b"Transient", b"AC analys"), "it has 0 transients"),
        (binary(volts=VOLTS * np.nan), "a value is not finite"),
        (binary().replace(b"V(out)", b"I(out)").replace(b"V(b)", b"I(b)"), "no node voltage"),
    ],
)
def test_what_is_no_whole_transient_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "a.raw").write_bytes(content)
    with pytest.raises(InputError, match="raw file") as error:
        read_transient(tmp_path / "a.raw")
    assert reason in str(error.value)
    assert str(tmp_path / "a.raw") in str(error.value)
