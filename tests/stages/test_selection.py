"""Selections: parsed, resolved against topics, compiled; which numbers are meant, and what is said where none are."""

from types import SimpleNamespace as Message

import numpy as np
import pytest
from robots import TWO_ARMS

from pipeline.errors import DataError, ParameterError
from stages.ingest.recording import Samples, Topic
from stages.ingest.selections.extractors import Flag, getter
from stages.ingest.selections.kinematics import read_robot
from stages.ingest.selections.layouts import steps_of
from stages.ingest.selections.selection import parse

XYZ, XYZW = ("x", "y", "z"), ("x", "y", "z", "w")


def below(place, names):
    return tuple(f"{place}.{name}" if place else name for name in names)


POSE = (*below("position", XYZ), *below("orientation", XYZW))
TRANSFORM = (*below("translation", XYZ), *below("rotation", XYZW))
TWIST = (*below("linear", XYZ), *below("angular", XYZ))
WRENCH = (*below("force", XYZ), *below("torque", XYZ))

FIELDS = {
    "Pose": POSE,
    "PoseStamped": below("pose", POSE),
    "Transform": TRANSFORM,
    "TransformStamped": below("transform", TRANSFORM),
    "Odometry": (
        *below("pose.pose", POSE),
        "pose.covariance[36]",
        *below("twist.twist", TWIST),
        "twist.covariance[36]",
    ),
    "EndpointState": (*below("pose", POSE), *below("twist", TWIST), *below("wrench", WRENCH)),
    "PointStamped": below("point", XYZ),
    "Point": XYZ,
    "Vector3Stamped": below("vector", XYZ),
    "Tracker": (*XYZ, "roll", "pitch", "yaw"),
    "FlatPose": (*XYZ, "qx", "qy", "qz", "qw"),
    "TwoArms": (*below("left", POSE), *below("right", POSE), "mode"),
    "PoseArray": below("poses[]", POSE),
    "Float64MultiArray": ("layout.dim[].size", "layout.dim[].stride", "layout.data_offset", "data[]"),
    "Fixed": ("pose[7]", "matrix[16]"),
    "JointState": ("position[]", "velocity[]", "effort[]"),
    "TFMessage": below("transforms[].transform", TRANSFORM),
    "WrenchStamped": below("wrench", WRENCH),
    "Wrench": WRENCH,
    "Twist": TWIST,
    "Imu": (*below("orientation", XYZW), *below("angular_velocity", XYZ), *below("linear_acceleration", XYZ)),
    "Bool": ("data",),
    "String": (),
}


def topics(*kinds):
    return [Topic(name=f"/{kind.lower()}", type=f"x_msgs/msg/{kind}", count=9, fields=FIELDS[kind]) for kind in kinds]


def table(*fields, **names):
    return [Topic(name="table", type="rows", count=9, fields=fields, names=names)]


def resolve(text, found, quantity="pose", robot=None):
    return parse(text, "ingest.left").resolve(found, "demo.bag", robot, quantity)


def message(path, value):
    """A message that holds `value` at a dotted path."""
    for name in reversed(path.split(".")):
        value = Message(**{name: value})
    return value


def posed(kind="position", turn="orientation"):
    point, turned = Message(x=1.0, y=2.0, z=3.0), Message(x=0.1, y=0.2, z=0.3, w=0.9)
    return Message(**{kind: point, turn: turned})


