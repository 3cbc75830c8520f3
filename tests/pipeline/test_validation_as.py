"""Plain tables made into declared parameters at a place of the caller's choice; what is wrong is named there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from annotated_types import Len, MinLen
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Discriminator

from pipeline.errors import EXIT_USAGE, ParameterError
from pipeline.stage import Positive, Stage, parameters
from pipeline.validation import validate, validate_as
from stages.policy.avoidance.parameters import Avoidance, Box, Obstacle, RoasPlusParameters, Sphere
from stages.rollout.parameters import ClpvdsController, Controller
from stages.world.parameters import Scene


@parameters
class Ring:
    """A kind of its own."""

    kind: Literal["ring"] = "ring"
    radius: Positive = 1.0


@parameters
class Bar:
    """Another kind, with a part that must be given and a table of parts."""

    kind: Literal["bar"] = "bar"
    length: Positive
    ends: tuple[Annotated[Ring | Plate, Discriminator("kind")], ...] = ()


@parameters
class Plan:
    """Lists of so many entries, fixed by their type, by their limits, or free upwards; some of them optional."""

    kind: Literal["plan"] = "plan"
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    one: tuple[int] = (0,)
    pair: Annotated[tuple[Positive, ...], Len(2, 2)] = (1.0, 2.0)
    some: Annotated[tuple[float, ...], MinLen(2)] = (0.0, 0.0)
    few: Annotated[tuple[float, ...], Len(1, 3)] = (0.0,)
    maybe: tuple[float, float] | None = None
    rings: tuple[Ring, Ring] = (Ring(), Ring())
    rows: tuple[tuple[float, float], ...] = ()


@parameters
class Plate:
    """A part without numbers."""

    kind: Literal["plate"] = "plate"
    label: str = ""


UNION = Ring | Bar
ANNOTATED = Annotated[Ring | Bar, Discriminator("kind")]


@pytest.mark.parametrize("declared", [UNION, ANNOTATED])
def test_members_of_a_union_are_told_apart_by_their_kind(declared: Any) -> None:
    assert validate_as(declared, "part", {"kind": "ring", "radius": 2}) == Ring(radius=2.0)
    assert validate_as(declared, "part", {"kind": "bar", "length": 3.0}) == Bar(length=3.0)
    assert validate_as(declared, "part", {"radius": 2.0}) == Ring(radius=2.0)  # the first is meant where none is named


def test_a_class_alone_needs_no_kind() -> None:
    assert validate_as(Ring, "part", {}) == Ring()
    assert validate_as(Ring, "part", {"kind": "ring"}) == Ring()
    made = validate_as(Bar, "part", {"length": 1, "ends": [{"kind": "plate", "label": "a"}, {"kind": "ring"}]})
    assert made.ends == (Plate(label="a"), Ring())


def test_what_is_given_stays_as_it_is() -> None:
    given: dict[str, Any] = {"radius": 2.0}
    validate_as(UNION, "part", given)
    assert given == {"radius": 2.0}
    assert validate_as(Bar, "part", {"length": 1.0, "ends": ({"kind": "ring"},)}).ends == (Ring(),)  # tuples, too


REFUSALS: list[tuple[Any, dict[str, Any], str, str]] = [
    (UNION, {"kind": "rnig"}, "kind", "there is no kind 'rnig'; did you mean 'ring'? Valid: bar, ring."),
    (UNION, {"kind": 3}, "kind", "there is no kind 3; Valid: bar, ring."),
    (UNION, {"kind": None}, "kind", "there is no kind None; Valid: bar, ring."),
    (UNION, {"kind": "bar"}, "length", "must be given."),
    (UNION, {"kind": "bar", "length": 0}, "length", "should be greater than 0, not 0."),
    (UNION, {"kind": "bar", "length": float("nan")}, "length", "should be a finite number, not NaN."),
    (UNION, {"kind": "bar", "length": "1"}, "length", 'should be a valid number, not "1".'),
    (UNION, {"kind": "bar", "length": True}, "length", "should be a valid number, not true."),
    (UNION, {"kind": "bar", "length": 1, "ens": 1}, "ens", "unknown parameter; did you mean 'ends'? Valid: ends, "),
    (UNION, {"length": 1.0}, "length", "unknown parameter; Valid: kind, radius."),
    (UNION, {"kind": "bar", "length": 1, "ends": [{}]}, "ends.0.kind", "must be given."),
    (
        UNION,
        {"kind": "bar", "length": 1, "ends": [{"kind": "ring"}, {"kind": "plaet"}]},
        "ends.1.kind",
        "there is no kind 'plaet'; did you mean 'plate'? Valid: plate, ring.",
    ),
    (
        UNION,
        {"kind": "bar", "length": 1, "ends": [{"kind": "ring", "radius": -1}]},
        "ends.0.radius",
        "should be greater than 0, not -1.",
    ),
    (Ring, {"kind": "bar"}, "kind", "must be 'ring', not 'bar'."),
    (Ring, {"radius": [1.0]}, "radius", "should be a valid number, not [1.0]."),
]


PLANS: list[tuple[dict[str, Any], str, str]] = [
    ({"place": [0.1]}, "place", "must have 3 entries, not 1."),
    ({"place": []}, "place", "must have 3 entries, not 0."),
    ({"place": [1, 2, 3, 4]}, "place", "must have 3 entries, not 4."),
    ({"place": (1.0, 2.0)}, "place", "must have 3 entries, not 2."),
    ({"place": np.zeros(2)}, "place", "must have 3 entries, not 2."),
    ({"place": [0.1, "a"]}, "place.1", 'should be a valid number, not "a".'),  # a wrong one before a missing one
    ({"place": 3}, "place", "should be a valid array, not 3."),
    ({"one": []}, "one", "must have 1 entry, not 0."),
    ({"one": [1, 2]}, "one", "must have 1 entry, not 2."),
    ({"pair": [1.0]}, "pair", "must have 2 entries, not 1."),
    ({"pair": [1.0, 2.0, 3.0]}, "pair", "must have 2 entries, not 3."),
    ({"pair": [1.0, -2.0]}, "pair.1", "should be greater than 0, not -2.0."),
    ({"some": [1.0]}, "some", "must have at least 2 entries, not 1."),
    ({"few": []}, "few", "must have at least 1 entry, not 0."),
    ({"few": [1, 2, 3, 4]}, "few", "must have at most 3 entries, not 4."),
    ({"maybe": [1.0]}, "maybe", "must have 2 entries, not 1."),
    ({"maybe": [1.0, 2.0, 3.0]}, "maybe", "must have 2 entries, not 3."),
    ({"rings": [{}]}, "rings", "must have 2 entries, not 1."),
    ({"rings": [{}, {"radius": -1}]}, "rings.1.radius", "should be greater than 0, not -1."),
    ({"rows": [[1.0, 2.0], [1.0]]}, "rows.1", "must have 2 entries, not 1."),
    ({"rows": [[1.0, 2.0, 3.0]]}, "rows.0", "must have 2 entries, not 3."),
    ({"plaec": [0.1], "place": [0.1]}, "plaec", "unknown parameter; did you mean 'place'?"),
]


@pytest.mark.parametrize(("given", "place", "sentence"), PLANS, ids=[f"{k}-{row[1]}" for k, row in enumerate(PLANS)])
def test_lists_with_too_few_and_too_many_entries(given: Mapping[str, Any], place: str, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        validate_as(Plan, "part", given)
    assert caught.value.location == f"part.{place}"
    assert caught.value.problem.startswith(sentence)


def test_lists_of_the_right_length_pass() -> None:
    made = validate_as(
        Plan, "part", {"place": np.arange(3.0), "maybe": [1, 2], "rows": [[1, 2], (3, 4)], "few": [1] * 3}
    )
    assert (made.place, made.maybe, made.rows) == ((0.0, 1.0, 2.0), (1.0, 2.0), ((1.0, 2.0), (3.0, 4.0)))


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=6))
def test_a_place_has_three_coordinates(values: list[float]) -> None:
    if len(values) == 3:
        assert validate_as(Scene, "scene", {"start": values}).start == tuple(values)
    else:
        with pytest.raises(ParameterError, match=rf"^scene\.start: must have 3 entries, not {len(values)}\.$"):
            validate_as(Scene, "scene", {"start": values})


@pytest.mark.parametrize("location", ["part", "scene.parts.3"])
@pytest.mark.parametrize(
    ("declared", "given", "place", "sentence"), REFUSALS, ids=[f"{k}-{row[2]}" for k, row in enumerate(REFUSALS)]
)
def test_what_is_wrong_is_named_at_the_callers_place(
    declared: Any, given: Mapping[str, Any], place: str, sentence: str, location: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        validate_as(declared, location, given)
    assert caught.value.location == f"{location}.{place}"
    assert caught.value.problem.startswith(sentence)
    assert str(caught.value) == f"{location}.{place}: {caught.value.problem}"
    assert caught.value.exit_code == EXIT_USAGE


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_only_finite_positive_numbers_pass_where_such_are_needed(value: float) -> None:
    if 0.0 < value < float("inf"):
        assert validate_as(UNION, "part", {"radius": value}) == Ring(radius=value)  # to the bit
    else:
        with pytest.raises(ParameterError) as caught:
            validate_as(UNION, "part", {"radius": value})
        assert caught.value.location == "part.radius"


def test_a_stage_is_validated_at_its_name() -> None:
    stage = Stage(name="make", summary="", parameters=UNION, inputs=(), outputs=(), run=lambda context: None)
    assert validate(stage, {"kind": "bar", "length": 2}) == Bar(length=2.0)
    with pytest.raises(ParameterError) as caught:
        validate(stage, {"kind": "bar", "length": -2})
    assert caught.value.location == "make.length"


# --- as the Python face uses it -------------------------------------------------------------------------------------


def test_obstacles_methods_and_couplings_are_made_of_the_tables_of_an_experiment() -> None:
    assert validate_as(Obstacle, "obstacles.0", {"kind": "sphere", "centre": [0, 1.5], "radius": 1}) == Sphere(
        centre=(0.0, 1.5), radius=1.0
    )
    assert validate_as(Obstacle, "obstacles.1", {"kind": "box", "centre": (0.0, 0.0), "half_extents": (1, 2)}) == Box(
        centre=(0.0, 0.0), half_extents=(1.0, 2.0)
    )
    assert validate_as(Avoidance, "avoidance", {"kind": "roas+", "detour": False}) == RoasPlusParameters(detour=False)
    assert validate_as(Controller, "coupling", {"kind": "clpvds", "v_max": 1}) == ClpvdsController(v_max=1.0)


@pytest.mark.parametrize(
    ("declared", "given", "location", "sentence"),
    [
        (Obstacle, {"kind": "shpere"}, "o.0.kind", "did you mean 'sphere'? Valid: box, ellipsoid, sphere."),
        (Obstacle, {"kind": "sphere", "radius": 1.0}, "o.0.centre", "must be given."),
        (Obstacle, {"kind": "sphere", "centre": [0, 0], "radius": -1}, "o.0.radius", "greater than 0, not -1."),
        (
            Obstacle,
            {"kind": "sphere", "centre": [0, 0], "radius": 1, "velocity": [0, float("nan")]},
            "o.0.velocity.1",
            "finite number, not NaN.",
        ),
        (Avoidance, {"kind": "roas+", "marign": 0.1}, "o.0.marign", "did you mean 'margin'?"),
        (Avoidance, {"kind": "raos+"}, "o.0.kind", "did you mean 'roas+'"),
        (Controller, {"kind": "clpvds", "mode": "papre"}, "o.0.mode", "must be 'paper' or 'robust', not 'papre'."),
    ],
)
def test_tables_of_obstacles_that_are_wrong(
    declared: Any, given: Mapping[str, Any], location: str, sentence: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        validate_as(declared, "o.0", given)
    assert caught.value.location == location
    assert sentence in caught.value.problem


@pytest.mark.parametrize("given", ["roas+", 3, ["roas+"]])
def test_what_is_no_table_is_refused(given: Any) -> None:
    with pytest.raises(ParameterError, match="table") as caught:
        validate_as(Avoidance, "avoidance", given)
    assert caught.value.location == "avoidance"
