"""Measurements of waveforms, independent of any circuit."""
