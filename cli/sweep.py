"""``taction sweep``: a grid of verifications in one database."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from cli.common import STATUS, json_option, reports_errors, scene_argument

if TYPE_CHECKING:
    from verification.studies.sweep.plan import Plan
    from verification.studies.sweep.run import Count
    from verification.studies.sweep.store import Store


@click.command(short_help="A grid of verifications; resumable, local or on a cluster.")
@scene_argument
@click.option(
    "--over",
    multiple=True,
    required=True,
    metavar="KEY=LOW:HIGH:N",
    help="An axis of the grid: C=1pF:1nF:31 (logarithmic), ...:lin, C=1p,2p, or two keys with a"
    " blank between that change together. Repeat it for a grid.",
)
@click.option(
    "-o", "--output", type=click.Path(dir_okay=False), help="Database; SCENE's name.sqlite."
)
@click.option(
    "--engine", type=click.Choice(["auto", "ngspice", "statespace", "both"]), default=None
)
@click.option(
    "--retry", type=click.Choice(["failed"]), help="Compute points without verdict again."
)
@click.option(
    "--export", "export_file", metavar="FILE", help="Table as .csv or .parquet, grid as .nc."
)
@click.option("--plot", metavar="FILE", help="Maps over two axes, curves over one (PNG, SVG, PDF).")
@click.option("--keep-waveforms", is_flag=True, help="Store the outputs over time, too.")
@click.option(
    "--once",
    is_flag=True,
    help="Run ngspice once a point; its error is measured against the state-space engine.",
)
@click.option("--jobs", type=click.IntRange(1, 4096), help="Processes; one a core by default.")
@click.option("--cluster", metavar="tcp://HOST:PORT", help="Run on this Dask cluster instead.")
@json_option
@reports_errors
def sweep(scene: str, over: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """Verify SCENE at every point of a grid and store the results.

    A sweep that was interrupted goes on where it was when the same command is given again. Ends
    with 0 when every point is stored, whatever its outcome, and with 3 where none has a verdict.
    """
    from netlist_gen.overrides.axes import parse_axes
    from verification.ideal.lambda_rule import read_scene
    from verification.studies.sweep.plan import Plan, engines_of
    from verification.studies.sweep.store import Store

    asked = read_scene(scene)
    plan = Plan(
        asked,
        parse_axes(asked, over),
        engines_of(asked, options["engine"]),
        second_look=not options["once"],
        keep_waveforms=options["keep_waveforms"],
    )
    _check_files(plan, options)
    began = time.perf_counter()
    with Store(options["output"] or f"{asked.name}.sqlite") as store:
        count = _run(plan, store, options)
        _report(plan, store, count, time.perf_counter() - began, as_json=as_json)
        _write_files(plan, store, options)
    decided = count.outcomes["pass"] + count.outcomes["fail"]
    sys.exit(0 if decided else STATUS["inconclusive"])


def _check_files(plan: Plan, options: dict[str, Any]) -> None:
    """Refuse what could not be written before any work is done."""
    if options["export_file"] is not None:
        from verification.report.sweep.files import check_sweep_export

        check_sweep_export(options["export_file"])
    if options["plot"] is not None:
        from verification.report.sweep.maps import check_sweep_plot

        check_sweep_plot(plan, options["plot"])


def _run(plan: Plan, store: Store, options: dict[str, Any]) -> Count:
    from verification.studies.running.executors import workers_at
    from verification.studies.sweep.run import sweep as run

    with _display(plan.total) as progress:
        try:
            with workers_at(options["cluster"], options["jobs"]) as workers:
                retry = options["retry"] == "failed"
                return run(plan, store, workers, retry_failed=retry, progress=progress)
        except KeyboardInterrupt:
            text = (
                f"taction: interrupted; {store.count()} results are in {store.path}, the same"
                " command goes on from there"
            )
            click.echo(text, err=True)
            sys.exit(130)


def _report(plan: Plan, store: Store, count: Count, seconds: float, *, as_json: bool) -> None:
    from verification.report.sweep.records import document_parts, print_sweep

    if as_json:
        for part in document_parts(plan, store, count, seconds):
            click.echo(part, nl=False)
        return
    from rich.console import Console

    print_sweep(plan, store, count, Console(highlight=False))


def _write_files(plan: Plan, store: Store, options: dict[str, Any]) -> None:
    if options["export_file"] is not None:
        from verification.report.sweep.files import export_sweep

        export_sweep(plan, store, options["export_file"])
        click.echo(f"wrote {options['export_file']}", err=True)
    if options["plot"] is not None:
        from verification.report.sweep.maps import plot_sweep

        plot_sweep(plan, store, options["plot"])
        click.echo(f"drew {options['plot']}", err=True)


@contextmanager
def _display(total: int) -> Iterator[Callable[[Count], None]]:
    """Show progress, rate and remaining time on stderr, only where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[state]}"))
    began = time.perf_counter()
    with Progress(*columns, console=Console(stderr=True)) as display:
        task = display.add_task("sweep", total=total, state="starting")

        def show(count: Count) -> None:
            state = _state(count, time.perf_counter() - began)
            display.update(task, completed=count.done, state=state)

        yield show


def _state(count: Count, seconds: float) -> str:
    """Return the rate of what was computed, not found, and what it means for the rest."""
    outcomes = ", ".join(f"{number} {name}" for name, number in sorted(count.outcomes.items()))
    if not count.ran:
        return outcomes
    rate = count.ran / seconds
    left = round((count.total - count.done) / rate)
    clock = f"{left // 3600}:{left // 60 % 60:02}:{left % 60:02}"
    return f"{rate:.3g}/s, {clock} left; {outcomes}"
