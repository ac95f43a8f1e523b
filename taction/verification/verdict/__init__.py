"""The stages of `taction.verification.verdict.verify.verify`, in the order of the data."""
