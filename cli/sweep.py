"""``taction sweep``: a scene verified at every point of a grid, in one database."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from taction.cli.common import (
    CLUSTER,
    ENGINES,
    GRID_ENGINES,
    JOBS,
    STATUS,
    ask_axes,
    check_report,
    console,
    output_option,
    plot_option,
    report_option,
    save_report,
    say,
    scene_command,
)

if TYPE_CHECKING:
    from taction.verification.report.html.blocks import Report
    from taction.verification.studies.store import Store
    from taction.verification.studies.sweep.plan import Plan
    from taction.verification.studies.sweep.run import SweepCounts

WIDE = 100  # columns that hold the bar beside the numbers


@scene_command
@click.option(
    "--over",
    multiple=True,
    required=True,
    metavar="KEY=LOW:HIGH:N",
    help="Axis of the grid: C=1pF:1nF:31 (31 points, logarithmic), C=1pF:1nF:31:lin (linear) or"
    " C=1p,2p (values). Two axes in one option, with a blank between them, change together. Repeat"
    " the option for a grid.",
)
@click.option(
    "--fix",
    multiple=True,
    metavar="KEY[=VALUE]",
    help="Hold a key at every point, by default at the scene's own value: --fix lambda holds lambda"
    " where the scene gives a resistance. Repeat the option for several keys.",
)
@output_option("Database of the results; by default the scene's name with the ending .sqlite.")
@click.option(
    "--engine",
    type=click.Choice([*ENGINES, *GRID_ENGINES]),
    help="Engine in the place of the scene's own. both: both engines at every point; hybrid:"
    " the state-space engine at every point, ngspice at the decisive points.",
)
@click.option(
    "--retry", type=click.Choice(["failed"]), help="Compute points without a verdict again."
)
@click.option(
    "--export", "export_file", metavar="FILE", help="Write a table (.csv, .parquet) or grid (.nc)."
)
@plot_option("maps over two axes, or curves over one axis,")
@report_option()
@click.option("--keep-waveforms", is_flag=True, help="Store also the outputs over time.")
@JOBS
@CLUSTER
def sweep(scene: str, over: tuple[str, ...], as_json: bool, **options: Any) -> None:
    """Verify SCENE at every point of a grid and store the results.

    The same command continues an interrupted sweep. Exit status: 0 if every point is stored,
    whatever its outcome; 1 if two engines disagree at a point; 3 if no point has a verdict.
    """
    from taction.studies import plan_sweep
    from taction.verification.report.sweep.agreement import summarise
    from taction.verification.studies.store import Store

    keep = options["keep_waveforms"]
    plan = plan_sweep(scene, over, options["engine"], fix=options["fix"], keep_waveforms=keep)
    ask_axes(plan.scene, plan.groups)
    _check_files(plan, options)
    start = time.perf_counter()
    with Store(options["output"] or f"{plan.scene.name}.sqlite") as store:
        count = run_plan(plan, store, options)
        seconds = time.perf_counter() - start
        _write_files(plan, store, options)  # before the text: its reader may go
        save_report(options["report"], lambda: _page(plan, store, count))
        _report(plan, store, count, seconds, as_json=as_json)
        disagree = len(plan.engines) > 1 and summarise(plan, store).disagree
    verdicts = count.outcomes["pass"] + count.outcomes["fail"]
    sys.exit(STATUS["fail" if disagree else "pass" if verdicts else "inconclusive"])


def _check_files(plan: Plan, options: dict[str, Any]) -> None:
    """Refuse a file that cannot be written, before any work is done."""
    if options["export_file"] is not None:
        from taction.verification.report.sweep.files import check_sweep_export

        check_sweep_export(options["export_file"])
    check_report(options["report"])
    if options["plot"] is not None:
        from taction.verification.report.sweep.plot import check_sweep_plot

        check_sweep_plot(plan, options["plot"])


def run_plan(plan: Plan, store: Store, options: dict[str, Any]) -> SweepCounts:
    """Compute what `store` lacks, with progress on stderr; Ctrl-C ends the command with 130.

    `options` are those of the command: cluster, jobs and retry.
    """
    from taction.verification.studies.running.executors import workers_at
    from taction.verification.studies.sweep.run import sweep as run

    with _display() as progress:
        try:
            with workers_at(options["cluster"], options["jobs"], say) as workers:
                retry = options["retry"] is not None
                return run(
                    plan,
                    store,
                    workers,
                    retry_failed=retry,
                    progress=progress,
                    announce=say,
                )
        except KeyboardInterrupt:
            stored = f"{store.count()} results are in {store.path}"
            click.echo(f"taction: interrupted; {stored}; the same command continues", err=True)
            sys.exit(130)


def _report(plan: Plan, store: Store, count: SweepCounts, seconds: float, *, as_json: bool) -> None:
    from taction.verification.report.sweep.document import document_parts, print_sweep

    if as_json:
        for part in document_parts(plan, store, count, seconds):
            click.echo(part, nl=False)
        return
    print_sweep(plan, store, count, console())


def _write_files(plan: Plan, store: Store, options: dict[str, Any]) -> None:
    if options["export_file"] is not None:
        from taction.verification.report.sweep.files import export_sweep

        export_sweep(plan, store, options["export_file"])
        click.echo(f"wrote {options['export_file']}", err=True)
    if options["plot"] is not None:
        from taction.verification.report.sweep.plot import plot_sweep

        plot_sweep(plan, store, options["plot"])
        click.echo(f"drew {options['plot']}", err=True)


def _page(plan: Plan, store: Store, count: SweepCounts) -> Report:
    from taction.verification.report.html.sweep_report import sweep_report

    return sweep_report(plan, store, count)


@contextmanager
def _display() -> Iterator[Callable[[SweepCounts], None]]:
    """Show progress, rate and remaining time on stderr; without a terminal a few lines."""
    if not sys.stderr.isatty():
        from taction.cli.sparse_lines import SparseLines

        lines = SparseLines(say)
        yield lambda count: lines.stage(count.text)
        return
    from rich.progress import BarColumn, Progress, TextColumn
    from rich.table import Column

    page = console(stderr=True)
    bar = [BarColumn()] if page.width >= WIDE else []
    text = "{task.completed}/{task.total} {task.fields[state]}"
    columns = (*bar, TextColumn(text, table_column=Column(overflow="fold", no_wrap=False)))
    start = time.perf_counter()
    with Progress(*columns, console=page) as display:
        task = display.add_task("sweep", total=None, state="starting")

        def show(count: SweepCounts) -> None:
            state = _state(count, time.perf_counter() - start)
            display.update(task, total=count.total, completed=count.done, state=state)

        yield show


def _state(count: SweepCounts, seconds: float) -> str:
    """Return the rate of the computed (not the stored) points, the remaining time, the outcomes."""
    outcomes = ", ".join(f"{number} {name}" for name, number in sorted(count.outcomes.items()))
    if not count.ran or count.remaining is None:
        return outcomes
    left = round(count.remaining)
    clock = f"{left // 3600}:{left // 60 % 60:02}:{left % 60:02}"
    return f"{count.ran / seconds:.3g}/s, {clock} left; {outcomes}"
