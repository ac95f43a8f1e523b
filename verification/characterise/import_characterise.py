"""From a vendor's netlist to an imported op-amp: figures and linear model, all by simulation."""

from __future__ import annotations

import numpy as np

from taction.spice_models.foreign_devices import RefusedError
from taction.spice_models.foreign_netlist import read_subcircuit
from taction.spice_models.imported import Figures, ImportedOpAmp, LinearModel, check_pins
from taction.system.array_types import Complexes, Floats
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.verification.characterise.import_bench import Measured, measure
from taction.verification.characterise.rational_fit import fit_together, has_aaa

GOOD = 1e-3  # largest relative error of a linear model that serves as a witness
REACH = 30.0  # the highest fitted frequency, in unity-gain bandwidths
LARGEST = 4 * MEGABYTE
# What a pin and its trace add anyway: an input admittance is compared with itself and these.
PIN_FARADS, PIN_SIEMENS = 1e-12, 1e-9


def import_opamp(file: str, subcircuit: str, pins: tuple[str, ...], supply: float) -> ImportedOpAmp:
    """Read, check and characterise the subcircuit of a netlist.

    Parameters
    ----------
    file : str
        The vendor's netlist.
    subcircuit : str
        Its name in the file.
    pins : tuple of str
        The role of each port, see `taction.spice_models.imported.ROLES`.
    supply : float
        Of each supply voltage, V.

    Raises
    ------
    InputError
        The file cannot be read, a card is not accepted (with its line), or the pins do not fit.
    SimulationError
        ngspice is missing, or does not simulate the model.
    """
    try:
        checked = read_subcircuit(read_bounded(file, LARGEST), subcircuit, "m")
    except (UnusableFileError, RefusedError) as error:
        raise InputError(file, Complaint("netlist", "", str(error))) from None
    try:
        check_pins(pins, checked.ports)
    except ValueError as error:
        raise InputError(file, Complaint("--pins", ",".join(pins), str(error))) from None
    measured = measure(checked, pins, supply)
    figures = _figures(file, measured)
    linear, missing = _linear(measured, figures)
    return ImportedOpAmp(checked, pins, supply, figures, linear, missing)


def _figures(file: str, measured: Measured) -> Figures:
    """Read the figures of a data sheet from the response."""
    f, size = measured.frequencies, np.abs(measured.gain)
    below = np.flatnonzero(size < 1.0)
    if measured.gain[0].real < 0.0:
        text = "the gain is negative: exchange the roles inp and inn"
        raise InputError(file, Complaint("--pins", "", text))
    if size[0] <= 1.0 or not below.size:
        text = f"the gain is {size[0]:.4g} at {f[0]:g} Hz and never crosses 1: are the pins right?"
        raise InputError(file, Complaint("--pins", "", text))
    k = int(below[0])
    share = np.log(size[k - 1]) / np.log(size[k - 1] / size[k])
    unity = float(f[k - 1] * (f[k] / f[k - 1]) ** share)
    phase = np.unwrap(np.angle(measured.gain))
    lag = float(phase[k - 1] + share * (phase[k] - phase[k - 1]))
    return Figures(
        dc_gain=float(size[0]),
        unity_gain_bandwidth=unity,
        phase_margin=180.0 + float(np.degrees(lag)),
        output_resistance=float(np.abs(measured.impedance[k])),
        supply_current=max(measured.supply_current, 0.0),
    )


def _linear(measured: Measured, figures: Figures) -> tuple[LinearModel | None, str]:
    """Return the linear model, or None and the reason."""
    if not has_aaa():
        return None, "no linear model: this SciPy has no AAA; 1.15 or newer has it"
    f = measured.frequencies
    used = f <= REACH * figures.unity_gain_bandwidth
    responses = measured.gain[used], measured.impedance[used]
    (gain, impedance), (gain_error, impedance_error) = fit_together(f[used], responses)
    conductance, capacitance, input_error = _input(f[used], measured.admittance[used])
    errors = {"gain": gain_error, "output impedance": impedance_error, "input": input_error}
    worst = max(errors, key=errors.__getitem__)
    if errors[worst] > GOOD:
        return None, (
            f"no stable linear model: its {worst} is {100.0 * errors[worst]:.2g} % from the"
            f" simulated one, more than {100.0 * GOOD:g} %"
        )
    if not impedance.constant > 0.0:
        return None, "no linear model: the output has no resistance at high frequencies"
    return LinearModel(
        gain=gain,
        impedance=impedance,
        conductance=conductance,
        capacitance=capacitance,
        offset=-measured.inverting,
        rest=measured.output,
        bias_current=measured.bias_current,
        error=errors[worst],
        band=(float(f[0]), float(f[used][-1])),
    ), ""


def _input(f: Floats, admittance: Complexes) -> tuple[float, float, float]:
    """Return conductance, capacitance and the relative error of the two for an admittance."""
    s = 2j * np.pi * f
    size = np.abs(admittance) + PIN_SIEMENS + np.abs(s) * PIN_FARADS
    matrix = np.stack([np.ones_like(s), s], axis=1) / size[:, None]
    wanted = admittance / size
    scale = np.abs(matrix).max(axis=0)
    stacked = np.concatenate([(matrix / scale).real, (matrix / scale).imag])
    found = np.linalg.lstsq(stacked, np.concatenate([wanted.real, wanted.imag]), rcond=None)[0]
    conductance, capacitance = np.maximum(found / scale, 0.0).tolist()
    model = conductance + s * capacitance
    return conductance, capacitance, float(np.max(np.abs(model - admittance) / size))
