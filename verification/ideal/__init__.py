"""What an ideal network does: its answer, its energy, the choice of lambda."""
