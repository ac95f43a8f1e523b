"""Documents and texts of the commands whose result has no page of its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taction.cli.terminal import put
from taction.system.foreign_text import visible

if TYPE_CHECKING:
    from taction.spice_models.opamp import OpAmp
    from taction.tools import ImportedModel, Installation
    from taction.verification.characterise.characterise import OpAmpFigures
    from taction.verification.design.fresh_scene import NewScene
    from taction.verification.design.scaling import Scaled
    from taction.verification.design.tune import Tuned
    from taction.verification.reference import Solution
    from taction.verification.verdict.recording import MeasuredTransient

COLUMNS = (
    ("gbw", "Hz", "GBW"),
    ("slew_rate", "V/s", "slew rate"),
    ("offset_voltage", "V", "offset"),
    ("bias_current", "A", "bias"),
    ("voltage_noise", "V/rtHz", "noise"),
)
"""Figures of the list of op-amps, beside the range of the supply; `show` has all."""


IMPORTED = (
    ("dc_gain", ""), ("unity_gain_bandwidth", "Hz"), ("phase_margin", "degrees"),
    ("output_resistance", "ohm"), ("slew_rate", "V/s"), ("swing", "V"), ("supply_current", "A"),
    ("offset_voltage", "V"), ("bias_current", "A"), ("offset_current", "A"),
    ("common_mode_rejection", "dB"),
)  # fmt: skip
"""Figures of an imported op-amp, and their units."""


def print_solution(solution: Solution) -> None:
    """Print a solution and its certificate."""
    for n, value in enumerate(solution.u.tolist(), 1):
        put(f"u_{n} = {value!r}")
    put(f"lambda = {solution.lam!r}, objective = {solution.objective!r}")
    put(
        f"{solution.certificate_kind} {solution.certificate:.3g} (bound {solution.bound:.3g});"
        f" error in u at most {solution.error_bound:.2g}; condition {solution.condition:.3g};"
        f" {solution.iterations} iterations, {1e3 * solution.seconds:.2f} ms"
    )
    if not solution.trusted:
        put(f"inconclusive: {solution.reason}", markup=False)


def record_document(found: MeasuredTransient) -> object:
    """Return the measurements of a transient."""
    from taction.verification.report.documents.verdict import SimulateDocument

    return SimulateDocument.of(
        found.circuit.name, found.waveforms, found.measurements, found.output
    )


def print_record(record: MeasuredTransient) -> None:
    """Print the measurements of a transient, and what it cost."""
    from taction.verification.report.renderers.terminal import shown
    from taction.verification.report.views.verdict import channel_table

    put(shown(channel_table(record.measurements)))
    cost = record.waveforms.cost
    put(f"{record.waveforms.simulator}: {cost.points} points, {cost.seconds:.3g} s")


def tuned_document(found: Tuned) -> object:
    """Return a search, its best design and the verdict on it."""
    from taction.verification.report.documents.verdict import TuneDocument

    return TuneDocument.of(found.tuning, found.verdict)


def scaled_document(found: Scaled) -> object:
    """Return the scalings and the verdict."""
    from taction.verification.report.documents.verdict import ScaleDocument

    return ScaleDocument.of(found.scaling, found.verdict)


def print_scaled(found: Scaled) -> None:
    """Print the scalings, the loads and what the checks say."""
    from taction.system.quantities import show
    from taction.verification.design.scaling import scalings_of
    from taction.verification.verdict.headroom import describe

    scaling, verdict = found.scaling, found.verdict
    values = scalings_of(scaling).items()
    put(", ".join(f"{name} = {show(value, unit)}" for name, (value, unit) in values))
    low, high = (show(ohms, "ohm") for ohms in scaling.matrix_ohms)
    put(f"matrix resistors from {low} to {high}; lambda stays {scaling.lam:.4g}")
    for load in scaling.loads:
        put(f"{describe(load)} ({load.share:.0%})")
    for note in scaling.notes:
        put(f"note: {note}", markup=False)
    failing = [check for check in verdict.checks if check.outcome.value != "pass"]
    for check in failing:
        put(f"{check.name}: {check.outcome.value}: {check.reason}", markup=False)
    put(f"{verdict.outcome.value.upper()} (state-space engine)")


def fresh_document(found: NewScene) -> object:
    """Return a new scene for a matrix."""
    from taction.verification.report.documents.plain import NewDocument
    from taction.verification.report.documents.verdict import NewMatrixDocument

    if found.fresh is None or found.scaled is None:
        return NewDocument(found.file)
    return NewMatrixDocument.of(found.file, found.fresh, found.scaled.verdict)


def print_fresh(found: NewScene) -> None:
    """Print what was recognised in the files, how lambda was chosen, and the scalings."""
    fresh = found.fresh
    if fresh is not None and found.scaled is not None:
        for note in fresh.notes:
            put(note, markup=False)
        put(f"lambda {fresh.rule}", markup=False)
        print_scaled(found.scaled)


def models_document(models: dict[str, OpAmp]) -> object:
    """Return the figures of all presets."""
    from taction.verification.report.documents.plain import Preset

    return {name: Preset.of(model) for name, model in models.items()}


def print_models(models: dict[str, OpAmp]) -> None:
    """Print the figures that most boards depend on."""
    from taction.system.quantities import show as shown
    from taction.verification.report.blocks import Table, cell
    from taction.verification.report.renderers.terminal import shown as block

    rows = []
    for name, model in models.items():
        values = [(getattr(model, figure), unit) for figure, unit, _ in COLUMNS]
        known = [shown(x, unit, 3) if x and math.isfinite(x) else "-" for x, unit in values]
        ends = f"\N{PLUS-MINUS SIGN}{model.least_supply:g} to {model.most_supply:g} V"
        rows.append((name, *known, ends if math.isfinite(model.most_supply) else "-"))
    titles = ("", *(title for _, _, title in COLUMNS), "supply")
    put(block(Table("", titles, tuple(tuple(map(cell, row)) for row in rows))))
    put("all figures with their sources, and what the model does: taction parts show NAME")


def opamp_document(found: OpAmpFigures) -> object:
    """Return all figures of an op-amp."""
    from taction.verification.report.documents.plain import ShowDocument

    return ShowDocument.of(found.opamp, found.origins, found.results)


def model_document(found: ImportedModel) -> object:
    """Return an imported model, without its netlist."""
    return {"file": found.file, **{k: v for k, v in found.model.items() if k != "netlist"}}


def print_model(found: ImportedModel) -> None:
    """Print what was measured of an imported model, and how a scene uses it."""
    from taction.system.quantities import show

    model = found.model
    figures, linear = model["figures"], model["linear"]
    put(f"{model['name']}, simulated at ±{show(model['supply'], 'V')}")
    for key, unit in IMPORTED:
        value = figures[key]
        text = "none found" if value is None else show(value, unit)
        put(f"  {key.replace('_', ' '):22} {text}")
    for doubt in model["doubts"]:
        put(f"warning: {doubt}", markup=False)
    if linear is not None:
        poles = len(linear["gain"]["poles"])
        put(
            f"linear model: {poles} poles, within {100.0 * linear['error']:.2g} % of the simulated"
            f" response up to {show(linear['band'][1], 'Hz', 3)}"
        )
    else:
        put(f"{model['missing']}: boards with it stay inconclusive")
    put(f'in a scene beside it: opamp = {{ file = "{visible(found.file)}" }}', markup=False)


def doctor_document(found: Installation) -> object:
    """Return what is installed."""
    return {"findings": found.findings, "ok": all(each["ok"] for each in found.findings)}


def print_doctor(found: Installation) -> None:
    """Print what is installed, and what it is needed for."""
    for finding in found.findings:
        mark = "ok     " if finding["ok"] else "missing"
        put(f"{mark}  {finding['what']}: {finding['found']}", markup=False)
        put(f"         {finding['means']}", markup=False)
