"""The generic verbs on the toy project: golden output, exit codes, one sentence for what is wrong."""

from __future__ import annotations

import json
import os
import re
import subprocess

import pytest

SECONDS = re.compile(r"\d+\.\d\d s")


def printed(result):
    """Standard output and error, with times blotted out."""
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.stdout, SECONDS.sub("_ s", result.stderr)


def golden(text):
    return text.lstrip("\n")


def said(result, code):
    """The one sentence of an error."""
    assert result.exit_code == code, (result.stdout, result.stderr)
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    return result.stderr.removeprefix("error: ").rstrip("\n")


RESULT = golden(
    """
case  score
one      30
two      30

rows  score
   2     30
"""
)


def test_run(toy):
    result = toy.cli("run", "try")
    assert result.exit_code == 0
    assert printed(result) == (
        RESULT,
        golden(
            """
read      _ s
fit       _ s
score     _ s
runs/try/manifest.json written: commit it with the experiment.
3 stages, 3 computed, 0 cached.
"""
        ),
    )
    result = toy.cli("run", "try")
    assert result.exit_code == 0
    assert printed(result) == (
        RESULT,
        golden(
            """
read      cached
fit       cached
score     cached
runs/try/manifest.json agrees.
3 stages, 0 computed, 3 cached.
"""
        ),
    )


def test_run_quietly(toy):
    assert printed(toy.cli("run", "try", "--quiet")) == (RESULT, "")
    assert printed(toy.cli("run", "try", "-q", "--set", "fit.offset=13"))[1] == (
        "warning: fit: thirteen is an unlucky offset.\n"
    )


def test_run_of_a_sweep(toy):
    result = toy.cli("run", "many", "--jobs", "1", "-v")
    assert printed(result) == (
        golden(
            """
point       case  score
offset=0.0  one      30
offset=0.0  two      30
offset=1.0  one      40
offset=1.0  two      40
offset=2.0  one      50
offset=2.0  two      50

rows  score
   6     30
"""
        ),
        golden(
            """
offset=0.0  read      _ s
offset=1.0  read      cached
offset=2.0  read      cached
offset=0.0  fit       _ s
offset=1.0  fit       _ s
offset=2.0  fit       _ s
offset=0.0  score     _ s
[1/3] offset=0.0  _ s
offset=1.0  score     _ s
[2/3] offset=1.0  _ s
offset=2.0  score     _ s
[3/3] offset=2.0  _ s
runs/many/manifest.json written: commit it with the experiment.
9 stages, 7 computed, 2 cached.
"""
        ),
    )


def test_many_rows_are_shown_by_their_summary(toy, monkeypatch):
    from pipeline import advance

    monkeypatch.setattr(advance, "MOST_ROWS", 5)
    assert printed(toy.cli("run", "many", "--jobs", "1", "-q"))[0] == "rows  score\n   6     30\n"


def test_run_as_json(toy):
    result = toy.cli("run", "try", "--json")
    document = json.loads(result.stdout)
    assert set(document) == {"experiment", "stages", "rows", "summary", "manifest"}
    assert document["experiment"] == "try"
    assert document["manifest"] == "written"
    assert document["summary"] == {"groups": [{"rows": 2, "score": 30.0}]}
    assert document["rows"][0] == {"point": "main", "case": "one", "score": 30.0, "nothing": None}
    assert [(s["name"], s["point"], s["cached"]) for s in document["stages"]] == [
        ("read", "main", False),
        ("fit", "main", False),
        ("score", "main", False),
    ]
    assert all(len(s["key"]) == 64 and s["seconds"] > 0 for s in document["stages"])
    again = json.loads(toy.cli("run", "try", "--json", "--quiet").stdout)
    assert [s["cached"] for s in again["stages"]] == [True, True, True]
    assert again["rows"] == document["rows"]


def test_run_notes_on_the_manifest(toy):
    toy.cli("run", "try")
    overridden = "Options changed the experiment for this call: runs/try/manifest.json is left as it is.\n"
    assert overridden in toy.cli("run", "try", "--seed", "4").stderr
    path = toy.root / "runs" / "try" / "manifest.json"
    path.write_text(re.sub('"digest": "......', '"digest": "000000', path.read_text()))
    differs = (
        "Same keys, other bytes than in runs/try/manifest.json (another processor?): it is kept; "
        "compare with 'clpv verify try', replace it with --record.\n"
    )
    assert differs in toy.cli("run", "try").stderr
    assert "manifest.json written" in toy.cli("run", "try", "--record").stderr
    assert "manifest.json agrees" in toy.cli("run", "try").stderr


