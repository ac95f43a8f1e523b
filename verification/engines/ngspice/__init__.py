"""The third witness: a deck's text to waveforms, by ngspice."""
