"""The difference of two verdicts: keys of the scenes, then readings."""
