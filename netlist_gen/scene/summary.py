"""The parts of a scene in a few words, for its `repr` and its card. Nothing is read from files."""

from __future__ import annotations

from collections.abc import Iterator

from taction.netlist_gen.scene.checks import Checks
from taction.netlist_gen.scene.design import OpAmpChoice
from taction.netlist_gen.scene.problem import MatrixProblem, TactileProblem
from taction.system.quantities import quantity
from taction.system.reading_definitions import EXCURSIONS


def size_words(problem: TactileProblem | MatrixProblem) -> str:
    """Return the size of a problem, or the name of the file that has its matrix."""
    if isinstance(problem, TactileProblem):
        sensors = problem.sensors or problem.channels
        return sizes(problem.channels, sensors)
    if isinstance(problem.matrix, str):
        return f"matrix {problem.matrix!r}"
    sensors, channels = problem.matrix.shape
    return sizes(channels, sensors)


def sizes(channels: int, sensors: int) -> str:
    """Return the numbers of channels and sensors in words; as many sensors are not named.

    Examples
    --------
    >>> sizes(7, 7), sizes(1, 3)
    ('7 channels', '1 channel, 3 sensors')
    """
    words = counted(channels, "channel")
    return words if sensors == channels else f"{words}, {counted(sensors, 'sensor')}"


def counted(number: int, noun: str, nouns: str = "") -> str:
    """Return a number with its noun; `nouns` is a plural that does not end in an added s.

    Examples
    --------
    >>> counted(1, "channel"), counted(7, "channel"), counted(2, "entry", "entries")
    ('1 channel', '7 channels', '2 entries')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {nouns or noun + 's'}"


def opamp_name(name: str) -> str:
    """Return the name of an op-amp model in words.

    Examples
    --------
    >>> opamp_name("ua741"), opamp_name("ideal_changed")
    ('ua741', 'ideal with changed figures')
    """
    base = name.removesuffix("_changed")
    return name if base == name else f"{base} with changed figures"


def opamp_words(choice: OpAmpChoice) -> str:
    """Return the op-amp's name, and whether its figures are those of the preset."""
    changed = choice.model_fields_set - {"base", "file", "level"}
    return f"{choice.file or choice.base}{' (changed)' if changed else ''}"


def check_words(checks: Checks) -> Iterator[str]:
    """Yield the limits of the checks."""
    yield f"steady state within {_percent(checks.steady_state.tolerance)}"
    settling = checks.settling_time
    yield f"settled within {_percent(settling.band)}{_times(settling.min, settling.max)}"
    if checks.rise_time is not None:
        yield f"rise time{_times(checks.rise_time.min, checks.rise_time.max)}"
    for name in EXCURSIONS:
        if (check := getattr(checks, name)) is not None:
            yield f"{name} at most {_percent(check.max)}"
    if checks.noise is not None:
        yield f"noise at most {quantity(checks.noise.max, 'V')}"
    margin = checks.stability.margin
    yield f"stable with C / {margin:g}" if margin > 1.0 else "stable"


def _times(least: float | None, most: float | None) -> str:
    low = "" if least is None else f", at least {quantity(least, 's')}"
    return low if most is None else f"{low}, at most {quantity(most, 's')}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
