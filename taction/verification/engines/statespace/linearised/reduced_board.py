"""Reduce a large board to a few patterns over its channels and over its sensors.

The cells stay as they are; only vectors over the channels (and over the sensors) become sums of a
few orthonormal patterns. All unknowns of one kind (the outputs of all integrators, say) share the
patterns of their side, so the result is again a board: its matrix is T between the patterns, and
its poles lie where those of a board with other singular values of T lie. (A projection without
this structure has growing modes that the board lacks.) The patterns are those of the transient
``(s M - K)^-1 M e`` at a few rates s, repeated: a rational Krylov space. With some 20 patterns of a
smooth kernel, or 40 of a random matrix, it holds the strain step to 1e-6.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.equations.coarse_board import units
from taction.verification.engines.statespace.equations.descriptor import (
    Descriptor,
    Devices,
    Triplets,
)
from taction.verification.engines.statespace.equations.mirror_symmetry import numbered_kinds
from taction.verification.engines.statespace.linearised.board import LinearBoard


@dataclass(frozen=True, slots=True, eq=False)
class ReducedBoard:
    """A board of patterns, and the way back.

    Attributes
    ----------
    board : LinearBoard
        The board of patterns.
    patterns : sparse array (size, reduced size)
        Unknowns of the large board for each unknown of the board of patterns; orthonormal.
    """

    board: LinearBoard
    patterns: Any

    @classmethod
    def of(cls, board: LinearBoard, vectors: Floats, least: float) -> ReducedBoard:
        """Reduce a linear board to the patterns in vectors of its unknowns, (size, k).

        Patterns below the share `least` of the largest are left out.
        """
        descriptor, patterns = board.descriptor, _patterns(board.descriptor, vectors, least)
        return cls(LinearBoard(board.circuit, _projected(descriptor, patterns)), patterns)


def _patterns(descriptor: Descriptor, vectors: Floats, least: float) -> Any:
    """Return the patterns of all sides, as a sparse matrix (size, reduced size)."""
    from scipy import sparse

    blocks, columns = list[tuple[Ints, Floats]](), 0
    for side in _sides(descriptor):
        shown = np.concatenate([_normalised(vectors[places]) for places in side], axis=1)
        U, sizes, _ = np.linalg.svd(shown, full_matrices=False)
        kept = U[:, sizes > least * sizes.max(initial=0.0)]
        blocks += [(places, kept) for places in side]
    rows, places, values = [], [], []
    for at, kept in blocks:
        rows.append(np.repeat(at, kept.shape[1]))
        places.append(np.tile(columns + np.arange(kept.shape[1]), len(at)))
        values.append(kept.ravel())
        columns += kept.shape[1]
    where = (np.concatenate(rows), np.concatenate(places))
    return sparse.csr_array((np.concatenate(values), where), shape=(descriptor.size, columns))


def _normalised(vectors: Floats) -> Floats:
    """Return the columns that are not zero, with the length 1."""
    lengths = np.linalg.norm(vectors, axis=0)
    return np.asarray(vectors[:, lengths > 0.0] / lengths[lengths > 0.0])


def _sides(descriptor: Descriptor) -> Iterator[list[Ints]]:
    """Yield the places of the kinds of unknowns, (units,) each, of which there is one in each unit.

    Kinds that belong to the same channels (or sensors) are one side.
    """
    unit, sides = units(descriptor), dict[tuple[bytes, bool], list[Ints]]()
    for kind in numbered_kinds(descriptor.names):
        for stated in (False, True):
            places = kind[descriptor.determined[kind] == stated]
            if len(places):
                sides.setdefault((unit[places].tobytes(), len(places) == 1), []).append(places)
    yield from sides.values()


def _projected(descriptor: Descriptor, patterns: Any) -> Descriptor:
    """Return the equations between patterns."""
    from scipy import sparse

    size, back = descriptor.size, patterns.T.tocsr()

    def between(triplets: Triplets) -> Floats:
        where = (triplets.rows, triplets.columns)
        matrix = sparse.csr_array((triplets.values, where), shape=(size, size))
        return np.asarray((back @ matrix @ patterns).toarray())

    M, K = between(descriptor.mass), between(descriptor.local)
    for part in descriptor.couplings:
        sinks, drivers = patterns[part.sinks], patterns[part.drivers]
        K += sinks.T @ (part.conductance @ drivers.toarray())
        K += drivers.T @ ((part.conductance * part.loaded).T @ sinks.toarray())
    reduced = patterns.shape[1]
    rows, columns = (index.ravel() for index in np.indices((reduced, reduced)))
    names = tuple(f"pattern{k + 1}" for k in range(reduced))
    nothing = np.zeros(0, dtype=np.int64)
    return Descriptor(
        names=names,
        node_count=reduced,
        mass=Triplets(rows, columns, M.ravel()),
        local=Triplets(rows, columns, K.ravel()),
        couplings=(),
        switched=back @ descriptor.switched,
        constant=back @ descriptor.constant,
        determined=np.asarray(abs(back) @ descriptor.determined > 0.0),
        devices=Devices((), nothing, nothing, np.zeros(0), np.zeros(0)),
        places={name: k for k, name in enumerate(names)},
        mirror=None,
    )
