"""Topologies: one file each says how a scene becomes a board, and what this board is."""
