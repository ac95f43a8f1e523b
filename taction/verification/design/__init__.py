"""The search for a better board: candidates, their evaluation, and a ranking."""