def track(resolved, *rows):
    values = np.array([resolved.request.extract(row) for row in rows], dtype=float)
    clock = np.arange(len(rows), dtype=np.int64)
    return resolved.track(Samples(log_time=clock, stamp=None, values=values))


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        ("Pose", "/pose", posed()),
        ("PoseStamped", "/posestamped", message("pose", posed())),
        ("PoseStamped", "/posestamped:pose", message("pose", posed())),
        ("Transform", "/transform", posed("translation", "rotation")),
        ("TransformStamped", "/transformstamped", message("transform", posed("translation", "rotation"))),
        ("Odometry", "/odometry", message("pose.pose", posed())),
        ("Odometry", "/odometry:pose", message("pose.pose", posed())),
        ("EndpointState", "/endpointstate", message("pose", posed())),
        ("TwoArms", "/twoarms:left", message("left", posed())),
        ("PoseArray", "/posearray:poses[1]", Message(poses=[None, posed()])),
        ("Float64MultiArray", "/float64multiarray:data[2:9]", Message(data=[9, 9, 1, 2, 3, 0.1, 0.2, 0.3, 0.9, 9])),
        ("Fixed", "/fixed:pose", Message(pose=np.array([1, 2, 3, 0.1, 0.2, 0.3, 0.9]))),
        ("FlatPose", "/flatpose", Message(x=1, y=2, z=3, qx=0.1, qy=0.2, qz=0.3, qw=0.9)),
        ("FlatPose", "/flatpose:x, y,z,qx,qy,qz,qw", Message(x=1, y=2, z=3, qx=0.1, qy=0.2, qz=0.3, qw=0.9)),
    ],
)
def test_poses_are_found(kind, text, found):
    result = track(resolve(text, topics(kind)), found)
    np.testing.assert_array_equal(result.values, [[1, 2, 3]])
    np.testing.assert_array_equal(result.quaternion, [[0.1, 0.2, 0.3, 0.9]])


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        ("PoseStamped", "/posestamped:pose.position", message("pose", posed())),
        ("Odometry", "/odometry:twist.twist.linear", message("twist.twist.linear", Message(x=1, y=2, z=3))),
        ("PointStamped", "/pointstamped", message("point", Message(x=1, y=2, z=3))),
        ("Point", "/point", Message(x=1, y=2, z=3)),
        ("Point", "/point:x,y,z", Message(x=1, y=2, z=3)),
        ("Vector3Stamped", "/vector3stamped", message("vector", Message(x=1, y=2, z=3))),
        ("Float64MultiArray", "/float64multiarray:data[0:3]", Message(data=np.arange(1.0, 9.0))),
        ("Float64MultiArray", "/float64multiarray:data[1],data[0],data[2]", Message(data=[2, 1, 3])),
        ("Fixed", "/fixed:matrix[12:15]", Message(matrix=[0] * 12 + [1, 2, 3, 1])),
        ("PoseArray", "/posearray:poses[0].position", Message(poses=[posed()])),
    ],
)
def test_positions_are_found(kind, text, found):
    result = track(resolve(text, topics(kind)), found)
    np.testing.assert_array_equal(result.values, [[1, 2, 3]])
    assert result.quaternion is None


def test_euler_angles_are_about_fixed_axes():
    resolved = resolve("/tracker", topics("Tracker"))
    half = np.sqrt(0.5)
    quarter = np.pi / 2
    result = track(
        resolved,
        Message(x=1, y=2, z=3, roll=quarter, pitch=0, yaw=0),
        Message(x=1, y=2, z=3, roll=0, pitch=0, yaw=quarter),
        Message(x=1, y=2, z=3, roll=quarter, pitch=0, yaw=quarter),
        Message(x=1, y=2, z=3, roll=np.nan, pitch=0, yaw=0),
    )
    expected = [[half, 0, 0, half], [0, 0, half, half], [0.5, 0.5, 0.5, 0.5], [np.nan] * 4]
    np.testing.assert_allclose(result.quaternion, expected, rtol=0, atol=1e-15)


def test_scale_is_of_positions_only():
    samples = Samples(log_time=np.zeros(1, dtype=np.int64), stamp=None, values=np.arange(1.0, 8.0)[None])
    result = resolve("/pose", topics("Pose")).track(samples, scale=0.001)
    np.testing.assert_allclose(result.values, [[0.001, 0.002, 0.003]])
    np.testing.assert_array_equal(result.quaternion, [[4, 5, 6, 7]])


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        ("WrenchStamped", "/wrenchstamped", message("wrench.force", Message(x=1, y=2, z=3))),
        ("Wrench", "/wrench", message("force", Message(x=1, y=2, z=3))),
        ("EndpointState", "/endpointstate", message("wrench.force", Message(x=1, y=2, z=3))),
        ("WrenchStamped", "/wrenchstamped:wrench.force", message("wrench.force", Message(x=1, y=2, z=3))),
        ("Vector3Stamped", "/vector3stamped", message("vector", Message(x=1, y=2, z=3))),
        ("Float64MultiArray", "/float64multiarray:data[0:3]", Message(data=[1, 2, 3, 4])),
    ],
)
def test_forces_are_found(kind, text, found):
    np.testing.assert_array_equal(track(resolve(text, topics(kind), "force"), found).values, [[1, 2, 3]])


