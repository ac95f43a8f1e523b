"""Noise analyses by ngspice: kT/C, a sharp resonance, and results that are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.analysis import Band, Noise, OperatingPoint
from taction.system.errors import BadEvidence
from taction.verification.engines.ngspice.evidence import Ending, integrated_noise
from taction.verification.engines.ngspice.process import find_simulator, start
from taction.verification.verdict.output_noise import noise_bands
from tests.support.small_decks import SmallDeck, divider

KT = 1.380649e-23 * 300.15
R, L, C = 1e4, 1e-6, 1e-12
RC = noise_bands(np.array([-1.0 / (R * C) + 0j]))


def noise_deck(bands: tuple[Band, ...], *, saved: str = "out", parts: str = "") -> SmallDeck:
    """R and C between ``out`` and ground."""
    cards = [f".noise v({saved}) V1 dec {b.density} {b.start!r} {b.stop!r}" for b in bands]
    lines = [
        "* taction test",
        "V1 in 0 0.0 ac 1.0",
        parts or f"R1 out 0 {R!r}",
        f"C1 out 0 {C!r}",
        ".options noopiter reltol=1e-06",
        ".save onoise_spectrum onoise_total",
        *cards,
        ".end",
    ]
    return SmallDeck("\n".join(lines) + "\n", (saved,), Noise(bands))


def noise(deck: SmallDeck) -> float:
    with start(deck, find_simulator(), timeout=30.0) as run:
        return run.noise()


@pytest.mark.usefixtures("ngspice")
def test_a_resistor_and_a_capacitor_have_kt_over_c() -> None:
    assert noise(noise_deck(RC)) == pytest.approx(math.sqrt(KT / C), rel=1e-3)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("sharpness", [3.0, 300.0, 10_000.0])
def test_a_resonance_has_kt_over_c_too(sharpness: float) -> None:
    """By equipartition, however sharp the resonance is; ngspice's own integral loses it."""
    ohms = sharpness * math.sqrt(L / C)
    poles = np.roots([L * C, L / ohms, 1.0]).astype(np.complex128)
    deck = noise_deck(noise_bands(poles), parts=f"R1 out 0 {ohms!r}\nL1 out 0 {L!r}")
    assert noise(deck) == pytest.approx(math.sqrt(KT / C), rel=1e-3)


@pytest.mark.usefixtures("ngspice")
def test_a_node_without_noise_is_refused() -> None:
    """A silent resistor, or a node that only the card names: ngspice adds it to the circuit."""
    decks = (noise_deck(RC, parts=f"R1 out 0 {R!r} noisy=0"), noise_deck(RC, saved="nowhere"))
    for deck in decks:
        with pytest.raises(BadEvidence, match="is the node in the circuit"):
            noise(deck)


@pytest.mark.usefixtures("ngspice")
def test_other_frequencies_than_asked_for_are_refused() -> None:
    deck = noise_deck(RC)
    wider = (*RC[:-1], replace(RC[-1], steps=RC[-1].steps + 1))
    fewer = (replace(RC[0], start=2.0 * RC[0].start), *RC[1:])
    for bands in (wider, fewer):
        with pytest.raises(BadEvidence, match="were asked for"):
            noise(replace(deck, analysis=Noise(bands)))
    with pytest.raises(BadEvidence, match="4 plots; 2 were asked for"):
        noise(replace(deck, analysis=Noise(RC[:1])))


@pytest.mark.usefixtures("ngspice")
def test_another_analysis_is_refused() -> None:
    assert isinstance(divider().analysis, OperatingPoint)
    with pytest.raises(BadEvidence, match="OperatingPoint, not Noise"):
        noise(divider())


@pytest.mark.parametrize(
    ("density", "message"), [(math.nan, "not finite"), (math.inf, "not finite"), (-1.0, "negative")]
)
def test_a_density_that_is_none_is_refused(tmp_path: Path, density: float, message: str) -> None:
    band = Band(1.0, 1, 1)

    def plot(name: str, vectors: tuple[str, ...], *rows: tuple[float, ...]) -> bytes:
        named = "".join(f"\t{k}\t{vector}\tvoltage\n" for k, vector in enumerate(vectors))
        head = (
            f"Title: t\nPlotname: {name}\nFlags: real\nNo. Variables: {len(vectors)}\n"
            f"No. Points: {len(rows)}\nVariables:\n{named}Binary:\n"
        )
        return head.encode() + np.array(rows).tobytes()

    names = ("frequency", "onoise_spectrum")
    spectrum = plot("Noise Spectral Density Curves", names, (1.0, 1e-9), (10.0, density))
    integral = plot("Integrated Noise", ("v(onoise_total)",), (1e-9,))
    deck = SmallDeck("", ("out",), Noise((band,)))
    ending = Ending(0, False, 1.0, 0.1, "", tmp_path)
    (tmp_path / "out.raw").write_bytes(spectrum + integral)
    with pytest.raises(BadEvidence, match=message):
        integrated_noise(deck, ending)
    (tmp_path / "out.raw").write_bytes(integral + spectrum)
    with pytest.raises(BadEvidence, match="the plot is 'Integrated Noise'"):
        integrated_noise(deck, ending)
