"""Several mixtures to choose between: which there are, and the artifacts that hold them, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import hook

from pipeline.errors import DataError
from stages.artifacts.mixture import (
    read_assignments,
    read_mixtures,
    read_sampler,
    write_assignments,
    write_mixture,
    write_sampler,
)
from stages.mixture import stage
from stages.mixture.auto import fit_auto
from stages.mixture.em import fit_em
from stages.mixture.fit import MixtureFit
from stages.mixture.gaussian import GaussianMixture, responsibilities
from stages.mixture.parameters import AutoParameters, EmParameters, PcGmmParameters
from stages.mixture.pcgmm import fit_pcgmm

QUICK = AutoParameters(components=(4, 6), points=90, sweeps=6)
Data = tuple[np.ndarray, np.ndarray, np.ndarray]


def data(d: int = 2) -> Data:
    demonstrations = hook(d)
    position, velocity = (
        np.concatenate([getattr(one, name) for one in demonstrations]) for name in ("position", "velocity")
    )
    return position, velocity, np.array([len(one.time) for one in demonstrations])


def fit(given: Data, parameters: AutoParameters = QUICK, seed: int = 0) -> dict[str, MixtureFit]:
    return fit_auto(*given, parameters, np.random.default_rng(seed))


def identical(one: GaussianMixture, other: GaussianMixture) -> bool:
    names = ("weights", "means", "covariances")
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names)


@pytest.mark.parametrize("d", [2, 3])
def test_the_candidates_and_their_names(d: int) -> None:
    found = fit(data(d))
    assert list(found) == ["pcgmm", "em-4", "em-6"]
    assert [found[f"em-{K}"].mixture.components for K in (4, 6)] == [4, 6]
    for one in found.values():
        assert one.mixture.dimension == d
        assert len(one.sampled) <= 90
    assert found["pcgmm"].log_posterior.shape == (1, 6)
    assert list(fit(data(d), AutoParameters(components=(), points=60, sweeps=3))) == ["pcgmm"]


def test_a_candidate_is_what_its_own_way_of_fitting_finds() -> None:
    found, generator = fit(data()), np.random.default_rng(0)
    alone = fit_pcgmm(*data(), PcGmmParameters(points=90, sweeps=6), generator)
    assert identical(found["pcgmm"].mixture, alone.mixture)
    for K in (4, 6):
        plain = EmParameters(components=K, restarts=1, points=90)
        assert identical(found[f"em-{K}"].mixture, fit_em(*data(), plain, generator).mixture)


def test_too_few_different_points_leave_em_out() -> None:
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 2.0]])
    few: Data = (np.repeat(corners, 8, axis=0), np.ones((40, 2)), np.array([40]))
    found = fit(few, AutoParameters(components=(3, 6), points=40, sweeps=3))
    assert list(found) == ["pcgmm", "em-3"]
    with pytest.raises(DataError, match="all points are the same"):
        fit((np.ones((40, 2)), np.ones((40, 2)), np.array([40])))


def test_the_same_seed_gives_the_same_bytes() -> None:
    one, two, other = fit(data()), fit(data()), fit(data(), seed=1)
    for name in one:
        assert identical(one[name].mixture, two[name].mixture)
        assert one[name].log_posterior.tobytes() == two[name].log_posterior.tobytes()
    assert not all(np.array_equal(one[name].log_posterior, other[name].log_posterior) for name in one)


# Artifacts.


@pytest.mark.parametrize("d", [2, 3])
def test_mixtures_come_back_to_the_last_bit(tmp_path: Path, d: int) -> None:
    mixtures = {name: one.mixture for name, one in fit(data(d)).items()}
    for file in ("a.parquet", "b.parquet"):
        write_mixture(tmp_path / file, mixtures, {"kind": "auto"})
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    back = read_mixtures(tmp_path / "a.parquet")
    assert list(back) == list(mixtures)
    assert all(identical(back[name], mixtures[name]) for name in mixtures)
    # One that is alone, by whatever name and of one component, as well.
    alone = {"em": GaussianMixture(weights=[1.0], means=[np.full(d, 0.1)], covariances=[np.eye(d) / 3.0])}
    write_mixture(tmp_path / "c.parquet", alone, {})
    back = read_mixtures(tmp_path / "c.parquet")
    assert list(back) == ["em"]
    assert identical(back["em"], alone["em"])


def test_assignments_are_told_apart_by_candidate(tmp_path: Path) -> None:
    given = data()
    fits = fit(given)
    gammas = {name: responsibilities(one.mixture, given[0]) for name, one in fits.items()}
    write_assignments(tmp_path / "assignments.parquet", gammas, fits)
    columns = read_assignments(tmp_path / "assignments.parquet")
    n = len(given[0])
    assert len(columns["sample"]) == 3 * n
    for name, one in fits.items():
        own = columns["candidate"] == name
        np.testing.assert_array_equal(columns["sample"][own], np.arange(n))
        np.testing.assert_array_equal(columns["component"][own], gammas[name].argmax(axis=1))
        np.testing.assert_array_equal(columns["responsibility"][own], gammas[name].max(axis=1))
        np.testing.assert_array_equal(np.flatnonzero(columns["sampled"][own]), one.sampled)
        np.testing.assert_array_equal(columns["table"][own][one.sampled], one.labels)
        assert (columns["table"][own][~columns["sampled"][own].astype(bool)] == -1).all()


def test_the_sampler_comes_back_by_candidate_and_chain(tmp_path: Path) -> None:
    given = data()
    chains = fit_pcgmm(*given, PcGmmParameters(points=60, sweeps=5, chains=3), np.random.default_rng(0))
    plain = fit_em(*given, EmParameters(max_components=4, points=60), np.random.default_rng(0))
    fits = {"pcgmm": chains, "em": plain}
    write_sampler(tmp_path / "sampler.parquet", fits)
    columns, criteria = read_sampler(tmp_path / "sampler.parquet")
    for name, one in fits.items():
        own = columns["candidate"] == name
        shape = one.log_posterior.shape
        assert columns["log_posterior"][own].tobytes() == one.log_posterior.tobytes()
        np.testing.assert_array_equal(columns["components"][own].reshape(shape), one.components_by_sweep)
        rows, sweeps = np.indices(shape)
        np.testing.assert_array_equal(columns["chain"][own], rows.ravel())
        np.testing.assert_array_equal(columns["sweep"][own], sweeps.ravel())
    assert columns["chain"][columns["candidate"] == "pcgmm"].max() == 2
    assert criteria == {"pcgmm": {}, "em": plain.criterion}
    assert list(plain.criterion) == [1, 2, 3, 4]


def test_the_stage_says_what_there_is(tmp_path: Path) -> None:
    fits = stage.by_name("auto", fit(data()))
    outputs = {name: tmp_path / f"{name}.parquet" for name in ("mixture", "sampler")}
    write_mixture(outputs["mixture"], {name: one.mixture for name, one in fits.items()}, {})
    write_sampler(outputs["sampler"], fits)
    said: dict[str, Any] = dict(stage.headline(outputs))
    counts = {f"components_{name}": one.mixture.components for name, one in fits.items()}
    assert {name: said[name] for name in counts} == counts
    assert said["burn_in_sweeps"] <= 3.0
    rows = stage.rows(outputs)
    assert len(rows) == sum(counts.values())
    assert [row["candidate"] for row in rows] == [name for name, one in fits.items() for _ in one.mixture.weights]
    assert stage.by_name("em", fits["em-4"]) == {"em": fits["em-4"]}
