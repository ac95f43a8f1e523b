"""Where a report comes from: versions, engine, hashes, and the deck to copy."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.html.blocks import Block, Code, Facts, Notes, Section
from taction.verification.studies.running.digests import digest, files_of, own_code
from taction.verification.studies.running.versions import describe_machine
from taction.verification.verdict.verify import Verdict

LONGEST = 400_000  # characters of a deck in a report
SHOWN = ("date", "taction", "python", "numpy", "scipy", "ngspice", "system", "processor", "cores")


def machine_rows() -> tuple[tuple[str, str], ...]:
    """Return the versions and the machine."""
    machine = describe_machine()
    return tuple((name, "none" if machine[name] is None else str(machine[name])) for name in SHOWN)


def origin_rows(scene: Scene) -> tuple[tuple[str, str], ...]:
    """Return versions, machine, and the SHA-256 of every file that the scene was read from."""
    rows = [*machine_rows()]
    rows.append(("SHA-256 of taction's source", own_code().hex()))
    rows += [(f"SHA-256 of {name}", text) for name, text in _hashes(scene)]
    return tuple(rows)


def _hashes(scene: Scene) -> Iterator[tuple[str, str]]:
    """Yield the hashes of the files of a scene that still exist, and of its arrays in memory."""
    yield from _file_hash(str(scene.file), Path(scene.file))
    for key, value in files_of(scene).items():
        if isinstance(value, str | Path):
            yield from _file_hash(str(value), scene.folder / value)
        elif value is not None:
            yield f"{key}, an array", digest(value).hex()


def _file_hash(name: str, file: Path) -> Iterator[tuple[str, str]]:
    if file.is_file():
        yield name, hashlib.sha256(file.read_bytes()).hexdigest()


def origin_section(scene: Scene, more: tuple[tuple[str, str], ...] = ()) -> Section:
    """Return the versions and hashes behind a report, after the rows `more`."""
    rows = (("scene file", str(scene.file)), *more, *origin_rows(scene))
    return Section("Versions and hashes", (Facts("", rows),))


def plain_origin(more: tuple[tuple[str, str], ...]) -> Section:
    """Return the versions behind a report on many scenes."""
    return Section("Versions and hashes", (Facts("", (*more, *machine_rows())),))


def run_rows(document: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the engine of a verdict in words."""
    names = ("simulator", "solver", "method")
    return tuple((name, str(document[name] or "–")) for name in names)


def deck_section(verdict: Verdict) -> Section:
    """Return the deck of the simulated board, to copy."""
    deck = write_deck(verdict.circuit, verdict.transient).text
    digest = ("SHA-256 of the deck", hashlib.sha256(deck.encode()).hexdigest())
    size = f"{len(deck.splitlines())} lines"
    block: Block = Code(
        "the deck", deck, f"{size}; it runs with: ngspice -b -r board.raw board.cir"
    )
    if len(deck) > LONGEST:
        text = (
            f"The deck has {size} and is too long for this page: taction netlist SCENE -o board.cir"
        )
        block = Notes("", (text,))
    return Section("Deck", (block, Facts("", (digest,))))