def test_numbers_and_truth_values_are_told_apart():
    for text, kind, row, boolean in (
        ("/bool", "Bool", Message(data=True), True),
        ("/bool:data", "Bool", Message(data=np.bool_(False)), True),
        ("/bool", "Bool", Message(data=1), False),
        ("/twoarms:mode", "TwoArms", Message(mode=4), False),
    ):
        resolved = resolve(text, topics(kind), "number")
        assert resolved.request.extract(row) == (float(getattr(row, "data", 4)),)
        assert isinstance(resolved.request.extract, Flag)
        assert resolved.request.extract.boolean is boolean


def transform(parent, child, x, sec=0, nanosec=0):
    header = Message(frame_id=parent, stamp=Message(sec=sec, nanosec=nanosec))
    moved = Message(translation=Message(x=x, y=2.0, z=3.0), rotation=Message(x=0.0, y=0.0, z=0.0, w=1.0))
    return Message(header=header, child_frame_id=child, transform=moved)


def test_frames_are_matched_as_a_pair_with_their_own_stamp():
    resolved = resolve("/tfmessage:base->hand", topics("TFMessage"))
    extract = resolved.request.extract
    other = [transform("base", "head", 9.0), transform("world", "hand", 9.0)]
    assert extract(Message(transforms=other)) is None
    assert extract(Message(transforms=[*other, transform("/base", "hand", 1.0, 5, 7)]))[:3] == (1.0, 2.0, 3.0)
    assert extract.stamp(None) == (5, 7)
    empty = Samples(log_time=np.zeros(0, dtype=np.int64), stamp=None, values=np.zeros((0, 7)))
    with pytest.raises(DataError, match=r"^demo\.bag, .*hand: .* Valid: base->head, world->hand\.$"):
        resolved.track(empty)


def test_joints_are_matched_by_name():
    robot = read_robot(TWO_ARMS, "two.urdf")
    resolved = resolve("/jointstate:fk(left_hand)", topics("JointState"), robot=robot)
    extract = resolved.request.extract
    assert extract(Message(name=["left_s1", "x", "left_s0"], position=[2.0, 9.0, 1.0])) == [1.0, 2.0]
    assert extract(Message(name=["left_s0", "left_s1"], position=[3.0, 4.0])) == [3.0, 4.0]
    assert extract(Message(name=["left_s0", "left_s1"], position=[])) is None
    assert extract(Message(name=["gripper"], position=[1.0])) is None
    result = track(resolved, Message(name=["left_s0", "left_s1"], position=[0.0, 0.0]))
    np.testing.assert_allclose(result.values, [[0.7, 0.2, 0.0]])
    empty = Samples(log_time=np.zeros(0, dtype=np.int64), stamp=None, values=np.zeros((0, 2)))
    metres = resolved.track(Samples(log_time=np.zeros(1, dtype=np.int64), stamp=None, values=np.zeros((1, 2))), 0.001)
    np.testing.assert_allclose(metres.values, [[0.7, 0.2, 0.0]])  # a URDF is in metres
    with pytest.raises(DataError, match=r"no message has the joint 'left_s0'; .*Valid: gripper\.$"):
        resolved.track(empty)
    with pytest.raises(ParameterError, match=r"^ingest\.urdf: must be given: .*fk\(left_hand\)\)\.$"):
        resolve("/jointstate:fk(left_hand)", topics("JointState"))
    with pytest.raises(DataError, match=r"^two\.urdf: has no link 'hand'"):
        resolve("/jointstate:fk(hand)", topics("JointState"), robot=robot)
    with pytest.raises(DataError, match=r"hold no joint positions; JointState is needed\.$"):
        resolve("/bool:fk(left_hand)", topics("Bool"), robot=robot)


