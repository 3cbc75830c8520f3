"""Thousands of random scenes: what ROAS+ promises, and what the other methods do in the same scenes.

1 to 5 disjoint spheres, each of which covers a point of the way that the system would take (`stages/rollout/scenes.py`
draws them). Half of the scenes are of linear systems, half of LPV-DS learned from LASA motions; those in space are
learned from two motions each, one of which gives the depth. Run by `make bench`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache

import numpy as np
from lasa import KINDS, motions, motions_in_space
from scenes import METHODS, ROAS_PLUS, Tally, Task, all_of, header, linear, linear_task, run, scene, task

from stages.dynamics.lpvds import LpvDs
from stages.policy.avoidance.parameters import Avoidance, CbfParameters, RoasPlusParameters
from stages.policy.avoidance.scene import merged, refusal
from stages.policy.avoidance.shapes import Shapes, spheres
from stages.policy.avoidance.traps import traps_of
from stages.policy.outcome import Outcome
from stages.rollout.parameters import RandomScenes
from stages.trajectory import Array

SCENES = 5_000
"""Of each dimension and each kind of system: 10,000 a dimension."""
CLOCKS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
"""Seconds between steps of ROAS+; every scene is run at each. The others are run at 10 ms."""
SPECIAL = 1_000
"""Scenes of each special set and dimension, each at one of the clocks."""
OTHER_V = 1_000
"""Scenes of each dimension and each kind that learns V."""
MOVING, OVERLAPPING = 1_000, 1_000
"""Scenes a dimension, half linear and half learned."""
ROUNDING = 1e-12
"""Relative rise of V that counts as none."""
TOUCH = 1e-9
"""Metres of penetration that count as none."""
ASIDE = 0.05
"""Standard deviation of a start from a demonstration's, as a share of its distance from the goal."""

LONGEST = 100.0
"""Longest roll-out, as a multiple of that without obstacles: a field may be learned that all but stands somewhere."""

Case = tuple[np.random.Generator, Task]


@cache
def learned(kind: str, d: int) -> list[tuple[LpvDs, list[Array]]]:
    """Systems learned from all 30 motions, and the first points of their test demonstrations."""
    result = []
    for motion in motions() if d == 2 else motions_in_space():
        result.append((KINDS[kind].fit(motion.train, motion.goal).model, [t.position[0] for t in motion.test]))
    return result


def learned_cases(kind: str, d: int, count: int, salt: int) -> Iterator[Case]:
    """Learned systems in turn, from starts near those of their test demonstrations."""
    systems = learned(kind, d)
    for case in range(count):
        generator = np.random.default_rng([salt, d, case])
        model, starts = systems[case % len(systems)]
        start = starts[int(generator.integers(len(starts)))]
        aside = ASIDE * float(np.linalg.norm(start - model.goal)) * generator.normal(size=d)
        yield generator, task(model, start + aside)


def linear_cases(d: int, count: int, salt: int) -> Iterator[Case]:
    """Linear systems anywhere."""
    for case in range(count):
        generator = np.random.default_rng([salt, d, case])
        yield generator, linear_task(generator, d)


def in_random_scenes(
    cases: Iterator[Case], given: RandomScenes, methods: Sequence[tuple[Avoidance, float]]
) -> list[Tally]:
    """Run every case in one random scene with each method at its clock."""
    tallies = [Tally() for _ in methods]
    for generator, one in cases:
        shapes = scene(one, given, generator)
        if not shapes.number:
            continue
        for tally, (method, dt) in zip(tallies, methods, strict=True):
            tally.add(one, run(one, shapes, method, dt, times=LONGEST), dt)
    return tallies


