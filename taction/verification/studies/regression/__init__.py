"""Scenes against a stored baseline."""