def test_messages_that_are_too_short_hold_nothing():
    for text, kind, row in (
        ("/posearray:poses[1]", "PoseArray", Message(poses=[posed()])),
        ("/float64multiarray:data[0:3]", "Float64MultiArray", Message(data=[1, 2])),
        ("/float64multiarray:data[0],data[1],data[5]", "Float64MultiArray", Message(data=[1, 2])),
    ):
        resolved = resolve(text, topics(kind))
        assert resolved.request.extract(row) is None
        empty = Samples(log_time=np.zeros(0, dtype=np.int64), stamp=None, values=np.zeros((0, 3)))
        with pytest.raises(DataError, match=r"no message holds these numbers"):
            resolved.track(empty)


@pytest.mark.parametrize(
    ("text", "columns", "row", "expected"),
    [
        ("l_", ("l_x", "l_y", "l_z"), {"l_x": 1, "l_y": 2, "l_z": 3}, [1, 2, 3]),
        ("table:l_", ("l_x", "l_y", "l_z"), {"l_x": 1, "l_y": 2, "l_z": 3}, [1, 2, 3]),
        ("l_z,l_x, l_y", ("l_z", "l_x", "l_y"), {"l_x": 1, "l_y": 2, "l_z": 3}, [3, 1, 2]),
        ("state[1:4]", ("state",), {"state": np.arange(6.0)}, [1, 2, 3]),
        ("table:state[1:4]", ("state",), {"state": np.arange(6.0)}, [1, 2, 3]),
        ("pose", ("pose",), {"pose": [1, 2, 3]}, [1, 2, 3]),
        ("state:c,a,b", ("state",), {"state": [1, 2, 3, 4, 5, 6]}, [3, 1, 2]),
    ],
)
def test_columns_are_found(text, columns, row, expected):
    found = table("time", "l_x", "l_y", "l_z", "state[6]", "pose[3]", state=tuple("abcdef"))
    resolved = resolve(text, found)
    assert resolved.request.topic == "table"
    assert resolved.request.columns == columns
    assert list(resolved.request.extract(row)) == expected
    assert parse(text, "x").fits(found)


def test_a_prefix_takes_the_orientation_that_there_is():
    names = ("ax", "ay", "az", "aqx", "aqy", "aqz", "aqw", "bx", "by", "bz", "broll", "bpitch", "byaw")
    assert resolve("a", table(*names)).request.columns == names[:7]
    assert resolve("b", table(*names)).layout == "euler"
    assert resolve("a", table(*names), "force").request.columns == names[:3]
    assert resolve("ax", table(*names), "number").request.extract({"ax": 3.0}) == (3.0,)


