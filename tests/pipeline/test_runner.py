"""Runs: what is computed and what is not, failures, interruptions, and the same bytes every time."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from pipeline.errors import EXIT_FAILED, EXIT_USAGE, ClpvError, DataError, ExecutionError, StoreError
from pipeline.executors import ONE_THREAD
from pipeline.store import file_digest

ALL = ["main/read", "main/fit", "main/score"]


def digests(outcomes):
    return {(o.point.id, o.stage): o.record["outputs"] for o in outcomes}


def failure(toy, *arguments, error=ClpvError, **options):
    with pytest.raises(error) as caught:
        toy.run(*arguments, **options)
    return caught.value


def sound(toy):
    """Everything in the store is what its name says."""
    store = toy.open().store
    assert all(file_digest(path) == path.name for path in toy.objects)
    for path in (store.folder / "actions").iterdir():
        record = store.action(path.stem)
        assert all(store.holds(artifact) for artifact in store.outputs(record).values())
    return True


# What is computed


def test_first_and_second_run(toy):
    first = toy.run()
    assert toy.computed(first) == ALL
    assert [e.kind for e in toy.events] == ["started", "done"] * 3
    second = toy.run()
    assert toy.computed(second) == []
    assert [(e.kind, e.stage) for e in toy.events] == [("cached", "read"), ("cached", "fit"), ("cached", "score")]
    assert digests(first) == digests(second)
    assert [o.seconds for o in second] == [0.0, 0.0, 0.0]


def test_outcomes_are_in_order_and_tell_what_was_given(toy):
    outcomes = toy.run("many")
    assert [(o.point.id, o.stage) for o in outcomes] == [
        (f"offset={offset}", stage) for offset in ("0.0", "1.0", "2.0") for stage in ("read", "fit", "score")
    ]
    assert [o.record["metrics"] for o in outcomes if o.stage == "fit"] == [
        {"model": 3.0},
        {"model": 4.0},
        {"model": 5.0},
    ]


def test_up_to_a_stage(toy):
    assert toy.computed(toy.run(last="fit")) == ALL[:2]
    assert toy.computed(toy.run()) == ALL[2:]


@pytest.mark.parametrize(
    ("change", "computed"),
    [
        ("score.digits=2", ["main/score"]),
        ("fit.offset=1", ["main/fit", "main/score"]),
        ("read.scale=2", ALL),
        ("seed=1", ["main/fit"]),  # the fit is random, and yet gives the same bytes
        ("description=other", []),
        ("read.scale=1", []),
        ("read.scale=1.0", []),
    ],
)
def test_a_changed_parameter_runs_that_stage_and_later_ones_only(toy, change, computed):
    toy.run()
    assert toy.computed(toy.run(sets=[change])) == computed
    assert toy.computed(toy.run()) == []


def test_same_bytes_cut_the_rest_off(toy):
    toy.run()
    toy.edit("fit", "repr(float(estimate", "repr(0.0 + float(estimate")
    assert toy.computed(toy.run()) == ["main/fit"]
    toy.edit("fit", "repr(0.0 + float(estimate", "repr(1.0 + float(estimate")
    assert toy.computed(toy.run()) == ["main/fit", "main/score"]


@pytest.mark.parametrize(
    ("module", "old", "new", "computed"),
    [
        ("arithmetic", "# one by one", "# each", []),
        ("arithmetic", "result * FACTOR", "result * FACTOR * 2", ["main/fit", "main/score"]),
        ("median", "ordering.middle", "ordering.middle or ordering.middle", []),
        ("read", "map(repr, values)", "map(str, values)", ["main/read"]),
        ("score", "no score today", "no score", ["main/score"]),
        ("parameters", "distance: Positive = 5.0", "distance: Positive = 6.0", []),
    ],
)
def test_a_changed_module(toy, module, old, new, computed):
    toy.run()
    toy.edit(module, old, new)
    assert toy.computed(toy.run()) == computed


def test_a_changed_source(toy):
    toy.run()
    (toy.root / "numbers.txt").write_text("1\n2\n9\n")
    assert toy.computed(toy.run()) == ALL
    os.utime(toy.root / "numbers.txt", (0, 0))
    assert toy.computed(toy.run()) == []
    (toy.root / "numbers.txt").write_text("1\n2\n6\n")  # as it was
    assert toy.computed(toy.run()) == []


def test_force(toy):
    toy.run()
    assert toy.computed(toy.run(force=["fit"])) == ["main/fit"]
    assert toy.computed(toy.run(force=["read", "fit", "score"])) == ALL
    assert toy.said("warning") == []


def test_shared_prefixes_are_computed_once(toy):
    outcomes = toy.run("many")
    assert [(e.point, e.kind) for e in toy.events if e.stage == "read"] == [
        ("offset=0.0", "started"),
        ("offset=0.0", "done"),
        ("offset=1.0", "cached"),
        ("offset=2.0", "cached"),
    ]
    assert sum(e.kind == "started" for e in toy.events) == 1 + 3 + 3
    assert toy.computed(outcomes) == [
        "offset=0.0/read",
        "offset=0.0/fit",
        "offset=0.0/score",
        "offset=1.0/fit",
        "offset=1.0/score",
        "offset=2.0/fit",
        "offset=2.0/score",
    ]
    assert toy.computed(toy.run("many", force=["read"])) == ["offset=0.0/read"]
    assert sum(e.kind == "started" for e in toy.events) == 1


def test_warnings_are_said_and_kept(toy):
    (_, fit, _) = toy.run(sets=["fit.offset=13"])
    assert toy.said("warning") == ["thirteen is an unlucky offset."]
    assert fit.record["warnings"] == ["thirteen is an unlucky offset."]


def test_the_record_says_how_it_came_about(toy):
    (_, fit, _) = toy.run()
    environment = fit.record["environment"]
    assert set(environment) == {"python", "platform", "processor", "blas", "packages", "revision"}
    assert list(environment["packages"]) == ["numpy"]
    assert fit.record["seconds"] >= 0
    assert fit.record["definitions"]["toy.arithmetic"].keys() == {"FACTOR", "total", "unused"}


# Damage


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove"])
def test_a_damaged_object_is_computed_again_with_a_warning(toy, damage):
    first = toy.run()
    path = toy.open().store.path(first[1].record["outputs"]["model"]["digest"])
    path.chmod(0o644)
    if damage == "remove":
        path.unlink()
    else:
        path.write_text("4.0" if damage == "flip" else "3")
    again = toy.run()
    assert toy.computed(again) == ["main/fit"]
    assert toy.said("warning") == ["an object in the store is missing or damaged: computing it again."]
    assert digests(again) == digests(first)
    assert sound(toy)
    assert toy.computed(toy.run()) == []


def test_all_objects_lost(toy):
    toy.run()
    for path in toy.objects:
        path.unlink()
    assert toy.computed(toy.run()) == ALL
    assert len(toy.said("warning")) == 3


def test_an_unreadable_record_is_computed_again(toy):
    toy.run()
    for path in (toy.root / "runs" / ".store" / "actions").iterdir():
        path.write_text("{")
    assert toy.computed(toy.run()) == ALL
    assert toy.computed(toy.run()) == []


def test_a_stage_that_writes_to_its_input_is_found_out(toy, monkeypatch):
    toy.run()
    monkeypatch.setenv("TOY_ACT", "input")
    toy.run(force=["score"])
    monkeypatch.delenv("TOY_ACT")
    assert toy.computed(toy.run()) == ["main/fit"]
    assert toy.said("warning") == ["an object in the store is missing or damaged: computing it again."]
    assert sound(toy)


# Reproducibility


def test_other_bytes_for_the_same_key_are_a_fault_and_the_first_stay(toy, monkeypatch):
    first = toy.run()
    monkeypatch.setenv("TOY_ACT", "random")
    forced = toy.run(force=["score"])
    assert toy.said("warning") == [
        "reproducibility fault: score came out with other bytes than before on the same machine."
    ]
    assert digests(forced) == digests(first)
    monkeypatch.delenv("TOY_ACT")
    assert toy.computed(toy.run()) == []


def test_other_bytes_from_another_machine(toy, monkeypatch):
    from pipeline import environment

    with monkeypatch.context() as patched:
        patched.setattr(environment, "processor", lambda: "another processor")
        first = toy.run()
    monkeypatch.setenv("TOY_ACT", "random")
    forced = toy.run(force=["score"])
    assert toy.said("warning") == ["score came out with other bytes than before on another machine."]
    assert digests(forced) == digests(first)


def test_other_bytes_for_a_damaged_object_are_a_fault_and_replace_it(toy, monkeypatch):
    first = toy.run()
    toy.open().store.path(first[2].record["outputs"]["score"]["digest"]).unlink()
    monkeypatch.setenv("TOY_ACT", "random")
    again = toy.run()
    assert toy.said("warning") == [
        "an object in the store is missing or damaged: computing it again.",
        "reproducibility fault: score came out with other bytes than before on the same machine.",
    ]
    assert digests(again) != digests(first)
    monkeypatch.delenv("TOY_ACT")
    assert digests(toy.run()) == digests(again)


def test_the_same_from_an_empty_store(toy, tmp_path):
    first = toy.run("many", sets=["fit.noise=1"])
    (toy.root / "runs" / ".store").rename(tmp_path / "away")
    second = toy.run("many", sets=["fit.noise=1"])
    assert digests(first) == digests(second)


def test_noise_depends_on_seed_and_replicate(toy):
    def model(*sets):
        return toy.run(sets=["fit.noise=1", *sets])[1].record["metrics"]["model"]

    found = [model(), model("seed=1"), model("fit.replicate=1"), model("seed=1", "fit.replicate=1")]
    assert len(set(found)) == 4
    assert model() == found[0]
    assert toy.computed(toy.run("many", sets=["fit.noise=1", "score.digits=3"]))


def test_a_pool_gives_the_same_bytes(toy, tmp_path):
    alone = toy.run("many", sets=["fit.noise=1"])
    (toy.root / "runs" / ".store").rename(tmp_path / "away")
    together = toy.run("many", sets=["fit.noise=1"], jobs=2)
    assert digests(together) == digests(alone)
    assert toy.computed(together) == toy.computed(alone)
    assert sum(e.kind == "started" for e in toy.events) == 7


# Failures


def test_a_failing_stage(toy):
    error = failure(toy, sets=["score.act=raise"], error=ExecutionError)
    assert str(error) == (
        "stage score at main failed with ValueError: no score today. Run again with --debug for the traceback."
    )
    assert (error.stage, error.point, error.exit_code) == ("score", "main", EXIT_FAILED)
    assert isinstance(error.__cause__, ValueError)
    assert toy.said("failed") == [str(error)]
    assert toy.computed(toy.run()) == ["main/score"]
    assert sound(toy)


def test_an_error_of_the_data_is_passed_on(toy):
    (toy.root / "numbers.txt").write_text("1\nx\n")
    error = failure(toy, error=DataError)
    assert str(error) == "numbers.txt: could not convert string to float: 'x'."
    assert toy.objects == []


def test_a_message_of_many_lines_is_shown_by_its_first(toy):
    toy.edit("score", '"no score today"', '"no score today.\\nsecond line"')
    assert "ValueError: no score today. Run again" in str(failure(toy, sets=["score.act=raise"]))
    toy.edit("score", '"no score today.\\nsecond line"', "")
    assert "ValueError: no message. Run again" in str(failure(toy, sets=["score.act=raise"]))


def test_a_stage_that_does_not_write_its_output(toy):
    for act in ("forget", "link"):
        error = failure(toy, sets=[f"score.act={act}"], error=ExecutionError)
        assert str(error) == "stage score at main did not write its output score."
    assert sound(toy)


def test_a_stage_that_reads_what_is_not_there(toy):
    toy.edit("score", "act = context", 'open("/no/such/file")\n    act = context')
    error = failure(toy, error=ExecutionError)
    assert str(error) == (
        "stage score at main: a file cannot be read or written: [Errno 2] No such file or directory: '/no/such/file'."
    )


def test_a_stage_that_draws_undeclared_random_numbers(toy):
    toy.edit("fit", "random=True,", "")
    error = failure(toy, sets=["fit.noise=1"])
    assert "RuntimeError: stage fit draws random numbers: declare it with random=True. Run again" in str(error)


def test_a_point_that_fails_lets_the_others_finish(toy):
    toy.experiment("many", "[sweep]\n'score.act' = ['raise', '', 'forget']\n")
    error = failure(toy, "many")
    assert str(error).startswith("2 of 3 points failed; the first: stage score at act=raise failed with ValueError")
    assert error.exit_code == EXIT_FAILED
    assert isinstance(error.__cause__, ExecutionError)
    assert [e.point for e in toy.events if e.kind == "failed"] == ["act=raise", "act=forget"]
    assert [e.point for e in toy.events if e.kind == "done" and e.stage == "score"] == ["act="]
    assert toy.computed(toy.run("many", sets=["score.act=''"])) == []


def test_a_failing_prefix_fails_every_point_and_runs_once(toy):
    (toy.root / "numbers.txt").write_text("x")
    error = failure(toy, "many")
    assert str(error).startswith("3 of 3 points failed; the first: stage read at offset=0.0: numbers.txt: ")
    assert sum(e.kind == "started" for e in toy.events) == 1


def test_a_source_that_is_missing_at_one_point(toy):
    toy.experiment("many", "[sweep]\n'read.file' = ['absent.txt', 'numbers.txt']\n")
    error = failure(toy, "many")
    assert str(error) == (
        "1 of 2 points failed; the first: stage read at file=absent.txt: "
        "absent.txt: cannot be read: No such file or directory."
    )
    assert [e.stage for e in toy.events if e.kind == "done"] == ["read", "fit", "score"]


def test_the_exit_code_is_that_of_the_first_failure(toy):
    toy.edit("score", 'raise ValueError("no score today")', "raise ParameterError('score.act', 'not this one.')")
    toy.edit("score", "import os\n", "import os\n\nfrom pipeline.errors import ParameterError\n")
    toy.experiment("many", "[sweep]\n'score.act' = ['', 'raise']\n")
    error = failure(toy, "many")
    assert error.exit_code == EXIT_USAGE
    assert str(error) == "1 of 2 points failed; the first: stage score at act=raise: score.act: not this one."


def test_failures_in_a_pool(toy):
    toy.experiment("many", "[sweep]\n'score.act' = ['raise', '', 'forget']\n")
    error = failure(toy, "many", jobs=2)
    assert str(error).startswith("2 of 3 points failed; the first: stage score at act=")
    assert [e.point for e in toy.events if e.kind == "done" and e.stage == "score"] == ["act="]
    assert "no score today" in str(error.__cause__.__cause__) or "forget" in str(error)
    assert sound(toy)


def test_a_worker_that_dies(toy):
    toy.experiment("many", "[sweep]\n'score.act' = ['die', '']\n")
    error = failure(toy, "many", jobs=2)
    assert "stage score at act=die: its worker process died; run again, finished work is kept." in str(error)
    assert error.exit_code == EXIT_FAILED
    assert sound(toy)
    assert toy.run(sets=["score.act=''"])[-1].record["metrics"] == {"score": 30.0}


def test_a_store_that_cannot_be_written(toy, monkeypatch):
    monkeypatch.chdir(toy.root)
    (toy.root / "runs" / ".store").write_text("")
    error = failure(toy, error=StoreError)
    assert str(error).startswith("runs/.store cannot be written (")
    assert toy.events == []


def test_a_cached_run_needs_no_writable_store(toy, monkeypatch):
    toy.run()

    def refuse(self, *arguments, **options):
        raise OSError(30, "Read-only file system")

    for name in ("write_text", "replace", "hardlink_to", "unlink"):
        monkeypatch.setattr(Path, name, refuse)
    assert toy.computed(toy.run()) == []


EDIT = """
    from pathlib import Path

    path = Path(__file__).with_name("{module}.py")
    path.write_text(path.read_text().replace("{old}", "{new}"))
    (path,) ="""


@pytest.mark.parametrize("jobs", [1, 2])
def test_code_that_is_edited_during_a_run_is_not_recorded(toy, jobs):
    """The module has been imported, or is about to be: either way its key would speak of other code."""
    toy.edit("read", "(path,) =", EDIT.format(module="score", old="10 * model", new="20 * model"))
    error = failure(toy, "many", error=ClpvError, jobs=jobs)
    assert "its code was edited while it ran; run again." in str(error)
    assert [e.stage for e in toy.events if e.kind == "failed"] == ["score"] * 3
    outcomes = toy.run("many")
    assert [o.cached for o in outcomes if o.stage == "score"] == [False] * 3
    assert outcomes[-1].record["metrics"] == {"score": 100.0}


def test_code_that_is_edited_before_it_is_imported(toy):
    toy.edit("read", "(path,) =", EDIT.format(module="arithmetic", old="FACTOR = 1.0", new="FACTOR = 2.0"))
    assert "stage fit at main: its code was edited while it ran" in str(failure(toy))
    assert toy.run()[1].record["metrics"] == {"model": 6.0}


def test_other_code_may_be_edited_during_a_run(toy):
    toy.edit("read", "(path,) =", EDIT.format(module="median", old="The median", new="Half"))
    assert toy.computed(toy.run()) == ALL


def test_what_a_stage_prints_does_not_go_to_standard_output(toy):
    toy.edit("score", "act = context", 'print("chatter")\n    act = context')
    done = toy.process("run", "try", "--json", "--quiet")
    assert json.loads(done.stdout)["experiment"] == "try"
    assert done.stderr == "chatter\n"


# Interruptions and company, in processes of their own


def hanging(toy, *arguments, **environment):
    """A run that hangs in the middle of a stage, which has written half of its output."""
    process = subprocess.Popen(
        toy.command("run", *arguments),
        env=toy.environment() | {"TOY_ACT": "hang"} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "hanging\n"
    return process


def test_a_killed_run_leaves_nothing_that_the_next_trusts(toy):
    process = hanging(toy, "try")
    process.kill()
    process.communicate(timeout=30)
    store = toy.open().store
    assert len(list((store.folder / "tmp").iterdir())) == 1
    assert not (toy.root / "runs" / "try" / "manifest.json").exists()
    assert sound(toy)
    outcomes = toy.run()
    assert toy.computed(outcomes) == ["main/score"]
    assert outcomes[2].record["metrics"] == {"score": 30.0}
    assert list((store.folder / "tmp").iterdir()) == []


def gone(process):
    """Whether a process has ended, waiting for it a while."""
    for _ in range(300):
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


def children(process):
    return [int(text) for text in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_their_run(toy, how):
    process = hanging(toy, "many", "--jobs", "2")
    workers = children(process.pid)
    assert len(workers) >= 2
    process.send_signal(how)
    _, said = process.communicate(timeout=30)
    assert all(map(gone, workers))
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert said.splitlines()[-1] == "error: interrupted; finished stages are kept."
        assert "Traceback" not in said
    assert sound(toy)
    assert toy.run("many")[-1].record["metrics"] == {"score": 50.0}


def test_an_interrupted_run_in_one_process(toy):
    process = hanging(toy, "try")
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "error: interrupted; finished stages are kept."
    assert list((toy.root / "runs" / ".store" / "tmp").iterdir()) == []
    assert toy.computed(toy.run()) == ["main/score"]


def test_a_second_run_leaves_a_running_one_alone(toy):
    process = hanging(toy, "try")
    assert toy.computed(toy.run()) == ["main/score"]
    assert len(list((toy.root / "runs" / ".store" / "tmp").iterdir())) == 1
    process.kill()
    process.communicate(timeout=30)


def test_two_runs_at_once(toy):
    options = ("--set", "fit.noise=1", "--jobs", "1")
    processes = [
        subprocess.Popen(toy.command("run", "many", *options), env=toy.environment(), stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [process.communicate(timeout=60)[1] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], said
    assert "warning" not in said[0] + said[1]
    assert sound(toy)
    assert toy.computed(toy.run("many", sets=["fit.noise=1"])) == []


def test_linear_algebra_uses_one_thread_even_where_it_is_loaded_late(toy):
    toy.edit(
        "read", "(path,) =", "import numpy, threadpoolctl\n    print(threadpoolctl.threadpool_info())\n    (path,) ="
    )
    environment = {name: text for name, text in toy.environment().items() if name not in ONE_THREAD}
    done = subprocess.run(toy.command("run", "try"), env=environment, capture_output=True, text=True, check=True)
    (found,) = re.findall("'num_threads': ([0-9]+)", done.stderr)
    assert found == "1"
