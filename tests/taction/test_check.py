"""`taction check` from the command line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import taction
from taction.system.errors import InputError
from tests.support.designer_decks import DECKS
from tests.support.running import taction as command

pytestmark = pytest.mark.usefixtures("ngspice")


def run(*words: str) -> tuple[int, str]:
    """Return the exit status, and what is printed on stdout."""
    done = command("check", *words)
    assert "Traceback" not in done.stderr
    return done.exit_code, done.stdout


@pytest.fixture
def deck(tmp_path: Path) -> str:
    place = tmp_path / "filter.cir"
    place.write_text(DECKS["sallen-key-low-pass"])
    return str(place)


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ((), 0), (("--check", "settling=1ms@1%"), 0), (("--check", "settling=1us@1%"), 1),
        (("--check", "overshoot=1%"), 1), (("--expect", "v(out)=1@0.1%"), 0),
        (("--expect", "v(out)=1.1@0.1%"), 1), (("--check", "margin=3"), 0),
        (("--check", "loudness=3"), 2), (("--output", "nowhere"), 2), (("--over", "R99=1:2"), 2),
        (("--expect", "v(nowhere)=1"), 2), (("--check", "settling"), 2),
        (("--check", "noise=1mV"), 0), (("--check", "noise=1nV"), 1),
    ],
)  # fmt: skip
def test_exit_statuses(options: tuple[str, ...], status: int, deck: str) -> None:
    assert run(deck, "--no-ngspice", *options)[0] == status


def test_an_oscillator_is_reported_and_fails_where_it_is_checked(tmp_path: Path) -> None:
    place = tmp_path / "wien.cir"
    place.write_text(DECKS["wien"].replace("gain=2.9", "gain=3.1"))
    status, text = run(str(place), "--no-ngspice")
    assert status == 0
    assert "Not stable" in text
    assert run(str(place), "--no-ngspice", "--check", "stable")[0] == 1
    assert run(str(place), "--no-ngspice", "--check", "settling=1s")[0] == 1


def test_the_document_has_its_schema(deck: str, tmp_path: Path) -> None:
    import jsonschema

    picture, page = tmp_path / "a.png", tmp_path / "a.html"
    status, text = run(
        deck, "--json", "--over", "C1=1n:4n:3", "--plot", str(picture), "--report", str(page),
        "-o", str(tmp_path / "flat.cir"),
    )  # fmt: skip
    assert status == 0
    found = json.loads(text)
    schema = json.loads(Path("docs/schemas/check-2.json").read_text("utf-8"))
    jsonschema.validate(found, schema)
    assert [point["value"] for point in found["sweeps"][0]["points"]] == [1e-9, 2e-9, 4e-9]
    assert found["outputs"][0]["name"] == "out"
    assert found["agreement"] < 3e-4
    assert picture.stat().st_size > 1000
    assert "Step response" in page.read_text("utf-8")
    assert taction.check(tmp_path / "flat.cir", ngspice=False).poles.stable


def test_a_part_alone_is_swept_around_its_value(deck: str) -> None:
    found = taction.check(deck, over="R1", ngspice=False)
    values = [point.value for point in found.sweeps[0].points]
    assert values[0] == pytest.approx(1e4 / 30.0)
    assert values[-1] == pytest.approx(3e5)


def test_a_mistake_names_what_is_accepted(deck: str) -> None:
    with pytest.raises(InputError, match="settling=1ms@1%"):
        taction.check(deck, checks="speed=1")
    with pytest.raises(InputError, match="'x': the deck has no such node; it has in"):
        taction.check(deck, outputs="v(x)")


@pytest.mark.parametrize(
    ("cards", "volts"),
    [(("R1 a b 1k", "R2 b 0 3k"), 0.75), (("R1 a b 1k", "C1 a 0 1n", "R2 b 0 1k"), 0.5)],
)
def test_a_board_without_poles_has_its_divided_voltage(
    cards: tuple[str, ...], volts: float, tmp_path: Path
) -> None:
    """No capacitance, or one at an ideal source: nothing moves."""
    place = tmp_path / "divider.cir"
    place.write_text("\n".join(["divider", "V1 a 0 1", *cards, ".end", ""]))
    options = ("--no-ngspice", "--output", "b", "--expect", f"v(b)={volts}@0.01%")
    status, text = run(str(place), *options)
    assert status == 0
    assert "has no poles" in text


def test_a_check_loads_no_scipy(deck: str) -> None:
    """Its import is a quarter of the processor time of a check of a small deck."""
    code = f"import sys, taction; taction.check({deck!r}); print('scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
