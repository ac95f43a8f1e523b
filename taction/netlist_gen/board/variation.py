"""A board with parts that vary within the scene's tolerances.

Every variation is a factor ``exp(z ln(1 + tolerance))``, so no value becomes negative; z = 1 and
z = -1 are the ends of the tolerance.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.parts import Capacitor, OpAmpCell, Resistor, ResistorMatrix
from taction.netlist_gen.scene.check_keys import Tolerances
from taction.spice_models.input_errors import MOST, drawn
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError

TEMPERATURE = "temperature"  # name and kind
INPUT_ERROR = "input_error"  # kind
DEVICE = "device"  # kind: an entry of an array that is programmed
DYNAMIC = ("capacitor", "stray", "opamp_gbw", "coil", "coupling")  # kinds that move no equilibrium
LEAST = 1e-12  # standard deviation of a device that may be stuck, over itself
SIGNIFICANT, FEWEST = 4.0, 30  # standard errors of one of hundreds of correlations, and boards
BRANCHES = {"L": "coil", "E": "gain", "F": "gain", "G": "gain", "H": "gain", "K": "coupling"}
"""Kinds of the branches that vary, by their letter; no table of a scene has them."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value that varies: of an element of the deck, an op-amp's figure, or the temperature."""

    name: str  # "Rf_3_5", "Rr_1", "Cc_1", "v_1.gbw", "v_1.offset_voltage", "temperature"
    kind: str  # key of `Tolerances`, `INPUT_ERROR` or `DEVICE`
    tolerance: float  # fraction; of the temperature K; of an input error V, A or a ratio


def parameters(circuit: Circuit, tolerances: Tolerances) -> tuple[Parameter, ...]:
    """Return all values that vary, in the order of the z of `vary`; refuse an unknown part."""
    pairs, own = dict(varying_parts(circuit)), tolerances.parts
    if unknown := [name for name in own if name not in pairs or name == TEMPERATURE]:
        known = difflib.get_close_matches(unknown[0], pairs, n=1, cutoff=0.0)
        text = f"the board has no such part; the nearest name is {known[0]!r}"
        raise InputError("scene", Complaint(f"tolerances.parts.{unknown[0]}", "", text))
    spreads = device_spreads(circuit)
    found = list[Parameter]()
    for name, kind in pairs.items():
        tolerance = own.get(name, getattr(tolerances, kind, 0.0))
        if kind == DEVICE and name not in own and name in spreads:
            tolerance = math.expm1(MOST * max(math.hypot(*spreads[name].values()), LEAST))
        if tolerance > 0:
            found.append(Parameter(name, kind, tolerance))
    for cell in circuit.opamps:  # input errors that are not given by the scene
        for figure, spread in circuit.models[cell.model].varying:
            found.append(Parameter(f"{cell.name}.{figure}", INPUT_ERROR, MOST * spread.sigma))
    return tuple(found)


def varying_parts(circuit: Circuit) -> Iterator[tuple[str, str]]:
    """Yield the names and kinds of the values that a tolerance can have."""
    for matrix in circuit.matrices:
        kind = "resistor" if matrix.device is None else DEVICE
        yield from ((name, kind) for name, _, _ in matrix.places())
    for resistor in circuit.resistors:
        yield resistor.label, "resistor"
    strays = circuit.named(Role.STRAY)
    for capacitor in circuit.capacitors:
        yield capacitor.label, "stray" if capacitor.card in strays else "capacitor"
    for branch in circuit.branches:
        if found := BRANCHES.get(branch.letter):
            yield branch.label, found
    for cell in circuit.opamps:
        if circuit.models[cell.model].imported is not None:
            continue  # a vendor's netlist is as it is
        if math.isfinite(circuit.models[cell.model].gbw):
            yield f"{cell.name}.gbw", "opamp_gbw"
        yield f"{cell.name}.dc_gain", "opamp_gain"
    yield TEMPERATURE, TEMPERATURE


def device_spreads(circuit: Circuit) -> dict[str, dict[str, float]]:
    """Return the standard deviations of every device, over its conductance, by kind."""
    found = dict[str, dict[str, float]]()
    for matrix in circuit.matrices:
        if matrix.device is not None:
            ohms = matrix.ohms[np.isfinite(matrix.ohms)]
            spreads = matrix.device.spreads(1.0 / ohms)
            if not spreads and not matrix.device.stuck:
                continue
            for place, (name, _, _) in enumerate(matrix.places()):
                own = {kind: float(each[place] * ohms[place]) for kind, each in spreads.items()}
                found[name] = own
    return found


def draw(tolerances: Tolerances, varied: Sequence[Parameter], seed: int, sample: int) -> Floats:
    """Return the z of one sample, one for each of `varied`, from a random stream of its own."""
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(sample,)))
    errors = [parameter.kind in (INPUT_ERROR, DEVICE) for parameter in varied]
    if tolerances.distribution == "normal":
        return random.standard_normal(len(varied)) / MOST
    z = random.uniform(-1.0, 1.0, len(varied))
    z[errors] = random.standard_normal(sum(errors)) / MOST
    return z


