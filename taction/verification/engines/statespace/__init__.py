"""The second witness: a circuit to its equations, poles and transients."""
