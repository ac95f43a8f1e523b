"""Every card of the macromodels, measured in a real ngspice."""

from __future__ import annotations

import math
import subprocess
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import constants
from scipy.special import wrightomega

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.parts import SignalAmplifier
from taction.netlist_gen.deck.deck import amplifier_lines
from taction.spice_models.amplifier import KINDS
from taction.spice_models.branches import Branch, check_parts, label_of
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import derive, load_presets
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.spice_models.transistor import Transistor, load_pairs, model_card, thermal_voltage
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from tests.support.small_decks import SmallDeck

PRESETS = load_presets()
ANTILOG = KINDS["exponential"].expression
TIGHT = ".options reltol=1e-12 abstol=1e-18 vntol=1e-15"


def simulate(ngspice: str, folder: Path, *lines: str) -> dict[str, NDArray[np.generic]]:
    """Run a deck and return its vectors by name; complex for an AC analysis."""
    deck, raw = folder / "deck.cir", folder / "out.raw"
    deck.write_text("\n".join(["test bench", *lines, ".end", ""]))
    subprocess.run(
        [ngspice, "-b", "-n", "-r", str(raw), str(deck)],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=60,
        check=True,
    )
    header, _, data = raw.read_bytes().partition(b"Binary:\n")
    fields, _, variables = header.decode().partition("Variables:\n")
    names = [line.split()[1].lower() for line in variables.splitlines()]
    kind = np.complex128 if "Flags: complex" in fields else np.float64
    return dict(zip(names, np.frombuffer(data, kind).reshape(-1, len(names)).T, strict=True))


@pytest.mark.parametrize("model", PRESETS.values(), ids=PRESETS)
def test_a_preset_has_its_figures(ngspice: str, tmp_path: Path, model: OpAmp) -> None:
    f_u = unity_gain_bandwidth(model) if math.isfinite(model.gbw) else 1e6
    result = simulate(
        ngspice,
        tmp_path,
        str(opamp_subcircuit(model, noninverting_grounded=False)),
        "Vg g 0 AC 1",
        f"Xg g 0 open {model.name}",
        "Io 0 loaded AC 1",
        f"Xo 0 0 loaded {model.name}",
        "Vn n 0 AC 1",
        f"Xn 0 n on {model.name}",
        "Vp p 0 AC 1",
        f"Xp p 0 op {model.name}",
        "Vc c 0 AC 1",
        f"Xc c c oc {model.name}",
        f".ac lin 3 1e-9 {f_u!r}",  # three, as ngspice makes one point of two
    )
    gain = result["v(open)"]
    # At 1 nHz; the first pole of a gain of 3e8 is at 47 mHz.
    assert abs(gain[0]) == pytest.approx(model.dc_gain, rel=1e-9)
    if math.isfinite(model.gbw):
        assert abs(gain[-1]) == pytest.approx(1.0, rel=1e-9)
        margin = math.degrees(np.angle(gain[-1]) % (2.0 * math.pi)) - 180.0
        assert margin == pytest.approx(phase_margin(model), abs=1e-7)
    assert result["v(loaded)"] == pytest.approx([model.output_resistance] * 3, rel=1e-9)

    omega = 2.0 * math.pi * f_u
    both = model.differential_capacitance + model.input_capacitance
    for name in ("i(vn)", "i(vp)"):
        assert -result[name][-1].imag == pytest.approx(omega * both, rel=1e-9)
        assert -result[name][0].real == pytest.approx(1.0 / model.input_resistance, rel=1e-9)
    assert -result["i(vc)"][-1].imag == pytest.approx(
        2.0 * omega * model.input_capacitance, rel=1e-9
    )


@pytest.mark.parametrize("model", PRESETS.values(), ids=PRESETS)
def test_a_preset_has_the_noise_of_its_figures(ngspice: str, tmp_path: Path, model: OpAmp) -> None:
    """Open loop, both inputs through silent resistors in which i_n makes about the noise e_n."""
    R = model.voltage_noise / model.current_noise if model.current_noise else 1e3
    result = simulate(
        ngspice,
        tmp_path,
        str(opamp_subcircuit(model, noninverting_grounded=False, noisy=True)),
        "V1 in 0 0.0 AC 1",
        f"Rp in p {R!r} noisy=0",
        f"Rn n 0 {R!r} noisy=0",
        f"X1 p n out {model.name}",
        ".options noopiter",
        ".save onoise_spectrum",
        ".noise v(out) V1 dec 1 1e-6 1e-5",
    )
    difference = (
        R if math.isinf(model.input_resistance) else R / (1 + 2 * R / model.input_resistance)
    )
    flicker = 1.0 + (model.voltage_noise_corner or 0.0) / result["frequency"][0]
    e_n = model.voltage_noise * math.sqrt(flicker)
    wanted = math.hypot(e_n, math.sqrt(2.0) * model.current_noise * difference)
    found = result["onoise_spectrum"][0]
    assert found == pytest.approx(wanted * model.dc_gain, rel=1e-5, abs=1e-30)


