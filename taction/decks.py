"""Jobs on a deck of another hand: check."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from taction.system.processes import one_limit

if TYPE_CHECKING:
    from taction.system.progress import Progress
    from taction.verification.studies.decks.board_check import BoardCheck

SECONDS = 60.0  # of all runs of ngspice of one check


@one_limit(SECONDS)
def check(
    deck: str | Path,
    *,
    outputs: str | Iterable[str] = (),
    checks: str | Iterable[str] = (),
    expect: str | Iterable[str] = (),
    linearise: bool = False,
    over: str | Iterable[str] = (),
    matrix: str | Path | None = None,
    strain: str | Path | None = None,
    lam: float = 0.0,
    unit: str = "1V",
    accept: str = "0.1%",
    tolerances: str | Path | None = None,
    samples: int = 300,
    seed: int = 1,
    ngspice: bool = True,
    transient: bool = False,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    r"""Find poles, oscillation onset, settling and noise of the linear op-amp circuit in DECK.

    DECK is a SPICE deck (ngspice, LTspice, HSPICE), which nothing runs: ngspice expands it, and the
    state-space engine reads its parts. Transistors, op-amps of vendors and whatever else is not
    linear are measured by ngspice at the operating point; its .ac is the witness.

    Parameters
    ----------
    deck : path
        The deck.
    outputs : str or iterable of str
        Node of interest, such as out or v(out); may be given several times. By default those that
        the deck prints, plots or saves, else the node called out, else every node.
    checks : str or iterable of str
        Limit of a reading: settling=1ms@1%, rise=10us, overshoot=5%, undershoot=5%, noise=1mV,
        margin=2 (factor by which the value of any part may change; no gain or phase margin),
        stable, oscillates. A circuit has to be stable unless it has to oscillate.
    expect : str or iterable of str
        Expected voltage at rest: v(out)=1.25@0.1%.
    linearise : bool
        Without effect: whatever is not linear is always measured at the operating point.
    over : str or iterable of str
        Part or .param to change: C1=1p:1n, gain=2:4:50, or a part alone. Every crossing of
        stability is found, and the readings at every value.
    matrix : path, optional
        Matrix T, .csv or .npy: the outputs are expected at the regularised optimum u of
        eps = T u, one --output for each column.
    strain : path, optional
        Strain eps of this problem, .csv or .npy.
    lam : float
        Weight lambda of its regulariser, the sum of u^2; 0 for least squares.
    unit : str
        Voltage of u = 1; negative where the outputs are inverted.
    accept : str
        Accepted deviation of these outputs, as a share of the largest one.
    tolerances : path, optional
        TOML file of tolerances: resistor = "1%", and tables [parts] with R1 = "0.1%", and [params]
        with the names of .param. The worst corners and the yield are found.
    samples : int
        Boards that are drawn within the tolerances.
    seed : int
        Seed of these boards.
    ngspice : bool
        Compare with ngspice's own small signal (.ac) of the deck.
    transient : bool
        Refused: ngspice's small signal is the witness of every deck.
    output : path, optional
        Write the flat cards of the deck, as ngspice expands it, into this file.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    BoardCheck
        Poles with bounds, the parts that move them, readings of the outputs, noise, checks, worst
        corners and yield; `plot` draws the step response and the poles.

    Raises
    ------
    InputError
        The deck, a node, a check, a value or a tolerance cannot be used.
    NoVerdictError
        ngspice is missing, or the circuit has no equilibrium or no state space.

    Examples
    --------
    >>> import pathlib, taction, tempfile
    >>> text = "RC\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     place = pathlib.Path(folder, "rc.cir")
    ...     _ = place.write_text(text)
    ...     found = taction.check(place, checks="settling=5us@1%", ngspice=False)
    >>> found.outcome.value, round(found.poles.rightmost.real)
    ('pass', -1000000)
    """
    from taction.system.errors import Complaint, InputError

    if str(deck).endswith(".toml"):  # before the modules of decks are loaded
        text = "a scene; `taction verify` takes it; expected a SPICE deck, such as filter.cir"
        raise InputError(deck, Complaint("deck", "", text))
    if (matrix is None) != (strain is None):
        missing = "--matrix" if matrix is None else "--strain"
        raise InputError(missing, Complaint("file", "", "--matrix and --strain belong together"))
    if transient:
        text = "ngspice's small signal (.ac) is compared with every deck; leave --transient out"
        raise InputError("--transient", Complaint("transient", "", text))
    from taction.verification.studies.decks.questions import reference_values, wanted

    asked = wanted(_listed(checks), _listed(expect))
    from taction.verification.studies.decks.board_sweep import SweptValue
    from taction.verification.studies.decks.foreign_board import read_board

    progress("deck")
    board, spread = read_board(deck, _listed(outputs)), None
    asked.refuse_unknown(board.flat.nodes)
    swept = [SweptValue.of(each, board) for each in _listed(over)]
    if matrix is not None and strain is not None:
        nodes = [out.node for out in board.circuit.outputs]
        values = reference_values(nodes, matrix, strain, lam, unit, accept)
        asked = replace(asked, expected=(*asked.expected, *values))
    if tolerances is not None:
        from taction.netlist_gen.deck.part_tolerances import read_tolerances

        spread = read_tolerances(tolerances, board.circuit, board.parameters)
    # all that can be refused is refused before the engine is loaded
    from taction.verification.studies.decks.board_check import check_board

    found = check_board(
        board,
        asked,
        ngspice=ngspice,
        over=swept,
        tolerances=spread,
        samples=(samples, seed),
        progress=progress,
    )
    if output is not None:
        from taction.system.output_files import write_atomically

        write_atomically(output, board.flat_text)
    return found


def _listed(given: str | Iterable[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)
