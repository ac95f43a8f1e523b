"""What a program has to know beside the commands: the scene file, and calls with their answers.

A test makes every call and reads every answer.
"""

from __future__ import annotations

from typing import Any

from taction.netlist_gen.scene.keys import SYMBOLS

SCENE = """\
[problem]
kind = "tactile"
channels = 3
[design]
capacitance = "20pF"
[checks]
settling_time = "1ms"
"""
SCENE_FILE: dict[str, Any] = {
    "format": "TOML; all keys, their types and defaults are in scene_schema",
    "quantities": "a number in SI base units, or text with prefix and unit: 1e-11 or '10pF';"
    " m is milli, M is mega, u is micro",
    "symbols": {**SYMBOLS, "gain": "design.gain", "lambda": "design.lambda"},
    "example": SCENE,
}
NUMBER = "settling_time"
EXAMPLES: tuple[dict[str, Any], ...] = (
    {
        "task": "verify a board with C = 20 pF and read its settling time, s",
        "files": {"board.toml": SCENE},
        "call": "taction verify board.toml --json",
        "schema": "verify-2",
        "read": [NUMBER],
    },
    {
        "task": "verify all scenes of a folder and read the outcome of the first",
        "files": {"boards/one.toml": SCENE},
        "call": "taction verify boards --json",
        "schema": "verify-files-2",
        "read": ["verdicts", 0, "outcome"],
    },
    {
        "task": "verify the board at five values of C and read the settling time at the last",
        "files": {"board.toml": SCENE},
        "call": "taction sweep board.toml --over C=10pF:100pF:5 --jobs 1 --json",
        "schema": "sweep-2",
        "read": ["points", 4, NUMBER],
    },
    {
        "task": "find the values of C at which the board begins to oscillate",
        "files": {"board.toml": SCENE},
        "call": "taction onset board.toml --over C=100fF:100pF:31 --no-confirm --json",
        "schema": "onset-2",
        "read": ["stable_ranges", 0, 0],
    },
    {
        "task": "read which key of a scene is wrong, and what would be accepted",
        "files": {"board.toml": SCENE.replace("capacitance", "capacitanc")},
        "call": "taction verify board.toml --json",
        "schema": "error-2",
        "read": ["error", "complaints", 0, "accepted"],
    },
)
