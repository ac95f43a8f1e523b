"""Grids of verifications, stored and resumable."""
