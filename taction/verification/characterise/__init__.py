"""What is measured on benches: op-amps, by both engines, and whatever is not linear in a deck."""
