"""Files of numbers: matrices, the axes of a sweep, raw files and logs of a simulator."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from taction.netlist_gen.scene.axes import parse_axes
from taction.netlist_gen.scene.inverse_problem import read_array
from taction.system.array_types import Cost, Waveforms
from taction.system.raw_file import write_raw
from taction.verification.engines.ngspice.evidence import Ending, accepted_waveforms
from taction.verification.studies.sweep import Plan
from tests.fuzz.edits import BYTE_EDITS, VALUE_EDIT, Target, edited
from tests.support.making import make_scene
from tests.support.small_decks import transient

NUMBERS = np.array([[1.0, -0.25, 3e-7], [0.0, 2.5, 1e30]])
SCENE = make_scene()


def _npy(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _reader(name: str, expected: Callable[[bytes], np.ndarray]) -> Callable[[bytes, Path], str]:
    def examine(content: bytes, folder: Path) -> str:
        (folder / name).write_bytes(content)
        scene = SCENE.model_copy()
        scene._file = folder / "scene.toml"
        values = read_array(scene, "problem.matrix", name, (None, None))
        assert np.isfinite(values).all()
        np.testing.assert_array_equal(values, expected(content))
        return "accepted, the same numbers"

    return examine


def _split(content: bytes) -> np.ndarray:
    """Read numbers between commas without the csv module; quotes are taken away."""
    text = content.decode("utf-8-sig")
    lines = [line for line in re.split("\r\n|\r|\n", text) if re.sub('[,"]', "", line).strip()]
    rows = [line.split(",") for line in lines if not line.lstrip(' \t"').startswith("#")]
    return np.array([[float(cell.replace('"', "")) for cell in row] for row in rows])


def _axes(content: bytes, folder: Path) -> str:
    words = content.decode("utf-8", "replace").split("\n")
    groups = parse_axes(SCENE, words)
    plan = Plan(SCENE, groups, "statespace")
    values = [plan.values_at(place) for place in range(min(5, plan.points))]
    assert values
    return "accepted"


CSV = b"\n".join(b",".join(b"%r" % x for x in row) for row in NUMBERS.tolist())
NPY = [_npy(NUMBERS.round(1).clip(-9.0, 9.0).astype(kind)) for kind in ("<f8", ">f4", "i8", "u1")]
NPY.append(_npy(np.asfortranarray(NUMBERS)))
AXES = [b"C=1pF:1nF:31", b"gain=10k:1M:21:lin", b"lambda=0.1,0.2", b"C=1p:2p:3 gain=1M:2M:3"]

TABLES = (
    Target(
        "matrices, CSV",
        edited([CSV, b"# y\n1,2\r\n\n3,4\n", b"1\n"], [VALUE_EDIT, *BYTE_EDITS]),
        _reader("T.csv", _split),
    ),
    Target(
        "matrices, .npy",
        edited(NPY, [VALUE_EDIT, *BYTE_EDITS]),
        _reader("T.npy", lambda content: np.load(io.BytesIO(content), allow_pickle=False)),
    ),
    Target("axes of a sweep", edited(AXES, [VALUE_EDIT, *BYTE_EDITS]), _axes),
)

DECK = transient(saved=("out", "in"), stop=1e-6, step=1e-7)
TIME = np.linspace(0.0, 1e-6, 11)
RECORD = Waveforms(TIME, DECK.saved, np.outer(TIME, [1e6, 2e6]), "test", Cost(0.0, 11))
# Of design.md: what no accepted run has in its error stream.
FATAL = ("error", "fatal", "aborted", "interrupted", "too small", "unusual leading", "to low")
LOG_LINES = (
    *("", "Note: Starting dynamic gmin stepping", "Note: Dynamic gmin stepping completed"),
    *("Warning: singular matrix:  check node a", "Note: No compatibility mode selected!"),
    *("doAnalyses: TRAN:  Timestep too small; time = 1e-9", "run simulation(s) aborted"),
    *("Warning: rawfile write error !!", "Error on line 3 : r1", "Fatal error", "to low"),
    *("Warning: can't find model 'x'", "Unusual leading characters", "x" * 3000, "\x00\x1b[2J"),
)


def _good(folder: Path) -> bytes:
    write_raw(folder / "out.raw", RECORD)
    return (folder / "out.raw").read_bytes()


def _base() -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return _good(Path(folder))


def _columns(content: bytes) -> dict[str, list[float]]:
    """Read a raw file by its own rules: names in tab lines, then rows of little-endian doubles."""
    head, _, data = content.partition(b"\nBinary:\n")
    lines = [row.split() for row in head.split(b"\n") if row.startswith(b"\t")]
    names = [words[1].decode("utf-8", "replace") for words in lines]
    values = struct.unpack(f"<{len(data) // 8}d", data)
    return {name: list(values[k :: len(names)]) for k, name in enumerate(names)}


def _examine_raw(content: bytes, folder: Path) -> str:
    (folder / "out.raw").write_bytes(content)
    ending = Ending(0, False, 1.0, 0.1, "", folder)
    waveforms = accepted_waveforms(DECK, ending, engine="test", bound=1e6)
    columns = _columns(content)
    assert columns["time"] == waveforms.time.tolist()
    assert [columns[f"v({node})"] for node in DECK.saved] == waveforms.values.T.tolist()
    assert all(a < b for a, b in zip(columns["time"], columns["time"][1:], strict=False))
    assert np.isfinite(waveforms.values).all()
    return "accepted, the same numbers"


def _examine_log(content: bytes, folder: Path) -> str:
    _good(folder)
    text = content.decode("utf-8", "replace")
    accepted_waveforms(DECK, Ending(0, False, 1.0, 0.1, text, folder), engine="test", bound=1e6)
    assert not [word for word in FATAL if word in text.lower()]
    return "accepted"


LOGS = st.lists(st.sampled_from(LOG_LINES), max_size=6).map(lambda lines: "\n".join(lines).encode())

SIMULATOR_FILES = (
    Target("raw files", edited([_base()], [VALUE_EDIT, *BYTE_EDITS]), _examine_raw),
    Target("logs", LOGS.flatmap(lambda log: edited([log], BYTE_EDITS)), _examine_log),
)