def test_dry_run_says_what_would_run_and_runs_nothing(toy):
    toy.cli("run", "many", "--jobs", "1")
    before = toy.objects
    result = toy.cli("run", "many", "--dry-run", "--set", "fit.noise=1", "--force", "read")
    assert result.exit_code == 0
    assert printed(result) == (
        golden(
            """
experiment  point       stage  state    why
many        offset=0.0  read   stale    forced
many        offset=0.0  fit    waiting  waits for numbers
many        offset=0.0  score  waiting  waits for numbers, model
many        offset=1.0  read   stale    forced
many        offset=1.0  fit    waiting  waits for numbers
many        offset=1.0  score  waiting  waits for numbers, model
many        offset=2.0  read   stale    forced
many        offset=2.0  fit    waiting  waits for numbers
many        offset=2.0  score  waiting  waits for numbers, model
"""
        ),
        "",
    )
    assert toy.objects == before
    document = json.loads(toy.cli("run", "try", "--dry-run", "--json").stdout)
    assert [s["state"] for s in document["stages"]] == ["cached", "cached", "cached"]


def test_dry_run_makes_nothing(toy):
    assert toy.cli("run", "try", "--dry-run").exit_code == 0
    assert not (toy.root / "runs" / ".store").exists()


def test_force(toy):
    toy.cli("run", "try")
    assert printed(toy.cli("run", "try", "--force", "fit", "--force", "score"))[1] == golden(
        """
read      cached
fit       _ s
score     _ s
runs/try/manifest.json agrees.
3 stages, 2 computed, 1 cached.
"""
    )


def test_status(toy):
    assert printed(toy.cli("status")) == (
        golden(
            """
experiment  stage  state    at
many        read   new      3 points
many        fit    waiting  3 points
many        score  waiting  3 points
try         read   new      main
try         fit    waiting  main
try         score  waiting  main
"""
        ),
        "",
    )
    toy.cli("run", "try")
    assert printed(toy.cli("status", "try", "--check")) == (
        golden(
            """
experiment  stage  state   at
try         read   cached  main
try         fit    cached  main
try         score  cached  main
"""
        ),
        "",
    )


def test_status_tells_why(toy, monkeypatch):
    from pipeline import key

    toy.cli("run", "try")
    version = key.version("numpy")
    monkeypatch.setattr(key, "version", lambda name: "99.0")
    toy.edit("arithmetic", "result += value", "result -= value")
    toy.experiment("try", "[fit]\noffset = 2\n")
    result = toy.cli("status", "try", "--why")
    assert result.exit_code == 0
    assert printed(result)[0] == golden(
        f"""
experiment  stage  state    at    why
try         read   cached   main
try         fit    stale    main  parameter fit.offset: 0.0 -> 2.0; code: toy.arithmetic.total changed; library numpy: {version} -> 99.0
try         score  waiting  main  waits for model
"""  # noqa: E501
    )


def test_status_check_fails_where_something_is_not_up_to_date(toy):
    assert toy.cli("status", "try", "--check").exit_code == 3
    toy.cli("run", "try")
    assert toy.cli("status", "try", "--check").exit_code == 0
    assert toy.cli("status", "--check").exit_code == 3
    assert toy.cli("status", "try", "--check", "--set", "fit.offset=1").exit_code == 3


def test_status_as_json(toy):
    toy.cli("run", "try", "--set", "fit.offset=1")
    document = json.loads(toy.cli("status", "try", "--json").stdout)
    assert document["current"] is False
    (experiment,) = document["experiments"]
    assert [(s["point"], s["stage"], s["state"], s["reasons"]) for s in experiment["stages"]] == [
        ("main", "read", "cached", []),
        ("main", "fit", "new", []),
        ("main", "score", "waiting", ["waits for model"]),
    ]
    assert [s["key"] is None for s in experiment["stages"]] == [False, False, True]


