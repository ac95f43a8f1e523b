"""Files of CrossSim and aihwkit: their numbers by their own formulas, and what is refused."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.built_arrays import device_of, wires_of
from taction.netlist_gen.board.devices import load_devices
from taction.netlist_gen.board.foreign_arrays import read_devices, read_wires
from taction.netlist_gen.board.wires import Wires
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.scene.writing import scene_text
from taction.system.array_types import Floats
from taction.system.errors import InputError
from tests.support.paths import DATA

CROSSSIM: dict[str, Any] = json.loads((DATA / "crosssim.json").read_text("utf-8"))
PCM: dict[str, Any] = json.loads((DATA / "aihwkit.json").read_text("utf-8"))
OFF = CROSSSIM["xbar"]["device"]["drift_error"]
FREE: dict[str, Any] = {
    "class": "StateIndependentNoiseModel", "g_max": 40.0, "prog_coeff": [0.2, 0.1, 0.0],
    "prog_noise_scale": 2.0, "drift_nu_mean": 0.05, "drift_nu_std": 0.01, "drift_scale": 1.0,
    "t_0": 10.0, "read_noise_scale": 0.0,
}  # fmt: skip
WAN: dict[str, Any] = {
    "class": "ReRamWan2022NoiseModel", "g_max": 40.0, "coeff_g_max_reference": 40.0,
    "coeff_dic": {"86400.0": [9.0], "1.0": [0.348, 16.030, -43.853, 45.393, -16.815]},
    "noise_scale": 1.0,
}  # fmt: skip


def file(folder: Path, data: Any) -> Path:
    path = folder / "params.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def changed(data: Any, key: str, value: Any) -> Any:
    made = inside = copy.deepcopy(data)
    *way, last = key.split(".")
    for part in way:
        inside = inside[part]
    inside[last] = value
    return made


def test_a_device_of_crosssim(tmp_path: Path) -> None:
    found = read_devices(file(tmp_path, CROSSSIM))
    assert (found.least, found.most) == pytest.approx((1e-6, 50e-6))
    assert (found.levels, found.read_noise) == (16, 0.01)
    g = np.array([1e-6, 30e-6])
    np.testing.assert_allclose(found.spreads(g)["programming"], 0.02 * 50e-6)
    relative = changed(CROSSSIM, "xbar.device.programming_error.model", "NormalProportionalDevice")
    found = read_devices(file(tmp_path, relative))
    np.testing.assert_allclose(found.spreads(g)["programming"], 0.02 * g)
    off = changed(CROSSSIM, "xbar.device.programming_error.enable", False)
    open_ended = read_devices(
        file(tmp_path, changed(off, "xbar.device.infinite_on_off_ratio", True))
    )
    assert (open_ended.least, open_ended.programming_error) == (0.0, ())


def test_a_measured_device_of_crosssim_has_its_polynomial(tmp_path: Path) -> None:
    joshi = changed(CROSSSIM, "xbar.device.programming_error.model", "PCMJoshi")
    joshi = changed(changed(joshi, "xbar.device.Rmin", 40e3), "xbar.device.Rmax", 4e6)
    found = read_devices(file(tmp_path, joshi))
    (sigma,) = found.spreads(np.array([20e-6]))["programming"]
    assert sigma == pytest.approx(
        1e-6 * (0.28638599 + 0.07585724 * 20 - 0.00178767 * 400), rel=1e-3
    )


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_noise_models_of_aihwkit_by_their_formulas(tmp_path: Path, share: float) -> None:
    """In uS, with x = g/g_max; nu of PCM is clip(-0.0155 ln x + 0.0244, 0.049, 0.1) times 2."""
    g, day, log = np.array([share * 50e-6]), 86400.0, math.log(share)
    pcm = read_devices(file(tmp_path, PCM))
    wanted = 0.5 * (50.0 / 25.0) * (0.26348 + 1.9650 * share - 1.1731 * share**2)
    assert pcm.spreads(g)["programming"][0] == pytest.approx(1e-6 * wanted, rel=1e-12)
    assert (pcm.least, pcm.most, pcm.drift_start) == pytest.approx((0.5e-6, 50e-6, 20.0))
    nu = 2.0 * min(max(-0.0155 * log + 0.0244, 0.049), 0.1)
    assert pcm.drift.at(np.array([share]))[0] == pytest.approx(nu)
    spread = 2.0 * min(max(-0.0125 * log - 0.0059, 0.008), 0.045)
    assert pcm.drift_spread.at(np.array([share]))[0] == pytest.approx(spread)
    free = read_devices(file(tmp_path, FREE))
    found = free.spreads(np.array([share * 40e-6]))["programming"][0]
    assert found == pytest.approx(1e-6 * 2.0 * (0.2 + 0.1 * share))
    assert free.drift.at(np.array([share, day])) == pytest.approx(0.05)
    wan = read_devices(file(tmp_path, WAN))
    found = wan.spreads(np.array([share * 40e-6]))["programming"][0]
    wanted = sum(c * share**n for n, c in enumerate(WAN["coeff_dic"]["1.0"]))
    assert found == pytest.approx(1e-6 * wanted)


def test_the_named_device_of_aihwkit_is_that_of_its_attributes(tmp_path: Path) -> None:
    data = PCM | {"g_converter": {"g_min": 0.25}, "g_max": 25.0, "prog_noise_scale": 1.0}
    found, named = read_devices(file(tmp_path, data | {"drift_scale": 1.0})), load_devices()
    g = np.array([0.3e-6, 2e-6, 20e-6])
    for each in ("programming",):
        np.testing.assert_allclose(
            found.spreads(g)[each], named["pcm-aihwkit"].spreads(g)[each], rtol=1e-4
        )
    x = g / 25e-6
    np.testing.assert_allclose(found.drift.at(x), named["pcm-aihwkit"].drift.at(x))


def crosssim_currents(G: Floats, volts: Floats, row: float, column: float) -> Floats:
    """Return currents of ``y = G v`` by sums of drops along the lines, as CrossSim describes them.

    The line of an input enters at output 1; that of an output leaves behind the last input.
    """
    drops = np.zeros_like(G)
    for _ in range(200):
        amps = G * (volts - drops)
        along_input = np.cumsum(amps[::-1], axis=0)[::-1]
        along_output = np.cumsum(amps, axis=1)
        drops = row * np.cumsum(along_input, axis=0)
        drops += column * np.cumsum(along_output[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(amps.sum(axis=1))


def test_wires_of_crosssim_give_the_currents_of_its_description(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    data = CROSSSIM
    for key in ("Rp_row_terminal", "Rp_col_terminal"):
        data = changed(data, f"xbar.array.parasitics.{key}", 0)
    found = read_wires(file(tmp_path, data))
    G, volts = rng.uniform(1e-4, 1e-3, (4, 3)), rng.uniform(-1.0, 1.0, 3)
    ports = Wires(**found).at_ports(G, by_column=True)
    amps = ports.across @ volts
    np.testing.assert_allclose(amps, crosssim_currents(G, volts, 1.5, 2.5), rtol=1e-9)
    whole = read_wires(file(tmp_path, CROSSSIM))
    assert (whole["driver"], whole["sense"]) == (30.0, 40.0)
    assert read_wires(file(tmp_path, changed(data, "xbar.array.parasitics.enable", False))) == {}


def scene_in(folder: Path, **tables: Any) -> Scene:
    (folder / "s.toml").write_text('problem = {kind = "tactile"}', encoding="utf-8")
    return with_values(taction.load_scene(folder / "s.toml"), tables)


def test_a_scene_takes_a_file_and_its_own_keys_replace_it(tmp_path: Path) -> None:
    file(tmp_path, CROSSSIM)
    one = scene_in(
        tmp_path,
        devices={"file": "params.json", "cell_levels": 8, "age": 5.0},
        wires={"file": "params.json", "word_line": 7.0},
    )
    device, wires = device_of(one), wires_of(one)
    assert device is not None
    assert wires is not None
    assert (device.most, device.levels, device.age) == (5e-5, 8, 5.0)
    assert (wires.word_line, wires.bit_line, wires.corner) == (7.0, 1.5, "top-right")
    assert "../params.json" in scene_text(one, tmp_path / "below")
    circuit = taction.synthesise(one)
    assert {each.device for each in circuit.matrices} == {device}
    file(tmp_path, changed(CROSSSIM, "xbar.array.parasitics.enable", False))
    assert wires_of(scene_in(tmp_path, wires={"file": "params.json"})) is None
    with pytest.raises(InputError, match="excludes 'cell'"):
        device_of(scene_in(tmp_path, devices={"file": "params.json", "cell": "rram-wan"}))


def test_read_noise_of_aihwkit_is_the_scene_s_or_none(tmp_path: Path) -> None:
    file(tmp_path, PCM | {"read_noise_scale": 1.0})
    with pytest.raises(InputError, match=r"read_noise_scale = 1\.0: .* devices\.read_noise"):
        device_of(scene_in(tmp_path, devices={"file": "params.json"}))
    found = device_of(scene_in(tmp_path, devices={"file": "params.json", "read_noise": 0.01}))
    assert found is not None
    assert found.read_noise == 0.01


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (changed(CROSSSIM, "xbar.device.Rmin", -1), r"xbar\.device\.Rmin = -1: expected a number"),
        (changed(CROSSSIM, "xbar.device.Rmin", True), "Rmin = true: expected a number above zero"),
        (changed(CROSSSIM, "xbar.device.Rmin", math.nan), "Rmin = NaN: expected a number"),
        (changed(CROSSSIM, "xbar.device.Rmin", 10**400), "Rmin = 1000.*expected a number"),
        (changed(CROSSSIM, "xbar.device.Rmin", 5e-324), "Rmin = 5e-324: expected a number"),
        (changed(CROSSSIM, "xbar.device.Rmax", 2e4), r"Rmax = 20000\.0: expected more than Rmin"),
        (changed(CROSSSIM, "xbar.device.cell_bits", 2.5), "cell_bits = 2.5: expected a whole"),
        (changed(CROSSSIM, "xbar.device", 3), "xbar.device = 3: expected a table"),
        (
            changed(CROSSSIM, "xbar.device.programming_error.model", "UniformIndependentDevice"),
            "programming_error.model .*no such devices; expected 'IdealDevice', 'NormalIndep",
        ),
        (
            changed(CROSSSIM, "xbar.device.drift_error", OFF | {"enable": True, "model": "SONOS"}),
            r"drift_error\.model .*no such devices; expected 'IdealDevice'",
        ),
        (
            changed(CROSSSIM, "xbar.device.programming_error.model", "RRAMWan"),
            "Rmin = 20000.0: expected at least 25471.2 ohm, for which RRAMWan was measured",
        ),
        (PCM | {"prog_coeff": []}, r"prog_coeff = \[\]: expected a list of 1 to 9 numbers"),
        (PCM | {"prog_coeff": [1.0, "x"]}, r'prog_coeff\.1 = "x": expected a number'),
        (PCM | {"g_converter": {"g_min": 60.0}}, "g_min = 60.0: expected less than g_max"),
        (PCM | {"class": "PCM"}, "class = \"PCM\": taction has no such devices; expected 'PCML"),
        (WAN | {"coeff_dic": {"noon": [1.0]}}, "expected a table of times"),
        ({}, "expected a parameter file of CrossSim, or JSON with the key 'class'"),
        ([1], "expected a parameter file of CrossSim"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused_with_its_key(tmp_path: Path, data: Any, says: str) -> None:
    path = file(tmp_path, data)
    with pytest.raises(InputError, match=says) as caught:
        read_devices(path)
    assert caught.value.file.endswith("params.json")


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("xbar.array.parasitics.Rp_row", "1", r'Rp_row = "1": expected a number of at least 0'),
        ("xbar.array.parasitics.current_from_input", False, "the input's line has the current"),
        ("xbar.array.parasitics.gate_input", True, "no gates of transistors"),
        ("core.balanced.interleaved_posneg", True, "lines of their own"),
    ],
)
def test_wires_that_taction_does_not_have_are_refused(
    tmp_path: Path, key: str, value: Any, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        read_wires(file(tmp_path, changed(CROSSSIM, key, value)))
    with pytest.raises(InputError, match="xbar: required"):
        read_wires(file(tmp_path, PCM))


@pytest.mark.parametrize("content", [b"", b"\x80\x04cos\nsystem\n.", b"[" * 100_000, b"{"])
def test_no_pickle_and_nothing_else_runs(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "params.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match="expected a parameter file of CrossSim"):
        read_devices(path)
