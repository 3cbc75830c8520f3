"""Plain values: canonical JSON, digests, flat names."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.values import canonical, digest, flatten, plain

LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
TREES = st.recursive(LEAVES, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=12)


@dataclass(frozen=True)
class Inner:
    x: tuple[float, ...]


@dataclass(frozen=True)
class Outer:
    a: int
    inner: Inner
    many: tuple[Inner, ...] = ()


def test_plain():
    assert plain(Outer(1, Inner((1.0, 2.0)), (Inner(()),))) == {
        "a": 1,
        "inner": {"x": [1.0, 2.0]},
        "many": [{"x": []}],
    }


def test_canonical_is_sorted_and_ascii():
    assert canonical({"b": (1, 2.0), "a": "ä"}) == '{"a":"\\u00e4","b":[1,2.0]}'


def test_canonical_refuses_what_is_not_finite():
    with pytest.raises(ValueError, match="Out of range"):
        canonical({"a": float("nan")})


def test_digest_is_that_of_the_text():
    assert digest({}) == "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"


@given(TREES)
def test_digest_depends_on_the_value_only(value):
    def reversed_keys(tree):
        if isinstance(tree, dict):
            return {key: reversed_keys(tree[key]) for key in reversed(tree)}
        return [reversed_keys(item) for item in tree] if isinstance(tree, list) else tree

    assert digest(reversed_keys(value)) == digest(value)
    assert plain(plain(value)) == plain(value)


def test_numbers_of_different_type_differ():
    assert len({digest(1), digest(1.0), digest(True), digest("1")}) == 4


def test_flatten():
    value = {"a": {"b": 1, "c": {}}, "many": [{"x": 1}, {"x": [1, 2]}], "numbers": [1, 2], "none": None, "empty": []}
    assert flatten(value) == {
        "a.b": 1,
        "a.c": {},
        "many.0.x": 1,
        "many.1.x": [1, 2],
        "numbers": [1, 2],
        "none": None,
        "empty": [],
    }
