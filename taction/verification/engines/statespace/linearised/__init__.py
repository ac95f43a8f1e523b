"""The linearisation of a board at its equilibrium: state space, modes, poles."""
