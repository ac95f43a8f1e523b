"""From a scene to a circuit to a deck."""
