"""One op-amp: its figures beside what its macromodel does, and a picture."""
