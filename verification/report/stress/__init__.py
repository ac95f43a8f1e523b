"""The stress cases as a table, as JSON, as JUnit XML and as a page."""
