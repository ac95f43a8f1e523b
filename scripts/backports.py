"""Add the backports of this machine's own Debian mirror to its apt sources.

``backports.py CODENAME URI [FOLDER]`` copies the entry for `URI` in FOLDER (``/etc/apt``), with its
key and options, changes the suite to ``CODENAME-backports`` and the components to ``main``, writes
it as a file of its own under ``sources.list.d`` and prints that file's path. Both formats are
read: one line an entry (``.list``) and deb822 paragraphs (``.sources``); the copy keeps its format.
Exit status 1: no entry for this URI. Standard library only: it runs before anything is installed.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ONE_LINE = re.compile(r"^\s*deb\s+(?P<options>\[[^]]*\]\s+)?(?P<uri>\S+)\s+(?P<suite>\S+)\s+\S")
FIELD = re.compile(r"^(?P<name>[A-Za-z0-9-]+):(?P<value>.*)$")


def same_archive(uri: str, wanted: str) -> bool:
    """Whether two repository addresses name the same place."""
    return uri.rstrip("/") == wanted.rstrip("/")


def from_one_line(text: str, codename: str, uri: str) -> str | None:
    """Make the backports entry from a ``.list`` file's text; None if it has none for `uri`."""
    for line in text.splitlines():
        match = ONE_LINE.match(line)
        if match and same_archive(match["uri"], uri):
            return f"deb {match['options'] or ''}{match['uri']} {codename}-backports main\n"
    return None


def paragraphs(text: str) -> list[dict[str, str]]:
    """List the fields of each deb822 paragraph; a continued value keeps its line breaks."""
    found: list[dict[str, str]] = []
    for block in re.split(r"\n\s*\n", text):
        fields: dict[str, str] = {}
        last = ""
        for line in block.splitlines():
            if line.startswith("#"):
                continue
            match = FIELD.match(line)
            if match:
                last = match["name"].title()
                fields[last] = match["value"].strip()
            elif last:
                fields[last] += "\n" + line
        if fields:
            found.append(fields)
    return found


def from_paragraphs(text: str, codename: str, uri: str) -> str | None:
    """Make the backports paragraph from a ``.sources`` file's text; None if none is for `uri`."""
    for fields in paragraphs(text):
        enabled = fields.pop("Enabled", "yes").lower() not in {"no", "false", "0"}
        uris = fields.get("Uris", "").split()
        if enabled and "deb" in fields.get("Types", "").split():
            for candidate in uris:
                if same_archive(candidate, uri):
                    fields.update(
                        Types="deb",
                        Uris=candidate,
                        Suites=f"{codename}-backports",
                        Components="main",
                    )
                    return "".join(f"{name}: {value}\n" for name, value in fields.items())
    return None


def write_entry(codename: str, uri: str, folder: Path) -> Path | None:
    """Write the backports entry beside the machine's own; its path, or None without a source."""
    readers = {".list": from_one_line, ".sources": from_paragraphs}
    parts = folder / "sources.list.d"
    for path in (folder / "sources.list", *sorted(parts.glob("*"))):
        reader = readers.get(path.suffix)
        entry = (
            reader(path.read_text("utf-8"), codename, uri) if reader and path.is_file() else None
        )
        if entry is not None:
            target = parts / f"taction-{codename}-backports{path.suffix}"
            parts.mkdir(exist_ok=True)
            target.write_text(entry, "utf-8")
            return target
    return None


if __name__ == "__main__":
    written = write_entry(sys.argv[1], sys.argv[2], Path(*sys.argv[3:4] or ["/etc/apt"]))
    if written is None:
        sys.exit(1)
    print(written)
