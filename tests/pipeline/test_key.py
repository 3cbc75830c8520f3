"""The stage key: every component counts, and differences are told in sentences."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from pipeline import key as keys
from pipeline import stage as contract
from pipeline.key import differences, stage_key

SOURCES = {"numbers.txt": "1" * 64}
INPUTS = {"numbers": "2" * 64}


def fit_key(toy, sets=(), seed=None, inputs=INPUTS, sources=SOURCES):
    """Key of the toy's stage fit."""
    project = toy.open()
    (point,) = project.experiment("try", sets, seed).points
    return stage_key(project.stage("fit"), point, inputs, sources)


def told(before, after):
    """Differences, the components before having been to the manifest and back."""
    components = json.loads(json.dumps(before.components))
    return differences(components, after, json.loads(json.dumps(before.definitions)))


def test_components(toy):
    found = fit_key(toy)
    assert len(found.value) == 64
    assert set(found.components) == {
        "contract",
        "stage",
        "code",
        "parameters",
        "inputs",
        "sources",
        "libraries",
        "python",
        "seed",
    }
    assert found.components["parameters"] == {
        "kind": "mean",
        "offset": 0.0,
        "noise": 0.0,
        "weights": None,
        "replicate": 0,
    }
    assert list(found.components["libraries"]) == ["numpy"]
    assert fit_key(toy) == found


def test_a_parameter(toy):
    before, after = fit_key(toy), fit_key(toy, ["fit.offset=2", "fit.weights=[1]"])
    assert after.value != before.value
    assert told(before, after) == ["parameter fit.offset: 0.0 -> 2.0", "parameter fit.weights: None -> [1.0]"]
    assert told(before, before) == []


def test_a_whole_number_for_a_float_is_the_same_parameter(toy):
    assert fit_key(toy, ["fit.offset=2"]).value == fit_key(toy, ["fit.offset=2.0"]).value
    toy.experiment("try", "[fit]\noffset = 0\n")
    before = fit_key(toy)
    toy.experiment("try", "")
    assert fit_key(toy).value == before.value


def test_another_kind(toy):
    before, after = fit_key(toy), fit_key(toy, ["fit.kind=median"])
    assert told(before, after) == [
        "parameter fit.kind: 'mean' -> 'median'",
        "parameter fit.offset: 0.0 -> absent",
        "parameter fit.noise: 0.0 -> absent",
        "parameter fit.weights: None -> absent",
        "parameter fit.replicate: 0 -> absent",
        "parameter fit.rounds: absent -> 1",
        "code: toy.arithmetic is no longer used",
        "code: toy.mean is no longer used",
        "code: toy.median is new",
        "code: toy.ordering is new",
    ]


def test_a_new_default_counts_though_the_module_does_not(toy):
    before = fit_key(toy)
    toy.edit("parameters", "offset: float = 0.0", "offset: float = 1.0")
    assert told(before, fit_key(toy)) == ["parameter fit.offset: 0.0 -> 1.0"]


def test_a_parameter_of_another_stage_does_not_count(toy):
    assert fit_key(toy, ["score.digits=2", "read.scale=3"]).value == fit_key(toy).value


def test_the_code(toy):
    before = fit_key(toy)
    toy.edit("arithmetic", "result += value", "result -= value")
    after = fit_key(toy)
    assert after.value != before.value
    assert told(before, after) == ["code: toy.arithmetic.total changed"]
    assert differences(before.components, after, None) == ["code: changed"]


def test_inputs_and_sources(toy):
    before = fit_key(toy)
    after = fit_key(toy, inputs={"numbers": "3" * 64}, sources={"other.txt": "1" * 64})
    assert told(before, after) == ["input numbers changed", "source numbers.txt changed", "source other.txt changed"]
    assert fit_key(toy, inputs={"numbers": "3" * 64}).value != before.value
    assert fit_key(toy, sources={"numbers.txt": "3" * 64}).value != before.value


def test_the_seed_where_the_stage_is_random(toy):
    before = fit_key(toy, seed=1)
    assert told(before, fit_key(toy, seed=2)) == ["seed: 1 -> 2"]
    toy.edit("fit", "random=True,", "random=False,")
    assert fit_key(toy, seed=1).value == fit_key(toy, seed=2).value
    assert fit_key(toy).components["seed"] is None


def test_libraries_python_and_contract(toy, monkeypatch):
    before = fit_key(toy)
    monkeypatch.setattr(keys, "version", lambda name: "0.0.1")
    numpy = before.components["libraries"]["numpy"]
    assert told(before, fit_key(toy)) == [f"library numpy: {numpy} -> 0.0.1"]
    monkeypatch.setattr(keys, "version", lambda name: numpy)
    monkeypatch.setattr(keys, "CONTRACT", contract.CONTRACT + 1)
    monkeypatch.setattr(keys, "sys", SimpleNamespace(version_info=SimpleNamespace(major=3, minor=99)))
    after = fit_key(toy)
    python = before.components["python"]
    assert told(before, after) == [
        f"python: {python} -> 3.99",
        f"contract: {contract.CONTRACT} -> {contract.CONTRACT + 1}",
    ]
    assert after.value != before.value


def test_a_library_that_is_not_installed():
    assert keys.version("no-such-distribution") == "absent"


def test_the_stage_name(toy):
    before = fit_key(toy)
    toy.edit("fit", 'name="fit"', 'name="fitting"')
    toy.edit("cli", "[fit]", "[fitting]")
    project = toy.open()
    (point,) = project.experiment("try").points
    after = stage_key(project.stage("fitting"), point, INPUTS, SOURCES)
    assert after.value != before.value


@pytest.mark.parametrize("part", ["parameters", "code", "inputs", "sources", "libraries", "python", "seed"])
def test_a_record_that_lacks_a_part_differs(toy, part):
    found = fit_key(toy, seed=1)
    components = {name: value for name, value in found.components.items() if name != part}
    assert differences(components, found, found.definitions) != []
