"""Samples in the database of studies, kept as they come: a run that is killed goes on from there.

A sample is found again only by the same board, checks, seed, taction and ngspice, so samples of
several studies may stand in one file, beside the points of sweeps, and are never mixed.
"""

from __future__ import annotations

from dataclasses import asdict

from pydantic import TypeAdapter, ValidationError

from spice_models.errors import Complaint, InputError
from verification.studies.running.digests import digest
from verification.studies.sweep.store import Row, Store
from verification.studies.tolerance.varied_board import Sample, VariedBoard

SAMPLE = TypeAdapter(Sample)


class SampleStore:
    """The samples of one board and seed in a store."""

    def __init__(self, store: Store, study: VariedBoard, seed: int) -> None:
        problem = (study.problem.matrix, study.problem.strain)
        self._store = store
        self._base = digest(study.versions, study.scene, *problem, study.nominal, seed)

    def get(self, number: int) -> Sample | None:
        """Return a sample, if it is stored.

        Raises
        ------
        InputError
            The database cannot be used, or holds something else in its place.
        """
        row = self._store.row(self._key(number))
        if row is None:
            return None
        try:
            return SAMPLE.validate_python(row.record)
        except ValidationError:
            text = f"sample {number} is damaged; start anew with another name"
            raise InputError(self._store.path, Complaint("database", "", text)) from None

    def put(self, sample: Sample) -> None:
        """Keep a sample at once.

        Raises
        ------
        InputError, OutOfDisk
            As `verification.studies.sweep.store.Store.put`.
        """
        key = self._key(sample.number)
        self._store.put(Row(key, sample.outcome, asdict(sample)), key)

    def _key(self, number: int) -> bytes:
        return digest(self._base, number)
