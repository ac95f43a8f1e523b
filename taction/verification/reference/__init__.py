"""The first witness: it sees only the problem (T, eps, lam, regulariser)."""
