"""Forward kinematics against pytransform3d's own transform manager, by hand, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytransform3d.rotations import matrix_from_quaternion
from pytransform3d.urdf import UrdfTransformManager
from robots import ODD, TWO_ARMS, joint, robot

from pipeline.errors import DataError
from stages.ingest.selections.kinematics import read_robot, rotations


@given(values=st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_agrees_with_the_transform_manager(values):
    manager = UrdfTransformManager()
    manager.load_urdf(ODD)
    for name, value in zip("abd", values, strict=True):
        manager.set_joint(name, value)
    expected = manager.get_transform("four", "base")
    chain = read_robot(ODD, "odd.urdf").chain("four")
    assert chain.drivers == ("a", "b", "d")
    position, quaternion = chain.forward(np.array([values, [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(position[0], expected[:3, 3], rtol=0, atol=1e-12)
    turned = matrix_from_quaternion(quaternion[0][[3, 0, 1, 2]])
    np.testing.assert_allclose(turned, expected[:3, :3], rtol=0, atol=1e-12)


def test_two_links_by_hand():
    chain = read_robot(TWO_ARMS, "two.urdf").chain("left_hand")
    assert chain.drivers == ("left_s0", "left_s1")
    position, quaternion = chain.forward(np.array([[0.0, 0.0], [np.pi / 2, 0.0], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(position, [[0.7, 0.2, 0.0], [0.0, 0.9, 0.0], [0.4, 0.5, 0.0]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.abs(quaternion[1]), [0, 0, np.sqrt(0.5), np.sqrt(0.5)], rtol=0, atol=1e-15)


def test_mimicked_joints_follow_their_driver():
    text = robot(
        joint("a", "revolute", "base", "one"),
        joint("b", "revolute", "one", "two", "1 0 0", extra='<mimic joint="a" multiplier="-2" offset="0.1"/>'),
        joint("c", "prismatic", "two", "three", axis="1 0 0", extra='<mimic joint="b" multiplier="0.5"/>'),
        links=["base", "one", "two", "three"],
    )
    chain = read_robot(text, "m.urdf").chain("three")
    assert chain.drivers == ("a",)
    a = 0.3
    b = -2 * a + 0.1
    c = 0.5 * b
    expected = [np.cos(a) + c * np.cos(a + b), np.sin(a) + c * np.sin(a + b), 0.0]
    np.testing.assert_allclose(chain.forward(np.array([[a]]))[0][0], expected, rtol=0, atol=1e-15)


def test_what_is_not_kinematics_is_not_read():
    odd = '<link name="base"><visual><geometry><mesh/></geometry></visual><inertial><mass/></inertial></link>'
    text = TWO_ARMS.replace('<link name="base"/>', odd).replace("</robot>", "<gazebo><plugin/></gazebo></robot>")
    assert read_robot(text, "x.urdf").chain("left_hand").drivers == ("left_s0", "left_s1")


def test_rodrigues_by_hand():
    found = rotations(np.array([0.0, 0.0, 1.0]), np.array([0.0, np.pi / 2]))
    np.testing.assert_allclose(found[1], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=1e-15)
    assert np.array_equal(rotations(np.zeros(3), np.array([1.0]))[0], np.eye(3))


def test_many_samples_are_fast():
    import time

    chain = read_robot(ODD, "odd.urdf").chain("four")
    values = np.random.default_rng(0).normal(size=(100_000, 3))
    begin = time.perf_counter()
    chain.forward(values)
    assert time.perf_counter() - begin < 5.0


def test_no_samples():
    position, quaternion = read_robot(ODD, "odd.urdf").chain("four").forward(np.zeros((0, 3)))
    assert position.shape == (0, 3)
    assert quaternion.shape == (0, 4)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", r"is not a URDF, or is damaged: it is not XML"),
        (TWO_ARMS[:300], r"is not a URDF, or is damaged: it is not XML"),
        ("<sdf/>", r"is not a URDF that can be used: Robot tag is missing; expand xacro"),
        (
            TWO_ARMS.replace('"revolute"', '"floating"', 1),
            r"is not a URDF that can be used: Unsupported joint type 'floating'",
        ),
        (
            TWO_ARMS.replace('xyz="0 0.2 0"', 'xyz="${y}"', 1),
            r"is not a URDF that can be used: .*; expand xacro files first",
        ),
        (TWO_ARMS.replace('parent link="base"', 'parent link="bass"', 1), r"is not a URDF that can be used: .*bass"),
        (TWO_ARMS.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"', 1), r"joint 'left_s0' has no axis"),
    ],
)
def test_what_is_no_urdf_is_refused(text, problem):
    with pytest.raises(DataError, match=rf"^r\.urdf: {problem}.*\.$"):
        read_robot(text, "r.urdf")


def test_unknown_links_and_bad_chains_are_refused():
    two = read_robot(TWO_ARMS, "two.urdf")
    with pytest.raises(
        DataError, match=r"^two\.urdf: has no link 'left_hnd'; did you mean 'left_hand'\? Valid: base, "
    ):
        two.chain("left_hnd")
    with pytest.raises(DataError, match=r"^two\.urdf: no joint moves link 'base'"):
        two.chain("base")
    loop = robot(joint("a", "revolute", "one", "two"), joint("b", "revolute", "two", "one"), links=["one", "two"])
    with pytest.raises(DataError, match=r"^l\.urdf: .*(loop|tree|cycle)"):
        read_robot(loop, "l.urdf").chain("two")
    mimic = TWO_ARMS.replace("</joint>", '<mimic joint="nobody"/></joint>', 1)
    with pytest.raises(DataError, match=r"^m\.urdf: joint 'left_s0' mimics 'nobody', which does not exist"):
        read_robot(mimic, "m.urdf")
