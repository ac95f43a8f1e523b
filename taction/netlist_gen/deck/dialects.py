"""The dialects of decks: a table of what each writes in another way than ngspice.

Every card of a board is written for ngspice first. A dialect turns the few cards that differ into
its own, so a new card of the board needs no change in a dialect that writes it in the same way.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from taction.netlist_gen.analysis import Analysis, NoiseAnalysis, SimulatorTolerances, Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.spice_models.opamp import THERMAL
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import RISE_LEVELS, SMALL_STEP

NATIVE = "ngspice"
LONGEST = 500  # characters of a line: HSPICE cuts off a line of more than 1024


@dataclass(frozen=True, slots=True)
class Dialect:
    """One language of decks."""

    name: str  # key of `DIALECTS`
    head: tuple[str, ...] = ()  # lines after the title: what checked a deck like this one
    # patterns of ngspice's cards and what is written for them, the first to the last
    cards_as: tuple[tuple[str, str], ...] = ()
    options: tuple[str, ...] = ()  # names in braces are those of `closing`
    heated: tuple[str, ...] = ()  # options of a board with transistors
    analysis: tuple[str, ...] = ()  # saved voltages, the transient, the end of the deck
    saved: str = "v({})"  # a node to save
    uncharged: str = " uic"  # what a transient has that begins with no charge
    is_linear: bool = False  # no program could check the deck of a board that is not
    measures: bool = True  # whether the dialect has ``.meas``, and a program that checks it
    folds: bool = True  # whether a line that begins with + goes on with the one before

    def refusals(self, circuit: Circuit) -> Iterator[Complaint]:
        """Yield what the dialect cannot express of `circuit`, by the key of the scene."""
        for model in () if self.name == NATIVE else circuit.models.values():
            if model.imported is not None:
                text = (
                    f"a vendor's netlist is written for ngspice only, not for {self.name}; expected"
                    " a preset (`taction parts`), or --dialect ngspice"
                )
                yield Complaint("design.opamp.file", repr(model.name), text)
        none = f"no free program reads {{}} of {self.name}; expected {{}}, or another --dialect"
        if self.is_linear and circuit.has_nonlinear_amplifiers:
            text = none.format("the nonlinear sources", "'linear'")
            yield Complaint("design.amplifier", repr(circuit.amplifier), text)
        if self.is_linear and not circuit.is_small_signal:
            text = none.format("the limits of op-amps", "'small-signal'")
            yield Complaint("design.opamp.level", "'large-signal'", text)

    def cards(self, text: str) -> str:
        """Return the deck up to its options, given as ngspice has it."""
        if self.name == NATIVE:
            return text
        written = list[str]()
        for line in text.split("\n"):
            for pattern, made in self.cards_as:  # a comment as it is, but for patterns of comments
                if not line.startswith("*") or pattern.startswith(r"^\*"):
                    line = re.sub(pattern, made, line)
            written.append(self._folded(line))
        return "\n".join([written[0], *self.head, *written[1:]])

    def closing(
        self,
        circuit: Circuit,
        analysis: Analysis,
        saved: Sequence[str],
        limits: SimulatorTolerances,
        solver: str,
    ) -> list[str]:
        """Return options, temperature, saved voltages, the analysis, and the end of the deck."""
        if self.name == NATIVE:
            return [*_native(circuit, analysis, saved, limits, solver), ".end", ""]
        if not isinstance(analysis, Transient) or analysis.voltages:
            raise ValueError(f"dialect {self.name!r} has transients from zero or rest only")
        values = {
            **asdict(limits),
            "celsius": circuit.temperature,
            "saved": " ".join(map(self.saved.format, saved)),
            "begin": analysis.begin,
            "stop": analysis.stop,
            "step": analysis.max_step,
            "uncharged": "" if starts_from_rest(circuit, analysis) else self.uncharged,
        }
        heated = self.heated if circuit.transistors else ()
        lines = (*self.options, *heated, *self.analysis)
        return [*(self._folded(line.format(**values)) for line in lines), ""]

    def _folded(self, line: str) -> str:
        """Return a card of SPICE with at most `LONGEST` characters a line, where it has spaces."""
        if len(line) <= LONGEST or line.startswith("*") or not self.folds:
            return line
        return textwrap.fill(
            line, LONGEST, subsequent_indent="+ ", break_long_words=False, break_on_hyphens=False
        )


def starts_from_rest(circuit: Circuit, analysis: Transient) -> bool:
    """Return whether the start needs an operating point; without constant sources rest is 0 V."""
    return analysis.initial == "rest" and circuit.has_constant_sources


def _native(
    circuit: Circuit,
    analysis: Analysis,
    nodes: Sequence[str],
    limits: SimulatorTolerances,
    solver: str,
) -> list[str]:
    """Return ngspice's options, saved voltages and analysis."""
    own = analysis.charge if isinstance(analysis, Transient) else None
    charge = limits.charge if own is None else own
    lines = [
        f".options {'noopiter' if isinstance(analysis, NoiseAnalysis) else solver}",
        f".options reltol={limits.relative!r} abstol={limits.current!r} vntol={limits.voltage!r}",
        f".options chgtol={charge!r} gmin={limits.junction!r} pivtol={limits.gmin!r}",
    ]
    if isinstance(analysis, Transient):
        method = "trap" if analysis.method == "trapezoidal" else "gear"
        lines.append(f".options method={method} trtol={analysis.truncation / limits.relative!r}")
    if circuit.transistors:
        lines.append(f".options temp={circuit.temperature!r} tnom={circuit.temperature!r}")
    if isinstance(analysis, NoiseAnalysis):
        for part in circuit.noises:  # of a sensor: that of a resistor beside the board
            ohms = THERMAL / part.density**2
            lines.append(f"Rnoise_{part.name} noise_{part.name} 0 {ohms!r}")
            lines.append(f"Gnoise_{part.name} 0 {part.node} noise_{part.name} 0 {1.0 / ohms!r}")
        lines.append("Vnoise noise_in 0 0.0 ac 1.0")  # ngspice asks for an input
        lines.append(".save onoise_spectrum onoise_total")
        sweeps = (f"dec {each.density} {each.start!r} {each.stop!r}" for each in analysis.bands)
        return [*lines, *(f".noise v({nodes[0]}) Vnoise {sweep}" for sweep in sweeps)]
    lines.append(".save " + " ".join(f"v({node})" for node in nodes))
    if not isinstance(analysis, Transient):
        return [*lines, ".op"]
    if analysis.voltages:
        # ngspice takes the charges of a transistor, which has inner unknowns, from its outer nodes
        known = {n: v for n, v in analysis.voltages.items() if n.endswith((".p1", ".p2"))
                 or "." not in n}  # fmt: skip
        lines.append(".ic " + " ".join(f"v({node})={volts!r}" for node, volts in known.items()))
    uncharged = "" if starts_from_rest(circuit, analysis) else " uic"
    begin = 10.0 * analysis.begin  # ngspice's first step is a tenth of the card's figure
    return [*lines, f".tran {begin!r} {analysis.stop!r} 0.0 {analysis.max_step!r}{uncharged}"]


