"""``taction solve``: the reference solution alone."""

from __future__ import annotations

import sys

import click

import taction
from taction.cli.common import STATUS, print_json, scene_command


@scene_command
def solve(scene: str, as_json: bool) -> None:
    """Solve the problem of SCENE numerically, without any circuit.

    Exit status: 3 if the solution has no certificate.
    """
    solution = taction.solve(scene)
    if as_json:
        print_json(
            {
                "outcome": "pass" if solution.trusted else "inconclusive",
                "u": solution.u,
                "v": solution.v,
                "lambda": solution.lam,
                "objective": solution.objective,
                "certificate": {
                    "kind": solution.certificate_kind,
                    "value": solution.certificate,
                    "bound": solution.bound,
                },
                "error_bound": solution.error_bound,
                "condition": solution.condition,
                "iterations": solution.iterations,
                "trusted": solution.trusted,
                "reason": solution.reason,
                "seconds": solution.seconds,
            }
        )
    else:
        for n, value in enumerate(solution.u.tolist(), 1):
            click.echo(f"u_{n} = {value!r}")
        click.echo(f"lambda = {solution.lam!r}, objective = {solution.objective!r}")
        click.echo(
            f"{solution.certificate_kind} {solution.certificate:.3g} (bound {solution.bound:.3g});"
            f" error in u at most {solution.error_bound:.2g}; condition {solution.condition:.3g};"
            f" {solution.iterations} iterations, {1e3 * solution.seconds:.2f} ms"
        )
        if not solution.trusted:
            click.echo(f"inconclusive: {solution.reason}")
    sys.exit(0 if solution.trusted else STATUS["inconclusive"])
