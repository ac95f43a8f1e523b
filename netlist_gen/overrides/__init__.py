"""Keys of a scene by name, and axes of values for them."""
