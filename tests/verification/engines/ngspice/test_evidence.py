"""Each point of evidence by itself; noise and small signals against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.analysis import NoiseAnalysis, NoiseBand
from taction.system.array_types import Cost, Waveforms
from taction.system.errors import (
    BadEvidence,
    DidNotLoad,
    Killed,
    OutOfDisk,
    SimulationError,
    SingularCircuit,
    StepTooSmall,
)
from taction.system.raw_file import write_raw
from taction.verification.engines.ngspice.evidence import (
    Ending,
    accepted_waveforms,
    important_lines,
    integrated_noise,
)
from taction.verification.engines.ngspice.process import Simulation, find_simulator
from taction.verification.verdict.board import noise_bands
from tests.support.small_decks import SmallDeck, divider, transient

DECK = transient(saved=("out", "in"), stop=1e-6, step=1e-7)
TIME = np.linspace(0.0, 1e-6, 11)


def ending(folder: Path, *, status: int = 0, errors: str = "") -> Ending:
    return Ending(status, False, 1.0, 0.25, errors, folder)


def record(
    time: np.ndarray = TIME, nodes: tuple[str, ...] = ("out", "in"), value: float = 0.5
) -> Waveforms:
    values = np.full((len(time), len(nodes)), value) * np.arange(1.0, len(nodes) + 1.0)
    return Waveforms(time, nodes, values, "test", Cost(0.0, len(time)))


def judged(folder: Path, waveforms: Waveforms, **left: object) -> Waveforms:
    write_raw(folder / "out.raw", waveforms)
    return accepted_waveforms(DECK, ending(folder, **left), engine="ngspice-46", bound=1e6)  # type: ignore[arg-type]  # keywords of `ending`


@pytest.mark.parametrize("nodes", [("out", "in"), ("in", "out")])
def test_a_good_record_is_accepted_in_any_order(nodes: tuple[str, ...], tmp_path: Path) -> None:
    got = judged(tmp_path, record(nodes=nodes))
    assert (got.engine, got.nodes, got.flags) == ("ngspice-46", ("out", "in"), ())
    assert got.cost == Cost(seconds=0.25, points=11)
    for node, value in zip(nodes, (0.5, 1.0), strict=True):
        np.testing.assert_array_equal(got[node], value)


REFUSED: dict[str, tuple[Callable[[], Waveforms], str]] = {
    "missing vector": (lambda: record(nodes=("out",)), r"missing: v\(in\)"),
    "extra vector": (lambda: record(nodes=("out", "in", "x")), r"not asked for: v\(x\)"),
    "a name twice": (lambda: record(nodes=("out", "out")), r"missing: v\(in\)"),
    "cut short": (lambda: record(TIME[:-1]), "ends at"),
    "too long": (lambda: record(TIME * (1.0 + 1e-8)), "ends at"),
    "starts late": (lambda: record(TIME[2:]), "begins at"),
    "time stands still": (lambda: record(TIME[[0, 1, 2, 2, *range(3, 11)]]), "strictly"),
    "time goes back": (lambda: record(TIME[[0, 2, 1, *range(3, 11)]]), "strictly"),
    "time is no number": (lambda: record(np.where(TIME[4] == TIME, np.nan, TIME)), "strictly"),
    "no number": (lambda: record(value=np.nan), r"v\(out\) nan V"),
    "infinite": (lambda: record(value=-np.inf), r"v\(out\) inf V"),
    "clamped": (lambda: record(value=1e99), r"v\(out\) 1e\+99 V"),
    "below the negative bound": (lambda: record(value=-1.1e6), r"v\(in\) 2200000.0 V"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str, tmp_path: Path) -> None:
    make, message = REFUSED[case]
    with pytest.raises(BadEvidence, match=message) as caught:
        judged(tmp_path, make())
    assert caught.value.folder == tmp_path


def test_a_plot_of_another_analysis(tmp_path: Path) -> None:
    write_raw(tmp_path / "out.raw", record())
    with pytest.raises(BadEvidence, match="'Operating Point' was asked for"):
        accepted_waveforms(divider(), ending(tmp_path), engine="ngspice-46", bound=1e6)


LOGS: dict[str, tuple[str, type[SimulationError]]] = {
    "Warning: rawfile write error !!\nrun simulation interrupted": ("could not be", OutOfDisk),
    "Warning: singular matrix:  check node a\nError: The operating point could not be simulated"
    "\ndoAnalyses: TRAN:  Timestep too small": ("singular", SingularCircuit),
    "doAnalyses: TRAN:  Timestep too small; time = 1e-9": ("time step", StepTooSmall),
    "Warning: 'r1 in out' is not a valid resistor instance line, ignored!": (
        "as it is",
        DidNotLoad,
    ),
    "Warning: Unusual leading characters like '='": ("as it is", DidNotLoad),
    "Warning: Value of resistor r3 is too small, set to 1.000000e-12": ("as it is", DidNotLoad),
    "Warning: can't find model 'x'": ("as it is", DidNotLoad),
    "Error: there aren't any circuits loaded.": ("as it is", DidNotLoad),
    "run simulation(s) aborted": ("reported an error", BadEvidence),
    "a step that is too small": ("reported an error", BadEvidence),
    "Fatal error": ("reported an error", BadEvidence),
}


@pytest.mark.parametrize("log", LOGS)
def test_the_log_is_read_even_when_all_else_is_good(log: str, tmp_path: Path) -> None:
    message, kind = LOGS[log]
    with pytest.raises(SimulationError, match=message) as caught:
        judged(tmp_path, record(), errors=log)
    assert type(caught.value) is kind
    assert log.splitlines()[0] in caught.value.log


def test_a_failure_brings_the_points_that_were_written(tmp_path: Path) -> None:
    with pytest.raises(BadEvidence, match="exit status 3"):  # without a reason
        judged(tmp_path, record(), status=3)
    with pytest.raises(Killed, match=r"SIGKILL.*memory") as caught:
        judged(tmp_path, record(TIME[:5]), status=-9)
    assert isinstance(caught.value.partial, Waveforms)
    np.testing.assert_array_equal(caught.value.partial.time, TIME[:5])


def test_what_ngspice_got_over_is_a_flag_once(tmp_path: Path) -> None:
    log = (
        "Note: Starting dynamic gmin stepping\n"
        "Warning: singular matrix:  check node f\n\n"
        "Warning: singular matrix:  check node f\n"
        "Warning: Dynamic gmin stepping failed\n"
        "Note: Dynamic gmin stepping completed\n"
    )
    assert judged(tmp_path, record(), errors=log).flags == (
        "Warning: singular matrix:  check node f",
        "Warning: Dynamic gmin stepping failed",
    )


KT = 1.380649e-23 * 300.15
R, L, C = 1e4, 1e-6, 1e-12
RC = noise_bands(np.array([-1.0 / (R * C) + 0j]))


def noise_deck(bands: tuple[NoiseBand, ...], *, saved: str = "out", parts: str = "") -> SmallDeck:
    """R and C between ``out`` and ground."""
    cards = [f".noise v({saved}) V1 dec {b.density} {b.start!r} {b.stop!r}" for b in bands]
    head = f"* taction test\nV1 in 0 0.0 ac 1.0\n{parts or f'R1 out 0 {R!r}'}\nC1 out 0 {C!r}\n"
    options = ".options noopiter reltol=1e-06\n.save onoise_spectrum onoise_total\n"
    text = head + options + "\n".join([*cards, ".end\n"])
    return SmallDeck(text, (saved,), NoiseAnalysis(bands))


def noise(deck: SmallDeck) -> float:
    with Simulation(deck, find_simulator(), timeout=30.0) as run:
        return run.accept(integrated_noise)


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("sharpness", [0.0, 3.0, 300.0, 10_000.0])
def test_a_resonance_has_kt_over_c_as_a_resistor_with_a_capacitor(sharpness: float) -> None:
    """By equipartition, however sharp the resonance is; ngspice's own integral loses it."""
    deck = noise_deck(RC)
    if sharpness:
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
            noise(replace(deck, analysis=NoiseAnalysis(bands)))
    with pytest.raises(BadEvidence, match="4 plots; 2 were asked for"):
        noise(replace(deck, analysis=NoiseAnalysis(RC[:1])))


