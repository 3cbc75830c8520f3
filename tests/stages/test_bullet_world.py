"""The simulated world: the same bytes for the same seed, what its sensors and contacts say, what it refuses."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.errors import DataError, ParameterError
from stages.policy.admittance import admittance_of
from stages.policy.carrying import ENDED, Carrier, Clamp, Phase
from stages.policy.parameters import AdmittanceParameters
from stages.trajectory import Array
from stages.world.boxes import check_scene, grip_ratio, pads_beside, varied
from stages.world.bullet import GRAVITY, STEP, SUPPORT_FRICTION, World
from stages.world.chain import forward
from stages.world.engine import bullet
from stages.world.following import Follower
from stages.world.parameters import Scene, Variation
from stages.world.robots import ROBOTS
from tests.support import CHECKOUT

SCENE = Scene()
CYCLE, STEPS = 0.004, 4
FACES = SCENE.box[1]


def press(world: World, cycles: int, speed: float = 0.02, outside: float = 0.001) -> Iterator[None]:
    """Both pads from so far outside of the box's faces inwards, m/s, a cycle at a time."""
    start, inwards = np.array(world.scene.start), np.array([[0.0, -speed, 0.0], [0.0, speed, 0.0]])
    pads = pads_beside(start, FACES + 2.0 * outside)
    follower = Follower(world, world.put(pads), CYCLE)
    for _ in range(cycles):
        pads = pads + CYCLE * inwards
        follower.follow(pads, inwards, np.zeros(2))
        world.drive(follower.q, follower.qdot, follower.torque, STEPS)
        follower.advance()
        yield


def told(seed: int, steps: int = 500) -> bytes:
    """Everything that a world says of itself, in each cycle of so many steps in which the box is pressed."""
    said = []
    with World(SCENE, np.random.default_rng(seed)) as world:
        for _ in press(world, steps // STEPS):
            hands = world.hands()
            arrays = [*vars(hands).values(), *world.box_pose(), world.contact_forces()]
            said += [array.tobytes() for array in arrays]
    return b"".join(said)


def python(program: str) -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=True)


@pytest.fixture(scope="module")
def first() -> bytes:
    return told(7)


def test_the_same_seed_gives_the_same_bytes(first: bytes) -> None:
    assert len(first) == 125 * 8 * (14 + 14 + 6 + 6 + 2 + 2 + 3 + 4 + 2)
    assert told(7) == first


def test_another_process_gives_the_same_bytes(first: bytes) -> None:
    program = "import sys; from tests.stages.test_bullet_world import told; sys.stdout.buffer.write(told(7))"
    assert python(program).stdout == first


def test_another_seed_gives_other_noise_and_nothing_else() -> None:
    def measured(seed: int) -> tuple[Array, list[bytes]]:
        with World(SCENE, np.random.default_rng(seed)) as world:
            forces, rest = [], []
            for _ in press(world, 20):
                hands = world.hands()
                forces.append(hands.force)
                rest += [hands.q.tobytes(), hands.qdot.tobytes(), hands.load.tobytes(), world.box_pose()[0].tobytes()]
        return np.array(forces), rest

    (here, same), (there, too) = measured(1), measured(2)
    assert same == too
    assert (here != there).all()


def test_nothing_is_printed_where_a_result_belongs() -> None:
    done = python("from stages.world.engine import bullet; bullet(); print('result', flush=True)")
    assert done.stdout == b"result\n"
    assert done.stderr == b""


@pytest.fixture(scope="module")
def pressed() -> list[tuple[Array, Array, Array]]:
    """True forces, measured ones without noise, and the places of the pads, a cycle each."""
    with World(replace(SCENE, noise=0.0), np.random.default_rng(0)) as world:
        seen = []
        for _ in press(world, 100):
            hands = world.hands()
            seen.append((world.contact_forces(), hands.force, hands.pads))
        # Held where they are, until everything is at rest.
        follower = Follower(world, hands.q, CYCLE)
        for _ in range(125):
            world.drive(follower.q, follower.qdot, follower.torque, STEPS)
        seen.append((world.contact_forces(), world.hands().force, world.hands().pads))
    return seen


