"""The dialect of Spectre, for boards of linear parts: what gnucap can read and simulate, too."""

from __future__ import annotations

from collections.abc import Iterator

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.dialects.dialect import (
    Dialect,
    DialectRequest,
    imported_opamps,
    starts_from_rest,
    transient_of,
)
from taction.system.errors import Complaint

LANGUAGE = "simulator lang=spectre"
_KINDS = {  # the first letter of a card: number of nodes, master, parameter
    "R": (2, "resistor", "r"),
    "C": (2, "capacitor", "c"),
    "I": (2, "isource", "dc"),
    "V": (2, "vsource", "dc"),
    "E": (4, "vcvs", "gain"),
    "G": (4, "vccs", "gm"),
}
_NO_READER = "no free program reads {what} of spectre; expected {accepted}, or another --dialect"


class Spectre(Dialect):
    """Spectre's own language."""

    name = "spectre"
    checked = (
        "written for Spectre; its parts were checked with gnucap in its Spectre mode (waveforms);",
        "not run by Spectre itself: options, save and tran are from its manual, and unchecked",
    )
    measures = parameters = False

    def refusals(self, circuit: Circuit) -> Iterator[Complaint]:
        """Yield imported op-amps, and every part whose card no free program could check."""
        yield from imported_opamps(circuit, self.name)
        if circuit.has_nonlinear_amplifiers:
            text = _NO_READER.format(what="the nonlinear sources", accepted="'linear'")
            yield Complaint("design.amplifier", repr(circuit.amplifier), text)
        if not circuit.is_small_signal:
            text = _NO_READER.format(what="the limits of op-amps", accepted="'small-signal'")
            yield Complaint("design.opamp.level", "'large-signal'", text)

    def cards(self, text: str) -> str:
        """Return every card as an instance statement."""
        lines = [_statement(line) for line in text.split("\n")]
        if not text.startswith(".title"):
            return "\n".join([LANGUAGE, *lines])
        notes = [f"// {note}" for note in self.checked]
        # Before this statement only the first line, a title, is a comment in any language.
        return "\n".join([lines[0], LANGUAGE, *notes, "global 0", *lines[1:]])

    def closing(self, request: DialectRequest) -> list[str]:
        """Return options, saved nodes and the transient."""
        transient, limits = transient_of(request, self.name), request.limits
        rest = starts_from_rest(request.circuit, transient)
        return [
            f"accuracy options reltol={limits.relative!r} iabstol={limits.current!r}"
            f" vabstol={limits.voltage!r} gmin={limits.junction!r}",
            "save " + " ".join(request.saved),
            f"transient tran stop={transient.stop!r} step={transient.begin!r}"
            f" maxstep={transient.max_step!r} method=traponly" + ("" if rest else " skipdc=yes"),
            "",
        ]


def _statement(line: str) -> str:
    words = line.split()
    if not words:
        return ""
    if line.startswith("*"):
        return "//" + line[1:]
    if line.startswith(".title"):
        return "// " + " ".join(words[1:])
    if words[0] == ".include":
        return f'include "{words[1]}"'
    if words[0] == ".subckt":
        return f"subckt {words[1]} ({' '.join(words[2:])})"
    if words[0] == ".ends":
        return " ".join(["ends", *words[1:]])
    if line.startswith("X"):
        return f"{words[0]} ({' '.join(words[1:-1])}) {words[-1]}"
    count, master, figure = _KINDS[line[0]]
    nodes, value = words[1 : count + 1], words[-1]
    return f"{words[0]} ({' '.join(nodes)}) {master} {figure}={value}"
