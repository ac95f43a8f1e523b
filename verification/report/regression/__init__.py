"""A regression as text, Markdown and JUnit XML."""
