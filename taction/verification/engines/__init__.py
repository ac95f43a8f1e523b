"""Engines that turn a circuit or a deck into waveforms."""
