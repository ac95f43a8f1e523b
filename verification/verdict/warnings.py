"""Warnings: remarks for the designer that do not make a check fail."""

from __future__ import annotations

from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.verdict.checks import Evidence

WELL_ABOVE = 10.0  # a tolerance should be this many times the error of the simulation


def find_warnings(evidence: Evidence, notes: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return warnings: tolerances too close to the simulation's error, fragile readings.

    `notes` are the remarks of the engine and of the plan; they come first.
    """
    if not evidence.poles.known_stable:
        return notes  # the stability check does not pass, so close tolerances no longer matter
    warnings = list(notes)
    checks, error = evidence.checks, evidence.error
    remedy = "set a smaller analysis.error or a larger analysis.points_per_period"
    if checks.steady_state.tolerance < WELL_ABOVE * error.steady_state:
        warnings.append(
            f"steady_state: the tolerance {checks.steady_state.tolerance:g} is not well above the"
            f" error {error.steady_state:.2g} of the simulation; {remedy}"
        )
    for name in EXCURSIONS:
        check, off = getattr(checks, name), error.readings[name]
        if check is not None and check.max < WELL_ABOVE * off:
            warnings.append(
                f"{name}: the limit {check.max:g} is not well above the error {off:.2g} of the"
                f" simulation; {remedy}"
            )
    if evidence.poles.damping_ratio < 1e-3:
        warnings.append(
            f"damping ratio {evidence.poles.damping_ratio:.2g}: the board nearly oscillates;"
            " component tolerances can make it oscillate"
        )
    for channel in evidence.measurements.channels:
        for name, reading in channel.fragile.items():
            if reading.alternative is not None:
                kind, what = READINGS[name], name.replace("_", " ")
                warnings.append(
                    f"channel {channel.index + 1}: {what} {show(reading.value, kind.unit)} is"
                    f" fragile: {show(reading.alternative, kind.unit)} with {kind.shifted}"
                )
    return tuple(warnings)
