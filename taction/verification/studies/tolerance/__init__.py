"""Yield and worst cases under component tolerances."""
