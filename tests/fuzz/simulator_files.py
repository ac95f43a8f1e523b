"""Raw files and logs of a simulator."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from taction.system.raw_file import write_raw
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.ngspice.evidence import Ending, accepted_waveforms
from tests.fuzz.edits import BYTE_EDITS, VALUE_EDIT, edited
from tests.fuzz.target import Target
from tests.support.small_decks import transient

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
    Target(
        "logs",
        LOGS.flatmap(lambda log: edited([log], BYTE_EDITS)),
        _examine_log,
    ),
)
