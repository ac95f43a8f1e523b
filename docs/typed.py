"""The directive `typed`: commands, run when the page is built, with what the terminal prints.

All commands run in one folder with `FILES` and the folder `scenes`, in the order in which Sphinx
reads the pages; a command that was run before has the output of then.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[1]
FILES = {
    "board.toml": ROOT / "scenes" / "paper-breadboard.toml",
    "fet100.cir": ROOT / "tests" / "data" / "fet100.cir",
}
COLUMNS = 80  # of the terminal
LONGEST = 60  # s, of a command on an idle machine; ten times as long is an error


class Typed(SphinxDirective):
    """Show commands with their outputs, each with a `$` before it.

    With ``:first: N`` and ``:last: N`` only so many lines of an output are shown, `[...]` between.
    """

    has_content = True
    option_spec = {  # noqa: RUF012, docutils reads it from the class
        "first": directives.positive_int,
        "last": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        """Return the block of text."""
        shown = []
        for line in self.content:
            shown += [f"$ {line}", *self._cut(output_of(line).splitlines()), ""]
        text = "\n".join(shown).rstrip()
        return [nodes.literal_block(text, text, language="text", classes=["terminal"])]

    def _cut(self, lines: list[str]) -> list[str]:
        first, last = self.options.get("first", 0), self.options.get("last", 0)
        if not (first or last) or len(lines) <= first + last:
            return lines
        return [*lines[:first], "[...]", *lines[len(lines) - last :]]


_outputs: dict[str, str] = {}
_folder: list[Path] = []


def output_of(line: str) -> str:
    """Run a command in the folder of the pages and return what it prints on a terminal's stdout.

    RuntimeError: the command ended with bad input or without a verdict.
    """
    if line not in _outputs:
        if not _folder:
            _folder.append(Path(tempfile.mkdtemp(prefix="docs-typed-")))
            for name, file in FILES.items():
                shutil.copy(file, _folder[0] / name)
            (_folder[0] / "scenes").symlink_to(ROOT / "scenes")
        environment = {
            **os.environ, "COLUMNS": str(COLUMNS), "NO_COLOR": "1",
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        }  # fmt: skip
        done = subprocess.run(  # noqa: S602, the line is of the documentation
            line, shell=True, cwd=_folder[0], env=environment,
            capture_output=True, text=True, check=False, timeout=10 * LONGEST,
        )  # fmt: skip
        if done.returncode not in (0, 1):
            raise RuntimeError(f"{line}: exit status {done.returncode}\n{done.stderr}")
        _outputs[line] = "\n".join(row.rstrip() for row in done.stdout.rstrip().splitlines())
    return _outputs[line]


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_directive("typed", Typed)
    app.connect("build-finished", lambda app, error: _clear())
    return {"parallel_read_safe": False}


def _clear() -> None:
    for folder in _folder:
        shutil.rmtree(folder, ignore_errors=True)
    _folder.clear()
