"""The sampler of PC-GMM: a distance-dependent Chinese restaurant over links, ref. [32].

Every point links to one point, itself included; points that links connect share a table. One sweep draws every link
anew from its conditional distribution

    p(link_i = j) ~ (alpha if j = i, else s_ij) x p(points of both tables together) / p(apart), if it joins two tables

with the tables' means and covariances integrated out (`conjugate.py`). Compiled, nothing is allocated in a sweep, and
all randomness is handed in. Not here: what the similarity s_ij is, or what becomes of the tables (`pcgmm.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stages.compiled import compiled
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

    `points`: shape (N, d), centred. `similarity`: s_ij, shape (N, N); the diagonal is not read. `alpha`: weight of a
    link to itself. `kappa`: kappa_0, in points. `scatter`: Lambda_0, shape (d, d).
    """
    similarity = np.array(similarity, dtype=np.float64)
    np.fill_diagonal(similarity, 0.0)
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
    _link_up(state.link, state.first, state.after, state.before)
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
def _link_up(link: Indices, first: Indices, after: Indices, before: Indices) -> None:
    for i in range(link.shape[0]):
        _attach(i, link[i], link, first, after, before)


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
        state.marginal[active[slot]] = log_marginal(
            tables[active[slot]], fixed.kappa, fixed.scatter, fixed.constants, buffers.matrix
        )


@compiled
def _attach(i: int, j: int, link: Indices, first: Indices, after: Indices, before: Indices) -> None:
    """Let point i link to point j."""
    link[i] = j
    before[i] = -1
    after[i] = first[j]
    if first[j] >= 0:
        before[first[j]] = i
    first[j] = i


@compiled
def _detach(i: int, link: Indices, first: Indices, after: Indices, before: Indices) -> None:
    """Take away the link of point i."""
    if before[i] >= 0:
        after[before[i]] = after[i]
    else:
        first[link[i]] = after[i]
    if after[i] >= 0:
        before[after[i]] = before[i]
    link[i] = -1


@compiled
def _hanging_on(i: int, first: Indices, after: Indices, members: Indices) -> int:
    """List the points that reach i by links, i included, in `members`; return how many they are.

    Without its own link, i is the root of a tree: what reaches it is all that is connected to it.
    """
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


@compiled
def draw_link(i: int, u_table: float, u_point: float, state: Seating, fixed: Prior, buffers: Scratch) -> None:
    """Draw the link of point i anew from its conditional distribution, with two uniform numbers in [0, 1).

    Will be modified: `state`, `buffers`.
    """
    link, first, after, before, table, tables, marginal, active, place, used = state
    points, similarity, alpha, kappa, scatter, constants, _ = fixed
    members, mass, chance, joined, total, matrix = buffers
    n, m = points.shape

    # 1. Without its link, i and what hangs on it may fall off their table: then they get one of their own.
    _detach(i, link, first, after, before)
    size = _hanging_on(i, first, after, members)
    own = table[i]
    if size < tables[own, 0]:
        rest = own
        own = active[used[0]]
        used[0] += 1
        for a in range(m):
            tables[own, a] = 0.0
        for member in members[:size]:
            table[member] = own
            for a in range(m):
                tables[own, a] += points[member, a]
        for a in range(m):
            tables[rest, a] -= tables[own, a]
        marginal[own] = log_marginal(tables[own], kappa, scatter, constants, matrix)
        marginal[rest] = log_marginal(tables[rest], kappa, scatter, constants, matrix)

    # 2. Log weight of every table. Its own stands for the links that join nothing: to itself and to what hangs on it.
    for slot in range(used[0]):
        mass[active[slot]] = 0.0
    for j in range(n):
        mass[table[j]] += similarity[i, j]
    mass[own] += alpha
    largest = -np.inf
    for slot in range(used[0]):
        other = active[slot]
        chance[other] = math.log(mass[other]) if mass[other] > 0.0 else -np.inf
        if other != own and mass[other] > 0.0:
            for a in range(m):
                total[a] = tables[own, a] + tables[other, a]
            joined[other] = log_marginal(total, kappa, scatter, constants, matrix)
            chance[other] += joined[other] - marginal[other] - marginal[own]
        largest = max(largest, chance[other])

    # 3. The table first, by weight, then a point of it, by similarity. Rounding cannot choose what has no weight.
    target = 0.0
    for slot in range(used[0]):
        chance[active[slot]] = math.exp(chance[active[slot]] - largest)
        target += chance[active[slot]]
    target *= u_table
    chosen = own
    for slot in range(used[0]):
        if chance[active[slot]] > 0.0:
            chosen = active[slot]
            target -= chance[chosen]
            if target < 0.0:
                break
    partner = i
    target = u_point * mass[chosen]
    if chosen == own:
        target -= alpha
    if chosen != own or target >= 0.0:
        for j in range(n):
            if table[j] == chosen and similarity[i, j] > 0.0:
                partner = j
                target -= similarity[i, j]
                if target < 0.0:
                    break
    _attach(i, partner, link, first, after, before)

    # 4. A link to another table moves all that hangs on i there, and frees its own.
    if chosen != own:
        for member in members[:size]:
            table[member] = chosen
        for a in range(m):
            tables[chosen, a] += tables[own, a]
        marginal[chosen] = joined[chosen]
        used[0] -= 1
        last = active[used[0]]
        active[place[own]] = last
        place[last] = place[own]
        active[used[0]] = own
        place[own] = used[0]


@compiled
def log_posterior(state: Seating, fixed: Prior) -> float:
    """Return the log of the links' prior times the tables' likelihood.

    A link to itself weighs alpha, here as in the sampler; the weights of each point's links are normalised to sum to 1.
    """
    result = -fixed.log_totals
    for i in range(state.link.shape[0]):
        j = state.link[i]
        result += math.log(fixed.alpha if j == i else fixed.similarity[i, j])
    for slot in range(state.used[0]):
        result += state.marginal[state.active[slot]]
    return result


@compiled
def sweeps(
    state: Seating,
    fixed: Prior,
    buffers: Scratch,
    orders: Indices,
    uniforms: Array,
    log_posteriors: Array,
    components: Indices,
    best: Indices,
) -> None:
    """Sweep over all points as often as `orders`, shape (sweeps, N), has rows, each a permutation of the points.

    `uniforms`: shape (sweeps, N, 2), in [0, 1). Will be modified: `state`, `buffers`; `log_posteriors` and
    `components`, shape (sweeps,); `best`, shape (N,): the tables of the sweep of highest posterior.
    """
    highest = -np.inf
    for sweep in range(orders.shape[0]):
        # Adding and taking away leaves rounding behind; a recount a sweep keeps it at that of one sweep.
        recount(state, fixed, buffers)
        for turn in range(orders.shape[1]):
            draw_link(orders[sweep, turn], uniforms[sweep, turn, 0], uniforms[sweep, turn, 1], state, fixed, buffers)
        log_posteriors[sweep] = log_posterior(state, fixed)
        components[sweep] = state.used[0]
        if log_posteriors[sweep] > highest:
            highest = log_posteriors[sweep]
            best[:] = state.table
