"""The descriptor equations of a circuit, and their DC and structured solutions."""
