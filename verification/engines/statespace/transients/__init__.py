"""Transients of a board: exact, by a reduced order, and by implicit steps."""
