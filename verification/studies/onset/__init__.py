"""Every stability crossing over a range, confirmed by transients."""
