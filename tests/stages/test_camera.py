"""Pictures of the simulated world, and moving pictures of them: what is there is seen, where it is, every time."""

from __future__ import annotations

import io
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_boxes import POT, box, learn, results_of
from PIL import Image

from stages.figures import animation
from stages.figures.animation import beads, best_still, carry_animation, encoded, staged
from stages.figures.results import Results
from stages.world.camera import FRONT, MIDDLE, Film, Moments, Picture, View
from stages.world.parameters import Scene
from stages.world.pots import POT_PROFILE, POT_SIDES, Pot, lathe, triangles
from stages.world.robots import arm

SMALL = View(eye=FRONT, target=MIDDLE, width=120, height=80)
POSTURES = np.array([arm("iiwa", left, "robot").posture for left in (True, False)])


def filmed(*places: tuple[float, float, float], pots: tuple[Pot, ...] = (), way: int = 0) -> list[Picture]:
    """Pictures of the box at some places."""
    n = len(places)
    moments = Moments(
        joints=np.tile(POSTURES, (n, 1, 1)),
        box=np.array(places),
        turn=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        pots=np.tile(np.array([pot.centre for pot in pots]).reshape(1, -1, 3), (n, 1, 1)),
    )
    beads_ = np.tile([0.3, 0.0, 0.8], (way, 1))
    film = Film(scene=Scene(robot="iiwa"), pots=pots, way=beads_, moments=moments, view=SMALL)
    return list(film.pictures())


def like(picture: Picture, name: str) -> np.ndarray:
    """Pixels, rows and columns, whose shade is nearest to that of a thing: box is brown, a pot red, a bead green."""
    red, green, blue = picture[..., 0].astype(int), picture[..., 1].astype(int), picture[..., 2].astype(int)
    found = {
        "box": (red - blue > 40) & (red - green < 45),
        "pot": red - green > 45,
        "bead": green - red > 40,
    }[name]
    return np.argwhere(found)


def test_what_is_there_is_seen_and_where_it_is() -> None:
    low, high = filmed((0.45, 0.0, 0.35), (0.45, 0.0, 0.75))
    assert low.shape == (80, 120, 3)
    assert low.dtype == np.uint8
    assert like(low, "box").shape[0] > 100
    assert like(high, "box")[:, 0].mean() < like(low, "box")[:, 0].mean() - 10  # higher up in the picture
    assert like(low, "pot").shape[0] == like(low, "bead").shape[0] == 0
    (potted,) = filmed((0.45, 0.0, 0.35), pots=(Pot(centre=(0.7, -0.3, 0.4), height=0.3, width=0.2),))
    assert like(potted, "pot").shape[0] > 30
    (marked,) = filmed((0.45, 0.0, 0.35), way=1)
    assert like(marked, "bead").shape[0] > 0


def test_equal_arrays_give_equal_pictures() -> None:
    (one,), (other,) = filmed((0.45, 0.0, 0.35)), filmed((0.45, 0.0, 0.35))
    assert np.array_equal(one, other)


def test_a_pot_is_a_closed_body_whose_faces_look_outwards() -> None:
    pot = Pot(centre=(0.5, 0.0, 0.4), height=0.24, width=0.2)
    corners, faces = lathe(pot), triangles()
    assert faces.max() == corners.shape[0] - 1
    a, b, c = (corners[faces[:, k]] for k in range(3))
    # Every edge belongs to two faces, once in each direction.
    edges = [tuple(edge) for face in faces.tolist() for edge in zip(face, [*face[1:], face[0]], strict=True)]
    assert len(set(edges)) == len(edges)
    assert {(j, i) for i, j in edges} == set(edges)
    # Its volume is that of cones between regular polygons.
    area = 0.5 * POT_SIDES * np.sin(2.0 * np.pi / POT_SIDES)
    expected = sum(
        (h1 - h0) * pot.height * area * (0.5 * pot.width) ** 2 * (r0 * r0 + r0 * r1 + r1 * r1) / 3.0
        for (h0, r0), (h1, r1) in itertools.pairwise(POT_PROFILE)
    )
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0).sum() == pytest.approx(expected)


