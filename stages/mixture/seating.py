"""The state of PC-GMM's sampler, ref. [32]: which point every point links to, and which table it thereby sits at.

Points that links connect, in either direction, share a table. A table is known by the sum of its points' moments
(`conjugate.py`). Compiled parts allocate nothing. Not here: how a link is drawn (`links.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled, inlined
from stages.mixture.conjugate import count_constants, log_marginal, moments
from stages.trajectory import Array

Indices = NDArray[np.int64]


class Prior(NamedTuple):
    """What the sampler holds fixed, of N points in d coordinates.

    Attributes:
        moments: shape (N, m), of `conjugate.moments`.
        similarity: shape (N, N), s_ij, symmetric, with a diagonal of zeros.
        alpha: weight of a link to itself.
        kappa: kappa_0, in points.
        scatter: Lambda_0, shape (d, d).
        constants: of `conjugate.count_constants`, shape (N + 1,).
        log_totals: sum over the points of the log of all weights of a point's links, which normalises their prior.
    """

    moments: Array
    similarity: Array
    alpha: float
    kappa: float
    scatter: Array
    constants: Array
    log_totals: float


class Seating(NamedTuple):
    """The sampler's state; all arrays are modified in place. N points, at most N tables.

    Attributes:
        link: shape (N,), the point that each point links to; -1 while it is being drawn.
        first, after, before: shape (N,), the points that link to a point, as a linked list; -1 ends it.
        table: shape (N,), the table of each point.
        tables: shape (N, m), per table: the sum of its points' moments.
        marginal: shape (N,), log p(points of the table).
        active, place: shape (N,), the tables in use, then those that are free; where each table stands in `active`.
        used: shape (1,), how many tables are in use.
    """

    link: Indices
    first: Indices
    after: Indices
    before: Indices
    table: Indices
    tables: Array
    marginal: Array
    active: Indices
    place: Indices
    used: Indices


class Scratch(NamedTuple):
    """Buffers of one draw.

    Attributes:
        members: shape (N,), the points that hang on the one whose link is drawn.
        mass, chance, joined: shape (N,), per table: similarity to its points, log weight, log likelihood when joined.
        sum: shape (m,), moments of two tables together.
        matrix: shape (d, d), of `conjugate.log_marginal`.
    """

    members: Indices
    mass: Array
    chance: Array
    joined: Array
    sum: Array
    matrix: Array


def prior(points: Array, similarity: Array, alpha: float, kappa: float, scatter: Array) -> Prior:
    """Gather what the sampler holds fixed.

    `points`: shape (N, d), centred. `similarity`: s_ij, shape (N, N), with a diagonal of zeros. `alpha`: weight of a
    link to itself. `kappa`: kappa_0, in points. `scatter`: Lambda_0, shape (d, d).
    """
    return Prior(
        moments=moments(points),
        similarity=similarity,
        alpha=float(alpha),
        kappa=float(kappa),
        scatter=np.ascontiguousarray(scatter),
        constants=count_constants(len(points), kappa, scatter),
        log_totals=float(np.log(alpha + similarity.sum(axis=1)).sum()),
    )


def seat(fixed: Prior, link: Indices | None = None) -> Seating:
    """Return the state in which every point links as `link`, shape (N,), says; none: to itself."""
    n, m = fixed.moments.shape
    link = np.arange(n) if link is None else np.array(link, dtype=np.int64)
    table = _connected(link)
    state = Seating(
        link=link.copy(),
        first=np.full(n, -1),
        after=np.full(n, -1),
        before=np.full(n, -1),
        table=table,
        tables=np.zeros((n, m)),
        marginal=np.zeros(n),
        active=np.arange(n),
        place=np.arange(n),
        used=np.array([table.max() + 1]),
    )
    _attach_all(state)
    recount(state, fixed, scratch(fixed))
    return state


def scratch(fixed: Prior) -> Scratch:
    """Return the buffers that a draw needs."""
    n, m = fixed.moments.shape
    return Scratch(
        members=np.zeros(n, dtype=np.int64),
        mass=np.zeros(n),
        chance=np.zeros(n),
        joined=np.zeros(n),
        sum=np.zeros(m),
        matrix=np.zeros_like(fixed.scatter),
    )


def _connected(link: Indices) -> Indices:
    """Return the table of each point, numbered from 0 in the order of their first points."""
    table = np.arange(link.shape[0])
    while True:
        lowest = np.minimum(table, table[link])
        np.minimum.at(lowest, link, table)
        if (lowest == table).all():
            return np.asarray(np.unique(table, return_inverse=True)[1], dtype=np.int64)
        table = lowest


@compiled
def _attach_all(state: Seating) -> None:
    for i in range(state.link.shape[0]):
        attach(i, state.link[i], state)


@compiled
def recount(state: Seating, fixed: Prior, buffers: Scratch) -> None:
    """Recompute every table's moments and likelihood from its points. Will be modified: `state`, `buffers`."""
    table, tables, active = state.table, state.tables, state.active
    n, m = fixed.moments.shape
    for slot in range(state.used[0]):
        tables[active[slot]] = 0.0
    for i in range(n):
        for a in range(m):
            tables[table[i], a] += fixed.moments[i, a]
    for slot in range(state.used[0]):
        assess(active[slot], state, fixed, buffers)


