"""What an op-amp's macromodel does, measured on test benches by both engines."""