_TOLERANCES = (
    ".options reltol={relative!r} abstol={current!r} vntol={voltage!r} chgtol={charge!r}"
    " gmin={junction!r}"
)
NGSPICE = Dialect(NATIVE)  # 39 and newer: every analysis, and vendors' netlists
LTSPICE = Dialect(  # XVII and newer
    "ltspice",
    (
        "* written for LTspice; checked with ngspice in its LTspice mode (waveforms) and spicelib",
        "* (names and values); not run by LTspice itself: plotwinsize, numdgt (no compression) and",
        "* .meas PARAM are from its manual, and unchecked",
    ),
    ((r"^(\.meas .* )param='([^']*)'$", r"\1PARAM \2"),),
    (_TOLERANCES, ".options method=trap plotwinsize=0 numdgt=15"),
    (".options temp={celsius!r} tnom={celsius!r}",),
    (".save {saved}", ".tran {begin!r} {stop!r} 0 {step!r}{uncharged}", ".end"),
    saved="V({})",
)
HSPICE = Dialect(  # with its classic step control
    "hspice",
    (
        "* written for HSPICE; checked with ngspice in its HSPICE mode (waveforms); not run by",
        "* HSPICE itself: runlvl, delmax, post and probe are from its manual",
    ),
    (
        (r"^B(\S+ \S+ \S+) [Vv]=(.*)$", r"E_\1 VOL='\2'"),  # B is a buffer of IBIS
        (r"\bln\(", "log("),  # the natural logarithm
    ),
    (
        _TOLERANCES.replace(".options", ".option"),
        ".option method=trap runlvl=0 delmax={step!r} post=2 probe",
    ),
    (".temp {celsius!r}", ".option tnom={celsius!r}"),
    (".probe tran {saved}", ".tran {step!r} {stop!r}{uncharged}", ".end"),
)
XYCE = Dialect(  # 7: options by package
    "xyce",
    (
        "* written for Xyce; its parts were checked with ngspice and, on linear boards, with"
        " gnucap;",
        "* not run by Xyce itself: .options and .print are from its manual, and unchecked",
    ),
    ((r"^(B\S+ \S+ \S+) [Vv]=(.*)$", r"\1 V={\2}"),),
    (
        ".options device gmin={junction!r}",
        ".options nonlin-tran reltol={relative!r} abstol={voltage!r}",
        ".options timeint method=trap reltol={relative!r} abstol={voltage!r}",
    ),
    (".options device temp={celsius!r} tnom={celsius!r}",),
    (".print tran {saved}", ".tran {begin!r} {stop!r} 0 {step!r}{uncharged}", ".end"),
    measures=False,
)
SPECTRE = Dialect(  # of linear parts: what gnucap can read and simulate, too
    "spectre",
    (  # before the first statement only the title is a comment in any language
        "simulator lang=spectre",
        "// written for Spectre; its parts were checked with gnucap in its Spectre mode"
        " (waveforms);",
        "// not run by Spectre itself: options, save and tran are from its manual, and unchecked",
        "global 0",
    ),
    (
        (r"^\*", "//"),
        (r"^\.title (.*)", r"// \1"),
        (r"^\.subckt (\S+) (.*)", r"subckt \1 (\2)"),
        (r"^\.ends\b", "ends"),
        (r"^(X\S+) (.*) (\S+)$", r"\1 (\2) \3"),
        (r"^(R\S+) (\S+ \S+) (\S+)$", r"\1 (\2) resistor r=\3"),
        (r"^(C\S+) (\S+ \S+) (\S+)$", r"\1 (\2) capacitor c=\3"),
        (r"^(I\S+) (\S+ \S+) (\S+)$", r"\1 (\2) isource dc=\3"),
        (r"^(V\S+) (\S+ \S+) (\S+)$", r"\1 (\2) vsource dc=\3"),
        (r"^(I\S+) (\S+ \S+) PWL\((.*)\)$", r"\1 (\2) isource type=pwl wave=[\3]"),
        (r"^(V\S+) (\S+ \S+) PWL\((.*)\)$", r"\1 (\2) vsource type=pwl wave=[\3]"),
        (r"^(E\S+) (\S+ \S+ \S+ \S+) (\S+)$", r"\1 (\2) vcvs gain=\3"),
        (r"^(G\S+) (\S+ \S+ \S+ \S+) (\S+)$", r"\1 (\2) vccs gm=\3"),
    ),
    (
        "accuracy options reltol={relative!r} iabstol={current!r} vabstol={voltage!r}"
        " gmin={junction!r}",
    ),
    (),
    (
        "save {saved}",
        "transient tran stop={stop!r} step={begin!r} maxstep={step!r} method=traponly{uncharged}",
    ),
    "{}",
    " skipdc=yes",
    is_linear=True,
    measures=False,
    folds=False,
)
DIALECTS = {each.name: each for each in (NGSPICE, LTSPICE, HSPICE, XYCE, SPECTRE)}
"""The table of dialects."""


