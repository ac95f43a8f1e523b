"""One channel of a board as a KiCad project: schematic, symbols and parts list."""
