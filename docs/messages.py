"""The index of error messages, read from the sources: the texts of every error that taction raises.

A part of a message that is known only at run time, such as a value or a file, is written as `…`.
"""

from __future__ import annotations

import ast
import functools
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scripts.rooms import modules
from taction.system import errors

OPEN = "…"  # in the place of what is known only at run time
WHERE_VALUES_ARE_READ = ("netlist_gen.scene", "spice_models", "system", "verification.characterise")
"""Rooms whose `ValueError` becomes the reason of an `InputError`."""
OF_INPUT = {"Complaint", "UnusableFileError", "RefusedError"}
SHORTEST = 8  # characters of a text that can be found in an index


@dataclass(frozen=True, slots=True, order=True)
class Message:
    """One text: the exception, the text with `…` for open parts, and the keys that it names."""

    kind: str
    text: str
    keys: tuple[str, ...] = ()


def kinds() -> dict[str, type[errors.TactionError]]:
    """Return every exception by its name, the root first."""
    found = {errors.TactionError.__name__: errors.TactionError}
    for name, each in vars(errors).items():
        if inspect.isclass(each) and issubclass(each, errors.TactionError):
            found[name] = each
    return found


@functools.cache
def messages() -> list[Message]:
    """Return the messages of all modules, sorted by kind and text."""
    keys = dict[tuple[str, str], set[str]]()
    for name, path in modules().items():
        for kind, text, key in _of_module(name, ast.parse(Path(path).read_text("utf-8"))):
            keys.setdefault((kind, text), set()).add(key)
    return sorted(Message(*each, tuple(sorted(found - {""}))) for each, found in keys.items())


def _of_module(name: str, tree: ast.Module) -> Iterator[tuple[str, str, str]]:
    """Yield kind, text and key of every error that a module makes."""
    known = {**{kind: kind for kind in kinds()}, **dict.fromkeys(OF_INPUT, "InputError")}
    del known["InputError"]  # what it says are its complaints
    if name.startswith(WHERE_VALUES_ARE_READ):
        known["ValueError"] = "InputError"
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        calls = [
            (node.func.id, node)
            for node in ast.walk(function)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
        ]
        before = 0
        for word, call in sorted(calls, key=lambda each: each[1].lineno):
            if word not in known:
                continue
            names = _assigned([*tree.body, *ast.walk(function)], before, call.lineno)
            before = call.lineno
            complaint = word == "Complaint"
            key = next(_texts(call.args[0], names), OPEN) if complaint else ""
            for text in _texts(call.args[2 if complaint else 0], names):
                if len(text.replace(OPEN, "").strip(" :;,.'")) > SHORTEST:
                    yield known[word], " ".join(text.split()), key.strip()


def _assigned(nodes: list[ast.AST], after: int, line: int) -> dict[str, list[ast.expr]]:
    """Return the values of each name: those set between two lines, else the last one before."""
    found = dict[str, list[tuple[int, ast.expr]]]()
    for node in nodes:
        if not isinstance(node, ast.Assign) or node.lineno > line:
            continue
        for target in node.targets:
            several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            pairs = (
                zip(target.elts, node.value.elts, strict=False)
                if several
                else [(target, node.value)]
            )
            for name, value in pairs:
                if isinstance(name, ast.Name):
                    found.setdefault(name.id, []).append((node.lineno, value))
    return {
        name: [value for row, value in pairs if row > after] or [max(pairs, key=lambda p: p[0])[1]]
        for name, pairs in found.items()
    }


def _texts(node: ast.expr, names: dict[str, list[ast.expr]]) -> Iterator[str]:
    """Yield the texts that an expression can have, with `…` for its open parts."""
    match node:
        case ast.Constant(value=str() as text):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(p.value if isinstance(p, ast.Constant) else OPEN for p in parts)
        case ast.IfExp(body=body, orelse=other):
            yield from _texts(body, names)
            yield from _texts(other, names)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            ends = list(_texts(right, names)) or [OPEN]
            yield from (a + b for a in list(_texts(left, names)) or [OPEN] for b in ends)
        case ast.Name(id=name):
            rest = {key: value for key, value in names.items() if key != name}
            for value in names.get(name, ()):
                yield from _texts(value, rest)


def page() -> Iterator[str]:
    """Yield the lines of the page: a table of the kinds, then the messages of each kind."""
    found = messages()
    yield "# Index of error messages\n"
    yield "This page is made from the sources. `…` stands for a value, a name or a file. Search for"
    yield "a few words of your message. [Error messages](../errors.md) says how one is built.\n"
    yield "| kind | exit status | what it means | what to do |"
    yield "|---|---|---|---|"
    for name, each in kinds().items():
        meaning, remedy = said(each)
        yield f"| [{name}](#{name.lower()}) | {each.exit_status} | {meaning} | {remedy} |"
    for name, each in kinds().items():
        own = [message for message in found if message.kind == name]
        yield f"\n## {name}\n"
        meaning, remedy = said(each)
        yield f"{meaning} {remedy}\n"
        if own:
            keys = any(message.keys for message in own)
            yield "| message | key, option or part |" if keys else "| message |"
            yield "|---|---|" if keys else "|---|"
            for message in own:
                yield f"| {_cell(message.text)} |" + (
                    f" {_cell(', '.join(message.keys))} |" if keys else ""
                )


def said(kind: type[errors.TactionError]) -> tuple[str, str]:
    """Return the first paragraph of an exception's docstring, what it means, and the second one."""
    parts = [" ".join(part.split()) for part in (inspect.getdoc(kind) or "").split("\n\n")]
    remedy = parts[1] if len(parts) > 1 and not parts[1].startswith("Attributes") else ""
    return parts[0].replace("``", "`"), remedy.replace("``", "`")


def _cell(text: str) -> str:
    """Return a text with the marks of Markdown as letters."""
    return re.sub(r"([\\|<>*_`\[\]$])", r"\\\1", text)
