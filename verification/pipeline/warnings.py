"""What a designer should know although no check failed."""

from __future__ import annotations

from netlist_gen.quantities import show
from spice_models.definitions import SHIFTED
from verification.pipeline.checks import Evidence

WELL_ABOVE = 10.0  # a tolerance should be this many times the simulation's own error


def find_warnings(evidence: Evidence, notes: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return warnings: tolerances too close to the simulation's error, fragile readings.

    `notes` are the engine's own remarks; they come first.
    """
    if not evidence.poles.stable:
        return notes  # it failed; how well a limit could be told no longer matters
    found = list(notes)
    wanted, error = evidence.checks, evidence.error
    remedy = "raise analysis.points_per_period"
    if wanted.steady_state.tolerance < WELL_ABOVE * error.steady_state:
        found.append(
            f"steady_state: the tolerance {wanted.steady_state.tolerance:g} is not well above the"
            f" simulation's own error {error.steady_state:.2g}; {remedy}"
        )
    if wanted.overshoot is not None and wanted.overshoot.max < WELL_ABOVE * error.overshoot:
        found.append(
            f"overshoot: the limit {wanted.overshoot.max:g} is not well above the simulation's own"
            f" error {error.overshoot:.2g}; {remedy}"
        )
    if evidence.poles.damping_ratio < 1e-3:
        found.append(
            f"damping ratio {evidence.poles.damping_ratio:.2g}: this board is on the edge of"
            " oscillation; component tolerances decide"
        )
    for channel in evidence.measurements.channels:
        for what, reading in (("rise", channel.rise_time), ("settling", channel.settling_time)):
            if reading is not None and reading.fragile and reading.alternative is not None:
                found.append(
                    f"channel {channel.index + 1}: {what} time {show(reading.value, 's')} is"
                    f" fragile: {show(reading.alternative, 's')} with {SHIFTED[what]}"
                )
    return tuple(found)
