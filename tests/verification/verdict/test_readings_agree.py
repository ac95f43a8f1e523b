"""`verify` reads the exact solution, `record_transient` a record: the same readings."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.verdict.recording import record_transient
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.paths import SCENES


def scenes() -> list[Scene]:
    shipped = [
        load_scene(SCENES / f"{name}.toml") for name in ("tuned-breadboard", "custom-matrix")
    ]
    paper = load_scene(SCENES / "paper-breadboard.toml")
    design = {"gain": "6.252Mohm", "unit_conductance": "0.3313uS", "resistance": "1.9Mohm"}
    made = [
        make_scene({"channels": n, "span": span}, design={**design, "capacitance": C})
        for n, span, C in ((3, 2.0, "30pF"), (5, 3.0, "100pF"), (7, 6.0, "15pF"))
    ]
    found = [*shipped, paper, *made]
    analysis = {"engine": "statespace"}
    return [
        s.model_copy(update={"analysis": s.analysis.model_copy(update=analysis)}) for s in found
    ]


@pytest.mark.parametrize("scene", scenes(), ids=lambda scene: scene.name)
def test_the_solution_and_its_record_are_read_the_same(scene: Scene) -> None:
    a, b = verify(scene).measurements, record_transient(scene).measurements
    assert [c.state for c in a.channels] == [c.state for c in b.channels]
    compared = 0
    for one, two in zip(a.channels, b.channels, strict=True):
        assert one.overshoot == pytest.approx(two.overshoot, abs=1e-5)
        assert one.rise_reason == two.rise_reason
        for x, y in (
            (one.rise_time, two.rise_time),
            (one.settling_time, two.settling_time),
        ):
            assert (x is None) is (y is None)
            if x is None or y is None:
                continue
            compared += 1
            assert abs(x.value - y.value) <= x.uncertainty + y.uncertainty + 1e-12 * x.value
            assert x.fragile is y.fragile
    assert compared >= len(a.channels)
    assert np.isfinite(a.amplitude)
