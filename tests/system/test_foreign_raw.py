"""Raw files of other programs: every form gives the same waveforms, and a cut file none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.system.errors import InputError
from taction.system.raw_file import read_transient, write_raw
from taction.system.waveforms import Cost, Waveforms

TIME = np.array([0.0, 1e-6, 3e-6, 4e-6])
VOLTS = np.array([[0.0, 1.0], [0.5, -2.0], [0.25, 3.5], [0.125, 0.75]])  # exact in single precision
HEAD = "Title: * other\nDate: Mon\nPlotname: Transient Analysis\nFlags: {}\n"
VARIABLES = "\t0\ttime\ttime\n\t1\tV(out)\tvoltage\n\t2\tI(R1)\tcurrent\n\t3\tV(b)\tvoltage\n"


def header(flags: str, points: int = len(TIME)) -> str:
    return (
        HEAD.format(flags)
        + f"No. Variables: 4\nNo. Points: {points}\nOffset: 0.0\nCommand: other\nVariables:\n"
        + VARIABLES
    )


def text(time: Floats = TIME) -> bytes:
    """As ngspice writes it with `set filetype=ascii`."""
    rows = [
        f" {k}\t{t!r}\n\t{out!r}\n\t7.0\n\t{b!r}\n\n"
        for k, (t, (out, b)) in enumerate(zip(time.tolist(), VOLTS.tolist(), strict=True))
    ]
    return (header("real") + "Values:\n" + "".join(rows)).encode()


def ltspice(kind: str = "<f4") -> bytes:
    """As LTspice writes it: a header in UTF-16, doubles for time, and single precision."""
    double = " double" if kind == "<f8" else ""
    fields = [("t", "<f8"), ("out", kind), ("i", kind), ("b", kind)]
    table = np.zeros(len(TIME), np.dtype(fields))
    table["t"], table["out"], table["b"] = TIME, *VOLTS.T
    table["t"][2] *= -1.0  # a point that compression marked
    return (header(f"real forward{double}") + "Binary:\n").encode("utf-16-le") + table.tobytes()


@pytest.mark.parametrize("content", [text(), ltspice(), ltspice("<f8")])
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
        (text()[:-2], "its last line is cut off"),
        (text(TIME[::-1]), "time decreases: several runs in one file"),
        (ltspice()[:-3], "Not enough data"),
        (ltspice("<f8")[:-30], "Not enough data"),
        (header("real").encode() + b"Binary:\n" + b"\0" * 100, "100 of 128 bytes"),
        (text().replace(b"Transient", b"AC analys"), "it has 0 transients"),
        (text().replace(b"0.5", b"nan"), "a value is not finite"),
        (text().replace(b"V(out)", b"I(out)").replace(b"V(b)", b"I(b)"), "no node voltage"),
    ],
)
def test_what_is_no_whole_transient_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    (tmp_path / "a.raw").write_bytes(content)
    with pytest.raises(InputError, match="raw file") as error:
        read_transient(tmp_path / "a.raw")
    assert reason in str(error.value)
    assert str(tmp_path / "a.raw") in str(error.value)
