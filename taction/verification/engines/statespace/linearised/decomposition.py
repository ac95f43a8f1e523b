"""Find the modes of one matrix: eigenvectors, Schur vectors of joined modes, Newton's steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.verification.engines.statespace.linearised.block import Block, complex_form, diagonal
from taction.verification.engines.statespace.linearised.real_modes import (
    Joined,
    both,
    mode_groups,
    turns,
    unmodal,
)

STEPS = 6  # largest number of steps
ROUNDED = 4.0  # times the rounding of A: a smaller coupling is rounding
IDLE = 1e-5  # a smaller turn of a stalled step may be rounding
CONVERGED = 1e-6  # largest turn of a step: the next one would be its square
STALLED = 0.1  # of the last turn: a larger one is rounding
NARROW = 0.25  # of the decay rate: poles so close to their centre may be one block


def decompose_blocks(A: Floats, size: Floats) -> list[Block]:
    """Decompose each of a stack A, (B, n, n); the rounding of its elements is relative to `size`.

    The eigensolver's error is ``eps |A|``, which the fastest mode determines. `_refine` reduces it
    to the rounding of each mode by itself, which is smaller by orders of magnitude for slow modes.
    A matrix has the same digits beside others as alone.

    Parameters
    ----------
    A : ndarray (B, n, n)
        Matrices, 1/s.
    size : ndarray (B, 2, n, n)
        See `Block`.

    Raises
    ------
    LinAlgError
        A matrix is not finite.
    """
    poles, vectors = np.linalg.eig(A)
    columns, found = list(map(_real_columns, poles, vectors)), dict[int, Block]()
    for real in sorted({number for _, _, number in columns}):
        places = np.array([k for k, (_, _, number) in enumerate(columns) if number == real])
        kept, right = (np.stack([columns[k][part] for k in places.tolist()]) for part in (0, 1))
        stack = _basis(kept, right, real, _some(size, places))
        well = _worst_condition(stack, np.ones(A.shape[-1])) < ILL
        for k, place in zip(np.flatnonzero(~well).tolist(), places[~well].tolist(), strict=True):
            block, scale = stack.taken(k), balance(A[place])
            if not _worst_condition(block, scale) < ILL:
                block = joined_basis(A[place], block, scale)
            (found[place],) = _refined(A[place, None], _stack_of_one(block))
        if well.any():
            blocks = _refined(_some(A, places[well]), stack.those(well))
            found.update(zip(places[well].tolist(), blocks, strict=True))
    return [found[place] for place in range(len(A))]


def _some(X: Floats, places: Ints) -> Floats:
    """Return some of a stack, without a copy if it is all."""
    return X if len(places) == len(X) else X[places]


def _stack_of_one(block: Block) -> Block:
    kept, right, left = block.kept[None], block.right[None], block.left[None]
    return Block(kept, block.real, right, left, block.coupled[None], block.size[None], block.joined)


def _refined(A: Floats, stack: Block, first: int = 0) -> list[Block]:
    """Take Newton's steps on a stack until each matrix has its modes; `first` were taken before."""
    found, places, before = dict[int, Block](), np.arange(len(A)), np.full(len(A), np.inf)
    staying = stack.is_refinable
    found.update((k, stack.taken(k)) for k in np.flatnonzero(~staying).tolist())
    for step in range(first, STEPS):
        if not staying.any():
            break
        if not staying.all():
            A, places, stack = A[staying], places[staying], stack.those(staying)
            before, staying = before[staying], staying[staying]
        refined, turned, wider = _refine(A, stack)
        refinable, stalled = refined.is_refinable, turned > STALLED * before
        rounded = (stalled | (step == STEPS - 1)) & (turned > IDLE)
        staying = ~(stalled | rounded | (turned < CONVERGED)) & refinable
        staying[list(wider)] = False
        for k in np.flatnonzero(~staying).tolist():
            following = refined.taken(k) if refinable[k] else stack.taken(k)
            if rounded[k]:
                one, _, joined = _refine(A[k, None], stack.taken(np.array([k])), rounded=True)
                following = _refinable(joined.get(0) or one.taken(0), stack, k)
            elif k in wider:
                following = _refinable(wider[k], stack, k)
                if following is wider[k]:
                    (following,) = _refined(A[k, None], _stack_of_one(following), step + 1)
            found[int(places[k])] = following
        stack, before = refined, turned
    last = zip(places.tolist(), staying.tolist(), strict=True)
    found.update((place, stack.taken(k)) for k, (place, stays) in enumerate(last) if stays)
    return [found[place] for place in range(len(found))]


def _refinable(block: Block, stack: Block, place: int) -> Block:
    """Return a block, or what it followed in a stack where no step can follow it."""
    return block if block.is_refinable else stack.taken(place)


