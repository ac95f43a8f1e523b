"""``taction --json --help``: every command with its arguments and options, as one document."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from typing import Any

import click

from taction.cli.terminal import own_name

TYPES = {  # click's names
    "Bool": "boolean",
    "File": "path",
    "Float": "number",
    "FloatRange": "number",
    "NumberRange": "number",
    "Int": "integer",
    "IntRange": "integer",
    "Path": "path",
    "String": "text",
    "Tuple": "text",
}


def reference(main: click.Group, names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the commands, or those of `names` and those below them; made from click."""
    from taction.verification.report.documents.catalogue import document_head

    with main.make_context("taction", [], resilient_parsing=True) as context:
        commands = list(_commands(main, context, names))
    return document_head("help") | {
        "program": "taction",
        "usage": "taction COMMAND [OPTIONS] [ARGUMENTS]; --json: one document on stdout",
        "commands": commands,
    }


def _commands(
    group: click.Group, context: click.Context, names: Sequence[str] = ()
) -> Iterator[dict[str, Any]]:
    for short in group.list_commands(context):
        if names and short not in names:
            continue
        command = group.get_command(context, short)
        if command is None:
            continue
        name = " ".join([*context.command_path.split()[1:], short])
        with click.Context(command, info_name=short, parent=context) as inner:
            if command.name:  # a family of commands does nothing itself
                yield _command(command, name, inner)
            if isinstance(command, click.Group):
                yield from _commands(command, inner)


def _command(command: click.Command, name: str, context: click.Context) -> dict[str, Any]:
    from taction.verification.report.documents.catalogue import ERROR, MODELS, schema_name

    parameters = [_parameter(p, context) for p in command.get_params(context)]
    schema = own_name(context)
    documents = [key for key in MODELS if key == schema or key.startswith(f"{schema}-")]
    return {
        "name": name,
        "usage": f"taction {' '.join([name, *command.collect_usage_pieces(context)])}",
        "help": inspect.cleandoc(command.help or ""),
        "arguments": [p for p in parameters if p.pop("kind") == "argument"],
        "options": [p for p in parameters if "flags" in p],
        "schemas": [schema_name(key) for key in (*documents, ERROR)],
    }


def _parameter(parameter: click.Parameter, context: click.Context) -> dict[str, Any]:
    """Return an argument or an option as plain data."""
    info = parameter.to_info_dict()
    kind = dict(info["type"])
    choices = kind.get("choices")
    record: dict[str, Any] = {
        "kind": info["param_type_name"],
        "name": info["name"],
        "type": "choice" if choices is not None else TYPES[kind["param_type"]],
        "required": info["required"],
        "several": bool(info["multiple"]) or info["nargs"] == -1,
    }
    record |= {key: kind[key] for key in ("min", "max") if kind.get(key) is not None}
    record |= {} if choices is None else {"choices": list(choices)}
    if isinstance(parameter, click.Option):
        default = parameter.get_default(context)
        record |= {
            "flags": [*parameter.opts, *parameter.secondary_opts],
            "is_flag": parameter.is_flag,
            "default": default if isinstance(default, str | int | float | bool) else None,
            "metavar": parameter.metavar,
            "envvar": parameter.envvar,
            "help": parameter.help or "",
        }
    return record
