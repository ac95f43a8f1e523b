"""Kill studies at random instants, and compare what they store with undisturbed runs."""
