"""Build step: an installed taction has one top-level package, ``taction``.

The source tree has four more top-level folders, with general names such as ``cli``, which other
projects use, too. For a wheel `build_py` moves these folders below ``taction`` and rewrites the
imports between them, and nothing else. An editable installation uses the source tree unchanged.
"""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.egg_info import egg_info

ROOT = "taction"
MOVED = ("spice_models", "netlist_gen", "verification", "cli")


def rewritten(source: str) -> str:
    """Return the text of a module with its imports of `MOVED` below `ROOT`.

    Raises
    ------
    SyntaxError
        An ``import folder.module``, which would bind another name below `ROOT`.
    """
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and _is_moved(node.module or ""):
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line.replace("from ", f"from {ROOT}.", 1)
        elif isinstance(node, ast.Import) and any(_is_moved(name.name) for name in node.names):
            if len(node.names) > 1 or "." in node.names[0].name or node.names[0].asname:
                raise SyntaxError(f"line {node.lineno}: write 'from folder import module' instead")
            line = lines[node.lineno - 1]
            lines[node.lineno - 1] = line.replace("import ", f"from {ROOT} import ", 1)
    return "".join(lines)


def _is_moved(module: str) -> bool:
    return module.partition(".")[0] in MOVED


class OnePackage(build_py):
    """`build_py` that puts the folders `MOVED` below `ROOT`."""

    def run(self) -> None:
        """Copy the modules as setuptools does, then move and rewrite the copies."""
        super().run()
        if self.editable_mode:
            return
        library = Path(self.build_lib)
        for name in MOVED:
            target = library / ROOT / name
            shutil.rmtree(target, ignore_errors=True)  # from an earlier build
            (library / name).rename(target)
        for file in (library / ROOT).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            if (new := rewritten(text)) != text:
                file.write_text(new, encoding="utf-8")


class OneName(egg_info):
    """`egg_info` that declares `ROOT` as the only top-level name."""

    def run(self) -> None:
        """Write the metadata as setuptools does, then replace the list of top-level names."""
        super().run()
        (Path(self.egg_info) / "top_level.txt").write_text(f"{ROOT}\n", encoding="utf-8")


setup(cmdclass={"build_py": OnePackage, "egg_info": OneName})