def test_the_foot_of_a_pot_is_never_lower_than_the_ground() -> None:
    assert Pot(centre=(0.0, 0.0, 0.4), height=0.24, width=0.2).foot == pytest.approx(0.28)
    assert Pot(centre=(0.0, 0.0, 0.1), height=0.24, width=0.2).foot == 0.01
    assert Pot(centre=(0.0, 0.0, 0.0), height=0.3, width=0.4).reach == pytest.approx(0.25)


def test_beads_lie_evenly_on_the_way() -> None:
    way = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.03, 0.03, 0.0]])
    assert beads(way) == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.03, 0.01, 0.0], [0.03, 0.03, 0.0]])
    )
    assert beads(np.zeros((5, 3))).shape == (1, 3)  # what never moves is one


def test_pictures_become_a_gif_and_a_still() -> None:
    pictures = [np.full((20, 30, 3), 40 * k, dtype=np.uint8) for k in range(5)]
    gif, png = encoded(pictures, 3)
    moving, still = Image.open(io.BytesIO(gif)), Image.open(io.BytesIO(png))
    assert (moving.size, moving.n_frames, moving.info["loop"]) == ((30, 20), 5, 0)
    assert moving.info["duration"] == 120
    assert (still.size, still.format) == ((30, 20), "PNG")
    assert encoded(pictures, 3) == (gif, png)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return learn(tmp_path_factory.mktemp("learned"))


def test_the_still_is_from_the_middle_of_the_push(learned: Results, tmp_path: Path) -> None:
    point = results_of(learned, tmp_path, [box(push="left"), box(number=1)]).points[0]
    pushed, calm = (r.carry for r in point.rollouts)
    assert pushed is not None
    assert calm is not None
    every = np.arange(60)
    assert best_still(pushed, every) == 24  # samples 22 to 25
    assert best_still(calm, every) == 25  # carried from 20 to 29
    assert best_still(calm, every[:15]) == 7  # nothing is carried there


def test_a_pot_moves_in_the_picture_while_the_box_is_led(learned: Results, tmp_path: Path) -> None:
    results = results_of(learned, tmp_path, [box(pots=[POT], avoidance="roas+")], velocity=(0.1, 0.0, 0.0))
    point = results.points[0]
    (rollout,) = point.rollouts
    assert rollout.carry is not None
    film = staged(point, rollout, rollout.carry, np.array([0, 20, 59]))
    assert film.moments.pots[:2, 0] == pytest.approx(np.tile(POT["centre"], (2, 1)))
    assert film.moments.pots[2, 0] - film.moments.pots[0, 0] == pytest.approx([0.02, 0.0, 0.0])
    assert film.scene.start == (0.45, -0.15, 0.35)
    assert film.scene.box == (0.2, 0.3, 0.2)


def test_the_animation_says_what_it_shows(learned: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "PICTURES", 3)
    monkeypatch.setattr(animation, "WIDTH", 60)
    monkeypatch.setattr(animation, "HEIGHT", 40)
    one = box(push="left")
    one.carried.q = np.tile(POSTURES, (60, 1, 1))
    made = carry_animation(results_of(learned, tmp_path, [box(number=1), one]).points[0])
    assert Image.open(io.BytesIO(made.gif)).size == (60, 40)
    assert "lift it from a pedestal, are disturbed at the left one and set it down on a shelf." in made.alt
    assert made.caption.startswith(
        "Roll-out `clpvds-robust/held/0`: robust CLPV-DS, held, 3.3 times as fast as it was."
    )
    lost = replace(results_of(learned, tmp_path, [one], name="lost").points[0].rollouts[0], outcome="dropped")
    assert lost.carry is not None
    assert animation._alt(lost, lost.carry).endswith("and end dropped.")
