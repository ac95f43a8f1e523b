"""Transients of a board: exact, by reduced order, by implicit steps."""
