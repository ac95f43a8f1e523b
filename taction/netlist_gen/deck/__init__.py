"""The circuit as an ngspice deck, checked before it is sent."""
