"""What belongs to no domain: errors, quantities, files that are whole or not there, processes."""
