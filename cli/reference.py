"""``taction --json --help``: everything that scripts and agents need, as one document."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import click

EXIT_STATUSES = {
    0: "pass, or the question was answered",
    1: "a check failed, or results differ",
    2: "bad input: a scene, a file or an option",
    3: "no verdict: inconclusive, or no result to trust",
    129: "SIGHUP, after all clean-up",
    130: "SIGINT (Ctrl-C), after all clean-up",
    141: "the reader of stdout has gone",
    143: "SIGTERM, after all clean-up",
}
ENVIRONMENT = {
    "TACTION_NGSPICE": "an ngspice in the place of the one on the PATH",
    "COLUMNS": "width of the tables where stdout is no terminal; 160 by default",
    "NO_COLOR": "set: no colours on a terminal",
    "GITHUB_ACTIONS": "true: `taction verify` prints annotations, as with --annotate",
    "OMP_NUM_THREADS": "threads of the numerical libraries; 1 by default, ngspice uses other cores",
    "OPENBLAS_NUM_THREADS": "the same",
    "MKL_NUM_THREADS": "the same",
    "TMPDIR": "folder of temporary files and of simulations",
    "_TACTION_COMPLETE": "bash_source, zsh_source or fish_source: print the shell completion",
}
TYPES = {  # click's names
    "Bool": "boolean",
    "File": "path",
    "Float": "number",
    "FloatRange": "number",
    "Int": "integer",
    "IntRange": "integer",
    "Path": "path",
    "String": "text",
    "Tuple": "text",
}


def reference(main: click.Group) -> dict[str, Any]:
    """Return commands, exit statuses, environment variables and schemas; made from click.

    `fields` says for every field of a document its unit and the schemas that have it.
    """
    from taction.cli.reference_examples import EXAMPLES, SCENE_FILE
    from taction.netlist_gen.scene.scene import scene_type
    from taction.verification.report.schemas.catalogue import MODELS, fields, schema
    from taction.verification.report.schemas.head import document_head, schema_name

    with main.make_context("taction", [], resilient_parsing=True) as context:
        commands = list(_commands(main, context))
    return document_head("help", {}) | {
        "program": "taction",
        "usage": "taction COMMAND [OPTIONS] [ARGUMENTS]; --json: one document on stdout",
        "commands": commands,
        "exit_statuses": {str(status): text for status, text in EXIT_STATUSES.items()},
        "environment": ENVIRONMENT,
        "scene_file": SCENE_FILE,
        "examples": list(EXAMPLES),
        "fields": fields(),
        "schemas": {schema_name(name): schema(name) for name in MODELS},
        "scene_schema": scene_type().model_json_schema(by_alias=True),
    }


def _commands(group: click.Group, context: click.Context) -> Iterator[dict[str, Any]]:
    from taction.verification.report.schemas.catalogue import MODELS
    from taction.verification.report.schemas.head import ERROR, schema_name

    for short in group.list_commands(context):
        command = group.get_command(context, short)
        if command is None:
            continue
        name = " ".join([*context.command_path.split()[1:], short])
        with click.Context(command, info_name=short, parent=context) as inner:
            parameters = [_parameter(p, inner) for p in command.get_params(inner)]
            schema = name.replace(" ", "-")
            documents = [key for key in MODELS if key == schema or key.startswith(f"{schema}-")]
            yield {
                "name": name,
                "usage": f"taction {' '.join([name, *command.collect_usage_pieces(inner)])}",
                "help": inspect.cleandoc(command.help or ""),
                "arguments": [p for p in parameters if p.pop("kind") == "argument"],
                "options": [p for p in parameters if "flags" in p],
                "schemas": [schema_name(key) for key in (*documents, ERROR)],
            }
            if isinstance(command, click.Group):
                yield from _commands(command, inner)


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
