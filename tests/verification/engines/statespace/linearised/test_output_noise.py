"""Noise of the outputs beside closed forms: kT/C, one op-amp, and a bound that holds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit, Output
from taction.netlist_gen.board.parts import Capacitor, NoiseCurrent, OpAmpCell, Resistor
from taction.netlist_gen.board.synthesis import synthesise
from taction.spice_models.opamp import OpAmp
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import (
    Covariance,
    _flicker,
    _white,
    output_noise,
)
from tests.support.boards import bare, decompose
from tests.support.making import make_scene, matrix_problem

KT = 1.380649e-23 * 300.15
R, C = 10e3, 2e-12


def stage(model: OpAmp | None, **parts: Any) -> Circuit:
    """One output, node ``out``, of the given parts."""
    models = {} if model is None else {model.name: model}
    return bare(models=models, outputs=(Output("out", 1.0),), **parts)


def noise(circuit: Circuit) -> float:
    """The noise of the one output, rms, V; its bound must be below 1e-6 of it."""
    (rms,), (error,) = output_noise(LinearBoard(circuit))
    assert 0.0 < error < 1e-6 * rms
    return float(rms)


@pytest.mark.parametrize("ohms", [1.0, R, 1e9])
def test_a_resistor_and_a_capacitor_have_kt_over_c(ohms: float) -> None:
    circuit = stage(
        None,
        resistors=(Resistor("r", "out", "0", ohms),),
        capacitors=(Capacitor("c", "out", "0", C),),
    )
    assert noise(circuit) == pytest.approx(math.sqrt(KT / C), rel=1e-9)


def integrator(model: OpAmp) -> Circuit:
    """R and C from the output of an op-amp to its inverting input."""
    return stage(
        model,
        opamps=(OpAmpCell("v", model.name, "0", "x", "out"),),
        resistors=(Resistor("r", "x", "out", R),),
        capacitors=(Capacitor("c", "x", "out", C),),
    )


def test_an_integrator_has_kt_over_c_and_the_current_noise() -> None:
    """``i_n² R² / (4 R C)``: the current sees R with the noise bandwidth 1 / (4 R C)."""
    silent = OpAmp("fast", 1e9)
    assert noise(integrator(silent)) == pytest.approx(math.sqrt(KT / C), rel=1e-8)
    i_n = 3e-12
    wanted = KT / C + i_n**2 * R / (4.0 * C)
    found = noise(integrator(replace(silent, current_noise=i_n)))
    assert found == pytest.approx(math.sqrt(wanted), rel=1e-8)
    sensor = replace(integrator(silent), noises=(NoiseCurrent("eps", "x", i_n),))
    assert noise(sensor) == pytest.approx(math.sqrt(wanted), rel=1e-8)


@pytest.mark.parametrize("gain", [10.0, 1e5])
def test_a_follower_has_its_voltage_noise_over_its_bandwidth(gain: float) -> None:
    """``e_n² H(0)² (pi/2) f``, with ``H(0) = A0 / (1 + A0)`` and ``f = gbw (1 + 1/A0)``."""
    e_n, gbw = 5e-9, 2e6
    model = OpAmp("pole", gain, gbw=gbw, voltage_noise=e_n)
    circuit = stage(model, opamps=(OpAmpCell("u", model.name, "in", "out", "out"),))
    circuit = replace(circuit, resistors=(Resistor("r", "in", "0", 1e-9),))
    wanted = e_n * gain / (1 + gain) * math.sqrt(math.pi / 2 * gbw * (1 + 1 / gain))
    assert noise(circuit) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("corner", [0.0, 100.0, 1e5])
@pytest.mark.parametrize("lowest", [1e-3, 0.1, 1e3, 5e6])
def test_a_follower_above_a_frequency(corner: float, lowest: float) -> None:
    """One pole f_b: white ``f_b (pi/2 - atan x)``, 1/f noise ``ln(1 + 1/x²) / 2`` each corner.

    With ``x = lowest / f_b``: the integrals of ``1 / (1 + (f/f_b)²)`` and of the same over f.
    """
    e_n, gbw, gain = 5e-9, 2e6, 1e5
    model = OpAmp("pole", gain, gbw=gbw, voltage_noise=e_n, voltage_noise_corner=corner)
    circuit = stage(model, opamps=(OpAmpCell("u", model.name, "in", "out", "out"),))
    circuit = replace(circuit, resistors=(Resistor("r", "in", "0", 1e-9),))
    f_b = gbw * (1 + 1 / gain)
    white = f_b * (math.pi / 2 - math.atan(lowest / f_b))
    flicker = corner * math.log1p((f_b / lowest) ** 2) / 2
    wanted = e_n * gain / (1 + gain) * math.sqrt(white + flicker)
    (rms,), (error,) = output_noise(LinearBoard(circuit), lowest)
    assert rms == pytest.approx(wanted, rel=1e-7)
    assert error < 1e-9 * rms


def of_modes(A: np.ndarray) -> Covariance:
    return Covariance(A, decompose(A), np.zeros((2, *A.shape)))


def test_the_bound_above_a_frequency_holds_on_stiff_boards(rng: np.random.Generator) -> None:
    """As below, and each pair of modes has its integrals in closed form.

    ``2 Re a / ((jw + r)(-jw + s)) = 2 Re a (1/(jw + r) + 1/(-jw + s)) / (r + s)``.
    """
    rates, w = np.geomspace(1.0, 1e8, 12), 30.0
    U = np.linalg.qr(rng.standard_normal((12, 12)))[0]
    F = rng.standard_normal((12, 12)) * np.sqrt(rates)[:, None]
    Q, c = F @ F.T, rng.standard_normal((3, 12))
    for weight, alone in (
        (_white(w), np.arctan(rates / w) * 2.0 / math.pi),
        (_flicker(w), 2.0 * np.log1p((rates / w) ** 2) / rates),
    ):
        pairs = 0.5 * np.add.outer(alone, alone) / np.add.outer(rates, rates)
        exact = np.einsum("ki,ij,kj->k", c, Q * pairs, c)
        A = -U @ np.diag(rates) @ U.T
        found, error = of_modes(A).variance(U @ Q @ U.T, c @ U.T, weight)
        assert (np.abs(found - exact) <= error).all()
        assert (error < 1e-4 * exact).all()


def test_the_bound_holds_on_stiff_boards(rng: np.random.Generator) -> None:
    """States of rates 1 to 10^10 /s, mixed by a rotation: P is known in closed form."""
    rates = np.geomspace(1.0, 1e10, 12)
    U = np.linalg.qr(rng.standard_normal((12, 12)))[0]
    F = rng.standard_normal((12, 12)) * np.sqrt(rates)[:, None]
    Q, c = F @ F.T, rng.standard_normal((3, 12))
    exact = np.einsum("ki,ij,kj->k", c, Q / np.add.outer(rates, rates), c)
    found, error = of_modes(-U @ np.diag(rates) @ U.T).variance(U @ Q @ U.T, c @ U.T)
    assert (np.abs(found - exact) <= error).all()
    assert (error < 1e-4 * exact).all()


def two_channels(**design: Any) -> LinearBoard:
    parts = {"capacitance": "1nF", "lambda": 0.2, "gain": "100kohm", "unit_conductance": "10uS"}
    scene = make_scene(design=parts | design)
    return LinearBoard(synthesise(scene, matrix_problem([[1.0, 0.3], [-0.2, 0.8]], [0.6, 0.4])))


def test_noise_of_unlimited_bandwidth_is_refused() -> None:
    """The outputs of a passive board are followers; this one has no input capacitance there."""
    model = {"base": "ideal", "gbw": "10MHz", "output_resistance": "75ohm"}
    with pytest.raises(EngineError, match="noise of output u_1 has no limit of its bandwidth"):
        output_noise(two_channels(topology="passive", gain="1Mohm", opamp=model))
    limited = {**model, "input_capacitance": "1pF"}
    rms, error = output_noise(two_channels(topology="passive", gain="1Mohm", opamp=limited))
    assert (error < 1e-6 * rms).all()
