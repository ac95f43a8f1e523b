"""Write a man page for taction and for each command into docs/_build/man, from click."""

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from taction.cli.main import main as taction
from taction.cli.reference import ENVIRONMENT, EXIT_STATUSES, reference

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "_build" / "man"


def pages(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the name of each page and its text."""
    commands = document["commands"]
    listed = [(command["name"], command["help"].split("\n")[0]) for command in commands]
    about = "design and verify regularising op-amp and resistor networks with SPICE"
    entries = [line for entry in listed for line in _entry(*entry)]
    yield "taction", _page("taction", about, [(".SH COMMANDS", entries)], "taction COMMAND ...")
    for command in commands:
        about, _, more = command["help"].partition("\n")
        options = [line for option in command["options"] for line in _option(option)]
        parts = [(".SH DESCRIPTION", _paragraphs(more)), (".SH OPTIONS", options)]
        name = f"taction-{command['name'].replace(' ', '-')}"
        yield name, _page(name, about.rstrip("."), parts, command["usage"])


def _page(name: str, about: str, parts: list[tuple[str, list[str]]], usage: str) -> str:
    ends = [(str(status), text) for status, text in EXIT_STATUSES.items()]
    tables = ((".SH EXIT STATUS", ends), (".SH ENVIRONMENT", list(ENVIRONMENT.items())))
    lines = [
        f'.TH {name.upper()} 1 "" "taction {metadata.version("taction")}"',
        ".SH NAME",
        f"{_plain(name)} \\- {_plain(about)}",
        ".SH SYNOPSIS",
        _plain(usage),
    ]
    for title, body in parts:
        lines += [title, *body] if body else []
    for title, table in tables:
        lines += [title, *(line for entry in table for line in _entry(*entry))]
    return "\n".join(lines) + "\n"


def _option(option: dict[str, Any]) -> list[str]:
    text = option["help"]
    if option["default"] not in (None, False):
        text += f" Default: {option['default']}."
    value = "" if option["is_flag"] else f" {option['metavar'] or option['type'].upper()}"
    return _entry(", ".join(option["flags"]) + value, text)


def _entry(name: str, text: str) -> list[str]:
    return [".TP", f"\\fB{_plain(name)}\\fR", _plain(text)]


def _paragraphs(text: str) -> list[str]:
    blocks = [" ".join(block.split()) for block in text.split("\n\n")]
    return [line for block in blocks if block for line in (".PP", _plain(block))]


def _plain(text: str) -> str:
    """Return `text` without the signs that roff reads: backslashes, and dots that begin a line."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + escaped if escaped.startswith((".", "'")) else escaped


def main() -> None:
    """Write all pages."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, text in pages(reference(taction)):
        (FOLDER / f"{name}.1").write_text(text, encoding="utf-8")
    print(f"wrote the man pages into {FOLDER}")


if __name__ == "__main__":
    main()
