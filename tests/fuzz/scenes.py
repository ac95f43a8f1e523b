"""Scenes: parsed, written again, built, and tiny ones verified by the state-space engine."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import plain
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import view
from taction.verification.studies.regression.baseline import baseline_text, observe
from taction.verification.verdict.scene_deck import deck_of
from taction.verification.verdict.verify import Verdict, verify
from tests.fuzz.edits import BYTE_EDITS, LINE_EDIT, SCALE_EDIT, VALUE_EDIT, edited
from tests.fuzz.target import Target
from tests.support.entries import FAST
from tests.support.paths import SCENES

BASES = [file.read_bytes() for file in sorted(SCENES.glob("*.toml"))]
BASES += [FAST.format(limit="1s", capacitance="10pF", opamp="ua741").encode()] * 6
EDITS = (SCALE_EDIT, SCALE_EDIT, SCALE_EDIT, VALUE_EDIT, LINE_EDIT, *BYTE_EDITS[:4])
MATRIX = SCENES / "custom-matrix"
MOST_ENTRIES = 3000  # of T: larger boards are parsed, not built
RUNS_COMMANDS = re.compile(
    r"^\s*(?:\.(?:control|include|lib)|\*#|\*ng_script|a\d)", re.MULTILINE | re.I
)
TINY = 24  # entries of T of a board that is simulated


def examine(content: bytes, folder: Path) -> str:
    """Run the stages of a scene as far as its size allows."""
    file = folder / "scene.toml"
    file.write_bytes(content)
    (folder / "custom-matrix").symlink_to(MATRIX)
    scene = load_scene(file)
    _check_round_trip(scene, folder / "again.toml")
    channels = getattr(scene.problem, "channels", 4)
    size = channels * (getattr(scene.problem, "sensors", 4) or channels)
    if size > MOST_ENTRIES:
        return "accepted, not built"
    problem = make_problem(scene)
    scene = resolve_lambda(scene)
    if problem.matrix.size > TINY:
        designed = synthesise(scene, problem)
        circuit, deck = deck_of(scene)  # whose op-amps may have their limits
        assert not RUNS_COMMANDS.search(deck.text), deck.text
        assert write_deck(circuit, deck.analysis).text == deck.text
        plain_one = replace(circuit, models=designed.models)
        assert write_deck(plain_one, deck.analysis) == write_deck(designed, deck.analysis)
        return "built"
    verdict = verify(scene.with_engine("statespace"), problem=problem)
    _check_reports(verdict)
    if verdict.outcome.value == "pass" and scene.design.amplifier == "linear":
        _check_solution(verdict, problem)
    shutil.rmtree(folder / "custom-matrix", ignore_errors=True)
    return f"verified: {verdict.outcome.value}"


def _check_round_trip(scene: Scene, file: Path) -> None:
    """Fail unless the scene's values, written as TOML, are the same scene."""
    values = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    file.write_text(_table(values), encoding="utf-8")
    again = load_scene(file)
    same = again.model_dump(mode="json") == scene.model_dump(mode="json")  # arrays as lists
    assert same, file.read_text(encoding="utf-8")


def _table(values: dict[str, Any]) -> str:
    return "\n".join(f"{json.dumps(key)} = {_text(item)}" for key, item in values.items())


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")


def _check_reports(verdict: Verdict) -> None:
    """Fail unless the verdict can be printed, and written as JSON and as a baseline."""
    assert verdict.outcome.value.upper() in page_text(view(verdict))
    assert json.dumps(plain(verdict_document(verdict)), allow_nan=False)
    text = baseline_text({"scene.toml": observe(verdict)})
    assert json.loads(text)["scenes"]["scene.toml"]["outcome"] == verdict.outcome.value


def _check_solution(verdict: Verdict, problem: InverseProblem) -> None:
    """Fail unless a linear board that passes has the solution of the stacked least squares."""
    design, T = verdict.scene.design, problem.matrix
    volts, G0 = design.unit_voltage, design.unit_conductance
    R = 1.786e6 if design.resistance is None else design.resistance
    lam = 1.0 / (R * design.gain * G0**2) if design.lam is None else design.lam
    assert isinstance(lam, float)
    channels = T.shape[1]
    left = np.vstack([T, np.sqrt(lam) * np.eye(channels)])
    right = np.concatenate([problem.strain, np.zeros(channels)])
    u = np.linalg.lstsq(left, right, rcond=None)[0] * volts
    amplitude = float(np.abs(u).max())
    largest = float(np.abs(verdict.steady.values - u).max())
    assert largest <= 1.01 * verdict.scene.checks.steady_state.tolerance * amplitude


SCENE = Target("scenes", edited(BASES, EDITS, most=2), examine)