def _basis(kept: Complexes, R: Floats, real: int, size: Floats) -> Block:
    """Return columns as a block; its rows are infinite where the columns are dependent."""
    # Row scaling makes the pivots independent of the states' amplitudes.
    scale = np.abs(R).max(axis=-1, initial=0.0)
    scale[scale == 0.0] = 1.0
    inverse = _inverse(R / scale[..., None])
    return Block(kept, real, R, inverse / scale[..., None, :], np.zeros(kept.shape), size)


def _real_columns(poles: Complexes, vectors: Complexes) -> tuple[Complexes, Floats, int]:
    """Return the kept poles, the real columns of their vectors, and the number of real poles."""
    real, first = np.flatnonzero(poles.imag == 0.0), np.flatnonzero(poles.imag > 0.0)
    kept = np.concatenate([poles[real], poles[first]]).astype(np.complex128)
    ringing = vectors[:, first]
    columns = np.concatenate([vectors[:, real].real, ringing.real, -ringing.imag], axis=1)
    return kept, columns, len(real)


def _inverse(X: Floats) -> Floats:
    """Return the inverse; infinite elements for a singular matrix."""
    try:
        inverse = np.asarray(np.linalg.inv(X), dtype=np.float64)
    except np.linalg.LinAlgError:
        if X.ndim > 2:
            return np.stack([_inverse(each) for each in X])
        return np.full_like(X, np.inf)
    finite = np.isfinite(inverse).all(axis=(-2, -1), keepdims=True)
    return np.where(finite, inverse, np.inf)


