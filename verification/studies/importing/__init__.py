"""Import of a vendor's op-amp: test benches in ngspice, figures, and a linear model."""
