"""Random scenes: every sphere is on the way, none where it may not be, the same for all methods and controllers."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import DataError, ParameterError
from stages.dynamics.lpvds import LpvDs
from stages.mixture.gaussian import GaussianMixture
from stages.paths import arc_length
from stages.policy.avoidance.parameters import (
    ApfParameters,
    Avoidance,
    Box,
    CbfParameters,
    NoAvoidance,
    RoasPlusParameters,
    Sphere,
)
from stages.policy.avoidance.shapes import BOX, SPHERE, Shapes
from stages.policy.outcome import Outcome
from stages.rollout.parameters import (
    ClpvdsController,
    Condition,
    Displacement,
    LpvdsController,
    RandomScenes,
    RolloutParameters,
)
from stages.rollout.scenes import FIRST, LAST, OFF_CENTRE, random_scene
from stages.rollout.simulate import Draw, Rollout, Simulated, draw_from, simulate
from stages.trajectory import Array, Trajectory

ROUNDING = 1e-9
DT = 0.01
PLAIN = LpvdsController()
seeds = st.integers(0, 2**32 - 1)
dimensions = st.integers(2, 3)


def bend(seed: int, d: int, n: int = 200) -> Array:
    """A curved way to a goal, of uneven speed."""
    generator = np.random.default_rng(seed)
    tau = np.linspace(0.0, 1.0, n)[:, None]
    start, aside = generator.normal(size=(2, d))
    goal = generator.normal(size=d)
    return np.asarray(goal + 0.1 * ((1.0 - tau**2) * start + np.sin(np.pi * tau) * aside))


def model(d: int = 2, turn: float = 1.0, P: Array | None = None) -> LpvDs:
    """A linear system, K = 1: towards the goal at the origin, about it with `turn` rad/s."""
    mixture = GaussianMixture(weights=np.ones(1), means=np.zeros((1, d)), covariances=np.eye(d)[None])
    matrix = -2.0 * np.eye(d)
    matrix[0, 1], matrix[1, 0] = -turn, turn
    return LpvDs(
        mixture=mixture, matrices=matrix[None], goal=np.zeros(d), lyapunov_matrix=np.eye(d) if P is None else P
    )


def start_at(position: Sequence[float] | Array, demo: str = "4") -> Trajectory:
    """A demonstration of 4 s of which only the start and the clock matter."""
    path = np.linspace(position, np.zeros(len(position)), 401)
    return Trajectory(
        dataset="made", demo=demo, split="test", time=np.linspace(0.0, 4.0, 401), position=path, velocity=0.0 * path
    )


def run(
    starts: Sequence[Trajectory],
    conditions: Sequence[Condition],
    avoidances: Sequence[Avoidance] = (RoasPlusParameters(),),
    system: LpvDs | None = None,
    draw: Draw | None = None,
    **more: object,
) -> Simulated:
    given: dict[str, object] = {"controllers": (PLAIN,), **more}
    parameters = RolloutParameters(
        conditions=tuple(conditions),
        avoidances=tuple(avoidances),
        **given,  # type: ignore[arg-type]
    )
    return simulate(model(starts[0].dimension) if system is None else system, starts, parameters, 0.2, draw=draw)


def random(name: str = "random", **given: object) -> Condition:
    return Condition(name=name, scenes=RandomScenes(**given))  # type: ignore[arg-type]


def same(one: Shapes, two: Shapes) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def by_name(done: Simulated) -> dict[str, Shapes]:
    return {scene.name: scene.shapes for scene in done.scenes}


# --- one scene ------------------------------------------------------------------------------------------------------


@given(seeds, dimensions, st.sampled_from([0.0, 0.5, 2.0]), st.sampled_from([0.02, 0.0, 0.2, -0.05]))
def test_every_sphere_keeps_what_is_said_of_it(seed: int, d: int, speed: float, apart: float) -> None:
    way = bend(seed, d)
    given = RandomScenes(speed=speed, apart=apart, free=0.03, fewest=1, most=4, smallest=0.04, largest=0.15)
    size = float(np.linalg.norm(way[0] - way[-1]))
    starts = np.stack([way[0], way[0] + 0.05 * size])
    shapes = random_scene(way, DT, starts, given, np.random.default_rng(seed))
    assert (shapes.kinds == SPHERE).all()
    assert shapes.number <= given.most
    centres, radii, velocities = shapes.centres, shapes.radii, shapes.velocities
    assert (radii >= given.smallest * size - ROUNDING).all()
    assert (radii <= given.largest * size + ROUNDING).all()

    # It covers a sample of the way at the moment when the state would be there, and not one near either end.
    length = arc_length(way)
    fraction, clock = length / length[-1], np.arange(way.shape[0]) * DT
    step = float(np.diff(fraction).max())
    inner = (fraction >= FIRST - step) & (fraction <= LAST + step)
    for centre, radius, velocity in zip(centres, radii, velocities, strict=True):
        gap = np.linalg.norm(way - (centre + clock[:, None] * velocity), axis=1)[inner]
        assert gap.min() <= OFF_CENTRE * radius + ROUNDING
    top = float(np.diff(length).max()) / DT
    assert (np.linalg.norm(velocities, axis=1) <= speed * top + ROUNDING).all()

    for a, b in itertools.combinations(range(shapes.number), 2):
        assert np.linalg.norm(centres[a] - centres[b]) >= radii[a] + radii[b] + apart * size - ROUNDING
    for place in (*starts, way[-1]):
        assert (np.linalg.norm(centres - place, axis=1) >= radii + given.free * size - ROUNDING).all()


@given(seeds, dimensions, st.integers(1, 3), st.integers(0, 2))
def test_as_many_as_were_asked_for_where_there_is_room(seed: int, d: int, fewest: int, more: int) -> None:
    way = np.linspace(np.full(d, 0.1), np.zeros(d), 200)
    given = RandomScenes(fewest=fewest, most=fewest + more, smallest=0.01, largest=0.02, apart=0.0)
    shapes = random_scene(way, DT, way[:1], given, np.random.default_rng(seed))
    assert fewest <= shapes.number <= fewest + more


def test_every_number_from_fewest_to_most_is_drawn() -> None:
    way, given = bend(0, 2), RandomScenes(fewest=2, most=4, smallest=0.01, largest=0.02)
    numbers = {random_scene(way, DT, way[:1], given, np.random.default_rng(seed)).number for seed in range(50)}
    assert numbers == {2, 3, 4}


def test_fewer_where_there_is_no_room_for_more() -> None:
    # A straight way of 1, spheres of a radius of at least 0.2 on it, disjoint: no six of them.
    way = np.linspace([1.0, 0.0], [0.0, 0.0], 200)
    given = RandomScenes(fewest=6, most=6, smallest=0.2, largest=0.2)
    numbers = [random_scene(way, DT, way[:1], given, np.random.default_rng(seed)).number for seed in range(20)]
    assert max(numbers) < 6
    assert min(numbers) >= 1


def test_spheres_may_overlap_where_the_room_between_them_is_negative() -> None:
    way, overlaps = bend(1, 2), {}
    for apart in (-0.1, 0.0):
        given = RandomScenes(fewest=3, most=3, smallest=0.1, largest=0.1, apart=apart)
        gaps = []
        for seed in range(10):
            shapes = random_scene(way, DT, way[:1], given, np.random.default_rng(seed))
            for a, b in itertools.combinations(range(shapes.number), 2):
                gaps.append(np.linalg.norm(shapes.centres[a] - shapes.centres[b]) - shapes.radii[[a, b]].sum())
        overlaps[apart] = sum(gap < -ROUNDING for gap in gaps)
    assert overlaps[0.0] == 0
    assert overlaps[-0.1] > 0


def test_spheres_stand_unless_a_speed_is_given() -> None:
    way, generator = bend(2, 3), np.random.default_rng(0)
    assert (random_scene(way, DT, way[:1], RandomScenes(), generator).velocities == 0.0).all()
    moving = random_scene(way, DT, way[:1], RandomScenes(speed=0.5), generator)
    assert (np.linalg.norm(moving.velocities, axis=1) > 0.0).all()


@given(seeds)
def test_a_scene_has_the_size_of_its_motion(seed: int) -> None:
    # Lengths are relative to the distance from start to goal: a motion twice as large has spheres twice as large.
    way = bend(3, 2)
    one, two = (
        random_scene(scale * way, DT, scale * way[:1], RandomScenes(speed=0.5), np.random.default_rng(seed))
        for scale in (1.0, 2.0)
    )
    assert two.radii == pytest.approx(2.0 * one.radii, rel=1e-12)
    assert two.centres == pytest.approx(2.0 * one.centres, rel=1e-9, abs=1e-12)
    assert two.velocities == pytest.approx(2.0 * one.velocities, rel=1e-9)


# --- scenes of a stage ----------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(seeds, dimensions, st.sampled_from([0.0, 0.5]), st.booleans())
def test_who_goes_on_as_if_nothing_were_there_collides(seed: int, d: int, speed: float, coupled: bool) -> None:
    generator = np.random.default_rng(seed)
    start = start_at(0.1 * generator.normal(size=d))
    controller = ClpvdsController() if coupled else PLAIN
    done = run(
        [start],
        [Condition(), random(count=3, speed=speed)],
        [NoAvoidance()],
        model(d, turn=float(generator.normal())),
        draw_from(seed),
        controllers=(controller,),
    )
    free, *among = done.rollouts
    assert free.outcome is Outcome.ARRIVED
    assert [r.outcome for r in among] == [Outcome.COLLIDED] * 3


def starts() -> list[Trajectory]:
    return [start_at((0.1, 0.0), "4"), start_at((0.0, -0.1), "5")]


METHODS = (NoAvoidance(), CbfParameters(), RoasPlusParameters())


def test_all_methods_and_controllers_meet_the_same_scenes() -> None:
    done = run(starts(), [random(count=2)], METHODS, controllers=(PLAIN, ClpvdsController()))
    names = [f"random/made/{demo}/{number}" for demo in "45" for number in range(2)]
    assert [scene.name for scene in done.scenes] == names
    assert len(done.rollouts) == 2 * 3 * 2 * 2
    for r in done.rollouts:
        assert r.scene == f"random/{r.dataset}/{r.demo}/{r.rollout[-1]}"
    assert {(r.controller, r.avoidance, r.scene) for r in done.rollouts} == set(
        itertools.product(("lpvds", "clpvds"), ("none", "cbf", "roas+"), names)
    )
    shapes = by_name(done)
    assert not any(same(shapes[a], shapes[b]) for a, b in itertools.combinations(names, 2))
    # Clearance is from the obstacles as they are: at the start it is the same for all.
    for name in names:
        assert len({float(r.clearance[0]) for r in done.rollouts if r.scene == name}) == 1


def test_a_single_scene_of_a_start_needs_no_number_in_the_name_of_its_roll_out() -> None:
    (one,) = run(starts()[:1], [random()]).rollouts
    assert (one.rollout, one.scene) == ("lpvds/roas+/random/4", "random/made/4/0")


def test_scenes_depend_on_the_seed_and_on_nothing_else_that_runs() -> None:
    first = by_name(run(starts(), [random()]))
    again = by_name(run(starts(), [Condition(), random("other"), random()], METHODS, controllers=(ClpvdsController(),)))
    assert all(same(shapes, again[name]) for name, shapes in first.items())
    assert not same(again["random/made/4/0"], again["other/made/4/0"])
    alone = by_name(run(starts()[1:], [random()]))
    assert same(alone["random/made/5/0"], first["random/made/5/0"])
    other = by_name(run(starts(), [random()], draw=draw_from(1)))
    assert not any(same(shapes, other[name]) for name, shapes in first.items())


def test_a_common_scene_is_on_the_way_from_the_first_start_and_free_of_all() -> None:
    near = [start_at((0.1, 0.0), "4"), start_at((0.09, 0.02), "5"), start_at((0.05, 0.0), "6")]
    done = run(near, [random(count=3, common=True, fewest=2)], METHODS)
    assert [scene.name for scene in done.scenes] == ["random/0", "random/1", "random/2"]
    for scene in done.scenes:
        among = [r for r in done.rollouts if r.scene == scene.name]
        assert sorted({r.demo for r in among}) == ["4", "5", "6"]
        assert not {r.outcome for r in among} & {Outcome.START_INSIDE, Outcome.GOAL_INSIDE}
        for start in near:
            gaps = np.linalg.norm(scene.shapes.centres - start.position[0], axis=1) - scene.shapes.radii
            assert (gaps >= 0.02 * 0.1 - ROUNDING).all()
        (first,) = [r for r in among if (r.demo, r.avoidance) == ("4", "none")]
        assert first.outcome is Outcome.COLLIDED


def test_the_way_of_a_scene_is_undisturbed() -> None:
    push = Displacement(offset=(0.0, 0.03))
    pushed = dataclasses.replace(random(), disturbances=(push,))
    assert same(
        by_name(run(starts()[:1], [pushed]))["random/made/4/0"],
        by_name(run(starts()[:1], [random()]))["random/made/4/0"],
    )


def test_given_obstacles_are_one_scene_for_all_starts() -> None:
    obstacles = (
        Sphere(centre=(0.05, 0.0), radius=0.01),
        Box(centre=(0.0, 0.05), half_extents=(0.01, 0.02), cover=True),
    )
    done = run(starts(), [Condition(), Condition(name="two", obstacles=obstacles)], METHODS)
    (scene,) = done.scenes
    assert (scene.name, scene.cover) == ("two", (False, True))
    assert scene.shapes.kinds.tolist() == [SPHERE, BOX]
    assert {r.scene for r in done.rollouts if r.condition == "two"} == {"two"}
    assert {(r.scene, r.avoidance) for r in done.rollouts if r.condition == "none"} == {("", "none")}
    seen = scene.seen_by(NoAvoidance())
    assert seen.kinds.tolist() == [SPHERE, SPHERE]
    assert seen.radii == pytest.approx([0.01, math.hypot(0.01, 0.02)])


def test_only_roas_plus_sees_spheres_that_overlap_as_one() -> None:
    obstacles = (Sphere(centre=(0.05, 0.01), radius=0.012), Sphere(centre=(0.05, -0.01), radius=0.012))
    (scene,) = run(starts()[:1], [Condition(name="two", obstacles=obstacles)]).scenes
    assert scene.seen_by(CbfParameters()).number == 2
    assert scene.seen_by(RoasPlusParameters(merge=False)).number == 2
    merged = scene.seen_by(RoasPlusParameters())
    assert merged.centres == pytest.approx(np.array([[0.05, 0.0]]), abs=1e-6)
    assert merged.radii == pytest.approx([0.022], rel=1e-6)
    assert scene.shapes.number == 2


# On the far side of a sphere of radius r about (m, 0), V = x^2 + 4 y^2 has a minimum where 4 > (m + r) / r.
STRETCHED = np.diag([1.0, 4.0])
BLOCK = Condition(name="one", obstacles=(Sphere(centre=(0.05, 0.0), radius=0.02),))


def test_traps_are_recorded_as_roas_plus_meets_them() -> None:
    def traps(condition: Condition, *methods: Avoidance, P: Array = STRETCHED) -> tuple[Array | None, bool]:
        (scene,) = run(starts()[:1], [condition], methods, model(turn=0.0, P=P)).scenes
        return scene.traps, scene.complete

    found, complete = traps(BLOCK, NoAvoidance(), RoasPlusParameters())
    assert found is not None
    assert found == pytest.approx(np.array([[0.07, 0.0]]), abs=1e-9)
    assert complete
    with_margin, _ = traps(BLOCK, RoasPlusParameters(margin=0.01))
    assert with_margin is not None
    assert with_margin == pytest.approx(np.array([[0.08, 0.0]]), abs=1e-9)
    round_v, complete = traps(BLOCK, RoasPlusParameters(), P=np.eye(2))
    assert round_v is not None
    assert (round_v.shape, complete) == ((0, 2), True)
    assert traps(BLOCK, NoAvoidance(), CbfParameters(), ApfParameters())[0] is None  # nobody asks
    box = Condition(name="box", obstacles=(Box(centre=(0.05, 0.0), half_extents=(0.01, 0.02)),))
    assert not traps(box, RoasPlusParameters())[1]


def test_scenes_in_space() -> None:
    start = start_at((0.1, 0.0, 0.05))
    done = run([start], [random(count=3, speed=0.3)], METHODS)
    assert [scene.shapes.centres.shape[1] for scene in done.scenes] == [3, 3, 3]
    outcomes = {r.rollout: r.outcome for r in done.rollouts}
    assert [outcomes[f"lpvds/none/random/4/{number}"] for number in range(3)] == [Outcome.COLLIDED] * 3


def test_the_same_scenes_give_the_same_bytes() -> None:
    def bytes_of(rollout: Rollout) -> list[bytes]:
        return [getattr(rollout, name).tobytes() for name in ("x", "p_hat", "clearance", "status")]

    conditions = [random(count=2, speed=0.5)]
    one, two = (run(starts(), conditions, METHODS).rollouts for _ in range(2))
    assert [bytes_of(r) for r in one] == [bytes_of(r) for r in two]


# --- what is refused ------------------------------------------------------------------------------------------------


def test_no_room_for_a_single_sphere_is_refused_with_a_remedy() -> None:
    with pytest.raises(DataError, match=r"no room for a sphere: lower scenes\.smallest") as error:
        run(starts(), [random(smallest=2.0, largest=2.0)])
    assert error.value.source == "condition random, made, demonstration 4"


def test_a_start_at_the_goal_has_no_room_either() -> None:
    with pytest.raises(DataError, match="no room"):
        run([start_at((0.0, 0.0))], [random()])


SPHERES = (Sphere(centre=(0.05, 0.0), radius=0.01),)


@pytest.mark.parametrize(
    ("changes", "location", "says"),
    [
        ({"conditions": (random(fewest=3, most=2),)}, "conditions.0.scenes.fewest", "more than most"),
        ({"conditions": (random(smallest=0.3, largest=0.2),)}, "conditions.0.scenes.smallest", "more than largest"),
        ({"conditions": (random(apart=math.nan),)}, "conditions.0.scenes.apart", "finite"),
        ({"conditions": (random(apart=-math.inf),)}, "conditions.0.scenes.apart", "finite"),
        (
            {"conditions": (Condition(), dataclasses.replace(random(), obstacles=SPHERES))},
            "conditions.1.scenes",
            "not both",
        ),
        (
            {"conditions": (Condition(name="a", obstacles=(*SPHERES, Sphere(centre=(0.0, 0.0), radius=-1.0))),)},
            "conditions.0.obstacles.1.radius",
            "positive",
        ),
        ({"conditions": (random("a"), random("a"))}, "conditions.1.name", "earlier condition"),
        ({"conditions": (random("a b"),)}, "conditions.0.name", "letters"),
        ({"conditions": (random(""),)}, "conditions.0.name", "letters"),
        ({"avoidances": (CbfParameters(), CbfParameters(margin=0.01))}, "avoidances.1.name", "earlier method"),
        ({"avoidances": (CbfParameters(), RoasPlusParameters(name="cbf"))}, "avoidances.1.name", "earlier method"),
        ({"avoidances": (ApfParameters(name="a"), ApfParameters(name="a"))}, "avoidances.1.name", "earlier method"),
        ({"avoidances": (ApfParameters(name="a/b"),)}, "avoidances.0.name", "letters"),
        ({"avoidances": (ApfParameters(name="<b>"),)}, "avoidances.0.name", "letters"),
    ],
)
def test_what_has_no_meaning_is_refused(changes: dict[str, object], location: str, says: str) -> None:
    parameters = dataclasses.replace(RolloutParameters(), **changes)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=says) as error:
        simulate(model(), starts(), parameters, 0.2)
    assert error.value.location == f"rollout.{location}"


def test_methods_of_one_kind_may_differ_by_name() -> None:
    fields = (ApfParameters(range=0.01), ApfParameters(name="wide", range=0.03), ApfParameters(name="apf-2.5+x"))
    done = run(starts()[:1], [Condition(name="one", obstacles=SPHERES)], fields)
    assert [r.avoidance for r in done.rollouts] == ["apf", "wide", "apf-2.5+x"]
