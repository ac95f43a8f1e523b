"""``taction models``: the op-amps, and one of them with what its macromodel does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from taction.cli.common import check_plot, command, console, plot_option, print_json, say
from taction.cli.import_model import import_

if TYPE_CHECKING:
    from taction.verification.characterise.witnesses import Witness

COLUMNS = (
    ("gbw", "Hz", "GBW"),
    ("slew_rate", "V/s", "slew rate"),
    ("offset_voltage", "V", "offset"),
    ("bias_current", "A", "bias"),
    ("voltage_noise", "V/rtHz", "noise"),
)
"""Figures of the list, beside the range of the supply; `show` has all."""


@click.group(invoke_without_command=True)
@click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout.")
@click.pass_context
def models(context: click.Context, as_json: bool) -> None:
    """List the op-amp presets; `show NAME` has one with all figures, measured beside stated."""
    if context.invoked_subcommand is None:
        _list(as_json)


def _list(as_json: bool) -> None:
    from taction.netlist_gen.scene.open_tables import OPAMPS
    from taction.spice_models.presets import FIGURES
    from taction.system.quantities import show as shown

    if as_json:
        names = [name for name in FIGURES if name != "phase_margin"]
        print_json(
            {
                name: {figure: getattr(model, figure) for figure in names}
                | {"source": model.source}
                for name, model in OPAMPS.items()
            }
        )
        return
    from taction.verification.report.tables import make_table, whole

    rows = []
    for name, model in OPAMPS.items():
        values = [(getattr(model, figure), unit) for figure, unit, _ in COLUMNS]
        known = [shown(x, unit, 3) if x and math.isfinite(x) else "-" for x, unit in values]
        ends = f"\N{PLUS-MINUS SIGN}{model.least_supply:g} to {model.most_supply:g} V"
        rows.append((name, *known, ends if math.isfinite(model.most_supply) else "-"))
    page = console()
    page.print(make_table(whole("", *(title for _, _, title in COLUMNS), "supply"), rows))
    page.print("all figures with their sources, and what the model does: taction models show NAME")


@command
@click.argument("name")
@plot_option("the Bode diagram and the steps of a follower")
def show(name: str, plot: str | None, as_json: bool) -> None:
    """Show all figures of the op-amp NAME with their sources, beside those of test benches.

    The benches are solved by our own equations and, where it is installed, by ngspice.
    """
    from taction.netlist_gen.scene.open_tables import OPAMPS
    from taction.spice_models.presets import figure_notes
    from taction.verification.characterise.characterise import characterise
    from taction.verification.report.opamp.figures import figures_document, print_figures

    if name not in OPAMPS:
        raise click.BadParameter(_unknown(name, tuple(OPAMPS)), param_hint="NAME")
    check_plot(plot)
    opamp, notes, witnesses = OPAMPS[name], figure_notes(name), _witnesses()
    results = {title: characterise(opamp, witness) for title, witness in witnesses.items()}
    if plot is not None:
        from taction.verification.report.opamp.plot import measure_curves, plot_opamp

        curves = {title: measure_curves(opamp, witness) for title, witness in witnesses.items()}
        plot_opamp(opamp, curves, plot)
        click.echo(f"wrote {plot}", err=True)
    if as_json:
        print_json(figures_document(opamp, notes, results), "models-show")
    else:
        print_figures(opamp, notes, results, console())


models.add_command(show)
models.add_command(import_)


def _unknown(name: str, known: tuple[str, ...]) -> str:
    from taction.system.errors import nearest_question

    hint = nearest_question(name, known, 0.6)
    return f"{name!r} is no preset; {hint}known: {', '.join(known)}"


def _witnesses() -> dict[str, Witness]:
    """Return our equations, and ngspice where it is installed."""
    from taction.system.errors import SimulationError
    from taction.verification.characterise.witnesses import Equations, Simulation
    from taction.verification.engines.ngspice.executable import find_simulator

    found: dict[str, Any] = {"state space": Equations()}
    try:
        found["ngspice"] = Simulation(find_simulator())
    except SimulationError as error:
        say(f"without ngspice: {error}")
    return found
