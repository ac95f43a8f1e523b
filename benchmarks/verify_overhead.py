"""What `verify` costs beside a bare ngspice on the same deck.

Run from the checkout: ``python benchmarks/verify_overhead.py [ROUNDS [SCENE]]``. The baseline is
the whole process ``ngspice -b -n -r out.raw deck.cir`` on the same deck; `verify` is called in this
process, with everything imported.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from timing import interleaved, print_machine, print_rounds, print_table, ratio

from netlist_gen.deck.deck import write_deck
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.file import load_scene
from verification.engines.ngspice.executable import environment, find_simulator
from verification.ideal.ideal_answer import ideal_answer, ideal_network
from verification.verify import Verdict, verify

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "scenes" / "paper-breadboard.toml"


def ngspice(folder: Path) -> subprocess.Popen[bytes]:
    """Start ngspice on the deck in `folder`, in the environment of the tool's own runs.

    Also in a session of its own as they are: a busy machine may share its time among sessions.
    """
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        [find_simulator().executable, "-b", "-n", "-r", "out.raw", "deck.cir"],
        cwd=folder,
        env=environment(folder),
        stdin=quiet,
        stdout=quiet,
        stderr=quiet,
        start_new_session=True,
    )


def wait(*runs: subprocess.Popen[bytes]) -> None:
    """Wait for `runs`, all of which must succeed."""
    for run in runs:
        assert run.wait() == 0


def written(verdict: Verdict, folder: Path) -> Path:
    """Write the deck of `verdict`'s transient and return the folder."""
    deck = write_deck(verdict.circuit, verdict.transient, solver=find_simulator().solver_option)
    (folder / "deck.cir").write_text(deck.text, encoding="utf-8")
    (folder / "spinit").write_text("* no code models are loaded\n")
    return folder


def main(words: list[str]) -> None:
    """Measure and print."""
    rounds, path = int(words[0]) if words else 20, words[1] if words[1:] else SCENE
    print_machine()
    scene = load_scene(path)
    verdicts: list[Verdict] = []
    network = ideal_network(make_problem(scene), scene)
    first = verify(scene)
    with ExitStack() as cleanup:
        folder = written(first, Path(cleanup.enter_context(tempfile.TemporaryDirectory())))
        jobs: dict[str, Callable[[], object]] = {
            "ngspice": lambda: wait(ngspice(folder)),
            "verify": lambda: verdicts.append(verify(scene)),
            "reference alone": lambda: ideal_answer(network, scene),
        }
        found = interleaved(jobs, rounds)
    verdicts = verdicts[-rounds:]
    points = len(first.waveforms.time)
    print_rounds(f"{scene.name}: {points} points, {rounds} rounds", found, "ngspice")
    beyond = [v - r for v, r in zip(found["verify"], found["reference alone"], strict=True)]
    print(f"verify less the reference: {ratio(beyond, found['ngspice'])} times ngspice\n")
    stages = {stage: [v.timing[stage] for v in verdicts] for stage in verdicts[0].timing}
    rows = [(stage, f"{1e3 * statistics.median(s):.1f}") for stage, s in stages.items()]
    print_table("Stages of verify; simulation is what was waited for", ("", "median, ms"), rows)


if __name__ == "__main__":
    main(sys.argv[1:])