def test_show(toy):
    toy.cli("run", "try")
    assert printed(toy.cli("show", "try")) == (
        golden(
            """
try: a try
preset robust, seed 0, 1 point(s); shown: main

parameter             value
read.file             numbers.txt
read.scale            1
fit.kind              mean
fit.offset            0
fit.noise             0
fit.weights           -
fit.replicate         0
score.digits          6
score.label           plain
score.mode            robust
score.act
score.cases.0.kind    near
score.cases.0.radius  1
score.strict          yes

stage  state   what
read   cached  reads numbers
fit    cached  fits a number
score  cached  scores the fit

figure        value
read: count       3
fit: model        3
score: score     30
"""
        ),
        "",
    )


def test_show_before_a_run(toy):
    result = toy.cli("show", "many", "--point", "offset=1.0")
    assert result.exit_code == 0
    assert "preset robust, seed 0, 3 point(s); shown: offset=1.0\n" in result.stdout
    assert "fit.offset            1\n" in result.stdout
    assert "read   new      reads numbers\n" in result.stdout


def test_show_a_stage(toy):
    toy.cli("run", "try", "--set", "fit.offset=13")
    result = toy.cli("show", "try", "--stage", "fit", "--set", "fit.offset=13")
    assert re.sub("objects/../[0-9a-f]{64}", "objects/…", result.stdout) == golden(
        """
fit: fits a number
parameter  value
kind       mean
offset     13
noise      0
weights    -
replicate  0

point  artifact  bytes  file
main   model         4  runs/.store/objects/…

figure  value
model      16
"""
    )
    assert result.stderr == "warning: thirteen is an unlucky offset.\n"


def test_show_a_stage_as_csv_and_json(toy):
    toy.cli("run", "many", "--jobs", "1")
    assert toy.cli("show", "many", "--stage", "score", "--csv").stdout == golden(
        """
point,case,score,nothing
offset=0.0,one,30.0,
offset=0.0,two,30.0,
offset=1.0,one,40.0,
offset=1.0,two,40.0,
offset=2.0,one,50.0,
offset=2.0,two,50.0,
"""
    )
    document = json.loads(toy.cli("show", "many", "--stage", "fit", "--point", "offset=2.0", "--json").stdout)
    assert document["parameters"]["offset"] == 2.0
    assert document["metrics"] == [{"point": "offset=2.0", "model": 5.0}]
    assert (document["rows"], document["warnings"], len(document["artifacts"])) == ([], [], 1)
    whole = json.loads(toy.cli("show", "many", "--json").stdout)
    assert [p["id"] for p in whole["points"]] == ["offset=0.0", "offset=1.0", "offset=2.0"]
    assert whole["metrics"] == {"read": {"count": 3}, "fit": {"model": 3.0}, "score": {"score": 30.0}}


def test_list(toy):
    toy.cli("run", "many", "--jobs", "1")
    assert printed(toy.cli("list")) == (
        golden(
            """
many: preset robust, 3 point(s)
    score                                        40
try: preset robust, 1 point(s)
    not run yet: 'clpv run try'
"""
        ),
        "",
    )
    document = json.loads(toy.cli("list", "--json").stdout)
    assert document["experiments"] == [
        {"experiment": "many", "points": 3, "preset": "robust", "figures": {"score": 40.0}},
        {"experiment": "try", "points": 1, "preset": "robust", "figures": {}},
    ]


