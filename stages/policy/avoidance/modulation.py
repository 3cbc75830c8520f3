"""Modulation of a dynamical system: Khansari-Zadeh and Billard, "A dynamical system approach to realtime obstacle
avoidance" (Autonomous Robots 32, 2012).

v = M (f - v_o) + v_o with M = E D E^-1: along the normal the velocity is scaled by 1 - w/G^(1/r), across it by
1 + w/G^(1/r). G = (|x - c|/R)^2 is 1 on the sphere of radius R and r the reactivity; for several obstacles, w_i =
prod_{j != i} (G_j - 1)/((G_i - 1) + (G_j - 1)) and the matrices are multiplied (their section 5). The velocities of
moving obstacles are weighted alike. A shape that is no sphere is taken as its bounding sphere.
"""

from __future__ import annotations

from stages.compiled import lean
from stages.policy.avoidance.scratch import ACTIVE, CLEAR, NORMAL, SIDE, VELOCITY, WEIGHT, Avoidance, Scratch
from stages.policy.avoidance.shapes import REACH, Shapes
from stages.policy.avoidance.survey import norm
from stages.trajectory import Array


@lean
def modulate(avoidance: Avoidance, shapes: Shapes, x: Array, x_next: Array, dt: float, room: Scratch) -> int:
    """Bend the step from x to `x_next`, shape (d,), metres, around every obstacle."""
    d, m = x.shape[0], shapes.kinds.shape[0]
    normals, levels, weights = room.tables[NORMAL], room.columns[CLEAR], room.columns[WEIGHT]
    velocity, carried = room.vectors[VELOCITY], room.vectors[SIDE]
    for i in range(m):
        squared = 0.0
        for j in range(d):
            normals[i, j] = x[j] - shapes.centres[i, j]
            squared += normals[i, j] ** 2
        length = norm(normals[i])
        for j in range(d):
            normals[i, j] /= length
        levels[i] = squared / (shapes.measures[i, REACH] + avoidance.margin) ** 2
    for j in range(d):
        velocity[j] = (x_next[j] - x[j]) / dt
        carried[j] = 0.0
    for i in range(m):
        weights[i] = weight_of(i, levels)
        for j in range(d):
            carried[j] += weights[i] * shapes.velocities[i, j]
    for j in range(d):
        velocity[j] -= carried[j]
    for i in range(m):
        bend = weights[i] / max(levels[i], 1e-300) ** (1.0 / avoidance.gain)
        radial = 0.0
        for j in range(d):
            radial += normals[i, j] * velocity[j]
        for j in range(d):
            along = radial * normals[i, j]
            velocity[j] = (1.0 - bend) * along + (1.0 + bend) * (velocity[j] - along)
    for j in range(d):
        x_next[j] = x[j] + (velocity[j] + carried[j]) * dt
    return ACTIVE


@lean
def weight_of(index: int, levels: Array) -> float:
    """The weight of one obstacle among several, from 0 to 1. `levels`: array, shape (m,), G_i; 1 on a surface."""
    weight = 1.0
    for other in range(levels.shape[0]):
        if other != index:
            total = (levels[index] - 1.0) + (levels[other] - 1.0)
            weight *= (levels[other] - 1.0) / total if total != 0.0 else 0.5
    return weight
