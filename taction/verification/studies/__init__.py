"""Studies that call the pipeline many times."""
