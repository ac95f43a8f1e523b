"""Values of several boards in one: every array has the boards on its first axis."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Self

import numpy as np

from taction.system.array_types import Ints


class Batch:
    """Values of R boards: attributes that are arrays or batches have R rows, others are shared."""

    def take(self, rows: Ints) -> Self:
        """Return the values of some of the boards.

        Examples
        --------
        >>> batch = Batch()
        >>> batch.volts = np.array([1.0, 2.0, 3.0])
        >>> batch.take(np.array([0, 2])).volts.tolist()
        [1.0, 3.0]
        """
        found = copy(self)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(found, name, value[rows])
            elif isinstance(value, Batch):
                setattr(found, name, value.take(rows))
        return found

    @classmethod
    def join(cls, several: Sequence[Self]) -> Self:
        """Return the values of several batches together; what they share is that of the first."""
        found = copy(several[0])
        for name, value in vars(found).items():
            values = [vars(each)[name] for each in several]
            if isinstance(value, np.ndarray):
                setattr(found, name, np.concatenate(values))
            elif isinstance(value, Batch):
                setattr(found, name, type(value).join(values))
        return found
