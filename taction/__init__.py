"""The public names of taction."""