def refuse_unable(name: str, *, measures: bool) -> None:
    """Refuse a name that is no dialect, and measures that a dialect does not have."""
    if name not in DIALECTS:
        text = f"expected one of {', '.join(DIALECTS)}"
        raise InputError("netlist", Complaint("dialect", repr(name), text))
    if measures and not DIALECTS[name].measures:
        able = ", ".join(other for other, each in DIALECTS.items() if each.measures)
        text = f"--measure: no free program checks the measures of this dialect; expected {able}"
        raise InputError("netlist", Complaint("--dialect", name, text))


END = 0.9  # of the record: from there on a channel that has settled is inside the band
NOT_SETTLED = 1e99  # s: the settling time of a record that ends outside the band


@dataclass(frozen=True, slots=True)
class Measures:
    """What the measures of a deck compare with."""

    targets: tuple[float, ...]  # the numerical solution at each output node, V
    starts: tuple[float, ...]  # their voltages before the step, V
    band: float  # half width of the settling band, fraction of the largest step


def measure_lines(circuit: Circuit, measures: Measures, stop: float) -> list[str]:
    """Return sources and ``.meas`` cards, for ngspice, of a transient that ends at `stop`, s."""
    channels = list(zip(circuit.outputs, measures.starts, measures.targets, strict=True))
    scale = max(abs(target - start) for _, start, target in channels)
    if not scale > 0.0:
        raise ValueError("no channel has a step, so there is nothing to measure")
    width = measures.band * scale
    lines = [
        f"* targets: the numerical solution at lambda = {circuit.value('lambda')!r}",
        f"* step amplitude A = {scale!r} V; settling band {measures.band!r} A;"
        f" {NOT_SETTLED!r} s: not settled",
    ]
    for n, (output, _, target) in enumerate(channels, 1):  # most_n: the largest distance of n
        before = f"V(most_{n - 1})" if n > 1 else "0"
        lines.append(f"Berr_{n} err_{n} 0 V=abs(V({output.node})-({target!r}))")
        lines.append(f"Bmost_{n} most_{n} 0 V=max({before},V(err_{n}))")
    lines += _settling("", f"most_{len(channels)}", width, stop)
    for n, (output, start, target) in enumerate(channels, 1):
        node, step, low, high = output.node, target - start, min(start, target), max(start, target)
        if abs(step) <= width:
            lines.append(f"* channel {n} starts inside the band: t_settle_{n} fails if it stays")
        lines += _settling(f"_{n}", f"err_{n}", width, stop)
        above, below = f"peak_{n}-({high!r})", f"({low!r})-low_{n}"
        if abs(step) >= SMALL_STEP * scale:
            ends = (f"VAL={start + level * step!r} CROSS=1" for level in RISE_LEVELS)
            first, last = (f"V({node}) {end}" for end in ends)
            lines.append(f".meas tran t_rise_{n} TRIG {first} TARG {last}")
            beyond = above if step > 0.0 else below
        else:
            lines.append(f"* channel {n} has a step under {SMALL_STEP:g} A: no rise time")
            beyond = f"max({above},{below})"
        lines += [f".meas tran peak_{n} MAX V({node})", f".meas tran low_{n} MIN V({node})"]
        lines.append(f".meas tran overshoot_{n} param='max(0,({beyond})/{scale!r})'")
    return lines


def _settling(suffix: str, node: str, width: float, stop: float) -> Iterator[str]:
    """Yield the last crossing of the band, which counts if a stretch at the end is inside."""
    yield f".meas tran last{suffix} WHEN V({node})={width!r} CROSS=LAST"
    yield f".meas tran end{suffix} MAX V({node}) FROM={END * stop!r} TO={stop!r}"
    value = f"last{suffix}+{NOT_SETTLED!r}*(end{suffix}>{width!r})"
    yield f".meas tran t_settle{suffix} param='{value}'"
