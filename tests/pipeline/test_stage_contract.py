"""What a stage is given: random numbers that depend on names only, and the functions that its table names."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.stage import StageContext, load


def context(stage="fit", seed=0, parameters=None):
    return StageContext(stage=stage, parameters=parameters, inputs={}, sources={}, outputs={}, seed=seed)


def drawn(*names, **options):
    return tuple(context(**options).generator(*names).integers(2**63, size=4))


class Replicate:
    def __init__(self, replicate):
        self.replicate = replicate


def test_the_generator_depends_on_seed_stage_replicate_and_names():
    found = [
        drawn(),
        drawn(seed=1),
        drawn(stage="score"),
        drawn(parameters=Replicate(1)),
        drawn("a"),
        drawn("b"),
        drawn("a", "b"),
        drawn("b", "a"),
        drawn("ab"),
        drawn(""),
        drawn(seed=2**32),
        drawn(seed=10**40),
    ]
    assert len(set(found)) == len(found)


def test_the_generator_depends_on_nothing_else():
    assert drawn("a") == drawn("a")
    assert drawn("a", parameters=Replicate(0)) == drawn("a")
    one = context()
    first = one.generator("a").integers(2**63)
    one.generator("b").integers(2**63)
    np.random.default_rng(0).integers(2**63)
    assert one.generator("a").integers(2**63) == first


def test_the_generator_draws_what_it_always_drew():
    """Numbers that committed manifests rest on."""
    assert drawn("lpvds/none/1")[:2] == (7349095935279480103, 2490130531577415525)


def test_the_generator_of_a_stage_that_is_not_random():
    with pytest.raises(RuntimeError, match="stage fit draws random numbers: declare it with random=True"):
        context(seed=None).generator()


def test_warnings():
    one = context()
    one.warn("first.")
    one.warn("second.")
    assert one.warnings == ["first.", "second."]
    assert context().warnings == []


def test_parameters_are_frozen_and_by_keyword(toy):
    (point,) = toy.open().experiment("try").points
    fit = point.parameters["fit"]
    with pytest.raises(AttributeError):
        fit.offset = 3
    with pytest.raises(TypeError):
        type(fit)("mean")


def test_modules_and_implementations(toy):
    project = toy.open()
    stage = project.stage("fit")
    (mean,) = project.experiment("try").points
    (median,) = project.experiment("try", ["fit.kind=median"]).points
    assert stage.modules(mean.parameters["fit"]) == ("toy.fit", "toy.mean")
    assert stage.modules(median.parameters["fit"]) == ("toy.fit", "toy.median")
    assert stage.implementation("median")([3, 1, 2], None, None) == 2
    assert project.stage("read").modules(mean.parameters["read"]) == ("toy.read",)
    assert load("toy.read:STAGE") is project.stage("read")


def test_stages_without_presets_sources_rows_or_figures(toy):
    stage = toy.open().stage("read")
    assert (stage.presets, stage.rows, stage.summarise, stage.warm, stage.random) == ({}, None, None, "", False)
    assert (stage.tables, stage.plots) == (None, "")
    assert toy.open().stage("fit").sources(None, toy.root) == {}