def test_columns_of_joints():
    robot = read_robot(TWO_ARMS, "two.urdf")
    resolved = resolve("table:fk(right_hand)", table("right_s0", "right_s1", "left_s0"), robot=robot)
    assert resolved.request.columns == ("right_s0", "right_s1")
    with pytest.raises(DataError, match=r"has no column for the joint 'left_s1'; did you mean 'left_s0'\?"):
        resolve("table:fk(left_hand)", table("right_s0", "right_s1", "left_s0"), robot=robot)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("/posestampd", r"there is no topic '/posestampd'; did you mean '/posestamped'\? Valid: "),
        ("posestamped", r"there is no topic 'posestamped'; did you mean '/posestamped'\?"),
        ("/string", r"messages of type x_msgs/msg/String hold no position: select another topic\.$"),
        ("/twist", r"messages of type x_msgs/msg/Twist hold no position: select another topic; it holds linear\.x, "),
        ("/wrench", r"hold no position"),
        ("/imu", r"hold no position"),
        ("/twoarms", r"holds more than one position: choose /twoarms:left or /twoarms:right"),
        ("/posearray", r"hold no position but arrays: name one of them, such as /posearray:poses\[0\]\.$"),
        ("/posearray:poses", r"hold no position at 'poses'"),
        (
            "/float64multiarray",
            r"hold no position but arrays: name numbers of one, such as /float64multiarray:data\[0:3\]\.$",
        ),
        (
            "/float64multiarray:data",
            r"is an array: name three numbers .* of it, such as /float64multiarray:data\[0:3\]",
        ),
        ("/float64multiarray:data[0:4]", r"gives 4 number\(s\), not three numbers .* or seven"),
        ("/float64multiarray:data[0]", r"is one number: name three numbers"),
        ("/fixed:pose[5:8]", r"hold no position at 'pose\[5:8\]'"),
        ("/fixed:matrix", r"is an array: name"),
        ("/posestamped:pose.position.x", r"is one number"),
        ("/posestamped:pose.orientation", r"hold no position"),
        (
            "/posestamped:pose.postion",
            r"hold no position at 'pose\.postion'; did you mean 'pose\.position'\? Valid: pose\.position\.$",
        ),
        ("/posestamped:a,b,c", r"hold no number at 'a'"),
        ("/posestamped:pose.position.x,pose.position.y", r"gives 2 number\(s\)"),
        ("/posestamped:base->hand", r"are no transforms between frames; TFMessage is needed"),
        (
            "/jointstate",
            r"holds joint positions, no pose: name a link of ingest\.urdf, such as /jointstate:fk\(left_hand\)",
        ),
        ("/jointstate:position[0:3]", r"holds joint positions, no pose"),
        ("/tfmessage", r"hold transforms: name a pair, such as /tfmessage:parent->child"),
    ],
)
def test_wrong_topics_and_fields_are_named(text, problem):
    with pytest.raises(DataError, match=problem) as caught:
        resolve(text, topics(*FIELDS))
    assert str(caught.value).startswith(f"demo.bag, {text}: ")
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("m_", r"'m_' is neither a column of numbers nor a prefix of x y z; "),
        ("l_x", r"gives 1 number\(s\)"),
        ("l_x,l_y,l_w", r"has no column of numbers 'l_w'; did you mean 'l_"),
        ("l_x,l_y", r"gives 2 number\(s\)"),
        ("state", r"gives 6 number\(s\)"),
        ("state[4:7]", r"is no part of the column of lists 'state': it has 6 numbers a row"),
        ("free", r"is no part of the column of lists 'free': name the numbers, such as free\[0:3\]"),
        ("state:a,b,x", r"the column 'state' has no element 'x'; "),
        ("free:a,b,c", r"the column 'free' has no element 'a'; none is known"),
        ("stat:a,b,c", r"has no column of lists 'stat'; did you mean 'state\[6\]'\?"),
        ("/tf:base->hand", r"a table has no frames"),
    ],
)
def test_wrong_columns_are_named(text, problem):
    found = table("time", "l_x", "l_y", "l_z", "state[6]", "free[]", state=tuple("abcdef"))
    with pytest.raises(DataError, match=problem) as caught:
        resolve(text, found)
    assert str(caught.value).startswith(f"demo.bag, {text}: ")
    assert str(caught.value).endswith(".")


def test_what_cannot_be_decoded_or_is_empty_is_refused():
    broken = [Topic(name="/a", type="x/A", count=3, problem="its definition is missing.")]
    with pytest.raises(DataError, match=r"^demo\.bag, /a: its definition is missing\.$"):
        resolve("/a", broken)
    with pytest.raises(DataError, match=r"^demo\.bag, /a: the topic has no messages"):
        resolve("/a", [Topic(name="/a", type="x/A", count=0, fields=FIELDS["Pose"])])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "  ",
        ":",
        "/a:",
        ":b",
        "/tf:->hand",
        "/tf:base->",
        "/a:x,,z",
        "/a:data[3:3]",
        "/a:data[x]",
        "/a:b[0:3].c",
        "/a:.b",
    ],
)
def test_what_is_no_expression_is_refused(text):
    with pytest.raises(ParameterError) as caught:
        parse(text, "ingest.left").resolve([Topic(name="/a", type="x/A", count=9, fields=("data[]",))], "demo.bag")
    assert caught.value.location == "ingest.left"
    assert str(caught.value).endswith(".")


def test_many_names_are_not_all_listed():
    many = [Topic(name=f"/topic_{number:03d}", type="x/A", count=1) for number in range(200)]
    with pytest.raises(DataError, match=r"and 188 more\.$") as caught:
        resolve("/topic_07x", many)
    assert len(str(caught.value)) < 400


def test_paths():
    assert steps_of("poses[0].position") == ("poses", 0, "position")
    assert steps_of("a[1][2].b[0:3]") == ("a", 1, 2, "b", slice(0, 3))
    assert getter(("a", "b"))(Message(a=Message(b=7))) == 7
    assert getter(())(7) == 7
    assert getter(("a", 1, "b", slice(0, 2)))(Message(a=[0, Message(b=[5, 6, 7])])) == [5, 6]
