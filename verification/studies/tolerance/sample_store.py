"""Samples in the database of studies: a study that was killed continues with the next sample.

The key of a sample is a digest of board, checks, seed and versions, so samples of several studies
and the points of sweeps share a file without being mixed.
"""

from __future__ import annotations

from dataclasses import asdict

from pydantic import TypeAdapter, ValidationError

from taction.system.errors import Complaint, InputError
from taction.verification.studies.running.digests import digest
from taction.verification.studies.sweep.store import Store, StoredResult
from taction.verification.studies.tolerance.varied_board import BoardSample, VariedBoard

SAMPLE = TypeAdapter(BoardSample)


class SampleStore:
    """The samples of one board and seed in a store."""

    def __init__(self, store: Store, board: VariedBoard, seed: int) -> None:
        problem = (board.problem.matrix, board.problem.strain)
        self._store = store
        self._base = digest(board.versions, board.scene, *problem, board.nominal, seed)

    def get(self, number: int) -> BoardSample | None:
        """Return a sample, if it is stored and not damaged.

        Raises
        ------
        InputError
            The database cannot be used, or the stored record is no sample.
        """
        record = self._store.record_of(self._key(number))
        try:
            return None if record is None else SAMPLE.validate_python(record)
        except ValidationError:
            text = f"sample {number} is damaged; start anew with another name"
            raise InputError(self._store.path, Complaint("database", "", text)) from None

    def is_damaged(self, number: int) -> bool:
        """Whether `get` found a sample that is damaged."""
        return self._key(number) in self._store.damaged

    def put(self, sample: BoardSample) -> None:
        """Store a sample; errors as `taction.verification.studies.sweep.store.Store.put`."""
        key = self._key(sample.number)
        self._store.put(key, StoredResult(sample.outcome, asdict(sample)), key)

    def _key(self, number: int) -> bytes:
        return digest(self._base, number)
