"""The ideal network of topology ``pinv``: the least squares solution of ``T u = eps``.

The linear solver has it at lambda = 0: u and the residual together, with its certificate.
"""

from __future__ import annotations

from taction.verification.reference.dynamics import AtOnce
from taction.verification.reference.solve import solve

NETWORK = AtOnce(solve)
