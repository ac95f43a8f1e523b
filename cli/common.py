"""The parts that commands share: ``--json``, common options, errors and exit statuses."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import click

from spice_models.errors import (
    INTERRUPTED,
    InputError,
    NoVerdictError,
    SimulationError,
    TactionError,
)

if TYPE_CHECKING:
    from rich.console import Console

STATUS = {"pass": 0, "fail": 1, "bad input": 2, "inconclusive": 3}
ENGINES = ("auto", "ngspice", "statespace")
GRID_ENGINES = ("both", "hybrid")


class EngineChoice(click.Choice[str]):
    """An engine; those that need a grid of points are refused with the command that has one."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the engine, or fail with the known engines."""
        if value in GRID_ENGINES and value not in self.choices:
            text = f"{value!r} runs two engines over a grid of points, for `taction sweep` only"
            self.fail(f"{text}; expected one of {', '.join(map(repr, self.choices))}", param, ctx)
        return super().convert(value, param, ctx)


ENGINE = click.option(
    "--engine", type=EngineChoice(ENGINES), help="Engine in the place of the scene's own."
)
JOBS = click.option(
    "--jobs", type=click.IntRange(1, 4096), help="Number of processes; by default one per core."
)
CLUSTER = click.option(
    "--cluster", metavar="tcp://HOST:PORT", help="Address of a Dask scheduler that runs the points."
)


def output_option(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option ``-o``, a file; `text` is its help."""
    return click.option("-o", "--output", type=click.Path(dir_okay=False), help=text)


def plot_option(content: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option ``--plot``, which draws `content` into a file."""
    text = f"Draw {content} into FILE (PNG, SVG or PDF)."
    return click.option("--plot", type=click.Path(dir_okay=False), metavar="FILE", help=text)


def check_plot(plot: str | None) -> None:
    """Refuse a ``--plot`` file that cannot be drawn, before any work is done."""
    if plot is not None:
        from verification.report.verdict.plots import check_plot_file

        check_plot_file(plot)


def command(function: Callable[..., None]) -> click.Command:
    """Return `function` as a command with the option ``--json`` and an exit status per error."""
    text = "Print one JSON document on stdout and everything else on stderr."
    made = click.command()(reports_errors(function))
    made.params.append(click.Option(["--json", "as_json"], is_flag=True, help=text))
    return made


def scene_command(function: Callable[..., None]) -> click.Command:
    """Return `function` as a `command` with the argument SCENE, the path of a scene file."""
    made = command(function)
    made.params.insert(0, click.Argument(["scene"], type=click.Path()))
    return made


def reports_errors(function: Callable[..., None]) -> Callable[..., None]:
    """Turn every error into a message and an exit status.

    An unexpected exception ends with 3, no verdict. Python's own status would be 1, which means
    here that a check failed.
    """

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> None:
        as_json = bool(kwargs.get("as_json"))
        try:
            function(*args, **kwargs)
        except TactionError as error:
            _report(error, as_json)
        except MemoryError:
            _report(NoVerdictError("out of memory: the scene is too large"), as_json)
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except KeyboardInterrupt:
            click.echo("taction: interrupted; no verdict was reached", err=True)
            sys.exit(INTERRUPTED)
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(141)
        except Exception:
            import traceback

            traceback.print_exc()
            click.echo("taction: this is a bug in taction; no verdict was reached", err=True)
            sys.exit(3)

    return wrapper


def _report(error: TactionError, as_json: bool) -> NoReturn:
    if as_json:
        print_json(_error_document(error))
    click.echo(f"taction: {error}", err=True)
    sys.exit(error.exit_status)


def print_json(document: Any) -> None:
    """Print one JSON document on stdout; NaN and infinities become null."""
    import json

    click.echo(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Return `value` in the types of JSON: arrays as lists, NaN and infinities as None."""
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


def console() -> Console:
    """Return a console on stdout that prints numbers without colours."""
    from rich.console import Console

    return Console(highlight=False)


@contextmanager
def stage_display(*, every: bool = False) -> Iterator[Callable[[str], None]]:
    """Show the current stage on stderr; without a terminal only long stages, or `every` one."""
    if not sys.stderr.isatty():
        shown: set[str] = set()

        def announce(stage: str) -> None:
            if (every or stage.startswith("simulation (about")) and stage not in shown:
                shown.add(stage)
                click.echo(f"taction: {stage}", err=True)

        yield announce
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
