"""The stages of `verification.verify.verify`, in the order of the data."""
