"""The linearised board: poles, margins, time scales, measures on the exact solution."""
