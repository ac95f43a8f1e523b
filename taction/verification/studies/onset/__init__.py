"""All stability crossings over a range, confirmed by transients."""
