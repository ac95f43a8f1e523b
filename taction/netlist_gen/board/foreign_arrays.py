"""Devices and wires of arrays from parameter files of CrossSim and aihwkit, which are data here.

Both are JSON. CrossSim writes its own (`CrossSimParameters.to_json`); of an aihwkit noise model it
is the class and its attributes. Only what is named here is read, and what taction's devices and
wires do not have is refused.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taction.netlist_gen.board.devices import MICRO, Device, Logarithmic, load_devices
from taction.system.errors import Complaint, InputError, listed
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded

ACCEPTED = (
    "a parameter file of CrossSim, or JSON with the key 'class' and the attributes of a noise model"
    " of aihwkit"
)
MOST = 1e30  # of a number: no product of a few leaves the floats
DEGREE = 8  # of a polynomial
BITS = 16  # of a cell
IDEAL = "IdealDevice"
INDEPENDENT, PROPORTIONAL = "NormalIndependentDevice", "NormalProportionalDevice"
MEASURED = {"PCMJoshi": "pcm-joshi", "RRAMMilo": "rram-milo", "RRAMWan": "rram-wan"}
"""Devices of CrossSim that are in ``devices.toml``, too."""
NU, SPREAD = (-0.0155, 0.0244, 0.049, 0.1), (-0.0125, -0.0059, 0.008, 0.045)
"""Slope over ln(g/g_max), offset and limits of PCM's drift in aihwkit: mean and deviation."""
READ_NOISE = (
    "the read noise of aihwkit depends on conductance and time; expected 0, or the key"
    " devices.read_noise of the scene: a fraction of the conductance, in its place"
)


