"""The verdicts of several files as a table, JSON, JUnit and annotations."""
