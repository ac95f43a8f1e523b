"""Stability crossings as tables and plots."""