def test_contacts_push_only_when_pressed(pressed: list[tuple[Array, Array, Array]]) -> None:
    forces, half = np.array([contact for contact, *_ in pressed]), 0.5 * FACES
    outside = np.array([np.abs(pads[:, 1] - SCENE.start[1]) - half for *_, pads in pressed])
    clear, deep = (outside > 2e-4).all(axis=1), (outside < -1e-3).all(axis=1)
    assert clear.sum() >= 5
    assert not forces[clear].any()
    assert deep.sum() >= 20
    assert (forces[deep] > 1.0).all()
    assert (forces >= 0.0).all()


def test_a_wrist_feels_what_the_contact_is(pressed: list[tuple[Array, Array, Array]]) -> None:
    contact, force, _ = pressed[-1]
    assert force == pytest.approx(contact, abs=0.02)
    assert contact.min() > 1.0
    # The box is at rest between them; what they differ by, its support holds by friction.
    assert abs(contact[0] - contact[1]) <= SUPPORT_FRICTION * SCENE.friction * SCENE.mass * GRAVITY


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_arms_hold_their_pads_against_gravity(robot: str) -> None:
    scene = Scene(robot=robot, noise=0.0)
    pads = pads_beside(np.array(scene.start), FACES + 0.1)
    with World(scene, np.random.default_rng(0)) as world:
        follower = Follower(world, world.put(pads), CYCLE)
        assert world.hands().pads == pytest.approx(pads, abs=1e-6)
        for _ in range(50):
            world.drive(follower.q, follower.qdot, follower.torque, STEPS)
        hands = world.hands()
    assert hands.pads == pytest.approx(pads, abs=1e-4)
    assert hands.qdot == pytest.approx(0.0, abs=1e-3)
    # Beside their own weight, which is out of it, wrists feel nothing.
    assert hands.force == pytest.approx(0.0, abs=0.01)
    assert hands.load == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_pads_follow_what_they_are_told(robot: str) -> None:
    scene = Scene(robot=robot, noise=0.0)
    velocity = np.array([0.02, 0.0, 0.05])
    pads = pads_beside(np.array(scene.start), FACES + 0.1)
    with World(scene, np.random.default_rng(0)) as world:
        follower = Follower(world, world.put(pads), CYCLE)
        for _ in range(125):
            pads = pads + CYCLE * velocity
            follower.follow(pads, np.tile(velocity, (2, 1)), np.zeros(2))
            world.drive(follower.q, follower.qdot, follower.torque, STEPS)
            follower.advance()
        hands = world.hands()
        for side, one in enumerate(world.arms):
            assert (follower.q[side] >= one.low).all()
            assert (follower.q[side] <= one.high).all()
    # The reference of the next cycle is what was led to: behind it by what a cycle's correction leaves.
    assert hands.pads == pytest.approx(pads, abs=5e-4)


def test_references_move_on_while_joints_are_driven() -> None:
    with World(replace(SCENE, noise=0.0), np.random.default_rng(0)) as world:
        q = world.put(pads_beside(np.array(SCENE.start), FACES + 0.1))
        rate = 0.05 * np.array([[1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0]] * 2) * [[1.0], [-1.0]]
        world.drive(q, rate, np.zeros(q.shape), 500)
        hands = world.hands()
    assert hands.q - q == pytest.approx(0.5 * rate, abs=2e-4)
    assert hands.qdot == pytest.approx(rate, abs=2e-3)


def test_noise_and_bias_of_the_sensors() -> None:
    with World(replace(SCENE, noise=0.3, bias=(0.2, -0.1)), np.random.default_rng(3)) as world:
        forces = np.array([world.hands().force for _ in range(2000)])
    assert forces.mean(axis=0) == pytest.approx([0.2, -0.1], abs=0.03)
    assert forces.std(axis=0) == pytest.approx(0.3, rel=0.06)
    assert np.corrcoef(forces.T)[0, 1] == pytest.approx(0.0, abs=0.1)


