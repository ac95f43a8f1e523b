"""The sections of reports: from results to blocks."""
