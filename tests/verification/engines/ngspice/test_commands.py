"""How ngspice lists a deck."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.system.errors import DidNotLoad, Killed, SimulationError, TimedOut
from taction.verification.engines.ngspice.commands import MEMORY, expand
from taction.verification.engines.ngspice.process import Simulator, find_simulator
from tests.support.small_decks import wrapped

LINES = (".param r=1k", "v1 in 0 1", "r1 in out {2*r}", "c1 out 0 1n")
FLAT = ("v1 in 0 1", "r1 in out 2.000000000000000e+03", "c1 out 0 1n")


@pytest.fixture(scope="session")
def simulator(ngspice: str) -> Simulator:
    return find_simulator(ngspice)


def test_a_deck_is_listed_flat(simulator: Simulator) -> None:
    assert expand(LINES, simulator) == (FLAT,)


ENDINGS: dict[str, type[SimulationError]] = {
    "exit 1": DidNotLoad, "kill -9 $$": Killed, "exec sleep 1000": TimedOut
}  # fmt: skip


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_simulator_that_does_not_list_is_told_of(
    ending: str, simulator: Simulator, tmp_path: Path
) -> None:
    with pytest.raises(ENDINGS[ending]):
        expand(LINES, wrapped(simulator, tmp_path, ending), seconds=0.3)


def test_a_listing_has_little_memory(simulator: Simulator, tmp_path: Path) -> None:
    told = tmp_path / "kilobytes"
    expand(LINES, wrapped(simulator, tmp_path, f"sleep 0.2; ulimit -v > {told}"))
    assert int(told.read_text()) == MEMORY // 1024


@pytest.mark.parametrize(
    ("wrong", "says"),
    [((*LINES, "r2 out 0 {nothing}"), "nothing"), ((".subckt s a", *LINES, ".ends"), "no card")],
)
def test_a_deck_of_which_ngspice_complains_is_refused(
    wrong: tuple[str, ...], says: str, simulator: Simulator
) -> None:
    with pytest.raises(DidNotLoad, match=says):
        expand(wrong, simulator)
