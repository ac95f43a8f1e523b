"""``taction models import``: a vendor's op-amp macromodel, for scenes."""

from __future__ import annotations

import re
from typing import Any

import click

from taction.cli.common import command, console, print_json


@command
@click.argument("file", type=click.Path())
@click.option("--subckt", required=True, help="Name of the subcircuit in FILE.")
@click.option(
    "--pins", required=True, metavar="ROLE,ROLE,...",
    help="Role of each port in its order: inp, inn, vcc, vee, out; nc for a port that stays open.",
)  # fmt: skip
@click.option("--supply", default="15V", show_default=True, help="Both supply voltages, as ±15V.")
@click.option(
    "-o", "--output", type=click.Path(dir_okay=False),
    help="The file to write, to lie beside the scene; by default NAME.opamp.json.",
)  # fmt: skip
def import_(
    file: str, subckt: str, pins: str, supply: str, output: str | None, as_json: bool
) -> None:
    """Import the op-amp macromodel of a vendor's netlist FILE for scenes.

    Only known cards, devices and functions are accepted, and written anew. ngspice measures the
    model; its response becomes a linear model for the state-space engine.
    """
    import json

    from taction.netlist_gen.scene.fields import BOTH_SIGNS
    from taction.spice_models.imported import to_document
    from taction.system.atomic_files import write_atomically
    from taction.system.errors import Complaint, InputError
    from taction.system.quantities import parse
    from taction.verification.characterise.import_characterise import import_opamp

    try:
        volts = parse(BOTH_SIGNS.sub("", supply), "V")
        if not 0.0 < volts <= 1e6:
            raise ValueError("must be above zero, and at most 1 MV")
    except ValueError as error:
        raise InputError("--supply", Complaint("supply", repr(supply), str(error))) from None
    name = re.sub(r"[^a-z0-9]", "_", subckt.lower())
    name = name if name[:1].isalpha() else f"m{name}"
    roles = tuple(word.strip().lower() for word in pins.split(","))
    opamp = import_opamp(file, subckt, roles, volts)
    found = to_document(name, opamp)
    target = output or f"{name}.opamp.json"
    write_atomically(target, json.dumps(found, indent=1) + "\n")
    click.echo(f"wrote {target}", err=True)
    if as_json:
        print_json({"file": target, **{k: v for k, v in found.items() if k != "netlist"}})
    else:
        _report(found, target)


import_.name = "import"


def _report(found: dict[str, Any], target: str) -> None:
    from taction.system.quantities import show

    figures, linear = found["figures"], found["linear"]
    page = console()
    page.print(f"{found['name']}, simulated at ±{show(found['supply'], 'V')}")
    for key, unit in (
        ("dc_gain", ""), ("unity_gain_bandwidth", "Hz"), ("phase_margin", "degrees"),
        ("output_resistance", "ohm"), ("supply_current", "A"),
    ):  # fmt: skip
        page.print(f"  {key.replace('_', ' '):22} {show(figures[key], unit)}")
    if linear is not None:
        poles = len(linear["gain"]["poles"])
        page.print(
            f"linear model: {poles} poles, within {100.0 * linear['error']:.2g} % of the simulated"
            f" response up to {show(linear['band'][1], 'Hz', 3)}"
        )
    else:
        page.print(f"{found['missing']}: boards with it stay inconclusive")
    page.print(f'in a scene beside it: opamp = {{ file = "{target}" }}')