def influences(
    tolerances: Tolerances,
    varied: Sequence[Parameter],
    seed: int,
    values: Mapping[int, float | None],
) -> dict[str, float]:
    """Return the correlations of values of drawn boards, by their numbers, with the parts.

    The square of one is the share of the variance that a line in its deviation explains. Parts
    that do not stand out of the scatter, or of fewer than `FEWEST` boards, are left out; the
    strongest come first.
    """
    known = {number: v for number, v in values.items() if v is not None and math.isfinite(v)}
    if len(known) < FEWEST:
        return {}
    z = np.array([draw(tolerances, varied, seed, number) for number in known])
    z, y = z - z.mean(axis=0), np.array([*known.values()]) - np.mean([*known.values()])
    scale = np.sqrt((z**2).sum(axis=0) * (y @ y))
    found = (y @ z / np.where(scale, scale, math.inf)).tolist()
    pairs = sorted(zip(varied, found, strict=True), key=lambda pair: -round(abs(pair[1]), 9))
    least = SIGNIFICANT / math.sqrt(len(known))
    return {part.name: size for part, size in pairs if abs(size) > least}


def vary(circuit: Circuit, tolerances: Tolerances, z: Floats) -> Circuit:
    """Return `circuit` with every part varied by its `z`, one value per item of `parameters`.

    An op-amp's gain-bandwidth product and second pole have the same factor. The temperature changes
    all parts of a kind by ``exp(drift z temperature)``.
    """
    varied = parameters(circuit, tolerances)
    shift = {p.name: float(value) for p, value in zip(varied, z, strict=True)}
    scale = {
        p.name: math.exp(shift[p.name] * math.log1p(p.tolerance))
        for p in varied
        if p.kind not in (INPUT_ERROR, DEVICE)
    }
    deviations = {p.name: shift[p.name] for p in varied if p.kind == DEVICE}
    kelvin = shift.get(TEMPERATURE, 0.0) * tolerances.temperature
    hot_r = math.exp(kelvin * tolerances.resistor_drift)
    hot_c = math.exp(kelvin * tolerances.capacitor_drift)
    hot: dict[type, float] = {Resistor: hot_r, ResistorMatrix: hot_r, Capacitor: hot_c}
    hot_gbw = math.exp(kelvin * tolerances.opamp_drift)

    models, cells = dict[str, OpAmp](), list[OpAmpCell]()
    for cell in circuit.opamps:  # each has a model of its own, but for the imported ones
        model = circuit.models[cell.model]
        if model.imported is None:
            errors = {figure: MOST * shift[f"{cell.name}.{figure}"] for figure, _ in model.varying}
            faster = scale.get(f"{cell.name}.gbw", 1.0) * hot_gbw
            gain = scale.get(f"{cell.name}.dc_gain", 1.0)
            model = _opamp(drawn(model, errors), cell.name, faster, gain)
        models[model.name] = model
        cells.append(replace(cell, model=model.name))
    programmed = tuple(_programmed(each, deviations) for each in circuit.matrices)
    made = replace(circuit, models=models, opamps=tuple(cells), matrices=programmed)
    made = replace(made, temperature=circuit.temperature + kelvin)
    return with_factors(made, scale, hot)


def with_factors(
    circuit: Circuit, scale: Mapping[str, float], every: Mapping[type, float] = MappingProxyType({})
) -> Circuit:
    """Return `circuit` with the values of `scale`, by name, and of a kind in `every` times these.

    InputError: coils would have a coupling of 1 or more.
    """

    def factor(part: Any) -> Floats | float:
        common = every.get(type(part), 1.0)
        if not isinstance(part, ResistorMatrix):
            return scale.get(part.label, 1.0) * common
        factors = np.full(part.ohms.shape, common)
        for name, k, n in part.places():
            factors[k, n] *= scale.get(name, 1.0)
        return factors

    made = circuit.scaled(factor)
    for part in made.branches:
        if part.letter == "K" and part.label in scale and not abs(part.value) < 1.0:
            text = "coils with a coupling of 1 or more; expected a smaller tolerance"
            raise InputError("tolerances", Complaint(part.label, f"{part.value:g}", text))
    return made


def _programmed(matrix: ResistorMatrix, deviations: Mapping[str, float]) -> ResistorMatrix:
    """Return a matrix with devices off by so many of `MOST` standard deviations, larger in ohms.

    Deviations of exactly one are the corners of a study, at which no cell is stuck. What is
    programmed varies no more.
    """
    if matrix.device is None:
        return matrix
    off = np.zeros(matrix.ohms.shape)
    for name, k, n in matrix.places():
        off[k, n] = -MOST * deviations.get(name, 0.0)
    siemens, device = 1.0 / matrix.ohms, matrix.device
    if np.all(np.isin(np.abs(off), (0.0, MOST))):
        device = replace(device, stuck_at_least=0.0, stuck_at_most=0.0)
    ohms = matrix.ohms.copy()
    moved = np.isfinite(ohms) & (off != 0.0)
    ohms[moved] = 1.0 / device.programmed(siemens, off)[moved]
    return replace(matrix, ohms=ohms, device=None)


def _opamp(model: OpAmp, name: str, faster: float, gain: float) -> OpAmp:
    try:
        return replace(
            model,
            name=f"{model.name}_{name}",
            gbw=model.gbw * faster,
            second_pole=model.second_pole * faster,
            dc_gain=model.dc_gain * gain,
        )
    except ValueError as error:
        raise InputError("tolerances", Complaint(f"op-amp {name}", "", str(error))) from None