def test_a_box_falls_as_far_as_gravity_says() -> None:
    # Nothing is below a box that begins beside its support.
    with World(replace(SCENE, noise=0.0), np.random.default_rng(0)) as world:
        engine, client = world._bullet, world.client
        q = world.put(pads_beside(np.array(SCENE.start), 0.5))
        engine.resetBasePositionAndOrientation(world.box, [0.0, 1.5, 2.0], [0, 0, 0, 1], physicsClientId=client)
        world.drive(q, np.zeros(q.shape), np.zeros(q.shape), 200)
        centre, turn = world.box_pose()
    fallen = GRAVITY * STEP * STEP * 200 * 201 / 2.0  # semi-implicit steps
    assert centre == pytest.approx([0.0, 1.5, 2.0 - fallen], abs=1e-6)
    assert turn == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-9)


def test_the_boxs_centre_is_not_that_of_its_mass() -> None:
    with World(replace(SCENE, centre_of_mass=(0.01, -0.02, 0.005)), np.random.default_rng(0)) as world:
        assert world.box_pose()[0] == pytest.approx(SCENE.start, abs=1e-12)
        engine, client = world._bullet, world.client
        turned = engine.getQuaternionFromEuler([0.0, 0.0, np.pi / 2.0])
        engine.resetBasePositionAndOrientation(world.box, [1.0, 2.0, 3.0], turned, physicsClientId=client)
        # A quarter turn about z: the centre is at -(0.02, 0.01, 0.005) from that of the mass.
        assert world.box_pose()[0] == pytest.approx([0.98, 1.99, 2.995], abs=1e-6)


def test_a_box_that_is_nowhere_is_an_error() -> None:
    with World(SCENE, np.random.default_rng(0)) as world:
        world._bullet.resetBasePositionAndOrientation(
            world.box, [np.nan, 0.0, 0.0], [0, 0, 0, 1], physicsClientId=world.client
        )
        with pytest.raises(DataError, match="ran away"):
            world.box_pose()


