"""The sentence about the answer's error: one channel, T = 1, where every share is a fraction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.verification.reference.dynamics import IdealNetwork
from taction.verification.reference.solve import solve
from taction.verification.report.views.answer_view import (
    answer_text,
    true_error_text,
)
from taction.verification.verdict.answer_error import AnswerError

SCENE = "scenes/custom-matrix.toml"
LESS = "; a smaller lambda regularises less, but lets more noise through"
MORE = "; a larger lambda lets less noise through, but regularises more"


def one(eps: float, lam: float, stress: float | None, board: float | None = 1e-5) -> AnswerError:
    """u = eps / (1 + lam), in units of 2 V; the step has 1 V."""
    network = IdealNetwork(np.eye(1), np.array([eps]), lam, 1e-6, U0=2.0)
    known = None if stress is None else np.array([stress])
    found = AnswerError.of(network, solve(network.problem), known)
    return replace(found, board=board, step=1.0)  # V


@pytest.mark.parametrize(
    ("eps", "lam", "end"),
    [
        # 0.9 / 1.25 = 0.72: 0.2 lost by lambda, 0.08 by noise.
        (0.9, 0.25, "28 % OF from the true stress, because of regularisation (20 %) and"
                     " strain noise (8 %)"),
        # 1.1 / 1.25 = 0.88: 0.2 lost by lambda, 0.08 won back.
        (
            1.1,
            0.25,
            "12 % OF from the true stress, because of regularisation (20 %), partly cancelled by"
            " strain noise (8 %)",
        ),
        # 1.5 / 1.25 = 1.2: noise of 0.4, of which lambda takes 0.2.
        (
            1.5,
            0.25,
            "20 % OF from the true stress, because of strain noise (40 %), partly cancelled by"
            " regularisation (20 %)",
        ),
        # 0.5 / 1.25 = 0.4.
        (0.5, 0.25, "60 % OF from the true stress, because of strain noise (40 %) and"
                     " regularisation (20 %)"),
        (1.0, 0.25, "20 % OF from the true stress, because of regularisation alone"),
        (1.1, 1e-9, "10 % OF from the true stress, because of strain noise (10 %), partly"
                    " cancelled by regularisation (under 1 ppm)"),
        (1.0 + 1e-10, 1.0, "50 % OF from the true stress, because of regularisation (50 %), partly"
                           " cancelled by strain noise (under 1 ppm)"),
        (1.0, 1e-9, "the true stress within 1 ppm"),
        (1.25, 0.25, "the true stress within 1 ppm"),  # noise cancels lambda
    ],
)  # fmt: skip
def test_causes(eps: float, lam: float, end: str) -> None:
    start = "The board as drawn finds the regularised answer within 0.001 % of the step"
    answer, end = one(eps, lam, 1.0), end.replace("OF", "(of the largest, 2 V)")
    if "because" in end:
        end += MORE if abs(eps - 1.0) > lam else LESS  # 1 + lambda divides both
    assert answer_text(answer) == f"{start}; that answer is {end}."
    assert true_error_text(answer) == f"The regularised answer is {end}."


def test_lambda_trades_regularisation_against_noise_as_the_sentence_says() -> None:
    """A smaller lambda has less of the one part and more of the other; the sentence names it."""
    for eps, ends in ((1.1, LESS), (1.6, MORE)):
        less, own, more = (one(eps, lam, 1.0) for lam in (0.2, 0.25, 0.3))
        assert f"{ends}." in answer_text(own)
        bias, noise = (
            [abs(getattr(each, name)) for each in (less, own, more)]
            for name in ("regularisation", "noise")
        )
        assert bias == sorted(bias)
        assert noise == sorted(noise, reverse=True)
        errors = [abs(each.true_error) for each in (less, own, more)]
        assert (errors == sorted(errors)) is (ends is LESS)


def test_what_is_known() -> None:
    assert answer_text(one(1.25, 0.25, None)) == (
        "The board as drawn finds the regularised answer within 0.001 % of the step; the true"
        " stress is not known."
    )
    assert answer_text(one(1.25, 0.25, 0.0)).endswith("of the step; the true stress is zero.")
    assert "within 1 ppm of the step;" in answer_text(one(1.25, 0.25, None, board=0.0))


@pytest.mark.parametrize(
    ("volts", "error", "shown"),
    [
        (1.21e-5, 0.0, "0.0013 %"),
        (1.2e-5, 1e-9, "0.0013 %"),
        (3.0, 0.0, "300 %"),
        (1e-6, 0.0, "1 ppm"),
    ],
)
def test_within_is_never_too_small(volts: float, error: float, shown: str) -> None:
    answer = replace(one(1.0, 0.25, 1.0, board=volts), board_error=error)
    assert f" within {shown} of the step;" in answer_text(answer)
