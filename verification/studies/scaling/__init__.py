"""Proposals for the scalings of a design."""