@pytest.mark.parametrize("volts", [-13.0, -1.6, -1.5, -1.0, 0.5, 1.5, 1.52, 14.0])
def test_an_output_gives_no_more_than_its_largest_current(
    ngspice: str, tmp_path: Path, volts: float
) -> None:
    """The output is held at 0 V, the second pole at `volts` behind 75 ohm: 20 mA is 1.5 V."""
    model = replace(PRESETS["ua741"], large_signal=True, limits_current=True, output_current=20e-3)
    text = str(opamp_subcircuit(model, noninverting_grounded=True, supply=15.0))
    own = ("Eo", "Ro", "Ez", "Bl", "El")
    stage = [line for line in text.splitlines() if line.split()[0] in own]
    cards = [f"Vp p2 0 {volts!r}", "Vout out 0 0.0", *stage, TIGHT, ".op"]
    found = float(simulate(ngspice, tmp_path, *cards)["i(vout)"][0])

    def softplus(z: mpmath.mpf) -> mpmath.mpf:
        return mpmath.log1p(mpmath.exp(z))

    with mpmath.workdps(40):  # the voltage that belongs to the current that was found
        y = mpmath.mpf(found) / mpmath.mpf(20e-3)
        drop = 1500 * (softplus(100 * (y - 1)) - softplus(-100 * (y + 1))) / 100
        assert float(75 * mpmath.mpf(found) + drop) == pytest.approx(volts, rel=1e-9)
    assert abs(found) < 20e-3 * 1.01


def test_a_high_gain_behind_one_pole_has_its_operating_point(ngspice: str, tmp_path: Path) -> None:
    """R1 is 1.6e13 ohm here: below the absolute pivot limit of ngspice's own solver."""
    model = derive(PRESETS["ideal"], "pole", gbw=1e6)
    result = simulate(
        ngspice,
        tmp_path,
        str(opamp_subcircuit(model, noninverting_grounded=True)),
        "V1 in 0 0.1",
        "R1 in x 1000.0",
        "R2 x out 3000.0",
        "X1 0 x out pole",
        ".op",
    )
    assert result["v(out)"][0] == pytest.approx(-0.3 / (1.0 + 4.0 / 1e9), rel=1e-12)


@pytest.mark.parametrize(
    ("u_scale", "v_scale"), [(1.0, 1.0), (0.1 / 3.0, 1.0), (0.7 / 3.0, 1 / 39)]
)
def test_the_antilog_stage_is_the_exponential(
    ngspice: str, tmp_path: Path, u_scale: float, v_scale: float
) -> None:
    arguments = [-700.0, -20.0, -1.2345678901234567, 0.0, 1.0, math.pi, 29.999, 30.0]
    lines = []
    for i, x in enumerate(arguments):
        lines += [f"V{i} in{i} 0 {x * v_scale!r}"]
        stage = SignalAmplifier(f"_{i}", "exponential", f"in{i}", f"out{i}", u_scale, v_scale)
        lines += amplifier_lines(stage, ANTILOG)
    result = simulate(ngspice, tmp_path, *lines, TIGHT, ".op")
    measured = [float(result[f"v(out{i})"][0]) for i in range(len(arguments))]
    expected = [-u_scale * math.exp(x * v_scale / v_scale) for x in arguments]
    assert measured == pytest.approx(expected, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("drive", [-500.0, 0.0, 10.0, 2000.0, 1e6])
def test_a_loop_through_the_antilog_stage_converges(
    ngspice: str, tmp_path: Path, drive: float
) -> None:
    """``v = d - e^v``: Newton's first step lands at about d / 2, far above the solution."""
    result = simulate(
        ngspice,
        tmp_path,
        str(opamp_subcircuit(PRESETS["ideal"], noninverting_grounded=True)),
        "R1 v x 1e6",
        "R2 u x 1e6",
        f"I1 x 0 {drive * 1e-6!r}",
        "X1 0 x v ideal",
        "X2 0 y u ideal",
        "R3 a y 1e4",
        "R4 y u 1e4",
        *amplifier_lines(SignalAmplifier("A", "exponential", "u2", "a", 1.0, 1.0), ANTILOG),
        "E2 u2 0 v 0 1.0",
        ".options reltol=1e-9 abstol=1e-15 vntol=1e-12",
        ".op",
    )
    assert result["v(a)"][0] == pytest.approx(-float(wrightomega(drive)), rel=1e-6, abs=1e-9)


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
    with Simulation(deck, find_simulator(), timeout=60.0) as run:
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


@pytest.mark.parametrize(
    ("name", "label"),
    [("1", "R1"), (".1", "R.1"), ("a.b", "Ra.b"), (".x1.rin", "x1.Rin"), (".x.y.r2", "x.y.R2")],
)
def test_a_part_has_the_name_that_its_designer_wrote(name: str, label: str) -> None:
    assert label_of("R", name) == label


SOURCE, COIL = Branch("V", "1", "a", "0", 1.0), Branch("L", "1", "a", "0", 1e-3)


@pytest.mark.parametrize(
    ("part", "text"),
    [
        (Branch("F", "1", "a", "b", 2.0, ("V2",)), "no part 'V2'"),
        (Branch("H", "1", "a", "b", 2.0), "expected 1 controls"),
        (Branch("G", "1", "a", "b", 2.0, ("a",)), "expected 2 controls"),
        (Branch("K", "1", "L1", "L2", 0.5), "no part 'L2'"),
        (Branch("R", "1", "a", "b", 0.0), "other than 0"),
        (Branch("D", "1", "a", "b", 1.0), "expected one of"),
        (SOURCE, "a name of its own"),
    ],
)
def test_a_part_of_a_linear_model_that_cannot_be_is_named(part: Branch, text: str) -> None:
    assert (COIL.nodes, Branch("K", "1", "L1", "L2", 0.5).nodes) == (("a", "0"), ())
    check_parts([SOURCE, COIL, Branch("F", "1", "a", "b", 2.0, ("V1",))])
    with pytest.raises(ValueError, match=text):
        check_parts([SOURCE, COIL, part])