REFUSED: dict[str, tuple[dict[str, Any], str, str]] = {
    "heavy": ({"mass": 1.5}, "mass", r"slip out .* at least 7\.36 N are needed\."),
    "slippery": ({"friction": 0.3}, "mass", r"slip out .* at friction 0\.3 "),
    "goal-far": ({"goal": (1.2, 0.0, 0.5)}, "", r"cannot bring its pad to \[1\.2, 0\.2, 0\.5\] m: move start or goal"),
    "start-far": ({"start": (1.1, 0.0, 0.5)}, "", r"cannot bring its pad to \[1\.1, 0\.2, 0\.5\] m"),
    "long": ({"box": (0.2, 1.6, 0.2)}, "", r"cannot bring its pad .* take a shorter box\."),
    "start-in-ground": ({"start": (0.45, -0.15, 0.05)}, "start", r"ground: its centre must be higher than 0\.1 m\."),
    "goal-in-ground": ({"goal": (0.45, -0.15, 0.1)}, "goal", r"ground: its centre must be higher than 0\.1 m\."),
    "pad-in-shelf": ({"goal": (0.45, 0.02, 0.6)}, "start", r"begin inside .*: set start and goal apart\."),
    "box-in-shelf": ({"goal": (0.55, -0.05, 0.6)}, "start", r"begin inside of something"),
    "goal-in-pedestal": (
        {"start": (0.45, -0.15, 0.6), "goal": (0.55, -0.05, 0.35)},
        "goal",
        r"end inside of something",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_work_is_refused_with_its_place_and_a_remedy(name: str) -> None:
    changed, place, says = REFUSED[name]
    with pytest.raises(ParameterError, match=says) as refused:
        check_scene(Scene(**changed), 5.0, 0.05, "rollout.scene")
    assert refused.value.location == ".".join(["rollout.scene", place] if place else ["rollout.scene"])


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_what_works_is_not_refused(robot: str) -> None:
    check_scene(Scene(robot=robot), 5.0, 0.05, "rollout.scene")


def connected() -> int:
    """How many simulators run in this process."""
    module = bullet()
    return sum(bool(module.getConnectionInfo(physicsClientId=k)["isConnected"]) for k in range(20))


def test_the_simulator_is_left_in_any_case() -> None:
    before = connected()
    world = World(SCENE, np.random.default_rng(0))
    assert connected() == before + 1
    with pytest.raises(RuntimeError, match="on purpose"), world:
        raise RuntimeError("on purpose")
    assert connected() == before
    world.close()  # twice is no error
    for refused in (Scene(start=(0.45, -0.15, 0.05)), Scene(goal=(0.45, -0.15, 0.05))):
        with pytest.raises(ParameterError):
            World(refused, np.random.default_rng(0))
    with pytest.raises(ParameterError):
        check_scene(Scene(goal=(1.2, 0.0, 0.5)), 5.0, 0.05, "rollout.scene")
    assert connected() == before


def test_two_worlds_do_not_meet() -> None:
    with World(SCENE, np.random.default_rng(0)) as here, World(SCENE, np.random.default_rng(0)) as there:
        alone = there.box_pose()[0]
        for _ in press(here, 25):
            pass
        assert here.contact_forces().min() > 0.0
        assert there.box_pose()[0].tolist() == alone.tolist()
        assert there.contact_forces().tolist() == [0.0, 0.0]


def test_pads_beside_and_grip_ratio_by_hand() -> None:
    pads = pads_beside(np.array([0.5, 0.1, 0.4]), 0.3)
    assert pads == pytest.approx(np.array([[0.5, 0.25, 0.4], [0.5, -0.05, 0.4]]), abs=1e-15)
    assert grip_ratio(Scene(mass=0.5, friction=0.8), 5.0) == pytest.approx(8.0 / 4.905, rel=1e-12)


def test_boxes_vary_within_their_ranges_and_by_seed() -> None:
    scene = Scene(
        bias=(0.05, 0.0), variation=Variation(mass=0.2, friction=0.25, start=0.03, centre_of_mass=0.01, bias=0.1)
    )
    drawn = [varied(scene, np.random.default_rng(seed)) for seed in range(200)]
    ranges = {
        "mass": ([one.mass for one in drawn], 0.4, 0.2),
        "friction": ([one.friction for one in drawn], 1.0, 0.25),
        "x": ([one.start[0] for one in drawn], 0.45, 0.03),
        "y": ([one.start[1] for one in drawn], -0.15, 0.03),
        "centre of mass": (np.ravel([one.centre_of_mass for one in drawn]), 0.0, 0.01),
        "left bias": ([one.bias[0] for one in drawn], 0.05, 0.1),
        "right bias": ([one.bias[1] for one in drawn], 0.0, 0.1),
    }
    for name, (values, middle, half) in ranges.items():
        aside = np.abs(np.asarray(values) - middle)
        assert aside.max() <= half * (1.0 + 1e-12), name
        assert aside.max() > 0.9 * half, name
    assert {one.start[2] for one in drawn} == {0.35}
    assert varied(scene, np.random.default_rng(5)) == drawn[5]
    assert varied(SCENE, np.random.default_rng(5)) == SCENE


def test_the_load_is_fed_forward_by_hand() -> None:
    with World(SCENE, np.random.default_rng(0)) as world:
        pads = pads_beside(np.array(SCENE.start), FACES + 0.1)
        q, still = world.put(pads), np.zeros((2, 3))
        follower = Follower(world, q, CYCLE)
        follower.follow(pads, still, np.array([2.0, -3.0]))
        felt = 2.0 * (1.0 - np.exp(-2.0 * np.pi * 5.0 * CYCLE))  # through the low-pass of 5 Hz
        jacobian = np.empty((6, 7))
        forward(world.arms[0].chain, q[0], np.empty(3), np.empty((3, 3)), jacobian)
        assert follower.torque[0] == pytest.approx(felt * jacobian[2], rel=1e-9)
        assert not follower.torque[1].any()  # a support that pushes up is not pressed on
        assert follower.qdot == pytest.approx(0.0, abs=1e-3)  # there already


FAR_OUT = np.array([[2.0, 0.5, 0.3], [-2.0, -0.5, 0.3]])
"""Metres: where no pad can be."""


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_references_stay_within_the_joints_limits(robot: str) -> None:
    """In every cycle, and no joint is faster than it can be."""
    with World(Scene(robot=robot), np.random.default_rng(0)) as world:
        follower = Follower(world, world.put(pads_beside(np.array(SCENE.start), FACES + 0.1)), CYCLE)
        low, high, speed = (np.array([getattr(one, name) for one in world.arms]) for name in ("low", "high", "speed"))
        limited, fastest = np.zeros(2, dtype=np.bool_), 0.0
        for _ in range(600):
            before = follower.q
            follower.follow(FAR_OUT, np.zeros((2, 3)), np.zeros(2))
            assert (np.abs(follower.qdot) <= speed * (1.0 + 1e-12)).all()
            follower.advance()
            assert ((low <= follower.q) & (follower.q <= high)).all()
            at_limit = ((follower.q == low) | (follower.q == high)).any(axis=1)
            assert (at_limit | ~follower.limited).all()
            limited |= follower.limited
            fastest = max(fastest, float((np.abs(follower.q - before) / CYCLE / speed).max()))
    assert limited.any()
    assert fastest == pytest.approx(1.0)  # as fast as they may be, and no faster


def test_joints_are_slowed_down_alike() -> None:
    """So that a pad that is led too fast goes where it is led, only later."""
    with World(replace(SCENE, robot="panda"), np.random.default_rng(0)) as world:
        q = world.put(pads_beside(np.array(SCENE.start), FACES + 0.1))
        slow, fast = Follower(world, q, CYCLE), Follower(world, q, CYCLE)
        pads, velocity = pads_beside(np.array(SCENE.start), FACES + 0.1), np.tile([0.0, 0.0, 0.1], (2, 1))
        slow.follow(pads, velocity, np.zeros(2))
        fast.follow(pads, 100.0 * velocity, np.zeros(2))
        for side, one in enumerate(world.arms):
            share = np.abs(fast.qdot[side] / one.speed).max()
            assert share == pytest.approx(1.0)
            here, there = (qdot / np.linalg.norm(qdot) for qdot in (slow.qdot[side], fast.qdot[side]))
            assert here == pytest.approx(there, abs=1e-3)


def test_what_is_missing_is_where_the_references_are() -> None:
    with World(SCENE, np.random.default_rng(0)) as world:
        pads = pads_beside(np.array(SCENE.start), FACES + 0.1)
        follower = Follower(world, world.put(pads), CYCLE)
        follower.follow(pads + np.array([[0.03, 0.0, 0.04], [0.0, 0.0, 0.0]]), np.zeros((2, 3)), np.zeros(2))
    assert follower.missing == pytest.approx([0.05, 0.0], abs=2e-6)
    assert follower.limited.tolist() == [False, False]


def test_stopped_references_do_not_move_on() -> None:
    with World(SCENE, np.random.default_rng(0)) as world:
        pads = pads_beside(np.array(SCENE.start), FACES + 0.1)
        follower = Follower(world, world.put(pads), CYCLE)
        follower.follow(pads + 0.1, np.ones((2, 3)), np.zeros(2))
        follower.advance()
        at = follower.q
        follower.stop()
        follower.advance()
    assert not follower.qdot.any()
    assert (follower.q == at).all()


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_dexterity_is_the_smallest_singular_value(robot: str) -> None:
    with World(Scene(robot=robot), np.random.default_rng(0)) as world:
        q = world.put(pads_beside(np.array(SCENE.start), FACES + 0.1))
        follower, jacobian = Follower(world, q, CYCLE), np.empty((6, 7))
        for side, one in enumerate(world.arms):
            forward(one.chain, q[side], np.empty(3), np.empty((3, 3)), jacobian)
            # Eigenvalues of J J', squared singular values.
            least = float(np.sqrt(np.linalg.eigvalsh(jacobian @ jacobian.T)[0]))
            assert follower.dexterity(side) == pytest.approx(least, rel=1e-6)
        assert min(follower.dexterity(side) for side in range(2)) > 0.1
        for _ in range(1000):
            follower.follow(pads_beside(np.array([2.0, 0.0, 0.5]), 1.0), np.zeros((2, 3)), np.zeros(2))
            follower.advance()
        assert max(follower.dexterity(side) for side in range(2)) < 0.05  # stretched out


# --- measured velocities, pushes from outside -----------------------------------------------------------------------


def test_measured_velocities_are_those_of_the_pads() -> None:
    with World(replace(SCENE, noise=0.0), np.random.default_rng(0)) as world:
        pads, velocity = (
            pads_beside(np.array(SCENE.start), FACES + 0.1),
            np.array([[0.02, 0.01, 0.05], [0.0, 0.05, 0.0]]),
        )
        follower, places = Follower(world, world.put(pads), CYCLE), []
        assert world.hands().velocity.tolist() == [[0.0] * 3] * 2
        for _ in range(125):
            pads = pads + CYCLE * velocity
            follower.follow(pads, velocity, np.zeros(2))
            world.drive(follower.q, follower.qdot, follower.torque, STEPS)
            follower.advance()
            places.append(world.hands())
    for before, here, after in zip(places[50:], places[51:], places[52:], strict=False):
        assert here.velocity == pytest.approx((after.pads - before.pads) / (2.0 * CYCLE), abs=1e-3)
    assert places[-1].velocity == pytest.approx(velocity, abs=1e-3)


@pytest.mark.parametrize("side", [0, 1])
def test_a_force_pushes_its_arm_only_and_the_wrist_does_not_feel_it(side: int) -> None:
    with World(replace(SCENE, noise=0.0), np.random.default_rng(0)) as world:
        pads = pads_beside(np.array(SCENE.start), FACES + 0.1)
        q = world.put(pads)
        still, pushes = np.zeros(q.shape), np.zeros((2, 3))
        pushes[side, 2] = 20.0
        world.drive(q, still, still, 500, pushes)
        pushed = world.hands()
        world.drive(q, still, still, 1000)
        released = world.hands()
    moved = pushed.pads - pads
    assert moved[side, 2] > 0.01
    assert moved[1 - side] == pytest.approx(0.0, abs=1e-4)
    # Behind the sensor: it feels its pad's own acceleration only, and there is hardly any.
    assert pushed.force == pytest.approx(0.0, abs=0.2)
    assert pushed.load == pytest.approx(0.0, abs=0.2)
    assert released.pads == pytest.approx(pads, abs=1e-3)


class Over:
    """A way up, across and down, at 0.15 m/s."""

    def __init__(self, scene: Scene) -> None:
        start, goal, up = np.array(scene.start), np.array(scene.goal), np.array([0.0, 0.0, 0.03])
        above = np.array([start[0], start[1], goal[2]]) + up
        self.corners, self.ended = [above, goal + up, goal], False

    def step(self, midpoint: Array, *, return_speed: float | None) -> Array:
        """0.6 mm towards the next corner."""
        assert return_speed is None  # nobody is pushed
        left = self.corners[0] - midpoint
        distance = float(np.linalg.norm(left))
        if distance > 0.15 * CYCLE:
            return np.asarray(midpoint + left * 0.15 * CYCLE / distance)
        reached = self.corners.pop(0)
        self.ended = not self.corners
        return reached

    def gap(self, midpoint: Array) -> float:
        """It waits for nothing."""
        return 0.0


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_a_box_is_carried_and_delivered(robot: str) -> None:
    scene = Scene(robot=robot)
    clamp = Clamp(
        length=FACES,
        admittance=admittance_of(AdmittanceParameters(), printed=False),
        squeeze=0.002,
        stand_off=0.05,
        approach_speed=0.05,
        release_speed=0.05,
    )
    carrier = Carrier(Over(scene), np.array(scene.start), clamp, CYCLE, 5.0)
    contact, upright, heights = [], [], []
    with World(scene, np.random.default_rng(1)) as world:
        follower = Follower(world, world.put(carrier.pads), CYCLE)
        for _ in range(5000):
            hands = world.hands()
            if carrier.phase in ENDED:
                break
            if carrier.phase is Phase.CARRY:
                box, (x, y, *_) = world.box_pose()
                contact.append(world.contact_forces())
                upright.append(1.0 - 2.0 * (x * x + y * y))
                heights.append(box[2])
            carrier.step(hands.force)
            follower.follow(carrier.pads, carrier.velocities, hands.load)
            world.drive(follower.q, follower.qdot, follower.torque, STEPS)
            follower.advance()
        box, (x, y, *_) = world.box_pose()
    assert carrier.phase is Phase.DONE
    assert box == pytest.approx(scene.goal, abs=0.003)
    assert 1.0 - 2.0 * (x * x + y * y) == pytest.approx(1.0, abs=1e-5)
    assert max(heights) > scene.goal[2] + 0.025
    assert np.mean(contact) == pytest.approx(5.0, abs=0.1)
    low, high = np.percentile(contact, [5.0, 95.0])
    assert 4.6 <= low <= high <= 5.4
    assert np.degrees(np.arccos(min(upright))) < 3.0
