"""An engine from another package: even steps of a linear board, each by a matrix exponential."""

import time

import numpy as np
from scipy.linalg import expm

from taction.system.errors import EngineError
from taction.system.waveforms import Cost, Waveforms
from taction.verification.verdict.simulation import Engine

POINTS = 4000


def begin(design):
    """Return the function that simulates a planned board."""
    if not design.circuit.is_linear:
        raise EngineError("even_steps simulates linear boards only")
    return lambda: simulate(design.board.state_space, design.transient)


def simulate(space, transient):
    """Return the waveforms of ``x' = A x + B [on, 1]`` after the step of the strain currents."""
    start = time.perf_counter()
    n, step = space.n, transient.stop / POINTS
    drive = space.B @ [1.0, 1.0]
    E = expm(step * np.block([[space.A, drive[:, None]], [np.zeros((1, n + 1))]]))
    x = np.empty((POINTS + 1, n))
    before = np.zeros(space.C.shape[0])  # everything is discharged, or at rest without strain
    x[0] = space.state_of(before)
    if transient.initial == "rest":
        x[0] = np.linalg.solve(space.A, -(space.B @ [0.0, 1.0]))
    for k in range(POINTS):
        x[k + 1] = E[:n, :n] @ x[k] + E[:n, n]
    volts = x @ space.C.T + space.D @ [1.0, 1.0]
    cost = Cost(time.perf_counter() - start, POINTS)
    instants = step * np.arange(POINTS + 1)
    return Waveforms(instants, space.nodes, volts, "even_steps", cost, method="exponential")


EVEN_STEPS = Engine(begin, title="even steps")
