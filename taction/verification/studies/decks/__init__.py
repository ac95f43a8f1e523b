"""Decks of another hand: read, linearised, measured, asked, compared with ngspice."""