def test_list_of_nothing(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("CLPV_ROOT", str(tmp_path))
    assert printed(toy.cli("list")) == ("", "There is no experiment yet: make one with 'clpv new NAME'.\n")
    assert printed(toy.cli("status")) == ("", "There is no experiment yet: make one with 'clpv new NAME'.\n")
    assert json.loads(toy.cli("list", "--json").stdout) == {"experiments": []}


def test_diff(toy):
    toy.cli("run", "many", "--jobs", "1")
    toy.cli("run", "try")
    toy.experiment("other", "[fit]\nkind = 'median'\n")
    assert printed(toy.cli("diff", "try", "many")) == (
        golden(
            """
parameter   try  many
fit.offset  0    [0.0, 1.0, 2.0]
figure        try  many   ratio
fit: model      3     4  1.3333
score: score   30    40  1.3333
"""
        ),
        "",
    )
    document = json.loads(toy.cli("diff", "try", "other", "--json").stdout)
    assert {"parameter": "fit.kind", "try": "mean", "other": "median"} in document["parameters"]
    assert {"figure": "fit: model", "try": 3.0, "other": None, "ratio": None} in document["metrics"]
    assert toy.cli("diff", "try", "try").stdout == "try and try have the same parameters and figures.\n"


def test_verify(toy):
    toy.cli("run", "try")
    result = toy.cli("verify", "try")
    assert result.exit_code == 0
    assert printed(result) == (
        "try verified: 3 of 3 stages bit for bit.\n",
        "read      _ s\nfit       _ s\nscore     _ s\n",
    )


def test_verify_with_a_mismatch(toy):
    toy.cli("run", "try")
    toy.edit("arithmetic", "FACTOR = 1.0", "FACTOR = 2.0")
    result = toy.cli("verify", "try", "-q")
    assert said(result, 4) == (
        "try does not agree with its manifest in 2 places: main, fit: model is 6.0, the manifest says 3.0; "
        "main, score: score is 60.0, the manifest says 30.0. "
        "If the change is meant, record it with 'clpv run try --record'."
    )
    result = toy.cli("verify", "try")
    assert "changed since the manifest was written: code: toy.arithmetic.FACTOR changed\n" in result.stderr
    document = json.loads(toy.cli("verify", "try", "--json").stdout)
    assert (document["passed"], document["bitwise"], len(document["mismatches"])) == (False, 1, 2)
    assert toy.cli("run", "try", "--record").exit_code == 0
    assert toy.cli("verify", "try").exit_code == 0


def test_doctor(toy):
    result = toy.cli("doctor")
    assert result.exit_code == 0
    assert re.findall(r"^[a-z ]+?(?=  +ok)", result.stdout, re.MULTILINE) == [
        "python",
        "libraries",
        "processor",
        "store",
        "compiled code",
        "workers",
        "linear algebra",
    ]


def test_doctor_finds_something(toy):
    (toy.root / "runs" / ".store").write_text("")
    result = toy.cli("doctor")
    assert result.exit_code == 1
    assert "FAILED" in result.stdout
    assert result.stderr == "error: store: make the runs folder writable, with a gigabyte to spare.\n"
    assert json.loads(toy.cli("doctor", "--json").stdout)["passed"] is False


ERRORS = {
    ("run", "tyr"): (2, "There is no experiment 'tyr'; did you mean 'try'? Valid: many, try."),
    ("run", "a/b"): (2, "There is no experiment 'a/b'; Valid: many, try."),
    ("run", "try", "--set", "fit.ofset=1"): (
        2,
        "fit.ofset: unknown parameter; did you mean 'offset'? Valid: kind, noise, offset, replicate, weights.",
    ),
    ("run", "try", "--set", "nonsense"): (
        2,
        "--set nonsense: write it as name=value, e.g. --set mixture.alpha=3.",
    ),
    ("run", "try", "--seed", "-1"): (2, "seed: must be a whole number from 0, not -1."),
    ("run", "try", "--force", "scroe"): (
        2,
        "There is no stage 'scroe'; did you mean 'score'? Valid: fit, read, score.",
    ),
    ("run", "try", "--set", "read.file=absent.txt"): (1, "absent.txt: cannot be read: No such file or directory."),
    ("run", "try", "--set", "read.file=source"): (1, "source: cannot be read: Is a directory."),
    ("run", "try", "-q", "--set", "score.act=raise"): (
        1,
        "stage score at main failed with ValueError: no score today. Run again with --debug for the traceback.",
    ),
    ("run", "try", "-q", "--set", "score.act=forget"): (1, "stage score at main did not write its output score."),
    ("status", "tyr"): (2, "There is no experiment 'tyr'; did you mean 'try'? Valid: many, try."),
    ("status", "--set", "fit.ofset=1"): (
        2,
        "runs/many/experiment.toml: fit.ofset: unknown parameter; did you mean 'offset'? "
        "Valid: kind, noise, offset, replicate, weights.",
    ),
    ("show", "many", "--point", "offset=1"): (
        2,
        "many has no point 'offset=1'; did you mean 'offset=1.0'? Valid: offset=0.0, offset=1.0, offset=2.0.",
    ),
    ("show", "try", "--csv"): (2, "--csv needs a stage: add --stage, e.g. --stage evaluate."),
    ("show", "try", "--stage", "scroe"): (
        2,
        "There is no stage 'scroe'; did you mean 'score'? Valid: fit, read, score.",
    ),
    ("show", "try", "--stage", "fit"): (3, "Stage fit of try at main is waiting: run 'clpv run try' first."),
    ("diff", "try", "tyr"): (2, "There is no experiment 'tyr'; did you mean 'try'? Valid: many, try."),
    ("verify", "try"): (2, "runs/try has no manifest to verify against: make it with 'clpv run try'."),
    ("new", "mine", "--template", "toi"): (
        2,
        "There is no template 'toi'; did you mean 'toy'? Valid: empty, toy.",
    ),
}


@pytest.mark.parametrize("arguments", ERRORS, ids=" ".join)
def test_an_error_is_one_sentence(toy, arguments):
    code, sentence = ERRORS[arguments]
    assert said(toy.cli(*arguments), code) == sentence
    assert not (toy.root / "runs" / "mine").exists()
    assert not (toy.root / "runs" / "try" / "manifest.json").exists()


@pytest.mark.parametrize("arguments", [(), ("bogus",), ("run",), ("run", "try", "--jobs", "0"), ("run", "try", "-x")])
def test_usage(toy, arguments):
    result = toy.cli(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr


def test_an_error_with_json_is_a_document_too(toy):
    result = toy.cli("run", "tyr", "--json")
    assert result.exit_code == 2
    assert json.loads(result.stdout) == {"error": result.stderr[len("error: ") : -1], "exit_code": 2}
    assert result.stderr.startswith("error: There is no experiment")


def test_debug_lets_the_traceback_through(toy):
    result = toy.cli("run", "try", "--debug", "-q", "--set", "score.act=raise")
    assert type(result.exception).__name__ == "ExecutionError"
    assert isinstance(result.exception.__cause__, ValueError)


def test_failures_of_a_sweep(toy):
    toy.experiment("many", "[sweep]\n'score.act' = ['raise', '', 'forget']\n")
    result = toy.cli("run", "many", "-q", "--jobs", "1")
    assert result.exit_code == 1
    assert result.stderr == golden(
        """
error: stage score at act=raise failed with ValueError: no score today. Run again with --debug for the traceback.
error: stage score at act=forget did not write its output score.
error: 2 of 3 points failed; the first: stage score at act=raise failed with ValueError: no score today. Run again with --debug for the traceback.
"""  # noqa: E501
    )
    assert not (toy.root / "runs" / "many" / "manifest.json").exists()


def test_a_broken_experiment_among_others_is_named(toy):
    toy.experiment("broken", "[fit]\nofset = 1\n")
    for verb in ("list", "status", "gc"):
        assert said(toy.cli(verb), 2).startswith("runs/broken/experiment.toml: fit.ofset: unknown parameter; ")
    toy.experiment("broken", "[fit")
    assert said(toy.cli("list"), 2).startswith("runs/broken/experiment.toml is not valid TOML: ")
    assert toy.cli("run", "try").exit_code == 0


@pytest.mark.parametrize("verb", [("list",), ("run", "try"), ("verify", "try"), ("status", "try"), ("show", "try")])
def test_a_broken_manifest(toy, verb):
    (toy.root / "runs" / "try" / "manifest.json").write_text("{")
    assert said(toy.cli(*verb), 2) == (
        "runs/try/manifest.json cannot be read as a manifest: restore it, or delete it and run 'clpv run try'."
    )


def test_a_store_that_cannot_be_written(toy, monkeypatch):
    monkeypatch.chdir(toy.root)
    (toy.root / "runs" / ".store").write_text("")
    assert said(toy.cli("run", "try"), 1) == (
        "runs/.store cannot be written (Not a directory): make the runs folder writable, with room to spare."
    )


def test_an_unexpected_error_of_the_system_is_one_sentence(toy, monkeypatch):
    from pipeline import advance

    def fail(*arguments, **options):
        raise PermissionError(13, "Permission denied", "some/file")

    monkeypatch.setattr(advance, "bring_up", fail)
    assert said(toy.cli("run", "try"), 1) == "some/file cannot be read or written: Permission denied."
    assert isinstance(toy.cli("run", "try", "--debug").exception, PermissionError)


def test_a_root_that_is_no_folder(toy, monkeypatch):
    monkeypatch.setenv("CLPV_ROOT", "/no/such/folder")
    assert said(toy.cli("list"), 2) == "CLPV_ROOT names '/no/such/folder', which is no folder."


def test_the_root_is_found_from_below(toy, monkeypatch):
    monkeypatch.delenv("CLPV_ROOT")
    monkeypatch.chdir(toy.root / "runs" / "try")
    assert toy.cli("run", "try").exit_code == 0
    assert (toy.root / "runs" / "try" / "manifest.json").exists()
    monkeypatch.setenv("CLPV_ROOT", "")
    assert "cached" in toy.cli("status", "try").stdout


def test_a_runs_folder_elsewhere(toy, tmp_path, monkeypatch):
    elsewhere = tmp_path / "a folder elsewhere"
    elsewhere.mkdir()
    (toy.root / "runs").rename(elsewhere / "runs")
    (toy.root / "runs").symlink_to(elsewhere / "runs")
    monkeypatch.chdir(tmp_path)
    assert toy.cli("run", "try").exit_code == 0
    assert (elsewhere / "runs" / "try" / "manifest.json").exists()
    assert toy.cli("show", "try", "--stage", "score").exit_code == 0


def test_names_in_any_script(toy):
    toy.experiment("größe-実験", 'description = "ünïcode"\n[score]\nlabel = "☃"\n')
    done = toy.process("run", "größe-実験", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    assert "größe-実験: ünïcode" in toy.cli("show", "größe-実験").stdout
    assert toy.cli("verify", "größe-実験").exit_code == 0
    (toy.root / "runs" / "größe-実験" / "manifest.json").read_text(encoding="ascii")


def test_completion_of_names(toy, monkeypatch):
    from pipeline.cli import complete_name

    monkeypatch.chdir(toy.root / "runs")
    assert complete_name("") == ["many", "try"]
    assert complete_name("t") == ["try"]


@pytest.mark.parametrize("buffered", [True, False])
@pytest.mark.parametrize("arguments", [("list",), ("status", "--json")])
def test_a_reader_that_goes_away(toy, arguments, buffered):
    """What is buffered meets the closed pipe at the end only."""
    reading, writing = os.pipe()
    os.close(reading)
    environment = toy.environment() | {"PYTHONUNBUFFERED": "" if buffered else "1"}
    with os.fdopen(writing, "w") as closed:
        done = subprocess.run(
            toy.command(*arguments), env=environment, stdout=closed, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (1, "")


def test_a_pool_from_the_command_line_gives_what_one_process_gives(toy, tmp_path):
    pool = toy.process("run", "many", "--jobs", "2", "--json", "--quiet")
    (toy.root / "runs" / ".store").rename(tmp_path / "away")
    alone = toy.process("run", "many", "--jobs", "1", "--json", "--quiet")
    assert (pool.returncode, pool.stderr, alone.stderr) == (0, "", "")
    first, second = json.loads(pool.stdout), json.loads(alone.stdout)
    assert (first.pop("manifest"), second.pop("manifest")) == ("written", "unchanged")
    for stage in (*first["stages"], *second["stages"]):
        del stage["seconds"]
    assert first == second


@pytest.mark.parametrize("arguments", [("run", "try"), ("run", "many", "--jobs", "2")])
def test_on_a_terminal(toy, arguments):
    """Progress is drawn and removed again; the table stays."""
    import pty

    master, slave = pty.openpty()
    environment = toy.environment() | {"TERM": "xterm", "COLUMNS": "80"}
    del environment["NO_COLOR"]
    process = subprocess.Popen(toy.command(*arguments), env=environment, stdin=slave, stdout=slave, stderr=slave)
    os.close(slave)
    shown = b""
    while True:
        try:
            chunk = os.read(master, 65536)
        except OSError:
            break
        if not chunk:
            break
        shown += chunk
    os.close(master)
    assert process.wait(timeout=30) == 0
    text = shown.decode()
    assert "score" in text
    assert "─" in text
    assert "Traceback" not in text
    assert "manifest.json written" in text
