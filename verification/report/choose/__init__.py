"""A choice of op-amp, C and gain as table, data and picture."""
