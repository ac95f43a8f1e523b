"""The linearised board: poles, margins, time scales, measurements on the exact solution."""