def test_standing_spheres() -> None:
    rivals = [(name, method) for name, method in METHODS.items() if name != "roas+"]
    methods = [(method, 0.01) for _, method in rivals] + [(ROAS_PLUS, dt) for dt in CLOCKS]
    names = [name for name, _ in rivals] + [f"roas+, {1e3 * dt:g} ms" for dt in CLOCKS]
    print("\n\nStanding spheres; V = |x - x_g|^2\n" + header("d", "system", "method"))
    for d in (2, 3):
        halves = {
            "linear": in_random_scenes(linear_cases(d, SCENES, 1), RandomScenes(), methods),
            "learned": in_random_scenes(learned_cases("qlf", d, SCENES, 2), RandomScenes(), methods),
        }
        halves["both"] = [all_of(two) for two in zip(*halves.values(), strict=True)]
        for system, tallies in halves.items():
            for name, tally in zip(names, tallies, strict=True):
                print(tally.row(str(d), system, name))
        for tally in halves["both"][len(rivals) :]:
            assert tally.count == 2 * SCENES
            assert tally.collided == 0
            assert tally.arrived == tally.count
            assert tally.clearance >= -TOUCH
            assert tally.rise <= ROUNDING
            assert tally.detours == 0


def head_on(generator: np.random.Generator, d: int) -> tuple[Task, Shapes]:
    """One to three spheres with their centres exactly on the straight way."""
    towards = np.zeros(d)
    towards[int(generator.integers(d))] = 1.0
    if generator.uniform() < 0.5:
        towards = generator.normal(size=d)
        towards /= np.linalg.norm(towards)
    size = generator.uniform(0.1, 1.0)
    places = np.linspace(0.25, 0.8, int(generator.integers(1, 4)))
    radii = generator.uniform(0.03, 0.12, size=places.shape[0])
    one = task(linear(np.zeros(d)), size * towards)
    return one, spheres(size * places[:, None] * towards, size * radii)


def near_goal(generator: np.random.Generator, d: int) -> tuple[Task, Shapes]:
    """A sphere 5 mm from the goal, in any direction that leaves the start free."""
    one = linear_task(generator, d)
    while True:
        radius, towards = one.size * generator.uniform(0.05, 0.4), generator.normal(size=d)
        centre = one.model.goal + (radius + 0.005) * towards / np.linalg.norm(towards)
        if np.linalg.norm(one.start - centre) > 1.05 * radius:
            return one, spheres(centre[None], np.array([radius]))


def receding(generator: np.random.Generator, d: int) -> tuple[Task, Shapes]:
    """A start that touches a sphere, with the goal on its other side, and more spheres ahead."""
    one = linear_task(generator, d)
    ahead = (one.model.goal - one.start) / one.size
    away = ahead + generator.normal(size=d)
    away = away / np.linalg.norm(away)
    if away @ ahead < 0.0:
        away = -away
    radius = one.size * generator.uniform(0.05, 0.3)
    centre = one.start - (radius * (1.0 + 1e-9)) * away
    more = scene(one, RandomScenes(most=3), generator)
    clear = np.linalg.norm(more.centres - centre, axis=1) > more.radii + radius
    return one, spheres(np.vstack([centre, more.centres[clear]]), np.append(radius, more.radii[clear]))


def test_special_scenes() -> None:
    sets: dict[str, Callable[[np.random.Generator, int], tuple[Task, Shapes]]] = {
        "exactly head-on": head_on,
        "goal 5 mm from a sphere": near_goal,
        "receding start": receding,
    }
    print("\n\nSpecial scenes, linear systems, V = |x - x_g|^2\n" + header("d", "set", "method"))
    for d in (2, 3):
        for number, (name, make) in enumerate(sets.items()):
            tallies = {method: Tally() for method in METHODS}
            for case in range(SPECIAL):
                one, shapes = make(np.random.default_rng([3, number, d, case]), d)
                for method, given in METHODS.items():
                    dt = CLOCKS[case % len(CLOCKS)] if method == "roas+" else 0.01
                    tallies[method].add(one, run(one, shapes, given, dt, times=LONGEST), dt)
            for method, tally in tallies.items():
                print(tally.row(str(d), name, method))
            tally = tallies["roas+"]
            assert tally.collided == 0
            assert tally.arrived == tally.count == SPECIAL
            assert tally.rise <= ROUNDING


