"""Boxes that vary: drawn within their ranges, and refused where the ranges hold a box that cannot be carried."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import ParameterError
from stages.world.boxes import check_scene, grip_ratio, varied
from stages.world.parameters import Scene, Variation

STUDY = Scene(
    mass=0.4, friction=0.95, variation=Variation(mass=0.2, friction=0.25, start=0.03, centre_of_mass=0.01, bias=0.1)
)


@given(st.integers(0, 2**32 - 1))
def test_boxes_are_drawn_within_their_ranges_and_by_seed(seed: int) -> None:
    one = varied(STUDY, np.random.default_rng(seed))
    assert one == varied(STUDY, np.random.default_rng(seed))
    assert 0.2 <= one.mass <= 0.6
    assert 0.7 <= one.friction <= 1.2
    assert np.abs(np.array(one.start) - STUDY.start).max() <= 0.03
    assert one.start[2] == STUDY.start[2]
    assert np.abs(one.centre_of_mass).max() <= 0.01
    assert np.abs(one.bias).max() <= 0.1
    assert (one.goal, one.box, one.noise) == (STUDY.goal, STUDY.box, STUDY.noise)


def test_without_variation_a_box_is_as_given() -> None:
    assert varied(Scene(), np.random.default_rng(0)) == Scene()


def test_what_friction_holds_by_hand() -> None:
    assert grip_ratio(Scene(mass=0.5, friction=0.8), 5.0) == pytest.approx(8.0 / 4.905, rel=1e-12)


def test_the_study_of_the_benchmark_can_be_carried() -> None:
    check_scene(STUDY, 5.0, 0.05, "scene")


@pytest.mark.parametrize(
    ("scene", "location", "says"),
    [
        (Scene(mass=2.0), "scene.mass", "at least 9.81 N"),
        (Scene(mass=0.3, variation=Variation(mass=0.3)), "scene.variation.mass", "reaches 0"),
        (Scene(friction=0.3, mass=0.1, variation=Variation(friction=0.5)), "scene.variation.friction", "reaches 0"),
        (Scene(mass=0.6, friction=0.7, variation=Variation(mass=0.2, friction=0.3)), "scene.variation", "0.8 kg"),
        (Scene(variation=Variation(start=0.5)), "scene.variation.start", "cannot bring its pad"),
        (Scene(centre_of_mass=(0.3, 0.0, 0.0)), "scene.centre_of_mass", "outside of the box"),
        (Scene(variation=Variation(centre_of_mass=0.2)), "scene.centre_of_mass", "outside of the box"),
        (Scene(goal=(1.4, 0.15, 0.47)), "scene", "cannot bring its pad"),
        (Scene(box=(0.2, 1.6, 0.2)), "scene", "cannot bring its pad"),
    ],
)
def test_what_cannot_be_carried_is_refused(scene: Scene, location: str, says: str) -> None:
    with pytest.raises(ParameterError, match=says) as error:
        check_scene(scene, 5.0, 0.05, "scene")
    assert error.value.location == location


def test_a_heavier_box_needs_more_force() -> None:
    heavy = replace(Scene(), mass=1.5)
    with pytest.raises(ParameterError):
        check_scene(heavy, 5.0, 0.05, "scene")
    check_scene(heavy, 10.0, 0.05, "scene")


@pytest.mark.parametrize(
    ("scene", "length_error", "location", "says"),
    [
        (Scene(length_error=-0.15), 0.0, "scene.length_error", "begin inside of the box"),
        (Scene(), -0.1, "scene.length_error", "begin inside of the box"),
        (Scene(goal=Scene().start), 0.0, "scene.goal", "nothing to carry"),
    ],
)
def test_what_would_begin_inside_of_something_is_refused(
    scene: Scene, length_error: float, location: str, says: str
) -> None:
    with pytest.raises(ParameterError, match=says) as error:
        check_scene(scene, 5.0, 0.05, "scene", length_error)
    assert error.value.location == location
