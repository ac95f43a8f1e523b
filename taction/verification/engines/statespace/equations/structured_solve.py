"""Large boards: structured solves of ``(c M - K) x = r``, and a coarse board for estimates.

The coarse board has every k-th channel and sensor, more strongly coupled. It has the cells, the
loads and the low spatial modes of the whole board, so its poles lie near those of the whole board,
and its transient shows the modes that the strain step excites. It serves for estimates only, never
for a result.

In the solves only T connects the channels. The unknowns are the summing nodes (N + M of them, the
sinks of the two resistor matrices) and the inner unknowns. Without the summing nodes, the inner
unknowns form separate small cells, an op-amp and its inverter each, which are inverted all at once.
A dense system on the summing nodes alone remains (the Schur complement of the cells). A
factorisation costs four products with T and one dense LU of size 2N, instead of one of size 16 N.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np

from taction.system.array_types import Bools, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import (
    Coupling,
    Descriptor,
    Triplets,
)

CHANNELS = 14  # of the coarse board, and as many sensors


def coarsen(descriptor: Descriptor) -> Descriptor:
    """Keep about `CHANNELS` channels and as many sensors of a board, evenly spaced.

    The result has a subset of the names; a small board is returned unchanged.
    """
    from scipy import sparse

    unit = units(descriptor)
    kept = unit < 0
    gain, assigned = 1.0, np.zeros(max(int(unit.max(initial=0)) + 1, 1), dtype=np.bool_)
    for part in descriptor.couplings:
        new_units: Ints = np.unique(unit[part.sinks])
        new_units = new_units[~assigned[np.maximum(new_units, 0)] & (new_units >= 0)]
        if not len(new_units):
            continue
        assigned[new_units] = True
        count = min(CHANNELS, len(new_units))
        chosen = new_units[np.linspace(0.0, len(new_units) - 1.0, count).round().astype(np.int64)]
        kept = kept | np.isin(unit, chosen)
        gain = max(gain, len(new_units) / count)
    if kept.all():
        return descriptor
    basis = sparse.eye_array(descriptor.size, format="csr")[:, np.flatnonzero(kept)]
    return projected(descriptor, basis, tuple(compress(descriptor.names, kept)), gain)


def projected(
    descriptor: Descriptor, basis: Any, names: tuple[str, ...], gain: float = 1.0
) -> Descriptor:
    """Return the equations between the columns of a sparse basis, with couplings times `gain`.

    Amplifiers stay between unknowns that are columns of the basis.
    """
    back, size = basis.T.tocsr(), len(names)
    M, K = (
        np.asarray((back @ _sparse(each, descriptor.size) @ basis).toarray())
        for each in (descriptor.mass, descriptor.local)
    )
    for part in descriptor.couplings:
        sinks, drivers, G = basis[part.sinks], basis[part.drivers], gain * part.conductance
        K += sinks.T @ (G @ drivers.toarray())
        K += drivers.T @ ((G * part.loaded).T @ sinks.toarray())
    rows, columns = (index.ravel() for index in np.indices((size, size)))
    inside, devices = abs(basis).sum(axis=1) > 0.0, descriptor.devices
    devices = devices.part(inside[devices.input] & inside[devices.output])
    inputs, outputs = (basis[each].argmax(axis=1) for each in (devices.input, devices.output))
    return Descriptor(
        names=names,
        node_count=min(int(inside[: descriptor.node_count].sum()), size),
        mass=Triplets(rows, columns, M.ravel()),
        local=Triplets(rows, columns, K.ravel()),
        couplings=(),
        switched=back @ descriptor.switched,
        constant=back @ descriptor.constant,
        determined=np.asarray(abs(back) @ descriptor.determined > 0.0),
        devices=replace(devices, input=inputs, output=outputs),
        places={name: k for k, name in enumerate(names)},
    )


def units(descriptor: Descriptor) -> Ints:
    """Return the channel or sensor of each unknown; -1 for voltage sources.

    Two unknowns belong together if an element connects them that is neither a resistor matrix nor
    a constant voltage source; a source of a strain belongs to its sensor.
    """
    from scipy.sparse import coo_array, csgraph

    source = np.zeros(descriptor.size, dtype=np.bool_)
    single = np.bincount(descriptor.local.rows, minlength=descriptor.size) == 1
    source[single & descriptor.determined & (descriptor.switched == 0.0)] = True
    source[descriptor.devices.output] = False
    pairs = [(t.rows, t.columns) for t in (descriptor.local, descriptor.mass)]
    pairs.append((descriptor.devices.input, descriptor.devices.output))
    rows, columns = (np.concatenate(side) for side in zip(*pairs, strict=True))
    tied = ~source[rows] & ~source[columns]
    shape = (descriptor.size, descriptor.size)
    ties = coo_array((np.ones(tied.sum()), (rows[tied], columns[tied])), shape=shape)
    unit = csgraph.connected_components(ties, directed=False)[1]
    return np.where(source, -1, unit)


KEPT, COMPLEX = 3e8, 16  # bytes of all solvers that are kept, and of a number in them


# Cells of one size: places (cells, m) among the inner unknowns, and their blocks of M and K.
Group = tuple[Ints, Floats, Floats]
Solver = Callable[[Any], Any]  # ``r -> x``, of a vector, or of the columns of an array


class Structure:
    """The pencil ``c M - K`` of a board, ready to be factorised at any shift.

    `descriptor`: the equations.
    `slopes` (m,): slopes of the behavioural amplifiers at the point of linearisation; by default
      zero.
    """

    def __init__(self, descriptor: Descriptor, slopes: Floats | None = None) -> None:
        from scipy import sparse

        self.descriptor = descriptor
        size = descriptor.size
        self.mass = _sparse(descriptor.mass, size)
        self.local = _sparse(descriptor.local, size)
        devices = descriptor.devices
        if devices.count:
            slopes = np.zeros(devices.count) if slopes is None else slopes
            places = (devices.output, devices.input)
            self.local = self.local + sparse.csr_array((slopes, places), shape=(size, size))
        sinks = [part.sinks for part in descriptor.couplings]
        self.outer: Ints = np.unique(np.concatenate([*sinks, np.zeros(0, dtype=np.int64)]))
        self.inner: Ints = np.setdiff1d(np.arange(size), self.outer)
        self._solvers: dict[complex, Solver] = {}
        self._split()
        self.groups = self._cells()

    def _split(self) -> None:
        """Split M, K and the couplings into outer (summing) and inner unknowns."""
        o, i = self.outer, self.inner
        place = np.full(self.descriptor.size, -1)
        place[o], place[i] = np.arange(len(o)), np.arange(len(i))
        self.parts = {
            name: (self.mass[rows][:, columns], self.local[rows][:, columns])
            for name, rows, columns in (("oo", o, o), ("oi", o, i), ("io", i, o), ("ii", i, i))
        }
        self.couplings: list[tuple[Ints, Ints, Floats, Floats]] = []
        for part in self.descriptor.couplings:
            if len(np.unique(part.drivers)) < len(part.drivers):
                raise EngineError("a node drives a resistor matrix twice")
            summing = np.isin(part.drivers, o)
            self._among(part, summing, place)
            drivers, G = part.drivers[~summing], part.conductance[:, ~summing]
            if drivers.size:
                load = G * part.loaded[~summing]
                self.couplings.append((place[part.sinks], place[drivers], G, load))

    def _among(self, part: Coupling, chosen: Bools, place: Ints) -> None:
        """Add the conductances from `chosen` drivers, which are summing nodes, to K there."""
        from scipy import sparse

        if not chosen.any():
            return
        sinks, drivers = place[part.sinks], place[part.drivers[chosen]]
        mass, K = self.parts["oo"]
        more, G = np.zeros(K.shape), part.conductance[:, chosen]
        more[np.ix_(sinks, drivers)] += G
        more[np.ix_(drivers, sinks)] += (G * part.loaded[chosen]).T
        self.parts["oo"] = mass, K + sparse.csr_array(more)

    def _cells(self) -> list[Group]:
        from scipy.sparse import csgraph

        M, K = self.parts["ii"]
        count, label = csgraph.connected_components(abs(M) + abs(K), directed=False)
        sizes = np.bincount(label, minlength=count)
        order = np.argsort(label, kind="stable")
        starts = np.concatenate([[0], np.cumsum(sizes)])
        groups = []
        for size in np.unique(sizes):
            chosen = np.flatnonzero(sizes == size)
            places = order[starts[chosen][:, None] + np.arange(size)]
            groups.append((places, _blocks(M, places), _blocks(K, places)))
        return groups

    @cached_property
    def transposed(self) -> Structure:
        """The pencil of the transposed matrices, for adjoint solves and left eigenvectors."""
        other = copy(self)
        other.mass, other.local = self.mass.T.tocsr(), self.local.T.tocsr()
        other.parts = {name[::-1]: (M.T, K.T) for name, (M, K) in self.parts.items()}
        other.couplings = [(sinks, at, load, G) for sinks, at, G, load in self.couplings]
        other.groups = [
            (places, M.transpose(0, 2, 1), K.transpose(0, 2, 1)) for places, M, K in self.groups
        ]
        other._solvers = {}
        return other

    def solver(self, shift: complex) -> Solver:
        """Return ``r -> x`` at a shift; a second transient of the board finds it ready.

        Solvers are kept up to `KEPT` bytes together: they are dense on the summing nodes.
        """
        if shift in self._solvers:
            return self._solvers[shift]
        solve = self.factor(shift)
        if (len(self._solvers) + 1) * len(self.outer) ** 2 * COMPLEX <= KEPT:
            self._solvers[shift] = solve
        return solve

    def factor(self, shift: complex) -> Solver:
        """Factorise ``shift M - K``, and return the solver.

        EngineError: the shift is an eigenvalue to working precision.
        """
        real = complex(shift).imag == 0.0
        c = complex(shift).real if real else complex(shift)
        Z = self._inner_inverse(c)
        oo, oi, io = (c * M - K for M, K in map(self.parts.__getitem__, ("oo", "oi", "io")))
        oi, io = oi.tocsr(), io.tocsc()
        schur = (oo - oi @ Z @ io).toarray()
        right, left = (Z @ io).tocsr(), (oi @ Z).tocsc()
        for sinks, drivers, G, _ in self.couplings:
            schur[sinks] += (right[drivers].T @ G.T).T
        for sinks, drivers, _, load in self.couplings:
            schur[:, sinks] += left[:, drivers] @ load.T
        for sinks, drivers, G, _ in self.couplings:
            for sinks2, drivers2, _, load in self.couplings:
                between = Z[drivers][:, drivers2]
                if between.nnz:
                    schur[np.ix_(sinks, sinks2)] -= _real_times(G, between @ load.T)
        return self._solver(Z, schur, oi, io)

    def _inner_inverse(self, c: Any) -> Any:
        """Return the inverse of the cells at shift c, as a sparse matrix."""
        from scipy import sparse

        rows, columns, values = [], [], []
        for places, M, K in self.groups:
            m = places.shape[1]
            rows.append(np.repeat(places, m, axis=1).ravel())
            columns.append(np.tile(places, (1, m)).ravel())
            values.append(np.linalg.inv(c * M - K).ravel())
        n = len(self.inner)
        if not rows:
            return sparse.csr_array((n, n))
        where = (np.concatenate(rows), np.concatenate(columns))
        return sparse.csr_array((np.concatenate(values), where), shape=(n, n))

    def _solver(self, Z: Any, schur: Any, oi: Any, io: Any) -> Solver:
        from scipy.linalg import get_lapack_funcs

        o, i, couplings = self.outer, self.inner, self.couplings
        if not o.size:  # a circuit without resistor matrices
            return lambda r: Z @ r
        scale = np.abs(schur).max(axis=1, initial=0.0)
        scaled = np.asfortranarray(schur / scale[:, None])
        routines: Any = get_lapack_funcs(("getrf", "getrs"), (scaled,))
        getrf, getrs = routines
        lu, pivots, singular = getrf(scaled, overwrite_a=True)
        if singular:
            raise EngineError("the shift is an eigenvalue of the board")

        def triangular(b: Any) -> Any:
            if np.iscomplexobj(b) and not np.iscomplexobj(lu):  # SciPy drops imag(b)
                return getrs(lu, pivots, b.real)[0] + 1j * getrs(lu, pivots, b.imag)[0]
            return getrs(lu, pivots, b)[0]

        def solve(r: Any) -> Any:
            y = Z @ r[i]
            right = r[o] - oi @ y
            for sinks, drivers, G, _ in couplings:
                right[sinks] += _real_times(G, y[drivers])
            x_o = triangular((right.T / scale).T)
            back = io @ x_o
            for sinks, drivers, _, load in couplings:
                back[drivers] -= _real_times(load.T, x_o[sinks])
            x = np.empty(r.shape, dtype=x_o.dtype)
            x[o] = x_o
            x[i] = y - Z @ back
            return x

        return solve


def _real_times(real: Floats, x: Any) -> Any:
    """Multiply a real matrix by a complex array without a complex copy of the matrix."""
    if not np.iscomplexobj(x):
        return real @ x
    if not x.flags.c_contiguous:
        return real @ x.real + 1j * (real @ x.imag)
    flat = x.view(np.float64).reshape(len(x), -1)
    return np.ascontiguousarray(real @ flat).view(np.complex128).reshape(-1, *x.shape[1:])


def _sparse(triplets: Any, size: int) -> Any:
    from scipy import sparse

    where = (triplets.rows, triplets.columns)
    return sparse.csr_array((triplets.values, where), shape=(size, size))


def _blocks(matrix: Any, places: Ints) -> Floats:
    """Return the diagonal blocks of a sparse matrix at `places` (cells, m): (cells, m, m)."""
    cells, m = places.shape
    coo = matrix.tocoo()
    cell = np.full(matrix.shape[0], -1)
    position = np.zeros(matrix.shape[0], dtype=np.int64)
    cell[places], position[places] = np.arange(cells)[:, None], np.arange(m)
    kept = cell[coo.row] >= 0
    blocks = np.zeros((cells, m, m))
    rows, columns = coo.row[kept], coo.col[kept]
    np.add.at(blocks, (cell[rows], position[rows], position[columns]), coo.data[kept])
    return blocks


Response = tuple[Callable[[Floats], Floats], Floats]
LOOSE = 1e17  # largest element of an inverse (rows scaled) that counts as regular


def dense_response(descriptor: Descriptor) -> Response:
    """Prepare the dense solution: ``r -> z``, and z (size, m) for a unit output of each amplifier.

    EngineError: K is singular: a node has no DC path, or a loop has no DC solution.
    """
    K = descriptor.dense.stiffness
    scale = np.abs(K).max(axis=1, initial=0.0)
    try:
        inverse = np.linalg.inv(K / scale[:, None]) if scale.all() else np.full_like(K, np.inf)
    except np.linalg.LinAlgError:
        inverse = np.full_like(K, np.inf)
    if not np.abs(inverse).max(initial=0.0) < LOOSE:
        raise _undetermined(K, descriptor.names)
    return _refined(descriptor, lambda r: inverse @ (r.T / scale).T, lambda z: K @ z)


def structured_response(structure: Structure) -> Response:
    """Prepare the same by structured solves."""
    solve, times = structure.factor(0.0), structure.descriptor.stiffness_times

    def product(z: Floats) -> Floats:
        return times(z) if z.ndim == 1 else np.stack([times(each) for each in z.T], axis=1)

    return _refined(structure.descriptor, lambda r: np.asarray(-solve(r)), product)


def _refined(
    descriptor: Descriptor, unrefined: Callable[[Floats], Floats], K: Callable[[Floats], Floats]
) -> Response:
    """Return solutions with one refinement."""

    def solve(r: Floats) -> Floats:
        z = unrefined(r)
        return z + unrefined(r - K(z))

    # -v_out + a = 0 in a device's row: a unit output is a right-hand side of -1.
    unit = np.zeros((descriptor.size, descriptor.devices.count))
    unit[descriptor.devices.output, np.arange(descriptor.devices.count)] = -1.0
    return solve, solve(unit) if unit.size else unit


def _undetermined(K: Floats, names: tuple[str, ...]) -> EngineError:
    """Name a node that the DC equations do not determine."""
    scale = np.abs(K).max(axis=1)
    isolated = np.flatnonzero(scale == 0.0)
    if isolated.size:
        return EngineError(f"node {names[isolated[0]]!r} has no DC path to any other node")
    null_vector = np.linalg.svd(K / scale[:, None])[2][-1]
    worst = names[int(np.argmax(np.abs(null_vector)))]
    message = f"the DC equations do not determine node {worst!r} (no DC path, or no feedback)"
    return EngineError(message)
