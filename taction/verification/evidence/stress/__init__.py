"""Stiff and extreme scenes with their right outcomes and true readings."""
