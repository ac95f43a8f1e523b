"""Transistors: figures, presets, and the model card against the equations in ngspice."""

from __future__ import annotations

import math

import pytest
from scipy import constants

from taction.netlist_gen.analysis import OperatingPoint
from taction.spice_models.transistor import Transistor, load_pairs, model_card, thermal_voltage
from taction.verification.engines.ngspice.process import find_simulator, start
from tests.support.small_decks import SmallDeck


@pytest.mark.parametrize("celsius", [-55.0, 27.0, 125.0])
def test_thermal_voltage_is_that_of_the_physical_constants(celsius: float) -> None:
    kelvin = constants.convert_temperature(celsius, "Celsius", "Kelvin")
    expected = constants.k * kelvin / constants.e
    assert thermal_voltage(celsius) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["ssm2220", "ssm2212"])
@pytest.mark.parametrize("volts", [0.4, 0.5, 0.6])
def test_ngspice_has_the_currents_of_the_equations(ngspice: str, name: str, volts: float) -> None:
    pair = load_pairs()[name]
    s = pair.sign
    cards = [
        "* one transistor",
        model_card(pair),
        f"Vb b 0 {s * volts!r}",
        "Vc c 0 0.0",
        f"Q1 c b 0 {pair.name}",
        "Hb vb 0 Vb -1.0",  # 1 V for 1 A into the base
        "Hc vc 0 Vc -1.0",
        ".options temp=50 tnom=50 reltol=1e-9 abstol=1e-18 vntol=1e-15 gmin=1e-20",
        ".save v(vb) v(vc)",
        ".op",
        ".end",
        "",
    ]
    deck = SmallDeck("\n".join(cards), ("vb", "vc"), OperatingPoint())
    with start(deck, find_simulator(), timeout=60.0) as run:
        found = run.result().values[-1]
    # The inner emitter is RE times the emitter current away: fixed point of the closed form.
    V = constants.k * 323.15 / constants.e
    inner = volts
    for _ in range(60):
        F = pair.saturation_current * math.exp(inner / V)
        R = pair.saturation_current * math.exp(volts / V)  # the collector is at 0 V
        base = (F - pair.saturation_current) / pair.forward_gain
        base += (R - pair.saturation_current) / pair.reverse_gain
        collector = F - R - (R - pair.saturation_current) / pair.reverse_gain
        inner = 0.5 * (inner + volts - pair.emitter_resistance * (collector + base))
    assert found == pytest.approx([s * base, s * collector], rel=1e-5)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"name": "a b"}, "name = 'a b'"),
        ({"polarity": "fet"}, "polarity = 'fet'"),
        ({"forward_gain": 0.0}, r"forward_gain = 0\.0"),
        ({"emitter_resistance": math.inf}, "emitter_resistance = inf"),
    ],
)
def test_a_figure_out_of_range_is_named(change: dict[str, object], text: str) -> None:
    figures = {
        "name": "q", "polarity": "npn", "saturation_current": 1e-14, "forward_gain": 100.0,
        "reverse_gain": 1.0, "emitter_resistance": 0.3, "emitter_capacitance": 1e-12,
        "collector_capacitance": 1e-12,
    }  # fmt: skip
    with pytest.raises(ValueError, match=text):
        Transistor(**(figures | change))  # type: ignore[arg-type]
