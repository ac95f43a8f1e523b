"""A line for every command on the files of `boards`, in the variants that some suites need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from taction.cli.command import Command
from taction.cli.commands import COMMANDS
from tests.support.paths import ROOT

VENDOR = str(ROOT / "tests" / "data" / "fet100.cir")
PINS = "--subckt FET100 --pins inp,inn,vcc,vee,out"

# The document of a line has the schema of the name before the comma.
LINES: dict[str, str] = {
    "verify": "verify a.toml --margins",
    "verify, failing": "verify slow.toml --changes 50",
    "verify, oscillating": "verify ringing.toml --margins --changes 50",
    "verify, inconclusive": "verify short.toml",
    "verify, ngspice and noise": "verify ngspice.toml",
    "verify, exponential": "verify exponential.toml --changes 0",
    "verify-files": "verify a.toml bad.toml slow.toml --jobs 1",
    "check": "check filter.cir --check settling=1ms@1%",
    "check, failing": "check filter.cir --expect v(out)=1@1% --check noise=1nV",
    "check, onset": "check filter.cir --over Rf=1k:100k:9 --no-ngspice",
    "demo": "demo -o told.html",
    "diff": "diff a.toml slow.toml",
    "netlist": "netlist a.toml",
    "bom": "bom a.toml",
    "build": "build a.toml -o built",
    "solve": "solve a.toml",
    "simulate": "simulate a.toml -o w.csv",
    "montecarlo": "montecarlo a.toml -n 4 --jobs 1",
    "corners": "corners a.toml --jobs 1",
    "corners, named": "corners a.toml --corner capacitor=-1",
    "tune": "tune a.toml",
    "scale": "scale a.toml",
    "choose": "choose a.toml --opamps tl084 --points 2 --jobs 1",
    "onset": "onset a.toml --over C=1fF:1pF:5",
    "onset, without transients": "onset a.toml --over gain --no-confirm",
    "sweep": "sweep a.toml --over C=1fF,10pF --jobs 1",
    "sweep, every outcome": "sweep short.toml --over C=1pF,5F --over opamp=ua741,op27 --jobs 1",
    "regress": "regress . --baseline b.json --jobs 1",
    "stress": "stress --only one-channel --jobs 1",
    "accuracy": "accuracy a.toml",
    "models": "models",
    "models-show": "models show ua741",
    "models-import": f"models import {VENDOR} {PINS}",
    "new": "new new.toml",
    "new-matrix": "new m.toml --matrix T.csv --strain eps.csv",
    "error": "verify bad.toml",
    "error, no design": "tune slow.toml --over gain=1M:1.1M",
    "error, an option": "verify a.toml --jobs 0",
    "error, a command": "verfy a.toml",
    "error, no ngspice": "verify ngspice.toml",
    "reproduce": "reproduce",
}


def commands(
    table: Mapping[str, Command] = COMMANDS, above: str = ""
) -> Iterator[tuple[str, Command]]:
    """Every command and those below it, by their names."""
    for name, command in table.items():
        yield f"{above}{name}", command
        yield from commands(command.commands, f"{name} ")


def line(name: str) -> list[str]:
    """Return the words of a line, the name of its command first."""
    return LINES[name].split()
