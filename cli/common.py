"""What every command shares: the scene argument, ``--json``, errors and exit statuses."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

import click

from spice_models.errors import InputError, NoVerdictError, SimulationError, TactionError

F = TypeVar("F", bound=Callable[..., Any])

STATUS = {"pass": 0, "fail": 1, "bad input": 2, "inconclusive": 3}


def scene_argument(command: F) -> F:
    """Add the argument SCENE, a path; reading it is the command's business."""
    return click.argument("scene", type=click.Path())(command)


def json_option(command: F) -> F:
    """Add ``--json``."""
    text = "One JSON document on stdout, everything else on stderr."
    return click.option("--json", "as_json", is_flag=True, help=text)(command)


def reports_errors(command: F) -> F:
    """Turn every error into a message and an exit status.

    Python would end with 1 for a bug, which here means "a check failed": anything unforeseen
    ends with 3, no verdict.
    """

    @functools.wraps(command)
    def wrapper(*args: Any, **kwargs: Any) -> None:
        as_json = bool(kwargs.get("as_json"))
        try:
            command(*args, **kwargs)
        except TactionError as error:
            _report(error, as_json)
        except MemoryError:
            _report(NoVerdictError("out of memory: this scene is too large for it"), as_json)
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except KeyboardInterrupt:
            click.echo("taction: interrupted; nothing was judged", err=True)
            sys.exit(130)
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(141)
        except Exception:
            import traceback

            traceback.print_exc()
            click.echo("taction: this is a bug; no verdict was reached", err=True)
            sys.exit(3)

    return wrapper  # type: ignore[return-value]


def _report(error: TactionError, as_json: bool) -> NoReturn:
    if as_json:
        print_json(_error_document(error))
    click.echo(f"taction: {error}", err=True)
    sys.exit(error.exit_status)


def print_json(document: Any) -> None:
    """Print one JSON document on stdout; what is not finite becomes null."""
    import json

    click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Return `value` as JSON can hold it: arrays as lists, NaN and infinities as None."""
    import enum
    import math

    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return value


@contextmanager
def stage_display() -> Iterator[Callable[[str], None]]:
    """Show the stage under way on stderr, only where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda stage: status.update(stage)


def _error_document(error: TactionError) -> dict[str, Any]:
    outcome = "bad input" if error.exit_status == STATUS["bad input"] else "inconclusive"
    document: dict[str, Any] = {
        "outcome": outcome,
        "error": {"kind": type(error).__name__, "message": str(error)},
    }
    if isinstance(error, InputError):
        document["error"]["file"] = error.file
        document["error"]["complaints"] = [
            {"key": c.key, "value": c.value, "accepted": c.accepted} for c in error.complaints
        ]
    if isinstance(error, SimulationError):
        document["error"]["log"] = error.log
        document["error"]["folder"] = str(error.folder) if error.folder else None
    return document
