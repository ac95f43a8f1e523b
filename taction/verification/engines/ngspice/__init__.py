"""The third witness: from the text of a deck to waveforms, by ngspice."""
