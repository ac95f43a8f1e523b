"""``taction --json --help``: everything that scripts and agents need, as one document.

A test makes every call of `EXAMPLES` and reads every answer.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from typing import Any

import click

from taction.cli.terminal import own_name
from taction.netlist_gen.scene.keys import SYMBOLS

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
    "TACTION_FOLDERS": "folders, a JSON list of texts: other files are not read",
    "COLUMNS": "width of the tables where stdout is no terminal; 160 by default",
    "NO_COLOR": "set: no colours on a terminal",
    "GITHUB_ACTIONS": "true: `taction verify` and `regress` print annotations, as with --annotate",
    "OMP_NUM_THREADS": "threads of the numerical libraries; 1 by default, ngspice uses other cores",
    "OPENBLAS_NUM_THREADS": "the same",
    "MKL_NUM_THREADS": "the same",
    "TMPDIR": "folder of temporary files and of simulations",
    "_TACTION_COMPLETE": "bash_source, zsh_source or fish_source: print the shell completion",
}
SCENE = """\
[problem]
kind = "tactile"
channels = 3
[design]
capacitance = "100pF"
opamp = "opa189"
[checks]
settling_time = "1ms"
"""
SCENE_FILE: dict[str, Any] = {
    "format": "TOML; all keys, their types and defaults are in scene_schema",
    "quantities": "a number in SI base units, or text with prefix and unit: 1e-11 or '10pF';"
    " m is milli, M is mega, u is micro",
    "symbols": {**SYMBOLS, "gain": "design.gain", "lambda": "design.lambda"},
    "example": SCENE,
}
NUMBER = "settling_time"
EXAMPLES: tuple[dict[str, Any], ...] = (
    {
        "task": "verify a board with C = 100 pF and read its settling time, s",
        "files": {"board.toml": SCENE},
        "call": "taction verify board.toml --json",
        "schema": "verify-2",
        "read": [NUMBER],
    },
    {
        "task": "verify all scenes of a folder and read the outcome of the first",
        "files": {"boards/one.toml": SCENE},
        "call": "taction verify boards --json",
        "schema": "verify-files-2",
        "read": ["verdicts", 0, "outcome"],
    },
    {
        "task": "verify the board at five values of C and read the settling time at the last",
        "files": {"board.toml": SCENE},
        "call": "taction sweep board.toml --over C=10pF:100pF:5 --jobs 1 --json",
        "schema": "sweep-2",
        "read": ["points", 4, NUMBER],
    },
    {
        "task": "find the values of C at which the board begins to oscillate",
        "files": {"board.toml": SCENE},
        "call": "taction onset board.toml --over C=100fF:100pF:31 --no-confirm --json",
        "schema": "onset-2",
        "read": ["stable_ranges", 0, 0],
    },
    {
        "task": "read which key of a scene is wrong, and what would be accepted",
        "files": {"board.toml": SCENE.replace("capacitance", "capacitanc")},
        "call": "taction verify board.toml --json",
        "schema": "error-2",
        "read": ["error", "complaints", 0, "accepted"],
    },
)
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
    """Return commands, exit statuses, environment variables and schemas; made from click.

    `fields` says for every field of a document its unit and the schemas that have it. With `names`
    of commands it has only these commands and those below them, and no fields and schemas.
    """
    from taction.verification.report.documents.catalogue import document_head

    with main.make_context("taction", [], resilient_parsing=True) as context:
        commands = list(_commands(main, context, names))
    return document_head("help") | {
        "program": "taction",
        "usage": "taction COMMAND [OPTIONS] [ARGUMENTS]; --json: one document on stdout",
        "commands": commands,
        "exit_statuses": {str(status): text for status, text in EXIT_STATUSES.items()},
        "environment": ENVIRONMENT,
        "scene_file": SCENE_FILE,
        "examples": list(EXAMPLES),
        **_schemas(every=not names),
    }


def _schemas(*, every: bool) -> dict[str, Any]:
    if not every:
        return {"fields": {}, "schemas": {}, "scene_schema": {}}
    from taction.netlist_gen.scene.scene import scene_type
    from taction.verification.report.documents.catalogue import MODELS, fields, schema, schema_name

    return {
        "fields": fields(),
        "schemas": {schema_name(name): schema(name) for name in MODELS},
        "scene_schema": scene_type().model_json_schema(by_alias=True),
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
