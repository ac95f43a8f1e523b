"""The evidence that a noise analysis of ngspice must show before its result is accepted.

In place of the points 3 to 7 of `evidence`: every card has two plots, the spectrum and its
integral. The spectrum begins and ends at the requested frequencies, with the requested number of
points, all finite and zero or more. A node without any noise is refused: ngspice adds a node of an
unknown name to the circuit.

The integral is not ngspice's own: between two points ngspice takes the density for ``a f^k`` and
computes a and ``f^k`` separately. On the flanks of a resonance k is in the hundreds, so that a
underflows and the resonance has no noise.
"""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.analysis import Band, Noise
from taction.system.errors import BadEvidence, SimulationError
from taction.verification.engines.ngspice.ending import Ending
from taction.verification.engines.ngspice.evidence import check_ending, documented
from taction.verification.engines.ngspice.raw_file import Plot, read_plots
from taction.verification.engines.ngspice.screening import Deck

SPECTRUM = ("Noise Spectral Density Curves", ("frequency", "onoise_spectrum"))
INTEGRAL = ("Integrated Noise", ("v(onoise_total)",))
FREQUENCY_TOLERANCE = 1e-6


def integrated_noise(deck: Deck, ending: Ending) -> float:
    """Return the noise of the saved node over all bands, rms, V.

    Raises
    ------
    SimulationError
        One of its kinds; `BadEvidence` where a plot is missing, is another one than asked for, or
        has other frequencies.
    """
    try:
        check_ending(ending)
        return _total(deck, read_plots(ending.raw))
    except SimulationError as error:
        raise documented(error, ending) from None


def _total(deck: Deck, plots: list[Plot]) -> float:
    analysis = deck.analysis
    if not isinstance(analysis, Noise):
        raise BadEvidence(f"the analysis is {type(analysis).__name__}, not Noise")
    spectra, integrals = plots[0::2], plots[1::2]
    if len(plots) != 2 * len(analysis.bands):
        raise BadEvidence(f"{len(plots)} plots; {2 * len(analysis.bands)} were asked for")
    for spectrum, integral in zip(spectra, integrals, strict=True):
        _check_name(spectrum, *SPECTRUM)
        _check_name(integral, *INTEGRAL)
    # ngspice runs the last card first.
    spectra.sort(key=lambda plot: float(plot.data[0, 0]))
    for spectrum, band in zip(spectra, analysis.bands, strict=True):
        _check_frequencies(spectrum, band)
    if not (variance := sum(map(_variance, spectra))):
        raise BadEvidence(f"no noise at node {deck.saved[0]}; is the node in the circuit?")
    return math.sqrt(variance)


def _check_name(plot: Plot, name: str, vectors: tuple[str, ...]) -> None:
    if (plot.name, plot.vectors) != (name, vectors):
        raise BadEvidence(
            f"the plot is {plot.name!r} with {', '.join(plot.vectors)}; {name!r} with"
            f" {', '.join(vectors)} was asked for"
        )


def _check_frequencies(spectrum: Plot, band: Band) -> None:
    frequencies = spectrum.data[:, 0]
    expected = (band.start, band.stop)
    found = (float(frequencies[0]), float(frequencies[-1]))
    if len(frequencies) != band.steps + 1 or not np.allclose(
        found, expected, rtol=FREQUENCY_TOLERANCE, atol=0.0
    ):
        raise BadEvidence(
            f"{len(frequencies)} frequencies from {found[0]:g} to {found[1]:g} Hz;"
            f" {band.steps + 1} from {expected[0]:g} to {expected[1]:g} Hz were asked for"
        )


def _variance(spectrum: Plot) -> float:
    """Return the integral of a spectrum by Simpson's rule over the logarithm of f, V²."""
    from scipy.integrate import simpson

    frequencies, densities = np.array(spectrum.data.T)
    if not (np.isfinite(densities).all() and densities.min() >= 0.0):
        raise BadEvidence("a noise density is negative or not finite")
    return float(simpson(frequencies * densities**2, x=np.log(frequencies)))
