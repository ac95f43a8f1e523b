"""Topologies: one module each says how a scene becomes a board, and what this board is."""
