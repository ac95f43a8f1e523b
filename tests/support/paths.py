"""Where things are in the checkout."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "taction" / "scenes"
DATA = ROOT / "tests" / "data"
GOLDEN = ROOT / "tests" / "golden"
CASES = DATA / "cases"
