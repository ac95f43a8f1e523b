"""The error of the answer in words: of the board, of regularisation, of noise."""

from __future__ import annotations

from taction.verification.report.texts import LEAST_SHARE, figure, percent, quantity, rounded_up
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.input_spread import SHARE


def answer_text(answer: AnswerError, *, short: bool = False, volts: bool = True) -> str:
    """Return in a sentence how far the board is from the answer, and the answer from the truth.

    It is empty for a board that does not come to rest at the answer, and where the answer cannot
    be trusted. "Within" rounds up. The `short` one has neither channel nor the kind of its unit;
    without `volts` the largest stress is named without its value.
    """
    if answer.board is None or not answer.unit:
        return ""
    near = _within(answer.board + answer.board_error, answer.unit)
    unit = f"of {quantity(answer.unit, 'V', 3)}" if short else f"({of_unit(answer, volts=volts)})"
    built = ""
    if answer.built is not None and answer.built_boards is not None:
        wide = _within(answer.built.distance + answer.built.error, answer.unit)
        built = f", and {100 * answer.built_boards:g} % of built boards {wide}"
        built += "" if short else f" ({answer.built.varies})"
    far = _truth(answer, "it" if short else "that answer", short=short)
    return f"The board as drawn finds the regularised answer {near} {unit}{built}; {far}."


def yield_text(answer: AnswerError) -> str:
    """Return what a board that passes as drawn says of built ones; empty where most of them pass.

    The bound is that of the place of rest alone, to first order in the deviations.
    """
    built = answer.built
    if built is None or built.most >= SHARE:
        return ""
    at_most = percent(rounded_up(built.most, 2)) if built.most else "0 %"
    return (
        f"passes as drawn; at most {at_most} of built boards pass ({built.varies}):"
        f" the others rest beyond {percent(built.limit)}, by their sensitivities"
    )


def true_error_text(answer: AnswerError, *, volts: bool = True) -> str:
    """Return in a sentence how far the answer is from the true stress, and why."""
    text = _truth(answer, "the regularised answer")
    share = f"; % {of_unit(answer, volts=volts)}" if " % from" in text else ""
    return f"{text[:1].upper()}{text[1:]}{share}."


def answer_heading(answer: AnswerError) -> str:
    """Return both distances without causes, those that are known."""
    far, texts, subject = answer.true_error, [], "the regularised answer"
    if answer.board is not None and answer.unit:
        near = _within(answer.board + answer.board_error, answer.unit)
        texts, subject = [f"{near} of {subject}"], "which"
    if far is not None:
        texts.append(f"{subject} is {figure(far, 'step', 3)} from the true stress")
    return ", ".join(texts)


def of_unit(answer: AnswerError, *, volts: bool = True) -> str:
    """Return what every share of an answer's error is a fraction of."""
    known = answer.stress is not None and answer.stress.any()
    value = f", {quantity(answer.unit, 'V', 3)}" if volts else ""
    return f"of the largest {'true ' * bool(known)}stress{value}"


def _within(volts: float, unit: float) -> str:
    """Return a bound as a fraction of `unit`, rounded up."""
    share = volts / unit
    up = "1 ppm" if share <= LEAST_SHARE else figure(rounded_up(share, 2), "step")
    return f"within {up}"


def _truth(answer: AnswerError, subject: str, *, short: bool = False) -> str:
    """Return how far the answer is from the true stress, and why."""
    stress, far, n = answer.stress, answer.true_error, answer.channel
    if stress is None:
        return "the true stress is not known"
    if not stress.any():
        return "the true stress is zero"
    if far is None or n is None:
        return f"{subject} cannot be trusted"
    volts = far * answer.unit + answer.target_error
    if volts <= max(2.0 * answer.target_error, LEAST_SHARE * answer.unit):
        return f"{subject} is the true stress {_within(volts, answer.unit)}"
    text = f"{subject} is {figure(far, 'step', 3)} from the true stress"
    if short:
        return f"{text} by {_causes(answer)}{_lambda(answer, short=True)}"
    place = f" in channel {n + 1}" if len(stress) > 1 else ""
    return f"{text}{place}, because of {_causes(answer)}{_lambda(answer)}"


def _lambda(answer: AnswerError, *, short: bool = False) -> str:
    """Return what another lambda does to an error; empty where lambda is 0 or a cause unknown."""
    if not answer.regularisation or answer.noise is None:
        return ""
    if abs(answer.regularisation) >= abs(answer.noise):
        how = "trades bias for noise" if short else "regularises less, but lets more noise through"
        return f"; a smaller lambda {how}"
    how = "trades noise for bias" if short else "lets less noise through, but regularises more"
    return f"; a larger lambda {how}"


def _causes(answer: AnswerError) -> str:
    """Return the causes with their shares, the larger one first; they add up to the error."""
    if answer.regularisation is None or answer.noise is None:
        return "regularisation and strain noise (their shares are not known)"
    shares = {"regularisation": answer.regularisation, "strain noise": answer.noise}
    first, second = sorted(shares, key=lambda name: -shares[name])
    if not shares[second]:
        return f"{first} alone"
    joint = " and" if shares[second] > 0.0 else ", partly cancelled by"
    large, small = (figure(abs(shares[name]), "step", 3) for name in (first, second))
    return f"{first} ({large}){joint} {second} ({small})"