def test_a_learned_v_among_standing_spheres() -> None:
    print("\n\nStanding spheres; a learned V\n" + header("d", "V", "method"))
    lines = []
    for d in (2, 3):
        for kind in ("pqlf", "warped"):
            tallies, trapped_where, places, exact = [Tally(), Tally()], [0, 0], 0, 0
            for case, (generator, one) in enumerate(learned_cases(kind, d, OTHER_V, 4)):
                shapes = scene(one, RandomScenes(), generator)
                if not shapes.number:
                    continue
                traps, complete = traps_of(one.model, merged(shapes, 0.0), 0.0)
                places, exact = places + traps.shape[0], exact + complete
                dt = CLOCKS[case % len(CLOCKS)]
                for number, method in enumerate((ROAS_PLUS, RoasPlusParameters(detour=False))):
                    path = run(one, shapes, method, dt, times=LONGEST)
                    tallies[number].add(one, path, dt)
                    if path.outcome == Outcome.TRAPPED:
                        trapped_where[number] += traps.shape[0] > 0
            for name, tally in zip(("roas+", "roas+ without detours"), tallies, strict=True):
                print(tally.row(str(d), kind, name))
                assert tally.collided == 0
                assert tally.clearance >= -TOUCH
                assert tally.rise <= ROUNDING
            stuck = tallies[1].outcomes[Outcome.TRAPPED]
            lines.append(
                f"{d}-D, {kind}: {places} traps foretold in {tallies[0].count} scenes ({exact} exactly); without "
                f"detours {stuck} roll-outs were caught, {trapped_where[1]} of them where a trap was foretold"
            )
            assert tallies[0].arrived >= 0.99 * tallies[0].count
    print("\n" + "\n".join(lines))


def test_moving_spheres() -> None:
    methods = [(ROAS_PLUS, 0.01), (CbfParameters(), 0.01)]
    print("\n\nMoving spheres\n" + header("d", "top speed of spheres", "method"))
    for d in (2, 3):
        for speed in (0.5, 1.0):
            given = RandomScenes(speed=speed)
            parts = [
                in_random_scenes(linear_cases(d, MOVING // 2, 5), given, methods),
                in_random_scenes(learned_cases("qlf", d, MOVING // 2, 6), given, methods),
            ]
            ours, theirs = (all_of(two) for two in zip(*parts, strict=True))
            print(ours.row(str(d), f"{speed:g} x the state's", "roas+"))
            print(theirs.row(str(d), f"{speed:g} x the state's", "cbf"))
            assert ours.unflagged == 0
            assert ours.flagged <= 0.02 * ours.count
            assert ours.collided <= theirs.collided
            assert ours.rise <= ROUNDING


def test_overlapping_spheres() -> None:
    given = RandomScenes(fewest=2, apart=-0.05)
    print("\n\nOverlapping spheres\n" + header("d", "clusters", "method"))
    for d in (2, 3):
        tallies, swallowed, apart = [Tally(), Tally()], 0, 0
        for cases in (linear_cases(d, OVERLAPPING, 7), learned_cases("qlf", d, OVERLAPPING, 8)):
            for generator, one in cases:
                shapes = scene(one, given, generator)
                seen = merged(shapes, 0.0)
                if seen.number == shapes.number:
                    apart += 1
                    continue
                if refusal(shapes, seen, 0.0, one.start, one.model.goal, recover=False) is not None:
                    swallowed += 1
                    continue
                for tally, method in zip(tallies, (ROAS_PLUS, CbfParameters()), strict=True):
                    tally.add(one, run(one, shapes, method, times=LONGEST), 0.01)
        for name, tally in zip(("roas+", "cbf"), tallies, strict=True):
            print(tally.row(str(d), "merged", name))
        print(
            f"{d}-D: {apart} scenes without an overlap and {swallowed} of which the sphere holds start or goal left out"
        )
        assert tallies[0].collided == 0
        assert tallies[0].arrived >= 0.99 * tallies[0].count
        assert tallies[0].rise <= ROUNDING
