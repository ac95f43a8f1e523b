"""Changes of a design that mend a failed check."""
