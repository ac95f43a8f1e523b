"""A circuit as descriptor equations, and how they are solved."""
