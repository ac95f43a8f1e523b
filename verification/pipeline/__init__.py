"""The stations of `verification.verify.verify`, in the order of the data."""
