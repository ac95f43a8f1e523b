"""Reference solvers: they see only the problem."""
