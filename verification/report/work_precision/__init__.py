"""Error against run time as tables and a plot."""