@pytest.mark.parametrize(
    ("density", "message"), [(math.nan, "not finite"), (math.inf, "not finite"), (-1.0, "negative")]
)
def test_a_density_that_is_none_is_refused(tmp_path: Path, density: float, message: str) -> None:
    band = NoiseBand(1.0, 1, 1)

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
    deck = SmallDeck("", ("out",), NoiseAnalysis((band,)))
    ending = Ending(0, False, 1.0, 0.1, "", tmp_path)
    (tmp_path / "out.raw").write_bytes(spectrum + integral)
    with pytest.raises(BadEvidence, match=message):
        integrated_noise(deck, ending)
    (tmp_path / "out.raw").write_bytes(integral + spectrum)
    with pytest.raises(BadEvidence, match="the plot is 'Integrated Noise'"):
        integrated_noise(deck, ending)
    beside = plot("Noise Spectral Density Curves", names, (1.5, 1e-9), (10.0, 1e-9))
    (tmp_path / "out.raw").write_bytes(beside + integral)
    with pytest.raises(BadEvidence, match="2 from 1 to 10 Hz were asked for"):
        integrated_noise(deck, ending)


def test_a_long_error_stream_has_its_first_and_last_lines() -> None:
    lines = [f"line {n}" for n in range(40)]
    shown = [*lines[:6], "... 28 lines", *lines[-6:]]
    assert important_lines("\n".join(["Note: nothing", *lines])).split("\n") == shown


def test_a_record_whose_first_vector_is_no_time_is_no_evidence(tmp_path: Path) -> None:
    write_raw(tmp_path / "out.raw", record())
    whole = (tmp_path / "out.raw").read_bytes()
    for name, other in (
        (b"\ttime\t", b"\tx\t"),
        (b"\tv(out)\t", b"\ttime\t"),
        (b"\tx\t", b"\tv(out)\t"),
    ):
        whole = whole.replace(name, other, 1)
    (tmp_path / "out.raw").write_bytes(whole)
    with pytest.raises(BadEvidence, match=r"the first vector is 'v\(out\)', not time"):
        accepted_waveforms(DECK, ending(tmp_path), engine="ngspice-46", bound=1e6)
