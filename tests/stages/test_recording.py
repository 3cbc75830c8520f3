"""Recordings for rerun, read back: entities, counts, times, values; which roll-outs are shown, and where none is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_boxes import POT, box, learn, results_of
from recordings_read import Read, read_back

from pipeline.errors import StoreError, UsageError
from pipeline.project import Project
from stages import STAGES
from stages.artifacts.rollouts import RecordedScene
from stages.figures.results import Results, read_results
from stages.figures.telling import telling
from stages.inspect import plane, recording
from stages.inspect.about import about
from stages.inspect.arms import MESHED
from stages.inspect.arms_layout import ABREAST
from stages.inspect.obstacles import MOMENTS, draw_obstacles
from stages.inspect.recording import identity, write_recording
from stages.inspect.shown import SERIES, Shown, choose
from stages.inspect.stream import Stream
from stages.policy.avoidance.shapes import BOX, ELLIPSOID, no_shapes, spheres
from stages.world.links import frames, visuals
from stages.world.robots import arm


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return learn(tmp_path_factory.mktemp("learned"))


@pytest.fixture(scope="module")
def letters(quickstart: tuple[Path, dict[str, Any]]) -> Results:
    project = Project.open(quickstart[0], STAGES)
    return read_results(project, project.experiment("quickstart"))


@pytest.fixture(scope="module")
def drawn(letters: Results, tmp_path_factory: pytest.TempPathFactory) -> Read:
    path = tmp_path_factory.mktemp("drawn") / "letters.rrd"
    size = write_recording(path, choose([letters], (), ()))
    assert size == path.stat().st_size
    return read_back(path)


@pytest.fixture
def carried(learned: Results, tmp_path: Path) -> Callable[..., Read]:
    """A recording of made-up boxes."""

    def make(*boxes: Any, rollouts: tuple[str, ...] = (), **options: Any) -> Read:
        results = results_of(learned, tmp_path, boxes, **options)
        write_recording(tmp_path / "boxes.rrd", choose([results], rollouts, ()))
        return read_back(tmp_path / "boxes.rrd")

    return make


# --- a point ----------------------------------------------------------------------------------------------------------


def test_every_condition_and_controller_is_there_on_one_time_line(drawn: Read, letters: Results) -> None:
    point = letters.points[0]
    roots = {f"/quickstart/{r.rollout}" for r in point.rollouts}
    assert {entity.rsplit("/executed", 1)[0] for entity in drawn.entities if entity.endswith("/executed")} == roots
    assert drawn.timelines == {"time"}  # and no wall clock
    assert drawn.application == "clpv"
    assert drawn.blueprints == 1
    assert drawn.below("/quickstart/model") == {
        "demonstrations/train",
        "demonstrations/test",
        "goal",
        "components",
        "flow",
        "flow/heads",
    }


def test_states_are_those_of_the_table(drawn: Read, letters: Results) -> None:
    for rollout in letters.points[0].rollouts[::5]:
        root = f"/quickstart/{rollout.rollout}"
        assert drawn.times(f"{root}/executed") == pytest.approx(rollout.time, abs=1e-9)
        executed = np.array(drawn.values(f"{root}/executed", "Points2D:positions")).reshape(-1, 2)
        assert executed == pytest.approx(rollout.executed, abs=1e-6)
        lyapunov = np.array(drawn.values(f"{root}/plot/lyapunov/V", "Scalars:scalars")).ravel()
        assert lyapunov == pytest.approx(1e6 * rollout.lyapunov)
        coupled = rollout.controller != "lpvds"
        assert (f"{root}/x" in drawn.entities, f"{root}/p_hat" in drawn.entities) == (coupled, coupled)
        if coupled:
            for name, states in (("x", rollout.x), ("p_hat", rollout.p_hat)):
                found = np.array(drawn.values(f"{root}/{name}", "Points2D:positions")).reshape(-1, 2)
                assert found == pytest.approx(states, abs=1e-6)


def test_a_push_breaks_the_path_and_is_said_beside_the_gate(drawn: Read, letters: Results) -> None:
    pushed = next(r for r in letters.points[0].rollouts if r.disturbed and r.controller != "lpvds")
    root = f"/quickstart/{pushed.rollout}"
    (parts,) = drawn.values(f"{root}/executed/way", "LineStrips2D:strips")
    assert [len(part) for part in parts] == [pushed.displaced, pushed.time.size - pushed.displaced]
    words = [row[0] for row in drawn.values(f"{root}/lane/disturbance", "StateChange:state")]
    assert words == ["", "pushed", ""]
    changes = drawn.times(f"{root}/lane/disturbance")
    assert changes[1] == pytest.approx(pushed.time[pushed.displaced], abs=1e-9)
    gate = [row[0] for row in drawn.values(f"{root}/lane/gate", "StateChange:state")]
    assert gate[0] == "x moves"
    assert "x waits" in gate
    moved = np.flatnonzero(pushed.gate[1:] != pushed.gate[:-1]) + 1
    assert drawn.times(f"{root}/lane/gate") == pytest.approx(pushed.time[[0, *moved]], abs=1e-9)


def test_flow_and_components_are_the_learned_ones(drawn: Read, letters: Results) -> None:
    point = letters.points[0]
    (arrows,) = drawn.values("/quickstart/model/flow", "Arrows2D:vectors")
    (origins,) = drawn.values("/quickstart/model/flow", "Arrows2D:origins")
    middles, directions = np.array(origins) + 0.5 * np.array(arrows), np.array(arrows)
    velocity = point.model.velocity(middles)
    unit = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    assert (directions / np.linalg.norm(directions, axis=1, keepdims=True) * unit).sum(axis=1) == pytest.approx(
        1.0, abs=1e-4
    )
    (rings,) = drawn.values("/quickstart/model/components", "LineStrips2D:strips")
    assert len(rings) == 2 * point.model.mixture.means.shape[0]
    (scale,) = drawn.values("/quickstart", "Transform3D:scale")
    assert scale[0] == [1.0, -1.0, 1.0]  # y points up


def test_ellipses_by_hand() -> None:
    (ring,) = plane.ellipses(np.array([[1.0, 2.0]]), np.array([[[4.0, 0.0], [0.0, 9.0]]]), 2.0)
    assert ring[0] == pytest.approx([1.0 + 4.0, 2.0])
    assert ring[16] == pytest.approx([1.0, 2.0 + 6.0])
    away = ring - np.array([1.0, 2.0])
    assert (away**2 / np.array([4.0, 9.0])).sum(axis=1) == pytest.approx(4.0)


def test_all_that_is_drawn_is_in_view(letters: Results) -> None:
    point = letters.points[0]
    (x0, x1), (y0, y1) = plane.bounds([point], [np.array([[1e3, -1e3]])])
    known = np.concatenate([t.position for t in point.midpoints.trajectories])
    assert x0 < known[:, 0].min() < known[:, 0].max() < x1
    assert y0 < known[:, 1].min() < known[:, 1].max() < y1
    # What has run away widens it by less than half of the demonstrations.
    assert max(x1 - x0, y1 - y0) < 2.0 * plane.extent_of(point)


def scene(velocity: tuple[float, float] = (0.0, 0.0)) -> RecordedScene:
    shapes = no_shapes(2, 3)
    shapes.kinds[:] = (0, BOX, ELLIPSOID)
    shapes.centres[:] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    shapes.measures[:] = [[0.1, 0.1, 0.0, 0.0], [0.02, 0.3, 0.2, 0.1], [0.0, 0.3, 0.3, 0.1]]
    shapes.velocities[:] = velocity
    return RecordedScene(name="some", shapes=shapes, traps=np.array([[0.1, 0.0]]), complete=True)


def obstacles(found: RecordedScene, path: Path) -> Read:
    rr, _ = recording.rerun()
    to = rr.RecordingStream("clpv", recording_id="one", send_properties=False)
    to.save(path, default_blueprint=rr.blueprint.Blueprint(rr.blueprint.Spatial2DView()))
    draw_obstacles(Stream(rr=rr, to=to), "scene", found, np.arange(1000) / 100.0)
    to.flush()
    to.disconnect()
    return read_back(path)


def test_obstacles_in_the_plane_are_outlines(tmp_path: Path) -> None:
    still = obstacles(scene(), tmp_path / "still.rrd")
    assert still.entities == {"/scene/1", "/scene/2", "/scene/3", "/scene/traps"}
    (circle,) = still.values("/scene/1", "LineStrips2D:strips")
    assert np.linalg.norm(circle[0], axis=1) == pytest.approx(0.1, abs=1e-6)
    assert still.times("/scene/1").size == 0
    moving = obstacles(scene((0.2, 0.0)), tmp_path / "moving.rrd")
    times = moving.times("/scene/1")
    assert times[[0, -1]] == pytest.approx([0.0, 9.99])
    assert times.size <= MOMENTS
    last = moving.values("/scene/1", "LineStrips2D:strips")[-1][0]
    assert np.mean(np.array(last)[:-1], axis=0) == pytest.approx([0.2 * 9.99, 0.0], abs=1e-5)


def test_obstacles_in_space_are_bodies(tmp_path: Path) -> None:
    shapes = spheres(np.array([[0.1, 0.2, 0.3]]), np.array([0.05]), np.array([[0.0, 0.1, 0.0]]))
    found = obstacles(RecordedScene(name="some", shapes=shapes, traps=None, complete=True), tmp_path / "space.rrd")
    assert found.entities == {"/scene/1"}
    assert found.values("/scene/1", "Ellipsoids3D:half_sizes")[0][0] == pytest.approx([0.05] * 3)
    places = np.array(found.values("/scene/1", "Transform3D:translation")).reshape(-1, 3)
    assert places[0] == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)
    assert places[-1] == pytest.approx([0.1, 0.2 + 0.999, 0.3], abs=1e-5)


def test_a_system_in_space_is_shown_in_space(learned: Results, letters: Results, tmp_path: Path) -> None:
    """The learned system of the boxes, with a roll-out of a point in space."""
    results = results_of(learned, tmp_path, [box()])
    point = results.points[0]
    (free,) = [replace(r, carry=None) for r in point.rollouts]
    (one,) = choose([results], (), ())
    write_recording(tmp_path / "space.rrd", [replace(one, rollout=free)])
    found = read_back(tmp_path / "space.rrd")
    assert found.below("/box/model") == {"demonstrations/train", "demonstrations/test", "goal", "components"}
    means = found.values("/box/model/components", "Ellipsoids3D:centers")[0]
    assert np.array(means) == pytest.approx(point.model.mixture.means, abs=1e-6)
    states = np.array(found.values(f"/box/{free.rollout}/x", "Points3D:positions")).reshape(-1, 3)
    assert states == pytest.approx(free.x, abs=1e-6)
    assert not found.values("/box", "Transform3D:scale")  # space is not turned over


def test_a_plane_beside_space_turns_over_the_plane_alone(learned: Results, letters: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, [box()])
    (one,) = choose([results], (), ())
    (free,) = [replace(r, carry=None) for r in results.points[0].rollouts]
    write_recording(tmp_path / "both.rrd", [replace(one, rollout=free), *choose([letters], ("lpvds/none/4",), ())])
    found = read_back(tmp_path / "both.rrd")
    assert not found.values("/box", "Transform3D:scale")
    assert found.values("/quickstart", "Transform3D:scale")


@pytest.mark.parametrize("kind", [0, BOX, ELLIPSOID])
def test_obstacles_of_each_kind_are_seen_by_themselves(tmp_path: Path, kind: int) -> None:
    whole = scene()
    (index,) = np.flatnonzero(whole.shapes.kinds == kind)
    part = type(whole.shapes)(*(field[[index]] for field in whole.shapes))
    found = obstacles(replace(whole, shapes=part), tmp_path / "one.rrd")
    (radius,) = found.values("/scene/1", "LineStrips2D:radii")
    assert radius[0] > 0.0
    (trap,) = found.values("/scene/traps", "Points2D:radii")
    assert trap[0] > 0.0
    (edge,) = found.values("/scene/1", "LineStrips2D:strips")
    assert edge[0][0] == pytest.approx(edge[0][-1])  # closed


# --- two arms ---------------------------------------------------------------------------------------------------------


def test_arms_box_ways_and_plots_are_there(carried: Callable[..., Read]) -> None:
    found = carried(box(push="left", named="left"))
    root = "/box/clpvds-robust/held/0"
    links = {visual.link for visual in visuals(arm("iiwa", True, "robot"))}
    scene = found.below(f"{root}/scene")
    assert {f"{side}/{link}" for side in ("left", "right") for link in links} <= scene
    assert {"box", "pedestal", "shelf", "x", "p_hat", "midpoint", "left_pad", "right_pad"} <= scene
    assert found.below(f"{root}/plot") == {
        *(f"force/{name}" for name in ("left", "right", "desired", "least", "most")),
        *(f"measured/{name}" for name in ("left", "right")),
        *(f"deviation/{name}" for name in ("left", "right", "midpoint", "threshold")),
        "lyapunov/V",
    }
    assert found.below(f"{root}/lane") == {"phase", "gate", "pushed", "named"}
    assert found.timelines == {"time"}
    phases = [row[0] for row in found.values(f"{root}/lane/phase", "StateChange:state")]
    assert phases == ["approach", "grip", "carry", "set-down", "release", "done"]
    assert found.times(f"{root}/lane/phase") == pytest.approx(0.2 * np.arange(6), abs=1e-9)
    assert [row[0] for row in found.values(f"{root}/lane/pushed", "StateChange:state")] == ["", "left", ""]
    assert [row[0] for row in found.values(f"{root}/lane/named", "StateChange:state")] == ["", "left", ""]
    for side in ("left", "right"):
        forces = np.array(found.values(f"{root}/plot/force/{side}", "Scalars:scalars")).ravel()
        assert forces == pytest.approx(np.where(np.arange(60) < 10, 0.0, 5.0))
    assert np.array(found.values(f"{root}/plot/force/desired", "Scalars:scalars")).ravel() == pytest.approx(5.0)
    assert np.array(found.values(f"{root}/plot/deviation/threshold", "Scalars:scalars")).ravel() == pytest.approx(6.0)


def test_links_are_where_the_joints_put_them(learned: Results, tmp_path: Path) -> None:
    one, moved = box(), arm("iiwa", True, "robot")
    one.carried.q = np.linspace(0.0, 1.0, 60)[:, None, None] * np.ones((60, 2, 7))
    results = results_of(learned, tmp_path, [one])
    write_recording(tmp_path / "moved.rrd", choose([results], (), ()))
    found, root = read_back(tmp_path / "moved.rrd"), "/box/clpvds-robust/held/0/scene/left"
    places, turns = frames(moved.chain, one.carried.q[:, 0])
    for visual in visuals(moved):
        at = np.array(found.values(f"{root}/{visual.link}", "Transform3D:translation")).reshape(-1, 3)
        expected = places[visual.joint] + turns[visual.joint] @ visual.place
        if visual.joint == 0:
            assert at == pytest.approx(expected[:1], abs=1e-6)  # the base stands still, and is written once
            assert found.times(f"{root}/{visual.link}").size == 0
        else:
            assert at == pytest.approx(expected, abs=1e-6)
            assert found.times(f"{root}/{visual.link}").size == 60
        blob = found.values(f"{root}/{visual.link}", "Asset3D:blob")
        assert bool(blob) == (visual.mesh is not None)


def test_a_pot_and_its_sphere_move_while_the_box_is_led(carried: Callable[..., Read]) -> None:
    found = carried(box(pots=[POT], avoidance="roas+"), velocity=(0.1, 0.0, 0.0))
    root = "/box/clpvds-robust/held/0"
    (sphere,) = found.values(f"{root}/scene/pots/1/safety_sphere", "Ellipsoids3D:half_sizes")
    assert sphere[0] == pytest.approx([POT["radius"]] * 3)
    places = np.array(found.values(f"{root}/scene/pots/1", "Transform3D:translation")).reshape(-1, 3)
    assert places[0] == pytest.approx(POT["centre"], abs=1e-6)
    assert places[20] == pytest.approx(POT["centre"], abs=1e-6)  # carried from sample 20 to 30, 0.02 s each
    assert places[-1] - places[0] == pytest.approx([0.1 * 0.2, 0.0, 0.0], abs=1e-6)
    assert found.below(f"{root}/plot") >= {"clearance/sphere", "clearance/box", "clearance/arms"}
    # Deviations are compared, and x is to move, while the box is led only.
    assert found.times(f"{root}/plot/deviation/left") == pytest.approx(0.02 * np.arange(20, 30))
    assert [row[0] for row in found.values(f"{root}/lane/gate", "StateChange:state")] == ["", "x moves", ""]
    still = carried(box(pots=[POT]), name="still")
    assert still.times(f"{root}/scene/pots/1").size == 0


def test_two_conditions_share_a_time_line(carried: Callable[..., Read]) -> None:
    one, other = box("held", push="left"), box("<stiff>", compliance=False)
    found = carried(one, other, rollouts=("*",))
    assert "/box/clpvds-robust/held/0/plot/force/left" in found.entities
    escaped = r"/box/clpvds-robust/\<stiff\>/0/plot/force/left"
    assert escaped in found.entities
    for root in ("/box/clpvds-robust/held/0", r"/box/clpvds-robust/\<stiff\>/0"):
        assert found.times(f"{root}/plot/force/left")[[0, -1]] == pytest.approx([0.0, 1.18])


def test_of_many_boxes_the_arms_are_lines(learned: Results, tmp_path: Path) -> None:
    boxes = [box(f"c{k}") for k in range(MESHED + 1)]
    results = results_of(learned, tmp_path, boxes)
    shown = choose([results], ("*",), ())
    assert len(shown) > ABREAST
    write_recording(tmp_path / "many.rrd", shown)
    found, root = read_back(tmp_path / "many.rrd"), "/box/clpvds-robust/c0/0/scene/left"
    assert not found.below(root)
    strips = found.values(root, "LineStrips3D:strips")
    places = frames(arm("iiwa", True, "robot").chain, np.zeros((1, 7)))[0][:, 0]
    assert len(strips) == 60
    assert np.array(strips[0][0]) == pytest.approx(places, abs=1e-6)
    assert not any(found.values(entity, "Asset3D:blob") for entity in found.entities)


# --- which roll-outs --------------------------------------------------------------------------------------------------


def names(shown: list[Shown]) -> list[str]:
    return [one.rollout.rollout for one in shown]


def test_without_a_choice_the_one_that_tells_most(learned: Results, tmp_path: Path) -> None:
    boxes = [box(), box(number=1), box("pushed", 0, push="left"), box("pushed", 1, push="left")]
    results = results_of(learned, tmp_path, boxes)
    assert names(choose([results], (), ())) == ["clpvds-robust/pushed/0"]
    assert names(choose([results], ("*/held/*",), ())) == ["clpvds-robust/held/0", "clpvds-robust/held/1"]
    calm = results_of(learned, tmp_path, boxes[:2], name="calm")
    assert names(choose([calm], (), ())) == ["clpvds-robust/held/0"]
    # A second experiment is shown with the same box, where it has it.
    assert names(choose([calm, results], (), ())) == ["clpvds-robust/held/0"] * 2


def test_what_is_alike_is_left_out_of_the_names(learned: Results, letters: Results, tmp_path: Path) -> None:
    boxes = [box(), box("pushed", 0, push="left"), box("pushed", 1, push="left")]
    results = results_of(learned, tmp_path, boxes)
    shown = choose([results], ("*/0",), ())
    assert [one.name for one in shown] == ["held", "pushed"]
    assert [one.name for one in choose([results], ("*",), ())] == ["held, 0", "pushed, 0", "pushed, 1"]
    assert {one.name for one in choose([letters], (), ())} == {"plain LPV-DS", "robust CLPV-DS"}
    both = choose([letters, results], ("*none*", "*held*"), ())
    assert {one.model[0] for one in both} == {"quickstart", "box"}
    assert {one.name.partition(",")[0] for one in both} == {"quickstart", "box"}


def test_controllers_keep_their_colours_and_others_take_turns(
    learned: Results, letters: Results, tmp_path: Path
) -> None:
    plain = {one.colour for one in choose([letters], (), ()) if one.rollout.controller == "lpvds"}
    coupled = {one.colour for one in choose([letters], (), ()) if one.rollout.controller == "clpvds"}
    assert len(plain) == len(coupled) == 1
    assert plain != coupled
    boxes = results_of(learned, tmp_path, [box(f"c{k}") for k in range(5)])
    assert [one.colour for one in choose([boxes], ("*",), ())] == list(SERIES[:5])


def test_points_go_by_their_id_or_by_what_sets_them_apart(letters: Results) -> None:
    point = letters.points[0]
    listed = replace(point, point=replace(point.point, id="components=[3]"))
    sweep = replace(letters, points=(listed, replace(point, point=replace(point.point, id="components=[4]"))))
    (found,) = {one.point.point.id for one in choose([sweep], ("lpvds/none/4",), ("components=[3]",))}
    assert found == "components=[3]"  # and no class of characters
    assert {one.point.point.id for one in choose([letters], (), ("Angle",))} == {"main"}


def test_experiments_of_which_nothing_is_chosen_are_refused(letters: Results, learned: Results, tmp_path: Path) -> None:
    boxes = results_of(learned, tmp_path, [box()])
    with pytest.raises(UsageError, match=r"^Nothing of box is chosen: leave it out, or choose otherwise\.$"):
        choose([letters, boxes], ("lpvds/*",), ())


def test_of_random_scenes_one_is_shown(letters: Results) -> None:
    some = letters.points[0].rollouts[:4]
    conditions = ["standing", "standing", "moving", "moving"]
    scenes = ["standing/4/0", "standing/4/1", "moving/4/0", "moving/4/1"]
    made = [replace(r, condition=c, scene=s) for r, c, s in zip(some, conditions, scenes, strict=True)]
    assert [r.scene for r in telling(made)] == ["standing/4/0", "moving/4/0"]


@pytest.mark.parametrize(
    ("rollouts", "points", "message"),
    [
        (
            ("lpvds/none/5x",),
            (),
            r"There is no roll-out 'lpvds/none/5x'; did you mean 'lpvds/none/5'\? Valid: .*wildcard",
        ),
        (("nothing*",), (), r"There is no roll-out 'nothing\*'; Valid: "),
        ((), ("mani",), r"There is no point 'mani'; did you mean 'main'\? Valid: Angle, main\.$"),
    ],
)
def test_what_is_not_there_is_refused(letters: Results, rollouts: Any, points: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        choose([letters], rollouts, points)


# --- as a file --------------------------------------------------------------------------------------------------------


def test_the_same_results_have_the_same_name_and_others_another(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, [box(), box(number=1)])
    first, second = choose([results], ("*/0",), ()), choose([results], ("*",), ())
    assert identity(first) == identity(choose([results], ("*/0",), ()))
    assert identity(first) != identity(second)


def test_a_file_appears_whole_or_not_at_all(letters: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = choose([letters], ("lpvds/none/4",), ())
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot be written"):
        write_recording(tmp_path / "file" / "one.rrd", shown)
    path = tmp_path / "one.rrd"
    path.write_text("before")
    monkeypatch.setattr(plane, "draw_rollout", lambda *given: (_ for _ in ()).throw(RuntimeError("killed")))
    with pytest.raises(RuntimeError, match="killed"):
        write_recording(path, shown)
    assert path.read_text() == "before"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "one.rrd"]


def test_words_say_what_is_shown(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, [box(push="left"), box(pressing=(0.0, 20.0, 0.0), push="right", number=1)])
    text = about(choose([results], ("*",), ()))
    assert text.startswith("# box\n\n    clpv run box\n")
    assert "- **box/clpvds-robust/held/0**: arrived. 1.18 s. mass 0.4 kg, friction 1, F_d 5 N" in text
    assert "mass as found 0.41 kg, L as found 300 mm" in text
    assert "left arm pushed by [0, 30, 40] mm." in text
    assert "right arm pushed by [0, 20, 0] N." in text
