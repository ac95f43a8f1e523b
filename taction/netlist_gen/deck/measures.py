"""What a deck measures: ``.meas`` cards of a transient, ``.noise`` cards of the outputs.

Rise time, settling time and overshoot are ``.meas`` cards. The definitions are those of
`verification.readings.measurements`; the distance of each channel from its target, and the largest
of them, are nodes of their own, so that one crossing, the last one, is the settling time. A
simulator interpolates its points by straight lines.

A noise analysis has the noise of the sensors, and one ``.noise`` for each band.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from taction.netlist_gen.analysis import NoiseAnalysis
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import NoiseCurrent
from taction.spice_models.opamp import THERMAL
from taction.system.reading_definitions import RISE_LEVELS, SMALL_STEP

END = 0.9  # of the record: from there on a channel that has settled is inside the band
NOT_SETTLED = 1e99  # s: the settling time of a record that ends outside the band


@dataclass(frozen=True, slots=True)
class Measures:
    """What the measures of a deck compare with."""

    targets: tuple[float, ...]  # the numerical solution at each output node, V
    starts: tuple[float, ...]  # their voltages before the step, V
    band: float  # half width of the settling band, fraction of the largest step

    @property
    def amplitude(self) -> float:
        """The largest step of any channel, V."""
        return max(abs(b - a) for a, b in zip(self.starts, self.targets, strict=True))


def measure_lines(circuit: Circuit, measures: Measures, stop: float) -> list[str]:
    """Return sources and ``.meas`` cards, for ngspice, of a transient that ends at `stop`, s."""
    if not measures.amplitude > 0.0:
        raise ValueError("no channel has a step, so there is nothing to measure")
    width = measures.band * measures.amplitude
    lines = [
        f"* targets: the numerical solution at lambda = {circuit.value('lambda')!r}",
        f"* step amplitude A = {measures.amplitude!r} V; settling band {measures.band!r} A;"
        f" {NOT_SETTLED!r} s: not settled",
    ]
    channels = list(zip(circuit.outputs, measures.starts, measures.targets, strict=True))
    for n, (output, _, target) in enumerate(channels, 1):
        lines.append(f"Berr_{n} err_{n} 0 V=abs(V({output.node})-({target!r}))")
    lines += [*_largest(len(channels)), *_settling("", "err", width, stop)]
    for n, (output, start, target) in enumerate(channels, 1):
        step = target - start
        if abs(step) <= width:
            lines.append(f"* channel {n} starts inside the band: t_settle_{n} fails if it stays")
        lines += _settling(f"_{n}", f"err_{n}", width, stop)
        if abs(step) >= SMALL_STEP * measures.amplitude:
            lines += _rise(n, output.node, start, step)
            lines += _overshoot(n, output.node, target, step, measures.amplitude)
        else:
            lines.append(f"* channel {n} has a step under {SMALL_STEP:g} A: no rise time")
            lines += _excursion(n, output.node, (start, target), measures.amplitude)
    return lines


def _largest(channels: int) -> Iterator[str]:
    """Yield the sources of the largest distance, node ``err``: short lines, whatever the board."""
    for n in range(1, channels):
        before = f"V(most_{n - 1})" if n > 1 else "V(err_1)"
        yield f"Bmost_{n} most_{n} 0 V=max({before},V(err_{n + 1}))"
    yield f"Berr err 0 V=V({f'most_{channels - 1}' if channels > 1 else 'err_1'})"


def _settling(suffix: str, node: str, width: float, stop: float) -> Iterator[str]:
    """Yield the last crossing of the band, which counts if the end of the record is inside.

    The end is a stretch, since an oscillation is inside for an instant in each period.
    """
    yield f".meas tran last{suffix} WHEN V({node})={width!r} CROSS=LAST"
    yield f".meas tran end{suffix} MAX V({node}) FROM={END * stop!r} TO={stop!r}"
    value = f"last{suffix}+{NOT_SETTLED!r}*(end{suffix}>{width!r})"
    yield f".meas tran t_settle{suffix} param='{value}'"


def _rise(n: int, node: str, start: float, step: float) -> Iterator[str]:
    low, high = (start + level * step for level in RISE_LEVELS)
    edges = f"TRIG V({node}) VAL={low!r} CROSS=1 TARG V({node}) VAL={high!r} CROSS=1"
    yield f".meas tran t_rise_{n} {edges}"


def _overshoot(n: int, node: str, target: float, step: float, amplitude: float) -> Iterator[str]:
    extreme, sign = ("MAX", "") if step > 0.0 else ("MIN", "-")
    yield f".meas tran peak_{n} {extreme} V({node})"
    yield f".meas tran overshoot_{n} param='max(0,{sign}(peak_{n}-({target!r}))/{amplitude!r})'"


def _excursion(n: int, node: str, ends: tuple[float, float], amplitude: float) -> Iterator[str]:
    """Yield the overshoot of a small step: outside start and target, on either side."""
    low, high = min(ends), max(ends)
    yield f".meas tran peak_{n} MAX V({node})"
    yield f".meas tran low_{n} MIN V({node})"
    value = f"max(0,max(peak_{n}-({high!r}),({low!r})-low_{n})/{amplitude!r})"
    yield f".meas tran overshoot_{n} param='{value}'"


SOURCE = "Vnoise noise_in 0 0.0 ac 1.0"
"""The input that ngspice asks for. It is connected to nothing: input-referred noise is not used."""

SAVED = ".save onoise_spectrum onoise_total"


def noise_cards(
    analysis: NoiseAnalysis, node: str, sensors: Iterable[NoiseCurrent] = ()
) -> list[str]:
    """Return the cards of `analysis` for the voltage of a node.

    The noise of a sensor is the thermal current of a resistor on a node of its own.
    """
    cards = [
        f".noise v({node}) Vnoise dec {band.density} {band.start!r} {band.stop!r}"
        for band in analysis.bands
    ]
    lines = []
    for part in sensors:
        ohms = THERMAL / part.density**2
        lines.append(f"Rnoise_{part.name} noise_{part.name} 0 {ohms!r}")
        lines.append(f"Gnoise_{part.name} 0 {part.node} noise_{part.name} 0 {1.0 / ohms!r}")
    return [*lines, SOURCE, SAVED, *cards]