@dataclass(frozen=True, slots=True)
class ForeignTable:
    """A table of a file: what is wrong with a value is said with file, key and what is accepted."""

    path: Path
    data: Mapping[str, Any]
    place: str = ""

    @classmethod
    def read(cls, path: Path) -> ForeignTable:
        """Read a file.

        Raises
        ------
        InputError
            It cannot be read, or is no JSON table.
        """
        try:
            data = json.loads(read_bounded(path, MEGABYTE))
        except (UnusableFileError, ValueError, RecursionError) as error:
            text = f"{str(error) or 'nested too deeply'}; expected {ACCEPTED}"
            raise InputError(path, Complaint("file", repr(path.name), text)) from None
        if not isinstance(data, dict):
            raise InputError(path, Complaint("file", repr(path.name), f"expected {ACCEPTED}"))
        return cls(path, data)

    def wrong(self, key: str, text: str) -> InputError:
        """Return the error about the value of a key."""
        value = self.data.get(key, "")
        shown = "" if key not in self.data else json.dumps(value)[:60]
        return InputError(self.path, Complaint(f"{self.place}{key}", shown, text))

    def table(self, key: str) -> ForeignTable:
        """Return the table at a dotted key; without one it is empty."""
        found, place = self, self.place
        for part in key.split("."):
            place += f"{part}."
            value = found.data.get(part, {})
            if not isinstance(value, dict):
                raise found.wrong(part, "expected a table")
            found = ForeignTable(self.path, value, place)
        return found

    def number(
        self, key: str, default: float | None = None, *, least: float = 0.0, positive: bool = False
    ) -> float:
        """Return a finite number of at least `least`; required without a default."""
        value = self.data.get(key, default)
        wanted = "a number above zero" if positive else f"a number of at least {least:g}"
        fits = isinstance(value, int | float) and not isinstance(value, bool)
        if not fits or not least <= value <= MOST or (positive and value < 1.0 / MOST):
            raise self.wrong(key, f"expected {wanted}, at most {MOST:g}")
        return float(value)

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return the coefficients of a polynomial."""
        values = self.data.get(key)
        if not isinstance(values, list) or not 1 <= len(values) <= DEGREE + 1:
            raise self.wrong(key, f"expected a list of 1 to {DEGREE + 1} numbers")
        each = {str(n): value for n, value in enumerate(values)}
        inner = ForeignTable(self.path, each, f"{self.place}{key}.")
        return tuple(inner.number(name, least=-MOST) for name in each)

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, "expected true or false")
        return value

    def one_of(self, key: str, known: Mapping[str, Any]) -> str:
        """Return a word that is known; without one the first of `known`."""
        value = self.data.get(key, next(iter(known)))
        if not isinstance(value, str) or value not in known:
            raise self.wrong(key, f"taction has no such devices; expected {listed(known)}")
        return value


def read_devices(path: Path, *, read_noise: bool = False) -> Device:
    """Return the devices of a file of CrossSim or aihwkit.

    Parameters
    ----------
    read_noise : bool
        Whether that of the file does not count, since the scene has its own.

    Raises
    ------
    InputError
        The file cannot be read or is damaged, or has what taction's devices do not have; with file,
        key and what is accepted.

    Examples
    --------
    >>> import tempfile
    >>> text = '{"xbar": {"device": {"Rmin": 1e4, "Rmax": 1e6, "cell_bits": 3}}}'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = (Path(folder) / "params.json").write_text(text)
    ...     found = read_devices(Path(folder) / "params.json")
    >>> found.least, found.most, found.levels
    (1e-06, 0.0001, 8)
    """
    found = ForeignTable.read(path)
    if "xbar" in found.data:
        return _crosssim(found.table("xbar.device"))
    if "class" in found.data:
        return NOISE_MODELS[found.one_of("class", NOISE_MODELS)](found, read_noise)
    raise InputError(path, Complaint("file", repr(path.name), f"expected {ACCEPTED}"))


def read_wires(path: Path) -> dict[str, Any]:
    """Return the wires of a file of CrossSim, by the keys of a scene's ``[wires]``.

    CrossSim's rows take the inputs of ``y = T x``, so they are the lines of T's columns; its
    columns, the lines of T's rows, end at the row's far side. Without parasitics there are none.

    Raises
    ------
    InputError
        As `read_devices`.
    """
    found = ForeignTable.read(path)
    if "xbar" not in found.data:
        text = "required; expected a parameter file of CrossSim"
        raise InputError(path, Complaint("xbar", "", text))
    given = found.table("xbar.array.parasitics")
    if not given.flag("enable", False):
        return {}
    if given.flag("gate_input", False):
        raise given.wrong("gate_input", "inputs drive lines, no gates of transistors: false")
    if not given.flag("current_from_input", True):
        raise given.wrong("current_from_input", "the input's line has the current: true")
    pairs = found.table("core.balanced")
    if pairs.flag("interleaved_posneg", False):
        raise pairs.wrong("interleaved_posneg", "entries of either sign have lines of their own")
    return {
        "word_line": given.number("Rp_col", 0.0),
        "bit_line": given.number("Rp_row", 0.0),
        "driver": given.number("Rp_row_terminal", 0.0),
        "sense": given.number("Rp_col_terminal", 0.0),
        "corner": "top-right",
    }


def _crosssim(device: ForeignTable) -> Device:
    """Return the devices of CrossSim, whose errors count in the largest conductance."""
    most = 1.0 / device.number("Rmin", positive=True)
    least = 1.0 / device.number("Rmax", positive=True)
    if not least < most:
        raise device.wrong("Rmax", "expected more than Rmin")
    bits = device.number("cell_bits", 0.0)
    if bits > BITS or bits != int(bits):
        raise device.wrong("cell_bits", f"expected a whole number of at most {BITS}")
    for key in ("drift_error", "nonlinear_IV"):
        _model(device.table(key), {IDEAL: None})
    name, size = _model(
        device.table("programming_error"),
        dict.fromkeys((IDEAL, INDEPENDENT, PROPORTIONAL, *MEASURED)),
    )
    error = {INDEPENDENT: (size * most,), PROPORTIONAL: (0.0, size)}.get(name, ())
    if name in MEASURED:
        measured = load_devices()[MEASURED[name]]
        error = measured.programming_error
        if most > measured.most * (1.0 + 1e-3):
            wanted = f"at least {1.0 / measured.most:.6g} ohm, for which {name} was measured"
            raise device.wrong("Rmin", f"expected {wanted}")
    name, size = _model(device.table("read_noise"), dict.fromkeys((IDEAL, PROPORTIONAL)))
    return Device(
        least=0.0 if device.flag("infinite_on_off_ratio", False) else least,
        most=most,
        levels=2 ** int(bits) if bits else 0,
        programming_error=error,
        read_noise=size if name == PROPORTIONAL else 0.0,
        source=f"CrossSim, {device.path.name}",
    )


def _model(error: ForeignTable, known: Mapping[str, Any]) -> tuple[str, float]:
    """Return the model of an error of CrossSim and its magnitude; one that is off is ideal."""
    if not error.flag("enable", False):
        return IDEAL, 0.0
    return error.one_of("model", known), error.number("magnitude", 0.0)


def _aihwkit(
    model: ForeignTable, coefficients: tuple[float, ...], scale: float, **drift: Any
) -> Device:
    """Return the devices of a noise model of aihwkit, which counts in µS and over g_max."""
    most = model.number("g_max", positive=True)
    pair = model.table("g_converter")
    least = pair.number("g_min", 0.0)
    if not least < most:
        raise pair.wrong("g_min", "expected less than g_max")
    error = (MICRO * scale * each / (MICRO * most) ** n for n, each in enumerate(coefficients))
    source = f"aihwkit, {model.path.name}"
    window = MICRO * least, MICRO * most
    return Device(*window, programming_error=tuple(error), source=source, **drift)


def _without_read_noise(model: ForeignTable, other: bool) -> None:
    if not other and model.number("read_noise_scale", 1.0):
        raise model.wrong("read_noise_scale", READ_NOISE)


def _pcm(model: ForeignTable, read_noise: bool) -> Device:
    _without_read_noise(model, read_noise)
    by, most = model.number("drift_scale", 1.0), model.number("g_max", positive=True)
    reference = model.number("prog_coeff_g_max_reference", most, positive=True)
    scale = model.number("prog_noise_scale", 1.0) * most / reference
    nu, spread = (
        Logarithmic(by * offset, by * slope, by * low, by * high)
        for slope, offset, low, high in (NU, SPREAD)
    )
    start = model.number("t_0", positive=True)
    error = model.numbers("prog_coeff")
    return _aihwkit(model, error, scale, drift=nu, drift_spread=spread, drift_start=start)


def _state_independent(model: ForeignTable, read_noise: bool) -> Device:
    _without_read_noise(model, read_noise)
    by, scale = model.number("drift_scale", 1.0), model.number("prog_noise_scale", 1.0)
    nu, spread = (Logarithmic(by * model.number(f"drift_nu_{key}")) for key in ("mean", "std"))
    start = model.number("t_0", positive=True)
    error = model.numbers("prog_coeff")
    return _aihwkit(model, error, scale, drift=nu, drift_spread=spread, drift_start=start)


def _reram(model: ForeignTable, read_noise: bool) -> Device:
    """Return the devices at the first of the measured times; they do not drift."""
    times = model.table("coeff_dic")
    try:
        first = min(times.data, key=float)
    except ValueError:
        text = "expected a table of times in s, each with the coefficients of a polynomial"
        raise model.wrong("coeff_dic", text) from None
    most = model.number("g_max", positive=True)
    reference = model.number("coeff_g_max_reference", most, positive=True)
    scale = model.number("noise_scale", 1.0) * most / reference
    return _aihwkit(model, times.numbers(first), scale)


NOISE_MODELS: dict[str, Callable[[ForeignTable, bool], Device]] = {
    "PCMLikeNoiseModel": _pcm,
    "StateIndependentNoiseModel": _state_independent,
    "ReRamWan2022NoiseModel": _reram,
}
"""Noise models of aihwkit by their class."""
