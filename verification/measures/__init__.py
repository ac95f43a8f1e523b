"""From waveforms to numbers; nothing here knows a circuit."""
