"""Error against run time over engines, methods and tolerances."""
