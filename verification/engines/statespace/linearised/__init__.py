"""A board at its equilibrium: state space, modes, poles."""
