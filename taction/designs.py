"""Jobs without a transient: the deck of a scene, and the solution of its problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.netlist_gen.deck.deck import Deck
    from taction.netlist_gen.scene.scene import Scene
    from taction.verification.reference import Solution


def netlist(
    scene: str | Path | Scene,
    *,
    split: bool = False,
    output: str | Path | None = None,
    dialect: str = "ngspice",
    parameters: bool = False,
    measure: bool = False,
) -> Deck:
    """Return the deck of a scene's transient; the same scene gives the same bytes.

    Parameters
    ----------
    scene : path or Scene
        The board.
    split : bool
        Write the resistor matrices into a second file; needs `output`.
    output : path, optional
        Write the deck into this file.
    dialect : str
        ``"ngspice"``, ``"ltspice"``, ``"hspice"``, ``"xyce"`` or ``"spectre"``.
    parameters : bool
        Write C, gain and lambda as ``.param`` cards, and R as an expression of them.
    measure : bool
        Add ``.meas`` cards of rise time, settling time and overshoot.

    Returns
    -------
    Deck
        Its `text` is the deck; `files` holds the second file of a split deck.

    Raises
    ------
    InputError
        The scene cannot be used, the dialect cannot express it, or the file cannot be written.

    Examples
    --------
    >>> import taction
    >>> deck = taction.netlist("scenes/paper-breadboard.toml")
    >>> deck.saved
    ('v_1', 'v_2', 'v_3', 'v_4', 'v_5', 'v_6', 'v_7')
    >>> deck = taction.netlist("scenes/paper-breadboard.toml", dialect="hspice", parameters=True)
    >>> "Rr_1 v_1 x_1 'R'" in deck.text
    True
    """
    from taction.netlist_gen.deck.dialects.table import DIALECTS
    from taction.system.errors import Complaint, InputError
    from taction.verification.reference.ideal_answer import read_scene
    from taction.verification.verdict.deck import DeckChoice, deck_of, write_files

    if dialect not in DIALECTS:
        text = f"expected one of {', '.join(DIALECTS)}"
        raise InputError("netlist", Complaint("dialect", repr(dialect), text))
    choice = DeckChoice(dialect, split, parameters, measure)
    _, deck = deck_of(read_scene(scene), output=output, choice=choice)
    if output is not None:
        write_files(deck, output)
    return deck


@overload
def solve(scene: str | Path | Scene, *, strains: None = None) -> Solution: ...
@overload
def solve(scene: str | Path | Scene, *, strains: ArrayLike) -> list[Solution]: ...
def solve(
    scene: str | Path | Scene, *, strains: ArrayLike | None = None
) -> Solution | list[Solution]:
    """Solve the problem of a scene numerically, without any circuit.

    Parameters
    ----------
    scene : path or Scene
        The problem: matrix, strain, amplifier and lambda.
    strains : array_like (K, M), optional
        Solve for each row instead of the scene's strain; the matrix is factorised once.

    Returns
    -------
    Solution or list of Solution
        `u` (N,), dimensionless, and its certificate; use it only if `trusted`, else see `reason`.
        With `strains`: one solution per row.

    Raises
    ------
    InputError
        The scene or the strains cannot be used.
    NoVerdictError
        No solution can be computed.

    Examples
    --------
    >>> import taction
    >>> scene = taction.Scene.from_arrays([[2.0, 0.0], [0.0, 1.0]], [4.0, 3.0], lam=1.0)
    >>> taction.solve(scene).u.round(12).tolist()
    [1.6, 1.5]
    >>> several = taction.solve(scene, strains=[[5.0, 0.0], [0.0, 2.0]])
    >>> [solution.u.round(12).tolist() for solution in several]
    [[2.0, 0.0], [0.0, 1.0]]
    """
    from taction.netlist_gen.scene.inverse_problem import make_problem, with_strains
    from taction.verification.reference import solve as solve_one
    from taction.verification.reference import solve_each
    from taction.verification.reference.ideal_answer import ideal_network, read_scene

    scene = read_scene(scene)
    problem = ideal_network(make_problem(scene), scene).problem
    if strains is None:
        return solve_one(problem)
    return solve_each(problem, [inverse.strain for inverse in with_strains(scene, strains)])
