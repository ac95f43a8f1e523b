"""Transients of a board: exact, and by implicit steps."""
