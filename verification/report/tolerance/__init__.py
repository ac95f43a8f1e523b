"""Yields and corners as tables."""