def _refine(
    A: Floats, block: Block, *, rounded: bool = False
) -> tuple[Block, Floats, dict[int, Block]]:
    """Take one Newton step on all modes of a stack at once; return how far it turns them, too.

    Modes too close for a step are joined, after which another step must follow (infinite turn): the
    matrices of such modes, by their places in the stack, are returned last. A coupling that is left
    is an error (`Block.coupled`): with `rounded` those that are only rounding, which the next step
    would turn back.
    """
    R, L, real, rest = block.right, block.left, block.real, block.rest
    count = block.kept.shape[-1]
    acting = complex_form(L @ (A @ R), block)
    left_over = complex_form(rest, block)
    acting += left_over * both(block.kept, real)[..., None, :]
    shift = count - real
    for each in block.joined:
        at = each.members
        acting[..., at] += left_over[..., at] @ each.inner
        if at[0] >= real:
            acting[..., at + shift] += left_over[..., at + shift] @ each.inner.conj()
    kept, reduced, joined = diagonal(acting).copy(), acting.copy(), []
    diagonal(reduced)[...] = 0.0
    for each in block.joined:
        centre, inner = _centred(acting[0][each.places])
        joined.append(Joined(each.members, inner))
        kept[..., each.members], reduced[0][each.places] = centre, 0.0
    turn, close = turns(reduced, kept, real, joined)
    if rounded:
        least = ROUNDED * block.rounding[..., :count, :]
        idle = (np.abs(turn) > IDLE) & (np.abs(reduced) <= least)
        turn[idle], close = 0.0, close | idle
    coupled = np.where(close, np.abs(reduced), 0.0)
    turning = unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + (np.eye(A.shape[-1]) - L @ R) @ L
    refined = Block(kept, real, R, L, coupled.sum(axis=-1), block.size, tuple(joined))
    # The next step would correct a pole by products of two couplings.
    second = np.abs((turn[..., :count] * reduced[..., :count].swapaxes(-1, -2)).sum(axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.sqrt(second / np.abs(kept))
    turned = np.fmax(np.abs(turn).max(axis=(-2, -1), initial=0.0), off.max(axis=-1, initial=0.0))
    wider: dict[int, Block] = {}
    for k in np.flatnonzero(coupled.any(axis=(-2, -1))).tolist():
        linked = coupled[k] > ROUNDED * block.taken(k).rounding[:count]
        own = refined.taken(k)
        if linked.any() and (joint := join(own, acting[k], linked)) is not own:
            wider[k], turned[k] = joint, np.inf
    return refined, turned, wider


def _centred(acting: Complexes) -> tuple[complex, Complexes]:
    """Split a small matrix into a multiple of the identity and the rest."""
    centre = complex(np.trace(acting)) / len(acting)
    return centre, acting - centre * np.eye(len(acting))


def is_narrow(centre: complex, inner: Complexes) -> bool:
    """Whether modes may be one block: their poles are close beside their decay."""
    return float(np.abs(np.linalg.eigvals(inner)).max(initial=0.0)) < NARROW * abs(centre.real)


@dataclass(frozen=True, eq=False)
class MatrixPart:
    """Some modes with their columns and rows; of pairs, the first ones, then the second ones."""

    kept: Complexes
    right: Floats
    left: Floats
    inner: Complexes | None = None


def join(block: Block, acting: Complexes, linked: Bools) -> Block:
    """Join linked modes, (k, n) by modes, whose matrix ``left A right`` is `acting`, (k, n).

    A pair that is linked with its own conjugate, or with a real mode, becomes two real columns.
    Modes that are not close to one another beside their decay are separated by an eigenproblem of
    their own.
    """
    real, count = block.real, len(block.kept)
    shift = count - real
    linked = linked.copy()
    for each in block.joined:
        linked[each.places] = True
    whole = unmodal(acting, real, count)
    reals: list[MatrixPart] = []
    pairs: list[MatrixPart] = []
    alone = np.ones(count, dtype=np.bool_)

    def add(at: Ints, found: Complexes, *, on_axis: bool) -> None:
        centre, inner = _centred(found)
        places = at if on_axis else np.concatenate([at, at + shift])
        part = MatrixPart(
            np.full(len(at), centre), block.right[:, places], block.left[places], inner
        )
        (reals if on_axis else pairs).append(part)
        alone[at[at < count]] = False

    changed = False
    for group in mode_groups(linked, real):
        upper = group[group >= real]
        full = np.concatenate([group, upper + shift])
        old = [each for each in block.joined if np.isin(each.members, group).any()]
        on_axis = len(upper) < len(group) or bool(linked[group][:, upper + shift].any())
        at = full if on_axis else group
        found = whole[np.ix_(at, at)] + 0j if on_axis else acting[np.ix_(at, at)]
        if is_narrow(*_centred(found)):
            changed |= not any(np.array_equal(each.members, group) for each in old)
            add(at, found, on_axis=on_axis)
        elif old:
            for each in old:
                add(each.members, acting[each.places], on_axis=bool(each.members[0] < real))
        else:
            kept, turned, number = _real_columns(*np.linalg.eig(whole[np.ix_(full, full)]))
            right, left = block.right[:, full] @ turned, _inverse(turned) @ block.left[full]
            reals.append(MatrixPart(kept[:number], right[:, :number], left[:number]))
            pairs.append(MatrixPart(kept[number:], right[:, number:], left[number:]))
            alone[group], changed = False, True
    if not changed:
        return block
    single = np.flatnonzero(alone)
    first, ringing = single[single < real], single[single >= real]
    both_places = np.concatenate([ringing, ringing + shift])
    reals.insert(0, MatrixPart(block.kept[first], block.right[:, first], block.left[first]))
    pairs.insert(
        0, MatrixPart(block.kept[ringing], block.right[:, both_places], block.left[both_places])
    )
    return assembled(reals, pairs, block.size)


def assembled(reals: list[MatrixPart], pairs: list[MatrixPart], size: Floats) -> Block:
    """Return the block of some parts."""
    firsts = [(part, slice(None, len(part.kept))) for part in pairs]
    seconds = [(part, slice(len(part.kept), None)) for part in pairs]
    ordered = [*((part, slice(None)) for part in reals), *firsts, *seconds]
    right = np.concatenate([part.right[:, some] for part, some in ordered], axis=1)
    left = np.concatenate([part.left[some] for part, some in ordered])
    kept = np.concatenate([part.kept for part in (*reals, *pairs)]).astype(np.complex128)
    joined, begin = [], 0
    for part in (*reals, *pairs):
        if part.inner is not None:
            joined.append(Joined(np.arange(begin, begin + len(part.kept)), part.inner))
        begin += len(part.kept)
    real = sum(len(part.kept) for part in reals)
    return Block(kept, real, right, left, np.zeros(len(kept)), size, tuple(joined))


ILL = 1e4  # condition number of a mode above which it is joined to its neighbours
BALANCING = 8  # sweeps
NEIGHBOUR = 10.0  # condition number of a mode that may be joined
REACHES = (0.03, 0.1, 0.3)  # distances of neighbours, over the size of the pole


def balance(A: Floats) -> Floats:
    """Return sizes of the states, (n,), in which rows and columns of A are about equally large."""
    scale, size = np.ones(len(A)), np.abs(A)
    np.fill_diagonal(size, 0.0)
    for _ in range(BALANCING):
        rows, columns = (size @ scale) / scale, scale * ((1.0 / scale) @ size)
        filled = (rows > 0.0) & (columns > 0.0)
        ratio = np.where(filled, rows, 1.0) / np.where(filled, columns, 1.0)
        scale *= ratio**0.25
    return np.asarray(np.exp2(np.round(np.log2(scale))))


def conditions(block: Block, scale: Floats) -> Floats:
    """Return the condition numbers of the modes, (k,), in states over their sizes."""
    real, count = block.real, block.kept.shape[-1]
    with np.errstate(invalid="ignore", over="ignore"):
        rows = ((block.left * scale) ** 2).sum(axis=-1)
        columns = ((block.right / scale[:, None]) ** 2).sum(axis=-2)
        for squares in (rows, columns):
            squares[..., real:count] += squares[..., count:]
        rows[..., real:count] *= 0.25
        return np.asarray(np.sqrt(rows[..., :count]) * np.sqrt(columns[..., :count]))


def _worst_condition(block: Block, scale: Floats) -> Floats:
    return np.asarray(conditions(block, scale).max(axis=-1, initial=0.0))


def joined_basis(A: Floats, block: Block, scale: Floats) -> Block:
    """Return a block with joined modes in place of ill-conditioned ones; or `block` itself.

    The basis of joined modes is orthonormal: Schur vectors of the matrix with balanced rows and
    columns, reordered.
    """
    import scipy.linalg

    eig: Any = scipy.linalg.eig
    balanced = A * scale / scale[:, None]
    poles, lefts, rights = eig(balanced, left=True, right=True)
    with np.errstate(divide="ignore", over="ignore"):
        kappa = 1.0 / np.abs((lefts.conj() * rights).sum(axis=0))
    rights *= scale[:, None]
    form: Any = scipy.linalg.schur(balanced, output="real")
    T, Z = form
    for reach in REACHES:
        near = reach * np.abs(poles)
        found = _joined_within(near, poles, kappa, rights, (T, scale[:, None] * Z), block.size)
        if found is None:
            continue
        found = replace(found, left=_inverse(found.right / scale[:, None]) / scale)
        if _worst_condition(found, scale) < ILL:
            return found
    return block


def _joined_within(
    reach: Floats,
    poles: Complexes,
    kappa: Floats,
    rights: Complexes,
    form: tuple[Floats, Floats],
    size: Floats,
) -> Block | None:
    """Join ill-conditioned modes to neighbours within `reach`; None where they are not narrow."""
    import scipy.linalg

    schur: Any = scipy.linalg.schur
    dtrsen: Any = scipy.linalg.lapack.dtrsen
    T, Z = form
    near = (np.abs(poles[:, None] - poles) < reach[:, None]) & (kappa > NEIGHBOUR)
    near &= (kappa > ILL)[:, None]
    near |= near.T
    conjugate = np.abs(poles[:, None] - poles.conj()).argmin(axis=1)
    near |= near[np.ix_(conjugate, conjugate)]
    label = np.zeros(len(poles), dtype=np.int64)
    groups = mode_groups(near, len(poles))
    for number, group in enumerate(groups, 1):
        label[group] = number
    owner = label[np.abs(_diagonal_poles(T)[:, None] - poles).argmin(axis=1)]
    kept, columns, real = _real_columns(poles[label == 0], rights[:, label == 0])
    rows = np.zeros(columns.shape[::-1])  # found at the end
    reals = [MatrixPart(kept[:real], columns[:, :real], rows[:real])]
    pairs = [MatrixPart(kept[real:], columns[:, real:], rows[real:])]
    for number, group in enumerate(groups, 1):
        if np.count_nonzero(owner == number) != len(group):
            return None
        mates = conjugate[group]
        on_axis = bool(np.isin(mates, group).all())
        if not on_axis and poles[group[0]].imag < 0.0:
            continue  # its conjugate is another group
        select = (owner == number) | np.isin(owner, label[mates])
        ordered, vectors, *_ = dtrsen(
            select.astype(np.int32), T, Z, job="N", lwork=max(len(T) ** 2, 1)
        )
        m = int(select.sum())
        acting, basis = ordered[:m, :m].astype(np.complex128), vectors[:, :m]
        if not on_axis:
            acting, U, m = schur(acting, output="complex", sort=lambda z: z.imag > 0.0)
            acting, basis = acting[:m, :m], basis @ U[:, :m]
            basis = np.concatenate([basis.real, -basis.imag], axis=1)
        centre, inner = _centred(acting)
        if m != len(group) or not is_narrow(centre, inner):
            return None
        part = MatrixPart(np.full(m, centre), basis, np.zeros(basis.shape[::-1]), inner)
        (reals if on_axis else pairs).append(part)
    return assembled(reals, pairs, size)


def _diagonal_poles(T: Floats) -> Complexes:
    """Return the eigenvalues of a real Schur form, in its order."""
    poles = T.diagonal().astype(np.complex128)
    lower = np.flatnonzero(T.diagonal(-1))
    ringing = 1j * np.sqrt(np.maximum(-T[lower, lower + 1] * T[lower + 1, lower], 0.0))
    poles[lower] += ringing
    poles[lower + 1] -= ringing
    return poles
