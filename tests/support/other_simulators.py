"""Decks of other dialects, run by programs that are not ours; readings without taction's code."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from spicelib import RawRead

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck
from taction.verification.engines.ngspice.process import find_simulator

Record = tuple[NDArray[np.float64], NDArray[np.float64]]  # time (P,), voltages (K, P)

_ROW = re.compile(r" ?\d+(\.\d*)?(E[-+]?\d+)? ")
_ANALYSES = (".option", ".print", ".tran", ".save", ".end\n", "accuracy ", "save ", "transient ")


def run_ngspice(deck: Deck, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a deck; `words` stand before the name of its file."""
    (folder / "deck.cir").write_text(deck.text)
    return subprocess.run(
        [find_simulator().executable, "-b", "-n", *words, "deck.cir"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=120.0,
        stdin=subprocess.DEVNULL,
    )


def ngspice_record(deck: Deck, folder: Path, mode: str = "") -> Record:
    """Run a deck in a compatibility mode of ngspice; its file is read by spicelib."""
    words = ["-D", f"ngbehavior={mode}"] if mode else []
    run_ngspice(deck, folder, *words, "-r", "out.raw")
    raw = RawRead(str(folder / "out.raw"), verbose=False)
    saved = [raw.get_trace(f"v({node})").get_wave() for node in deck.saved]
    return raw.get_trace("time").get_wave().astype(float), np.array(saved, dtype=float)


def gnucap_record(executable: str, deck: Deck) -> Record:
    """Run the parts of a deck in gnucap, with a transient of its own from zero.

    gnucap 0.36 does not know the options, ``.tran`` with four times, and Spectre's analyses.
    """
    spectre, run = deck.dialect == "spectre", deck.analysis
    assert isinstance(run, Transient)
    lines = deck.text.split("\n")[1:]
    unknown = (*_ANALYSES, "global 0", "simulator ", "include ", ".include ", ".end")
    known = [line for line in lines if not line.startswith(unknown) or line.startswith(".ends")]
    tail = [
        ".options method=trap reltol=1e-6 numdgt=12",
        ".print tran " + " ".join(f"v({node})" for node in deck.saved),
        f".tran {run.max_step!r} {run.stop!r} 0 uic basic",
        "",
    ]
    head = "simulator lang=spectre" if spectre else "simulator lang=spice"
    text = "\n".join([head, *known, "simulator lang=spice" if spectre else "", *tail])
    result = subprocess.run(
        [executable], input=text, capture_output=True, text=True, check=True, timeout=120.0
    )
    rows = [line.split() for line in result.stdout.splitlines() if _ROW.match(line)]
    table = np.array([row for row in rows if len(row) == len(deck.saved) + 1], dtype=float)
    return table[:, 0], table[:, 1:].T


def distance(one: Record, other: Record) -> float:
    """Return the largest difference of two records at the points of `one`, in largest swings."""
    (time, values), (instants, others) = one, other
    swing = float(np.ptp(values, axis=1).max())
    there = np.array([np.interp(time, instants, row) for row in others])
    inside = time <= instants[-1]
    return float(np.abs(values - there)[:, inside].max()) / swing
