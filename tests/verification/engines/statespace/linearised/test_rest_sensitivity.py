"""Sensitivities of the rest to resistors, against the derivative of the optimality condition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

from taction.netlist_gen.board.synthesis import synthesise
from taction.spice_models.opamp import OpAmp
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from tests.support.making import make_scene, matrix_problem

T = np.array([[1.0, -0.3, 0.05], [0.2, 0.8, 0.1], [0.0, 0.25, 1.1], [0.4, -0.1, 0.3]])
EPS = np.array([0.87, 0.46, 0.75, 0.5])
LAM, U0 = 0.2, 0.5


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_the_sensitivities_are_those_of_the_optimality_condition(amplifier: str) -> None:
    """``F(u) = T'(T u - eps) + mu (g^-1(u) + beta) = 0``; Rf is T in ``T u``, Rb is T'."""
    linear = amplifier == "linear"
    design = {"lambda": LAM, "gain": 1e5, "unit_conductance": 1e-5, "unit_voltage": U0}
    design |= {"amplifier": amplifier, "opamp": "ideal", "stray_capacitance": 0}
    if not linear:
        design |= {"exponential_slope": 0.1}
    circuit = synthesise(make_scene(design=design), matrix_problem(T, EPS))
    ideal = {name: OpAmp(name, 1e15) for name in circuit.models}
    found = RestSensitivity.of(LinearBoard(replace(circuit, models=ideal))).resistors()
    mu = LAM if linear else 0.5 * LAM
    gram, wanted = T.T @ T, T.T @ EPS
    u = np.linalg.solve(gram + mu * np.eye(3), wanted)
    slope = np.ones(3)
    if not linear:
        v = root(lambda v: gram @ np.exp(v) - wanted + mu * (v + 1.0), np.zeros(3), tol=1e-14).x
        u, slope = np.exp(v), np.exp(v)
    J, misfit = gram + mu * np.diag(1.0 / slope), T @ u - EPS
    for k, n in np.argwhere(T).tolist():
        forward = np.linalg.solve(J, T[k] * T[k, n] * u[n]) * U0
        feedback = np.linalg.solve(J, np.eye(3)[n] * T[k, n] * misfit[k]) * U0
        assert found[f"Rf_{k + 1}_{n + 1}"] == pytest.approx(forward, rel=1e-8, abs=1e-11)
        assert found[f"Rb_{k + 1}_{n + 1}"] == pytest.approx(feedback, rel=1e-8, abs=1e-11)
    for k in range(4):
        gain = -np.linalg.solve(J, T[k] * misfit[k]) * U0
        assert found[f"Rs_{k + 1}"] == pytest.approx(gain, rel=1e-8, abs=1e-11)
    for n in range(3):
        back = np.linalg.solve(J, np.eye(3)[n] * mu * (u[n] if linear else np.log(u[n]))) * U0
        assert found[f"Rr_{n + 1}"] == pytest.approx(back, rel=1e-8, abs=1e-11)
        # Both resistors of an inverter scale its output, with opposite signs.
        name = f"a_{n + 1}" if linear else f"u_{n + 1}"
        if f"R{name}_in" in found:
            assert found[f"R{name}_in"] == pytest.approx(-found[f"R{name}_fb"], rel=1e-8, abs=1e-11)
