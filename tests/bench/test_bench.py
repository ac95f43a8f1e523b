"""A sample of the bench: boards as written and drawn, and faults that it must find."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taction
from tests.bench import judge
from tests.bench.boards import board_of, number, write_matrix
from tests.bench.judge import Board, Limits, drawn, fault, judged, sheet_of


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Board:
    file = tmp_path_factory.mktemp("bench") / "board.toml"
    taction.new(file)
    return board_of(file)


def test_a_fresh_board_passes_on_the_bench(fresh: Board, ngspice: str) -> None:
    assert judged(fresh, ngspice, 20, 1).good


def test_a_board_for_a_matrix_passes_on_the_bench(tmp_path: Path, ngspice: str) -> None:
    words = write_matrix("random", tmp_path, "own")
    made = taction.new(tmp_path / "board.toml", matrix=words[1], strain=words[3], opamp="ad711")
    assert made.outcome == "pass"
    board = board_of(Path(made.file))
    assert 10.0 <= min(parts(board.deck).values()) <= max(parts(board.deck).values()) <= 10e6
    assert judged(board, ngspice, 20, 1).good


def test_a_wrong_pass_is_found(fresh: Board, ngspice: str) -> None:
    """A uA741 (80 nA in megohms), a limit that 1 % resistors break, and another target."""
    weak = sheet_of({"offset_voltage": 1e-3, "bias_current": 80e-9}, {"bias_current": 500e-9})
    assert judged(replace(fresh, sheet=weak), ngspice, 10, 1).passing < 0.95
    tight = replace(fresh, limits=Limits(1e-3, 0.04))
    assert judged(tight, ngspice, 10, 1).passing < 0.95
    off = replace(fresh, target=1.05 * fresh.target)
    assert judged(off, ngspice, 1, 1).as_written.startswith("rests")


def parts(deck: str) -> dict[str, float]:
    """Return the resistors of the board, ohm; those of a macromodel have no '_' in their names."""
    found = filter(None, map(judge.RESISTOR.match, deck.split("\n")))
    return {part[1]: float(part[4]) for part in found if "_" in part[1]}


def test_every_part_is_drawn_by_itself(fresh: Board) -> None:
    deck = drawn(fresh, np.random.default_rng(3))
    before, after = parts(fresh.deck), parts(deck)
    assert before.keys() == after.keys()
    ratios = np.array([after[name] / ohms for name, ohms in before.items()])
    assert len(set(ratios.tolist())) == len(ratios) > 100
    assert 0.008 < np.abs(ratios - 1.0).max() < 0.02
    offsets = [line.split()[3] for line in deck.split("\n") if line.startswith("Vos ")]
    assert len(set(offsets)) == len(offsets) == 28  # op-amps of seven channels and sensors
    assert np.std([float(v) for v in offsets]) == pytest.approx(0.5e-3 / 0.6745, rel=0.4)


def test_limits_by_hand_made_records() -> None:
    time, target = np.linspace(0.0, 1.0, 101), np.array([1.0, -0.5])
    rise = 1.0 - np.exp(-time / 0.05)
    board = Board("a", "", target, Limits(0.01, 0.02, 0.5, 0.1), 0.01, {})
    assert fault(board, time, rise[:, None] * target) == ""
    assert fault(board, time, rise[:, None] * target * 1.02).startswith("rests 0.02")
    late = replace(board, limits=Limits(0.01, 0.02, 0.1))
    assert fault(late, time, rise[:, None] * target).startswith("settles after 0.2")
    ringing = target * (1.0 + 0.3 * np.exp(-time / 0.05) * np.cos(20 * time))[:, None]
    assert fault(board, time, ringing).startswith("overshoots by 0.3")


def test_figures_of_a_sheet() -> None:
    found = sheet_of(
        {"offset_voltage": 1e-3, "bias_current": 80e-9, "offset_current": 20e-9},
        {"bias_current": 500e-9, "offset_voltage": 6e-3},
    )
    assert found["offset_voltage"] == (0.0, 2e-3)
    assert found["bias_current"] == pytest.approx((80e-9, 140e-9))
    assert found["offset_current"] == pytest.approx((0.0, 29.65e-9), rel=1e-3)


def test_quantities() -> None:
    assert [number(text) for text in ("182kohm", "8.264uS", "±15V", 0.5)] == [
        pytest.approx(182e3),
        pytest.approx(8.264e-6),
        15.0,
        0.5,
    ]


def test_the_judge_knows_nothing_of_taction() -> None:
    assert "import taction" not in Path(judge.__file__).read_text("utf-8")
    assert "from taction" not in Path(judge.__file__).read_text("utf-8")
