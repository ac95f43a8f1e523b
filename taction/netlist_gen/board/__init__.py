"""The board as a circuit: synthesis, parts, preferred values, varied parts."""
