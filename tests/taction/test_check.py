"""`taction check` from the command line, and decks that went wrong once."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from tests.support.designer_decks import DECKS, written
from tests.support.paths import CASES, SCENES
from tests.support.running import taction as command

pytestmark = pytest.mark.usefixtures("ngspice")


def run(deck: Path, *options: str) -> tuple[int, str]:
    """Return the exit status, and what is printed on stdout."""
    done = command("check", str(deck), "--no-ngspice", *options)
    assert "Traceback" not in done.stderr
    return done.exit_code, done.stdout


AXIS = "I1 0 out PULSE(0 1u)\nL1 out 0 1m\nC1 out 0 1n"  # no loss
# A gain of 3 into its own input.
LATCH = "V1 in 0 PULSE(0 1)\nR1 in p 1k\nR2 p out 1k\nC1 p 0 1n\nE1 out 0 p 0 3"
# The bridge of gain 3.1 grows at 1 / (2 pi R C) = 1.59 kHz with (3.1 - 3) / (2 R C).
WIEN = (CASES / "wienosc.cir").read_text().removesuffix(".end\n")
_, FILTER = DECKS["sallen-key-low-pass"].removesuffix(".end\n").split("\n", 1)


@pytest.mark.parametrize(
    ("deck", "options", "status"),
    [
        (FILTER, "", 0), (FILTER, "--check settling=1ms@1%", 0),
        (FILTER, "--check settling=1us@1%", 1), (FILTER, "--check overshoot=1%", 1),
        (FILTER, "--expect v(out)=1@0.1%", 0), (FILTER, "--expect v(out)=1.1@0.1%", 1),
        (FILTER, "--check margin=3", 0), (FILTER, "--expect v(nowhere)=1", 2),
        (FILTER, "--check settling", 2), (FILTER, "--check noise=1mV", 0),
        (FILTER, "--check noise=1nV", 1), (FILTER, "--check oscillates", 1),
        (WIEN, "", 1), (WIEN, "--check stable", 1), (WIEN, "--check settling=1s", 1),
        (WIEN, "--check agree=1", 1), (WIEN, "--transient", 1), (WIEN, "--check oscillates", 0),
        (WIEN, "--check oscillates --check stable", 1),
        (AXIS, "", 3), (AXIS, "--check stable", 3), (AXIS, "--check oscillates", 3),
        (LATCH, "", 1), (LATCH, "--check oscillates", 1),
    ],
)  # fmt: skip
def test_exit_statuses(deck: str, options: str, status: int, tmp_path: Path) -> None:
    assert run(written(tmp_path, deck), *options.split())[0] == status


def test_an_oscillator_is_named_with_its_frequency_and_the_nearest_stable_values() -> None:
    found = taction.check(CASES / "wienosc.cir", ngspice=False)
    (check,) = found.checks
    assert "oscillates at 1.59" in check.reason
    assert "for an oscillator: --check oscillates" in check.reason
    text = run(CASES / "wienosc.cir")[1]
    assert "Nearest stable value: E1 below 3 (now 3.1" in " ".join(text.split())
    margin = run(CASES / "wienosc.cir", "--check", "margin=2")[1]
    headline = " ".join(margin.split()).partition("FAILS")[0]  # before the reasons
    assert headline.count("oscillates at") == 1
    (check,) = taction.check(CASES / "wienosc.cir", checks="oscillates", ngspice=False).checks
    assert check.value == pytest.approx(math.sqrt(1e8 - 500.0**2) / math.tau, rel=1e-9)
    assert check.uncertainty is not None
    assert 0.0 < check.uncertainty < 1e-6


def test_the_document_of_an_undecided_deck_says_null(tmp_path: Path) -> None:
    status, text = run(written(tmp_path, AXIS), "--json", "--over", "C1=1n:2n:2")
    found = json.loads(text)
    assert (status, found["stable"], found["outcome"]) == (3, None, "inconclusive")
    for point in found["sweeps"][0]["points"]:
        assert point["stable"] is None
        assert point["overshoot"] is point["settling_time"] is None


def test_a_divider_keeps_every_margin_and_is_swept() -> None:
    options = ("--check", "margin=100", "--over", "R1=1k:10k:3", "--json")
    status, text = run(CASES / "resistive-over.cir", *options)
    found = json.loads(text)
    assert (status, found["outcome"], found["stable"]) == (0, "pass", True)
    assert found["sweeps"][0]["stable_ranges"] == [[1e3, 1e4]]
    assert [point["real"] for point in found["sweeps"][0]["points"]] == [None] * 3


def test_a_resistive_loop_with_gain_keeps_no_margin_unproved(tmp_path: Path) -> None:
    """Where the gain passes 2 the loop through the divider changes its sign."""
    place = written(tmp_path, "V1 in 0 1\nR1 in p 1k\nR2 p out 1k\nE1 out 0 p 0 1.9")
    found = taction.check(place, checks="margin=2", ngspice=False)
    assert found.outcome.value == "inconclusive"


@pytest.mark.parametrize(
    ("cards", "volts"),
    [(("R1 a b 1k", "R2 b 0 3k"), 0.75), (("R1 a b 1k", "C1 a 0 1n", "R2 b 0 1k"), 0.5)],
)
def test_a_board_without_poles_has_its_divided_voltage(
    cards: tuple[str, ...], volts: float, tmp_path: Path
) -> None:
    """No capacitance, or one at an ideal source: nothing moves."""
    place = written(tmp_path, "\n".join(["V1 a 0 1", *cards]))
    status, text = run(place, "--output", "b", "--expect", f"v(b)={volts}@0.01%")
    assert status == 0
    assert "has no poles" in text


def test_a_step_without_a_param_has_its_first_value() -> None:
    place = CASES / "ltspice_step.net"
    first = taction.check(place, ngspice=False)
    values = {row.name: row.value for row in first.parts}
    assert values["C1"] == 10e-12
    assert any("does not run; --over" in note for note in first.notes)
    (sweep,) = taction.check(place, over="cl=10p,100p,1n,10n", ngspice=False).sweeps
    assert sweep.points[0].real == pytest.approx(first.poles.rightmost.real, rel=1e-9)
    assert [point.value for point in sweep.points] == [10e-12, 100e-12, 1e-9, 10e-9]


@pytest.mark.parametrize("card", [".ac dec 10 1 1meg", ".measure ac f when vdb(out)=-3"])
def test_a_card_that_does_not_run_is_named_with_what_is_found(card: str, tmp_path: Path) -> None:
    place = written(tmp_path, f"V1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n{card}")
    notes = taction.check(place, ngspice=False).notes
    assert any(note.startswith(f"{card.split()[0]}: does not run; found are") for note in notes)


def test_a_board_of_scenes_passes_with_its_witness(tmp_path: Path) -> None:
    """Its op-amps have gains of 1e6 and no output resistance: pivots far from 1 are right."""
    place = tmp_path / "board.cir"
    taction.netlist(SCENES / "paper-breadboard.toml", output=place)
    found = taction.check(place)
    assert found.outcome.value == "pass"
    assert "ac_agrees" in {check.name for check in found.checks}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("refused-coax.cir", ("line 9", "a device 'T' is not accepted")),
        ("refused-model-name.net", ("line 3", "no subcircuit '{model_name}'")),
        ("refused-qspice.cir", ("line 5", "the character")),
        ("refused-space.cir", ("r1 in m 6.8 k", "unknown parameter (k)")),
    ],
)
def test_a_fair_refusal_names_line_and_reason(name: str, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        taction.check(CASES / name)
    assert [word for word in words if word not in str(error.value)] == []


@pytest.mark.parametrize(
    ("card", "wanted"),
    [
        ("E1 o 0 in 0 Laplace=10*(1+s/300)/((1+s/100)*(1+ s/1k))", [-1000.0, -100.0]),
        ("E1 o 0 LAPLACE {V(in)} = {2/(1+1m*s+1u*s^2)}", np.roots([1e-6, 1e-3, 1.0])),
        (".param w=2k q=0.5\nE1 o 0 in 0 laplace={w^2/(s**2+s*w/q+w*w)}", [-2000.0, -2000.0]),
        ("E1 o 0 in o laplace=1k/s", [-1000.0]),  # an integrator
        ("G1 0 o LAPLACE {V(in)} {1/(1+s*sqrt(4))}\nR1 o 0 1", [-0.5]),
        ("B1 o 0 V=V(in) Laplace=1/(1+s*3)", [-1.0 / 3.0]),
    ],
)
def test_a_transfer_function_becomes_states(card: str, wanted: list[float], tmp_path: Path) -> None:
    """Its poles are the roots of its denominator, and no part of it is a knob."""
    found = taction.check(written(tmp_path, f"V1 in 0 DC 0 AC 1\n{card}"), ngspice=False)
    poles = np.sort_complex(found.poles.poles)
    assert poles == pytest.approx(np.sort_complex(np.array(wanted, complex)), rel=1e-6, abs=1e-9)
    assert not any("taction" in part.name for part in found.parts)
