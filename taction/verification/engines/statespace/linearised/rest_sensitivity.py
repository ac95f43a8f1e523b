"""How far every resistor moves the outputs at rest: adjoint sensitivities of the equilibrium.

With ``F(z, p) = K z + b + f(z) = 0`` at the equilibrium, a change of the value p moves an output
``y = c z`` by ``-l dF`` with ``J' l = c``, where J is the Jacobian of F in z. So one factorisation
of J and one right-hand side for each output give the sensitivity to every part of the board. A
resistor R between the nodes a and b changes only the current balances of these nodes, so that
``dy / d ln R = (l_a - l_b) (z_b - z_a) / R`` (Tellegen's theorem). For a board with behavioural
amplifiers J is taken at the equilibrium: the linearised condition of the optimum.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import ResistorMatrix, entry_voltages
from taction.spice_models.input_errors import CHANGES
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.stamps import gain_stage, stamp
from taction.verification.engines.statespace.linearised.equilibrium import balance, scaled_jacobian
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard


@dataclass(frozen=True, eq=False)
class RestSensitivity:
    """First-order changes of the outputs at rest.

    The equilibrium of `board` is the point of linearisation; `adjoint` (N, size) is ``-dy / dF``:
    output n moves by ``-adjoint[n] @ dF``, V.
    """

    board: LinearBoard
    adjoint: Floats

    @classmethod
    def of(cls, board: LinearBoard) -> RestSensitivity:
        """Linearise `board` at its equilibrium: one factorisation, and a solve for each output.

        EngineError: the board has no equilibrium, or its Jacobian is singular.
        """
        descriptor, outputs = board.descriptor, board.circuit.outputs
        wanted = np.zeros((descriptor.size, len(outputs)))
        places = [descriptor.place(output.node) for output in outputs]
        wanted[places, np.arange(len(outputs))] = [output.sign for output in outputs]
        if descriptor.is_large:
            return cls(board, -board.structure.transposed.factor(0.0)(wanted).T)
        rest = board.equilibrium
        J, row, column = scaled_jacobian(descriptor, rest.slopes, np.abs(rest.values))
        try:
            return cls(board, (np.linalg.solve(J.T, wanted * column) / row).T)
        except np.linalg.LinAlgError:
            raise EngineError("the Jacobian of the equilibrium is singular") from None

    def towards(self, circuit: Circuit) -> Floats:
        """Return how far the equations of `circuit` move the outputs, to first order, V, (N,).

        The circuit has the parts of the board, with other values.
        """
        return -self.adjoint @ balance(stamp(circuit), self.board.equilibrium.values)[1]

    def resistors(self) -> dict[str, Floats]:
        """Return ``dy / d ln R`` (N,), V, of every resistor, by its name in the deck."""
        found: dict[str, Floats] = {}
        for matrix in self.board.circuit.matrices:
            elements = list(matrix.elements())
            names = [f"{matrix.name}_{k + 1}_{n + 1}" for k, n, *_ in elements]
            if matrix.wires is not None:
                k, n = np.array([element[:2] for element in elements]).T
                found |= dict(zip(names, self._wired(matrix)[k, n], strict=True))
                continue
            ends = [(a, b) for _, _, a, b, _ in elements]
            found |= self._branches(names, ends, [ohms for *_, ohms in elements])
        parts = self.board.circuit.resistors
        ends, ohms = [(part.a, part.b) for part in parts], [part.ohms for part in parts]
        return found | self._branches([part.label for part in parts], ends, ohms)

    def input_errors(self) -> dict[str, Floats]:
        """Return ``dy / dp`` (N,) of every input error p of an op-amp that varies.

        By the names of `variation.parameters`; V over V or A, of the common-mode error V. A current
        into an input leaves that node; an offset adds to the input of the gain stage, and so does
        the common-mode error times the voltage of the inputs.
        """
        board, found, felt = self.board, dict[str, Floats](), self._felt
        for cell in board.circuit.opamps:
            model, pins = board.circuit.models[cell.model], (cell.noninverting, cell.inverting)
            if not model.varying:
                continue
            row, gain = gain_stage(model, cell, board.descriptor)
            plus, minus = felt[:, self._places(pins)].T
            offset, volts = -gain * self.adjoint[:, row], [board.equilibrium[pin] for pin in pins]
            slopes = {
                "offset_voltage": offset,
                "bias_current": plus + minus,
                "offset_current": 0.5 * (plus - minus),
                "common_mode_rejection": offset * 0.5 * sum(volts),
            }
            for name, _ in model.varying:
                found[f"{cell.name}.{name}"] = slopes[CHANGES.get(name, name)]
        return found

    def gains(self) -> dict[str, Floats]:
        """Return ``dy / d ln A0`` (N,), V, of every op-amp at the small-signal level.

        By the names of `variation.parameters`. The gain acts on the input voltage at rest, so a
        change of its logarithm adds this voltage to the offset.
        """
        z, found = self.board.equilibrium, dict[str, Floats]()
        for cell in self.board.circuit.opamps:
            model = self.board.circuit.models[cell.model]
            if model.imported is not None or model.large_signal:
                continue
            half, plus, minus = 0.5 * model.rejection_error, z[cell.noninverting], z[cell.inverting]
            volts = (1.0 + half) * plus - (1.0 - half) * minus + model.input_offset
            row, gain = gain_stage(model, cell, self.board.descriptor)
            found[f"{cell.name}.dc_gain"] = -gain * volts * self.adjoint[:, row]
        return found

    @functools.cached_property
    def _felt(self) -> Floats:
        """How a current into each node, and into ground, lowers the outputs, (N, size + 1)."""
        felt = np.append(self.adjoint, np.zeros((len(self.adjoint), 1)), axis=1)
        return np.asarray(felt[:, self.board.descriptor.balance_rows])

    def _places(self, nodes: Sequence[str]) -> list[int]:
        """Return the places of nodes; ground's is the last one."""
        places = self.board.descriptor.places
        return [-1 if node == GROUND else places[node] for node in nodes]

    def _wired(self, matrix: ResistorMatrix) -> Floats:
        """Return the sensitivities to the resistors of a matrix behind its wires, (M, N, outputs).

        Wires are reciprocal: the adjoint solution has voltages behind them as the board has.
        """
        rows = np.concatenate([self.board.equilibrium.values[None], self._felt[:, :-1]])
        volts = {name: rows[:, place] for name, place in self.board.descriptor.places.items()}
        across = entry_voltages(matrix, volts)
        return np.asarray(-across[..., 1:] * across[..., :1] / matrix.ohms[..., None])

    def _branches(
        self, names: list[str], ends: list[tuple[str, str]], ohms: list[float]
    ) -> dict[str, Floats]:
        """Return the sensitivities to resistors between `ends`."""
        a, b = (self._places([pair[k] for pair in ends]) for k in (0, 1))
        felt, z = self._felt, np.append(self.board.equilibrium.values, 0.0)
        change = (felt[:, a] - felt[:, b]) * ((z[b] - z[a]) / np.array(ohms))
        return dict(zip(names, change.T, strict=True))
