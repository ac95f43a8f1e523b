"""The dialect of ngspice, which taction runs: every analysis, and vendors' netlists."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from taction.netlist_gen.analysis import (
    Analysis,
    NoiseAnalysis,
    OperatingPoint,
    SimulatorTolerances,
    SmallSignal,
    Transient,
)
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.dialects.dialect import (
    NATIVE,
    Dialect,
    DialectRequest,
    starts_from_rest,
    temperature_of,
)
from taction.netlist_gen.deck.measures import noise_cards
from taction.system.errors import Complaint


class Ngspice(Dialect):
    """Ngspice 39 and newer."""

    name = NATIVE

    def refusals(self, circuit: Circuit) -> Iterator[Complaint]:
        """Yield nothing: every board has a deck for ngspice."""
        yield from ()

    def cards(self, text: str) -> str:
        """Return the cards as they are."""
        return text

    def closing(self, request: DialectRequest) -> list[str]:
        """Return what follows the board, for any analysis."""
        celsius = temperature_of(request.circuit)
        return [
            *_options(request.limits, request.analysis, request.solver),
            *([f".options temp={celsius} tnom={celsius}"] if celsius else []),
            *_analysis_cards(request.circuit, request.analysis, request.saved),
            ".end",
            "",
        ]


def _options(limits: SimulatorTolerances, analysis: Analysis, solver: str) -> list[str]:
    lines = [
        f".options {'noopiter' if isinstance(analysis, NoiseAnalysis) else solver}",
        f".options reltol={limits.relative!r} abstol={limits.current!r} vntol={limits.voltage!r}",
    ]
    charge = limits.charge
    if isinstance(analysis, Transient) and analysis.charge is not None:
        charge = analysis.charge
    lines.append(f".options chgtol={charge!r} gmin={limits.junction!r} pivtol={limits.gmin!r}")
    if isinstance(analysis, Transient):
        method = "trap" if analysis.method == "trapezoidal" else "gear"
        lines.append(f".options method={method} trtol={analysis.truncation / limits.relative!r}")
    return lines


def _analysis_cards(circuit: Circuit, analysis: Analysis, nodes: Sequence[str]) -> list[str]:
    if isinstance(analysis, NoiseAnalysis):
        return noise_cards(analysis, nodes[0], circuit.noises)
    if isinstance(analysis, SmallSignal):
        raise ValueError(
            "a board has no AC source; taction.verification.characterise has benches with one"
        )
    save = ".save " + " ".join(f"v({node})" for node in nodes)
    if isinstance(analysis, OperatingPoint):
        return [save, ".op"]
    rest = starts_from_rest(circuit, analysis)
    step = repr(analysis.max_step)
    begin = repr(10.0 * analysis.begin)  # ngspice's first step is a tenth of the card's figure
    cards = [f".tran {begin} {analysis.stop!r} 0.0 {step}" + ("" if rest else " uic")]
    if analysis.voltages:
        known = {node: volts for node, volts in analysis.voltages.items() if _is_node(node)}
        pairs = " ".join(f"v({node})={volts!r}" for node, volts in known.items())
        cards.insert(0, f".ic {pairs}")
    return [save, *cards]


def _is_node(name: str) -> bool:
    """Whether an unknown of the state-space engine is a node of the deck, also in an op-amp.

    The inner unknowns of a transistor are not: ngspice takes its charges from the outer nodes.
    """
    return "." not in name or name.rpartition(".")[2] in ("p1", "p2")
