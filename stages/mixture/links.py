"""The sampler of PC-GMM: a distance-dependent Chinese restaurant over links, ref. [32].

Every point links to one point, itself included; points that links connect share a table. One sweep draws every link
anew from its conditional distribution

    p(link_i = j) ~ (alpha if j = i, else s_ij) x p(points of both tables together) / p(apart), if it joins two tables

with the tables' means and covariances integrated out (`conjugate.py`). Compiled, nothing is allocated in a sweep, and
all randomness is handed in. Not here: the state that is sampled (`seating.py`), what the similarity s_ij is, or what
becomes of the tables (`pcgmm.py`).
"""

from __future__ import annotations

import math

import numpy as np

from stages.compiled import compiled, inlined
from stages.mixture.conjugate import log_marginal
from stages.mixture.seating import (
    Indices,
    Prior,
    Scratch,
    Seating,
    assess,
    attach,
    detach,
    hanging_on,
    join,
    move_to_a_free_table,
    recount,
)
from stages.trajectory import Array


@compiled
def draw_link(i: int, u_table: float, u_point: float, state: Seating, fixed: Prior, buffers: Scratch) -> None:
    """Draw the link of point i anew from its conditional distribution, with two uniform numbers in [0, 1).

    The table is drawn first, by its weight, then a point of it, by similarity. Will be modified: `state`, `buffers`.
    """
    detach(i, state)
    size = _set_apart(i, state, fixed, buffers)
    own = state.table[i]
    _sum_similarity(i, state, fixed, buffers.mass)
    buffers.mass[own] += fixed.alpha
    _weigh_tables(own, state, fixed, buffers)
    chosen = _choose_table(own, u_table, state, buffers.chance)
    partner = _choose_point(i, chosen, u_point * buffers.mass[chosen], state, fixed)
    attach(i, partner, state)
    if chosen != own:
        join(own, chosen, buffers.members[:size], state)
        state.marginal[chosen] = buffers.joined[chosen]


@inlined
def _set_apart(i: int, state: Seating, fixed: Prior, buffers: Scratch) -> int:
    """Give point i, which links nowhere, and what hangs on it a table without anyone else; return how many they are."""
    size = hanging_on(i, state, buffers.members)
    rest = state.table[i]
    if size < state.tables[rest, 0]:
        own = move_to_a_free_table(buffers.members[:size], state, fixed)
        assess(own, state, fixed, buffers)
        assess(rest, state, fixed, buffers)
    return size


@inlined
def _sum_similarity(i: int, state: Seating, fixed: Prior, mass: Array) -> None:
    """Sum the similarity of point i to the points of each table, `mass`, shape (N,): will be modified."""
    table, similarity = state.table, fixed.similarity
    for slot in range(state.used[0]):
        mass[state.active[slot]] = 0.0
    # Neighbours in time mostly share a table: its sum is written only where the table changes.
    current, total = table[0], 0.0
    for j in range(table.shape[0]):
        if table[j] != current:
            mass[current] = total
            current = table[j]
            total = mass[current]
        total += similarity[i, j]
    mass[current] = total


@inlined
def _weigh_tables(own: int, state: Seating, fixed: Prior, buffers: Scratch) -> None:
    """Weigh the links into each table in `chance`, the largest weight 1. Will be modified: `buffers`.

    Table `own` stands for the links that join nothing: to the point itself and to what hangs on it.
    """
    tables, marginal, active, used = state.tables, state.marginal, state.active, state.used[0]
    mass, chance, joined, total = buffers.mass, buffers.chance, buffers.joined, buffers.sum
    largest = -np.inf
    for slot in range(used):
        other = active[slot]
        chance[other] = math.log(mass[other]) if mass[other] > 0.0 else -np.inf
        if other != own and mass[other] > 0.0:
            for a in range(total.shape[0]):
                total[a] = tables[own, a] + tables[other, a]
            joined[other] = log_marginal(total, fixed.kappa, fixed.scatter, fixed.constants, buffers.matrix)
            chance[other] += joined[other] - marginal[other] - marginal[own]
        largest = max(largest, chance[other])
    for slot in range(used):
        chance[active[slot]] = math.exp(chance[active[slot]] - largest)


@inlined
def _choose_table(own: int, u: float, state: Seating, chance: Array) -> int:
    """Return a table in use, drawn by its `chance`, shape (N,), with `u` in [0, 1). Nothing but rounding needs `own`.

    Rounding cannot choose what has no weight.
    """
    active, used = state.active, state.used[0]
    target = 0.0
    for slot in range(used):
        target += chance[active[slot]]
    target *= u
    chosen = own
    for slot in range(used):
        if chance[active[slot]] > 0.0:
            chosen = active[slot]
            target -= chance[chosen]
            if target < 0.0:
                break
    return chosen


@inlined
def _choose_point(i: int, chosen: int, target: float, state: Seating, fixed: Prior) -> int:
    """Return the point of table `chosen` at which the summed weights of point i's links to it exceed `target`.

    In its own table point i comes first, with weight alpha. Rounding cannot choose what has no weight.
    """
    table, similarity = state.table, fixed.similarity
    partner = i
    if chosen == table[i]:
        target -= fixed.alpha
        if target < 0.0:
            return partner
    for j in range(table.shape[0]):
        if table[j] == chosen and similarity[i, j] > 0.0:
            partner = j
            target -= similarity[i, j]
            if target < 0.0:
                break
    return partner


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
