"""Lambda by a rule: ``lambda = "discrepancy"`` becomes a number before the synthesis."""

from __future__ import annotations

from pathlib import Path

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import Complaint, InputError, SolverError


def resolve_lambda(scene: Scene) -> Scene:
    """Return `scene` with a number for lambda; unchanged where it has one.

    InputError: the scene lacks the variance of the noise, which the rule ``discrepancy`` needs.
    SolverError: the rule finds no optimum: its score is best at an end of the range.
    """
    rule = scene.design.lam
    if not isinstance(rule, str):
        return scene
    from taction.verification.reference.ideal_answer import is_biased
    from taction.verification.reference.lambda_choice import DECADES, choose, missing
    from taction.verification.reference.problem import Problem

    inverse, variance = make_problem(scene), scene.problem.noise.variance
    if text := missing(rule, variance):
        raise InputError(scene.file, Complaint("design.lambda", repr(rule), text))
    kind = scene.design.amplifier, is_biased(scene), scene.design.ridge_share
    problem = Problem(inverse.matrix, inverse.strain, 1.0, *kind)
    choice = choose(problem, rule, variance=variance)
    if choice.at_edge:
        raise SolverError(
            f"lambda = {rule!r} finds no optimum from {DECADES[0]:g} to {DECADES[1]:g} decades of"
            f" the squared norm of T: its score is best at the end, {choice.solution.lam:.3g}."
            " Give a number, or another rule"
        )
    return scene.with_lambda(choice.solution.lam, rule)


def read_scene(scene: str | Path | Scene, engine: str | None = None) -> Scene:
    """Return a scene, read from its path if necessary, with lambda as a number.

    `engine` replaces the engine of the scene.

    InputError, SolverError: see `taction.netlist_gen.scene.scene.load_scene` and
      `resolve_lambda`.
    """
    resolved = resolve_lambda(scene if isinstance(scene, Scene) else load_scene(scene))
    return resolved if engine is None else resolved.with_engine(engine)
