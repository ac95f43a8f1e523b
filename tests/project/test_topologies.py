"""What a board is stands with its topology: other files know neither its name nor its parts'."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taction.netlist_gen.topologies import NAMES
from tests.support.paths import ROOT

PACKAGE = ROOT / "taction"
QUOTED = f"""["']({"|".join(NAMES)})["']"""
PART = r"(part|cell|each|source|r|c|resistor|capacitor)\.name"
FORBIDDEN = {
    "compares with the name of a topology": rf"topology\s*(==|!=|in)\s|==\s*{QUOTED}",
    "takes a matrix by its place": r"\bmatrices\[\d",
    "reads the scalings of a board": r"\.scalings\b|\bScalings\(",
    "tests the beginning of a name": rf"\b{PART}\.(startswith|removeprefix|partition|split)\(",
    "builds the name of a part": rf"""\b{PART}\s*(==|in)\s*\(?f["']""",
}
OWN = ("netlist_gen/topologies/", "verification/reference/dynamics.py")


def sources() -> Iterator[tuple[str, str]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith(OWN):
            yield name, path.read_text("utf-8")


def found(name: str, text: str) -> Iterator[str]:
    for what, pattern in FORBIDDEN.items():
        for number, line in enumerate(text.splitlines(), 1):
            if re.search(pattern, line):
                yield f"{name}:{number} {what}: {line.strip()}"


def test_no_other_file_knows_a_topology_or_the_names_of_its_parts() -> None:
    wrong = [each for name, text in sources() for each in found(name, text)]
    assert not wrong, "\n".join(wrong)


def test_a_topology_is_named_in_its_file_only() -> None:
    """The default of a scene, and remedies of the one in the other, apart."""
    others = "|".join(name for name in NAMES if name != "integrator")
    pattern = re.compile(rf"""topolog\w*\W+["'`]({others})\b|["']({others})["']""")
    allowed = {"netlist_gen/kicad/symbols.py"}  # a kind of pin has the same name in KiCad
    assert sum(1 for _ in sources()) > 200
    wrong = {name for name, text in sources() if pattern.search(text)} - allowed
    assert wrong == set()
