"""Planted faults, each caught by a verdict of a shipped scene."""
