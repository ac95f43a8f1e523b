"""What topologies share: their base, the table of them, boards of two planes, antilog stages."""