@inlined
def assess(one: int, state: Seating, fixed: Prior, buffers: Scratch) -> None:
    """Recompute the likelihood of table `one` from its moments. Will be modified: `state`, `buffers`."""
    state.marginal[one] = log_marginal(state.tables[one], fixed.kappa, fixed.scatter, fixed.constants, buffers.matrix)


@inlined
def attach(i: int, j: int, state: Seating) -> None:
    """Let point i link to point j; tables stay as they are. Will be modified: `state`."""
    first, after, before = state.first, state.after, state.before
    state.link[i] = j
    before[i] = -1
    after[i] = first[j]
    if first[j] >= 0:
        before[first[j]] = i
    first[j] = i


@inlined
def detach(i: int, state: Seating) -> None:
    """Take away the link of point i; tables stay as they are. Will be modified: `state`."""
    link, after, before = state.link, state.after, state.before
    if before[i] >= 0:
        after[before[i]] = after[i]
    else:
        state.first[link[i]] = after[i]
    if after[i] >= 0:
        before[after[i]] = before[i]
    link[i] = -1


@inlined
def hanging_on(i: int, state: Seating, members: Indices) -> int:
    """List the points that reach i by links, i included, in `members`; return how many they are.

    Without its own link, i is the root of a tree: what reaches it is all that is connected to it.
    """
    first, after = state.first, state.after
    members[0] = i
    size = 1
    seen = 0
    while seen < size:
        child = first[members[seen]]
        while child >= 0:
            members[size] = child
            size += 1
            child = after[child]
        seen += 1
    return size


@inlined
def move_to_a_free_table(members: Indices, state: Seating, fixed: Prior) -> int:
    """Move `members`, all of one table and not all of it, to a table of their own; return that. Modifies `state`.

    The likelihoods of both tables are left as they were.
    """
    table, tables, used = state.table, state.tables, state.used
    rest = table[members[0]]
    own = int(state.active[used[0]])
    used[0] += 1
    m = tables.shape[1]
    for a in range(m):
        tables[own, a] = 0.0
    for member in members:
        table[member] = own
        for a in range(m):
            tables[own, a] += fixed.moments[member, a]
    for a in range(m):
        tables[rest, a] -= tables[own, a]
    return own


@inlined
def join(own: int, other: int, members: Indices, state: Seating) -> None:
    """Move `members`, all the points of table `own`, to table `other`, and free their own. Modifies `state`.

    The likelihood of `other` is left as it was.
    """
    active, place, used = state.active, state.place, state.used
    for member in members:
        state.table[member] = other
    for a in range(state.tables.shape[1]):
        state.tables[other, a] += state.tables[own, a]
    used[0] -= 1
    last = active[used[0]]
    active[place[own]] = last
    place[last] = place[own]
    active[used[0]] = own
    place[own] = used[0]
