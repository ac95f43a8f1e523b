"""The ideal network of topology ``ridge``: the regularised solution of the other topologies."""

from __future__ import annotations

from taction.verification.reference.dynamics import AtOnce
from taction.verification.reference.solve import solve

NETWORK = AtOnce(solve, regularised=True)
