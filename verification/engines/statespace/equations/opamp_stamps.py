"""Stamp the op-amps.

The op-amp is ``A(s) = A0 / ((1 + s/p1)(1 + s/p2))`` with ``p1 = 2 pi gbw / A0``: an integrator
``x1' = -p1 x1 + 2 pi gbw e``, a lag ``x2' = p2 (x1 - x2)``, and a voltage source behind the output
resistance. The input ``e = v+ - v-`` has the DC errors of `spice_models.opamp` where the model has
them. At the large-signal level e goes through a tanh, a clamp holds x1, and the output current is
limited.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np

from taction.spice_models.opamp import KNEE, OVERDRIVE
from taction.system.array_types import Bools, Floats, Ints
from taction.verification.engines.statespace.equations.amplifier_gains import (
    CLAMP,
    INPUT_STAGE,
    LIMITER,
)
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.equations.stamper import GROUND, Stamper

FIGURES = operator.attrgetter(
    "dc_gain",
    "gbw",
    "second_pole",
    "input_resistance",
    "differential_capacitance",
    "input_capacitance",
    "output_resistance",
    "input_offset",
    "rejection_error",
)


@dataclass(frozen=True, slots=True)
class _Signal:
    """Signals ``plus_gain z[plus] - minus_gain z[minus] + offset`` of P op-amps, each (P,)."""

    plus: Ints
    minus: Ints
    plus_gain: Floats
    minus_gain: Floats
    offset: Floats

    def times(self, factor: Floats) -> _Signal:
        """Return the signals times a factor (P,)."""
        gains = (factor * x for x in (self.plus_gain, self.minus_gain, self.offset))
        return _Signal(self.plus, self.minus, *gains)

    def replaced(self, where: Bools | Ints, places: Ints) -> _Signal:
        """Return the signals with the unknowns at `places` as some of them."""
        plus, minus = self.plus.copy(), self.minus.copy()
        plus[where], minus[where] = places, GROUND
        gains = [self.plus_gain.copy(), self.minus_gain.copy(), self.offset.copy()]
        for gain, new in zip(gains, (1.0, 1.0, 0.0), strict=True):
            gain[where] = new
        return _Signal(plus, minus, *gains)


def stamp_opamps(stamper: Stamper, pins: Ints) -> list[Devices]:
    """Stamp the op-amp macromodels; `pins` (P, 3) are plus, minus and output.

    Return the devices of op-amps at the large-signal level.
    """
    return _OpAmps(stamper, pins).stamp()


class _OpAmps:
    """The op-amps of a circuit, P of them."""

    def __init__(self, stamper: Stamper, pins: Ints) -> None:
        self.stamper, self.cells = stamper, stamper.circuit.opamps
        self.plus, self.minus, self.out = pins.T
        models = stamper.circuit.models
        which = {name: k for k, name in enumerate(models)}
        self.chosen = np.array([which[cell.model] for cell in self.cells], dtype=np.int64)
        self.models = tuple(models.values())
        self.limited = self._where([model.large_signal for model in self.models])

    def stamp(self) -> list[Devices]:
        """Stamp everything."""
        figures = np.array([FIGURES(model) for model in self.models]).reshape(-1, 9)
        gain, gbw, second, *impedances, offset, common = figures[self.chosen].T
        leak, between, grounded, resistance = impedances
        self._inputs(leak, between, grounded)
        poles = self._states(np.isfinite(np.stack([gbw, second], axis=1)))
        half = 0.5 * common
        signal = _Signal(self.plus, self.minus, 1.0 + half, 1.0 - half, offset)
        signal, stages = self._input_stages(signal)
        clamps = self._clamps(poles[:, 0])
        gbw, second = (np.where(np.isfinite(f), f, 0.0) for f in (gbw, second))  # no state: ground
        rate = 2.0 * np.pi * gbw
        signal = self._lag(poles[:, 0], rate / gain, signal.times(rate), signal.times(gain))
        rate = 2.0 * np.pi * second
        signal = self._lag(poles[:, 1], rate, signal.times(rate), signal)
        return [stages, clamps, self._outputs(signal, resistance)]

    def _inputs(self, leak: Floats, between: Floats, grounded: Floats) -> None:
        """Stamp the impedances and currents of the inputs."""
        stamper = self.stamper
        stamper.currents.branch(self.plus, self.minus, -1.0 / leak)
        stamper.mass.branch(self.plus, self.minus, between)
        drawn = np.array([model.input_currents for model in self.models]).reshape(-1, 2)
        for pin, amps in zip((self.plus, self.minus), drawn[self.chosen].T, strict=True):
            stamper.mass.add(pin, pin, grounded)
            stamper.constant_currents.append((pin, -amps))

    def _add(self, rows: Ints, signal: _Signal, *, laws: bool = True) -> None:
        """Stamp signals into rows that state laws, or into current balances."""
        stamper = self.stamper
        entries = stamper.laws if laws else stamper.currents
        constants = stamper.constant_laws if laws else stamper.constant_currents
        entries.add(rows, signal.plus, signal.plus_gain)
        entries.add(rows, signal.minus, -signal.minus_gain)
        constants.append((rows, signal.offset))

    def _where(self, chosen: list[bool]) -> Ints:
        """Return which op-amps have one of the `chosen` models."""
        return np.flatnonzero(np.array(chosen, dtype=np.bool_)[self.chosen])

    def _figures(self, which: Ints, values: list[float]) -> Floats:
        """Return one value of each of some op-amps, from one value of each model."""
        return np.array(values, dtype=np.float64)[self.chosen[which]]

    def _unknowns(self, kind: str, which: Ints) -> Ints:
        """Return the places of new unknowns of some op-amps, whose rows state laws."""
        places = self.stamper.nodes(f"x{self.cells[k].name}.{kind}" for k in which.tolist())
        self.stamper.fixed.update(places.tolist())
        return places

    def _devices(
        self, kind: str, which: Ints, inputs: Ints, size: Floats, width: Floats
    ) -> Devices:
        """Return devices of some op-amps whose outputs are new unknowns, named after their kind."""
        return Devices((kind,) * which.size, inputs, self._unknowns(kind, which), size, width)

    def _input_stages(self, signal: _Signal) -> tuple[_Signal, Devices]:
        """Return the signals behind the input stages ``V tanh(e / V)``, and these stages."""
        which, inputs = self.limited, signal.minus[self.limited].copy()
        # A stage of -e inverts. Where e is -v- alone, v- is its input.
        plain = (signal.plus == GROUND) & (signal.minus_gain == 1.0) & (signal.offset == 0.0)
        others = which[~plain[which]]
        places = self._unknowns("difference", others)
        inputs[~plain[which]] = places
        every = signal.times(-np.ones(len(self.chosen)))
        rows = np.full(len(self.chosen), GROUND)
        rows[others] = places
        self._add(rows, every)
        self.stamper.laws.add(places, places, -np.ones(len(places)))
        ranges = self._figures(which, [model.input_range for model in self.models])
        stages = self._devices(INPUT_STAGE, which, inputs, ranges, ranges)
        return signal.replaced(which, stages.output), stages

    def _clamps(self, first: Ints) -> Devices:
        """Stamp the clamps of the first poles `first` (P,) of op-amps with a finite swing."""
        swings = [model.swing(self.stamper.circuit.supply) for model in self.models]
        limited = [
            m.large_signal and np.isfinite(s) for m, s in zip(self.models, swings, strict=True)
        ]
        which = self._where(limited)
        rates = self._figures(which, [model.slew_rate for model in self.models])
        widths = self._figures(which, [swing / KNEE for swing in swings])
        clamps = self._devices(CLAMP, which, first[which], rates, widths)
        self.stamper.laws.add(first[which], clamps.output, np.ones(len(which)))
        return clamps

    def _states(self, has_state: Bools) -> Ints:
        """Return the places of the op-amps' poles, (P, 2); `GROUND` for a pole without a state."""
        names = [
            f"x{cell.name}.p{k}" if exists else "0"
            for cell, pair in zip(self.cells, has_state.tolist(), strict=True)
            for k, exists in enumerate(pair, 1)
        ]
        return self.stamper.nodes(names).reshape(-1, 2)

    def _lag(self, x: Ints, rate: Floats, driven: _Signal, signal: _Signal) -> _Signal:
        """Add states ``x' = driven - rate x``; return them, or `signal` where `x` is `GROUND`.

        `driven` is ``rate signal``, rounded once.
        """
        there = x != GROUND
        self.stamper.mass.add(x, x, np.ones(len(x)))
        self._add(x, driven)
        self.stamper.laws.add(x, x, -rate)
        return signal.replaced(there, x[there])

    def _outputs(self, signal: _Signal, resistance: Floats) -> Devices:
        """Stamp the voltage sources behind the output resistances; return the current limiters."""
        limiters = self._limiters(signal)
        ideal = resistance == 0.0
        plain = ~ideal
        plain[self._where([model.is_current_limited for model in self.models])] = False
        g = np.divide(1.0, resistance, out=np.ones_like(resistance), where=~ideal)
        driven = signal.times(g)
        for laws, chosen in ((True, ideal), (False, plain)):
            rows = np.where(chosen, self.out, GROUND)
            self._add(rows, driven, laws=laws)
            (self.stamper.laws if laws else self.stamper.currents).add(rows, self.out, -g)
        return limiters

    def _limiters(self, signal: _Signal) -> Devices:
        """Stamp the outputs with a largest current.

        The unknown ``d = v_out + b - x`` is the voltage over the output resistance, and b the drop
        of the limiter behind it.
        """
        which = self._where([model.is_current_limited for model in self.models])
        drop, out = self._unknowns("drop", which), self.out[which]
        ohms = self._figures(which, [model.output_resistance for model in self.models])
        volts = ohms * self._figures(which, [model.output_current for model in self.models])
        size = np.full(len(which), OVERDRIVE * self.stamper.circuit.supply)
        limiters = self._devices(LIMITER, which, drop, size, volts)
        laws, ones = self.stamper.laws, np.ones(len(which))
        for places, sign in (
            (out, 1.0),
            (limiters.output, 1.0),
            (signal.plus[which], -1.0),
            (drop, -1.0),
        ):
            laws.add(drop, places, sign * ones)
        self.stamper.currents.add(out, drop, -1.0 / ohms)
        return limiters
