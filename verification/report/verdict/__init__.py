"""A verdict as table, JSON, plot and waveform files."""
