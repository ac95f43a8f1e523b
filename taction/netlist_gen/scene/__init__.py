"""What is asked for: the scene file as frozen, checked values."""
