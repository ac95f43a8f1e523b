"""A channel of a board, or a whole board, as a KiCad project; the list of its wires."""
