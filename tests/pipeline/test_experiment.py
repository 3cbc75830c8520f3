"""Experiment files: presets, overrides, sweeps, and what is refused with which sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import EXIT_USAGE, ParameterError, UsageError
from pipeline.experiment import experiment_names, find_root, parse_override

TWO_CASES = 'score.cases=[{kind = "near"}, {kind = "far"}]'


def only(toy, sets=(), **options):
    """The parameters of the only point of the toy experiment."""
    (point,) = toy.open().experiment("try", sets, **options).points
    return point


def refusal(toy, *sets, name="try", seed=None):
    with pytest.raises(UsageError) as caught:
        toy.open().experiment(name, sets, seed)
    assert caught.value.exit_code == EXIT_USAGE
    return str(caught.value)


def test_defaults_and_description(toy):
    experiment = toy.open().experiment("try")
    assert (experiment.name, experiment.description, experiment.preset) == ("try", "a try", "robust")
    assert experiment.manifest_path == toy.root / "runs" / "try" / "manifest.json"
    assert not experiment.overridden
    (point,) = experiment.points
    assert (point.id, point.seed, dict(point.overrides)) == ("main", 0, {})
    assert point.parameters["fit"].kind == "mean"
    assert point.parameters["score"].mode == "robust"


def test_an_empty_file_is_an_experiment_with_defaults(toy):
    toy.experiment("empty", "")
    experiment = toy.open().experiment("empty")
    assert (experiment.description, experiment.preset, len(experiment.points)) == ("", "robust", 1)


def test_preset_sets_below_the_file(toy):
    assert only(toy, ["preset=paper"]).parameters["fit"].offset == 0.5
    assert only(toy, ["preset=paper"]).parameters["score"].mode == "paper"
    toy.experiment("try", 'preset = "paper"\n[fit]\noffset = 3\n')
    point = only(toy)
    assert (point.parameters["fit"].offset, point.parameters["score"].mode) == (3.0, "paper")


def test_preset_speaks_only_of_its_own_kind(toy):
    toy.experiment("try", 'preset = "paper"\n[fit]\nkind = "median"\n')
    assert only(toy).parameters["fit"].kind == "median"


def test_preset_of_a_table_in_a_table():
    from pipeline.experiment import _with_preset

    preset = {"a": 1, "inner": {"kind": "x", "b": 2, "c": 3}, "other": {"d": 4}}
    assert _with_preset({}, preset) == preset
    assert _with_preset({"inner": {"b": 5}}, preset)["inner"] == {"kind": "x", "b": 5, "c": 3}
    assert _with_preset({"inner": {"kind": "y", "b": 5}}, preset)["inner"] == {"kind": "y", "b": 5}
    assert _with_preset({"inner": 3}, preset) == {"a": 1, "inner": 3, "other": {"d": 4}}
    assert preset == {"a": 1, "inner": {"kind": "x", "b": 2, "c": 3}, "other": {"d": 4}}


def test_override_of_dotted_names_and_list_indexes(toy):
    point = only(toy, [TWO_CASES, "score.cases.1.distance=7", "score.cases.0.radius=2", "fit.weights=[1, 2.5]"])
    near, far = point.parameters["score"].cases
    assert (near.radius, far.distance, far.share) == (2.0, 7.0, 0.5)
    assert point.parameters["fit"].weights == (1.0, 2.5)


def test_later_override_wins_and_marks_the_experiment(toy):
    experiment = toy.open().experiment("try", ["fit.offset=1", "fit.offset=2"])
    assert experiment.overridden
    assert experiment.points[0].parameters["fit"].offset == 2.0


def test_seed_option(toy):
    assert only(toy, seed=5).seed == 5
    assert only(toy, ["seed=4"], seed=5).seed == 5
    assert only(toy, seed=10**40).seed == 10**40
    assert toy.open().experiment("try", seed=0).overridden


@pytest.mark.parametrize(
    ("text", "location", "value"),
    [
        ("a.b=3", "a.b", 3),
        ("a.b=3.0", "a.b", 3.0),
        (" a.b = true ", "a.b", True),
        ("a.b=Angle", "a.b", "Angle"),
        ('a.b="3"', "a.b", "3"),
        ("a.b=[1, 2]", "a.b", [1, 2]),
        ("a.b={c = 1}", "a.b", {"c": 1}),
        ("a.b=", "a.b", ""),
        ("a.b=c=d", "a.b", "c=d"),
        ("a.b=1\nc = 2", "a.b", "1\nc = 2"),
        ("a.b=2020-01-01", "a.b", "2020-01-01"),
        ("a.b=2020-01-01T10:00:00", "a.b", "2020-01-01T10:00:00"),
        ("a.b=10:00:00", "a.b", "10:00:00"),
        ("a.b=größe", "a.b", "größe"),
        ("a.b=" + "1" * 5000, "a.b", "1" * 5000),
    ],
)
def test_parse_override(text, location, value):
    found = parse_override(text)
    assert found == (location, value)
    assert type(found[1]) is type(value)


@pytest.mark.parametrize("text", ["", "a.b", "=3", "  = 3"])
def test_override_needs_a_name_and_a_value(text):
    with pytest.raises(UsageError, match="write it as name=value, e"):
        parse_override(text)


REFUSALS = {
    # names
    "fti.offset=1": "fti.offset: unknown stage or key; did you mean 'fit'? "
    "Valid: description, fit, preset, read, score, seed.",
    "fit.ofset=1": "fit.ofset: unknown parameter; did you mean 'offset'? "
    "Valid: kind, noise, offset, replicate, weights.",
    "fit.=3": "fit.: unknown parameter; Valid: kind, noise, offset, replicate, weights.",
    "fit.kind=maen": "fit.kind: there is no kind 'maen'; did you mean 'mean'? Valid: mean, median.",
    "fit.kind=[1]": "fit.kind: there is no kind [1]; Valid: mean, median.",
    'fit={kind = "median", offset = 1}': "fit.offset: unknown parameter; Valid: kind, rounds.",
    "preset=papr": "preset: there is no preset 'papr'; did you mean 'paper'? Valid: paper, robust.",
    "preset=[1]": "preset: there is no preset [1]; Valid: paper, robust.",
    # types
    "fit=3": "fit: must be a table of parameters.",
    "fit.offset=x": 'fit.offset: should be a valid number, not "x".',
    "fit.offset=true": "fit.offset: should be a valid number, not true.",
    "fit.offset=2020-01-01": 'fit.offset: should be a valid number, not "2020-01-01".',
    "fit.weights=3": "fit.weights: should be a valid array, not 3.",
    "fit.weights=[1, 2, 'a']": 'fit.weights.2: should be a valid number, not "a".',
    "score.digits=1.0": "score.digits: should be a valid integer, not 1.0.",
    "score.strict=1": "score.strict: should be a valid boolean, not 1.",
    "score.label=3": "score.label: should be a valid string, not 3.",
    "score.mode=papr": "score.mode: must be 'paper' or 'robust', not 'papr'.",
    "score.cases=[3]": "score.cases.0: should be a table, not 3.",
    "score.cases=[{radius = 1}]": "score.cases.0.kind: must be given.",
    "score.cases=[{kind = 'near'}, {kind = 'fra'}]": "score.cases.1.kind: there is no kind 'fra'; "
    "did you mean 'far'? Valid: far, near.",
    "score.cases=[{kind = 'far', shrae = 1}]": "score.cases.0.shrae: unknown parameter; did you mean 'share'? "
    "Valid: distance, kind, share.",
    "seed=-1": "seed: must be a whole number from 0, not -1.",
    "seed=1.5": "seed: must be a whole number from 0, not 1.5.",
    "seed=true": "seed: must be a whole number from 0, not True.",
    "description=3": "description: must be a text.",
    "description.x=3": "description.x: description is a value and has no parts.",
    # values
    "fit.offset=nan": "fit.offset: should be a finite number, not NaN.",
    "fit.offset=-inf": "fit.offset: should be a finite number, not -Infinity.",
    "fit.offset=1e999": "fit.offset: should be a finite number, not Infinity.",
    "fit.offset=1" + "0" * 400: "fit.offset: should be a finite number, not 1" + "0" * 59 + "….",
    "fit.noise=-1": "fit.noise: should be greater than or equal to 0, not -1.",
    "read.scale=0": "read.scale: should be greater than 0, not 0.",
    "score.cases=[{kind = 'far', share = 2}]": "score.cases.0.share: should be less than or equal to 1, not 2.",
    # overrides of lists
    "score.cases.0.radius=1": 'score.cases: should be a valid array, not {"0": {"radius": 1}}.',
    "sweep.fit.offset=[1]": "sweep.fit.offset: unknown stage or key; did you mean 'seed'? "
    "Valid: description, fit, preset, read, score, seed.",
}


@pytest.mark.parametrize("given", REFUSALS, ids=lambda text: text[:40])
def test_refusal_names_the_place_and_the_remedy(toy, given):
    assert refusal(toy, given) == REFUSALS[given]


def test_parameter_error_keeps_its_location(toy):
    with pytest.raises(ParameterError) as caught:
        toy.open().experiment("try", ["fit.ofset=1"])
    assert caught.value.location == "fit.ofset"


@pytest.mark.parametrize("index", ["2", "-1", "x", ""])
def test_list_index_out_of_range(toy, index):
    location = f"score.cases.{index}.radius"
    message = f"{location}: score.cases is a list of 2: number its items from 0."
    assert refusal(toy, TWO_CASES, f"{location}=1") == message


def test_list_item_below_a_value(toy):
    message = refusal(toy, TWO_CASES, "score.cases.0.radius.x=1")
    assert message == 'score.cases.0.radius: should be a valid number, not {"x": 1}.'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mixture = 3", "mixture: unknown table or key; Valid: description, fit, preset, read, score, seed, sweep."),
        ("[scroe]", "scroe: unknown table or key; did you mean 'score'? "),
        ("[fit]\nofset = 1", "fit.ofset: unknown parameter; did you mean 'offset'? "),
        ("[fit", "runs/try/experiment.toml is not valid TOML: "),
        ("seed = 1\nseed = 2", "runs/try/experiment.toml is not valid TOML: Cannot overwrite a value"),
        ("seed = " + "9" * 5000, "runs/try/experiment.toml is not valid TOML: "),
        ("seed = " + "[" * 5000, "runs/try/experiment.toml is not valid TOML: "),
        ("sweep = 3", "sweep: must be a table from dotted parameter names to lists."),
        ("[sweep]\nfit.offset = 3", "sweep.fit.offset: must be a list with at least one value."),
        ("[sweep]\nfit.offset = []", "sweep.fit.offset: must be a list with at least one value."),
        ("[sweep]\nfit.offset = [1, 2, 1]", "sweep.fit.offset: names a value twice."),
        (
            "[sweep]\n" + "".join(f"a.b{n} = [1,2,3,4,5,6,7,8,9,10]\n" for n in range(30)),
            f"sweep: has 1{'0' * 30} points; at most 10000 are taken.",
        ),
        ("[sweep]\nfit.ofset = [1]", "fit.ofset: unknown parameter; did you mean 'offset'? "),
        ("[sweep]\nfti.offset = [1]", "fti.offset: unknown stage or key; did you mean 'fit'? "),
        ("[sweep]\npreset = ['papr']", "preset: there is no preset 'papr'; did you mean 'paper'? "),
        ("[sweep]\nseed = [-1]", "seed: must be a whole number from 0, not -1."),
        ("[sweep]\ndescription = ['a']", "description: unknown stage or key; Valid: fit, preset, read, score, seed."),
    ],
    ids=lambda text: text[:30].replace("\n", " "),
)
def test_refusal_of_a_file(toy, text, message):
    toy.experiment("try", text)
    assert refusal(toy).startswith(message)


def test_a_file_with_a_byte_order_mark_and_other_line_ends(toy):
    (toy.root / "runs" / "try" / "experiment.toml").write_bytes(b"\xef\xbb\xbf[fit]\r\noffset = 2\r\n")
    assert only(toy).parameters["fit"].offset == 2.0


def test_file_that_is_not_text(toy):
    (toy.root / "runs" / "try" / "experiment.toml").write_bytes(b"\xff\xfe")
    assert refusal(toy).startswith("runs/try/experiment.toml is not valid TOML: ")


def test_folder_in_place_of_the_file(toy):
    toy.experiment("try", "").unlink()
    (toy.root / "runs" / "try" / "experiment.toml").mkdir()
    assert refusal(toy) == "runs/try/experiment.toml cannot be read: Is a directory."


@pytest.mark.parametrize("name", ["tyr", "a/b", "../try", "", ".store", "größe"])
def test_unknown_experiment(toy, name):
    hint = "did you mean 'try'? " if name in ("tyr", "../try") else ""
    assert refusal(toy, name=name) == f"There is no experiment {name!r}; {hint}Valid: many, try."


def test_no_experiment_at_all(toy):
    for name in ("try", "many"):
        (toy.root / "runs" / name / "experiment.toml").unlink()
    assert refusal(toy) == "There is no experiment 'try', nor any other: make one with 'clpv new NAME'."


def test_names_are_sorted_and_may_be_unicode_or_links(toy):
    toy.experiment("größe", "")
    (toy.root / "runs" / "linked").symlink_to(toy.root / "runs" / "try")
    (toy.root / "runs" / "dangling").symlink_to(toy.root / "nothing")
    (toy.root / "runs" / "no-experiment").mkdir()
    assert experiment_names(toy.root) == ["größe", "linked", "many", "try"]
    assert toy.open().experiment("linked").description == "a try"


def test_sweep_is_a_grid_with_the_last_axis_fastest(toy):
    toy.experiment("try", '[sweep]\n"fit.offset" = [1.5, 2]\nscore.label = ["a", "b"]\n')
    points = toy.open().experiment("try").points
    assert [p.id for p in points] == [
        "offset=1.5,label=a",
        "offset=1.5,label=b",
        "offset=2,label=a",
        "offset=2,label=b",
    ]
    assert [p.parameters["fit"].offset for p in points] == [1.5, 1.5, 2.0, 2.0]
    assert points[1].overrides == {"fit.offset": 1.5, "score.label": "b"}


def test_sweep_names_are_long_where_short_ones_are_not_clear(toy):
    toy.experiment(
        "try",
        '[score]\ncases = [{kind = "near"}]\n'
        '[sweep]\nfit.kind = ["mean"]\n"score.cases.0.kind" = ["near"]\n"score.cases.0.radius" = [1, 2]\n',
    )
    points = toy.open().experiment("try").points
    assert [p.id for p in points] == [f"fit.kind=mean,score.cases.0.kind=near,radius={radius}" for radius in (1, 2)]
    assert [p.parameters["score"].cases[0].radius for p in points] == [1.0, 2.0]


def test_sweep_over_seed_and_preset(toy):
    toy.experiment("try", '[sweep]\nseed = [0, 3]\npreset = ["robust", "paper"]\n')
    points = toy.open().experiment("try").points
    assert [(p.id, p.seed, p.parameters["fit"].offset) for p in points] == [
        ("seed=0,preset=robust", 0, 0.0),
        ("seed=0,preset=paper", 0, 0.5),
        ("seed=3,preset=robust", 3, 0.0),
        ("seed=3,preset=paper", 3, 0.5),
    ]


def test_sweep_of_lists_tables_and_texts(toy):
    toy.experiment("try", "[sweep]\nfit.weights = [[1, 2], [3]]\nscore.label = ['a b', '1/2', 2020-01-01]\n")
    points = toy.open().experiment("try").points
    assert [p.id for p in points][:3] == [
        "weights=[1, 2],label=a b",
        "weights=[1, 2],label=1/2",
        "weights=[1, 2],label=2020-01-01",
    ]
    assert points[2].parameters["score"].label == "2020-01-01"


def test_points_that_would_share_a_name_are_refused(toy):
    toy.experiment("try", "[sweep]\nscore.label = ['1,file=2', '1']\nread.file = ['2', '2,file=2']\n")
    message = "sweep: two of its points would be called 'label=1,file=2,file=2': write the values apart."
    assert refusal(toy) == message


def test_an_axis_that_the_command_line_sets_is_no_axis(toy):
    experiment = toy.open().experiment("many", ["fit.offset=7"])
    (point,) = experiment.points
    assert (point.id, point.parameters["fit"].offset, experiment.overridden) == ("main", 7.0, True)
    toy.experiment("many", "[sweep]\nseed = [1, 2]\nfit.offset = [0, 1]\n")
    points = toy.open().experiment("many", seed=9).points
    assert [(p.id, p.seed) for p in points] == [("offset=0", 9), ("offset=1", 9)]


def test_override_of_another_parameter_holds_at_every_point(toy):
    points = toy.open().experiment("many", ["score.digits=2"]).points
    assert [(p.parameters["fit"].offset, p.parameters["score"].digits) for p in points] == [(0, 2), (1, 2), (2, 2)]


def test_root_is_found_upward(toy, tmp_path):
    below = toy.root / "runs" / "try" / "deep" / "er"
    below.mkdir(parents=True)
    assert find_root(below) == toy.root
    assert find_root(toy.root) == toy.root
    assert find_root(tmp_path) == tmp_path


def test_the_nearest_root_wins(toy):
    inner = toy.root / "inner"
    (inner / "runs" / "own").mkdir(parents=True)
    assert find_root(inner) == toy.root
    (inner / "runs" / "own" / "experiment.toml").write_text("")
    assert find_root(inner) == inner


def test_resolving_does_not_change_what_it_is_given(toy):
    from pipeline.experiment import resolve

    document = {"fit": {"offset": 1}, "sweep": {"fit": {"noise": [0, 1]}}}
    stages = list(toy.open().stages.values())
    resolve("x", Path("x"), document, stages, [("fit.offset", 2)])
    assert document == {"fit": {"offset": 1}, "sweep": {"fit": {"noise": [0, 1]}}}
