"""What `clpv info` says about files of clpv and of rerun: what they are first, then which command opens them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from support import Invoke

from pipeline.errors import DataError
from stages.artifacts.channel import Channel
from stages.artifacts.channels import Poses
from stages.artifacts.log import write_log
from stages.artifacts.parquet import Column, Schema, write
from stages.inspect.bag_info import describe
from stages.inspect.own_files import TABLES, recognise

FACTS = {"mass": 0.3125, "compliance": True, "following": False, "pushes": [{}, {}], "pots": []}
ROLLOUT = {"what": "roll-out", "rollout": "clpvds-robust/held/0", "outcome": "arrived", "robot": "iiwa", "facts": FACTS}
DEMONSTRATION = {"what": "demonstration by shared teleoperation", "seed": 3, "number": 1}


def poses() -> Sequence[Channel]:
    """Two pads that move 10 cm."""
    time = np.arange(20) / 50.0
    position, turned = np.outer(time, [0.25, 0.0, 0.0]), np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))
    return [
        Poses(topic=f"/{side}/pose", frame="world", time=time, position=position, quaternion=turned)
        for side in ("left", "right")
    ]


def shown(clpv: Invoke, folder: Path, name: str, *options: str) -> str:
    result = clpv(folder, "info", str(folder / name), *options)
    assert result.exit_code == 0, result.output
    return str(result.stdout)


def test_a_roll_out_says_first_what_it_is(tmp_path: Path, clpv: Invoke) -> None:
    write_log(tmp_path / "one.mcap", poses(), ROLLOUT)
    lines = shown(clpv, tmp_path, "one.mcap").splitlines()
    assert lines[0] == (
        "A roll-out of clpv: clpvds-robust/held/0, two iiwa arms and a box of 312 g, compliance on, following off, "
        "2 pushes. Outcome: arrived."
    )
    assert lines[1].startswith("one.mcap: MCAP, ")
    assert any(line.startswith("/left/pose") for line in lines)
    at = lines.index("To look at it:")
    assert lines[at + 1 : at + 3] == [
        "    clpv inspect NAME --rollout clpvds-robust/held/0",
        f"    clpv inspect {tmp_path}/one.mcap",
    ]
    assert lines[-1] == f"    clpv ingest one {tmp_path}/one.mcap --left /left/pose --right /right/pose"
    found = json.loads(shown(clpv, tmp_path, "one.mcap", "--json"))
    assert found["written_by"] == "clpv"
    assert found["what"] == lines[0]
    assert found["look"] == ["clpv inspect NAME --rollout clpvds-robust/held/0", f"clpv inspect {tmp_path}/one.mcap"]
    assert found["details"] == ROLLOUT


def test_a_demonstration_says_its_number_and_seed(tmp_path: Path, clpv: Invoke) -> None:
    write_log(tmp_path / "demo2.mcap", poses(), DEMONSTRATION)
    lines = shown(clpv, tmp_path, "demo2.mcap").splitlines()
    assert lines[0] == "A demonstration by 'clpv teleop': number 2 of seed 3."
    assert not any("clpv inspect NAME" in line for line in lines)
    assert f"    clpv inspect {tmp_path}/demo2.mcap" in lines


@pytest.mark.parametrize(
    ("details", "what"),
    [
        ({"rollout": "a/b/0", "outcome": "lost"}, "A roll-out of clpv: a/b/0, two arms and a box. Outcome: lost."),
        ({}, "A log of clpv that does not say what it is of."),
        # Of another version, or made by hand: it is told as far as it can be.
        ({"rollout": "a/b/0"}, "A log of clpv that does not say what it is of."),
        ({"number": 1}, "A log of clpv that does not say what it is of."),
        ({"rollout": "a/b/0", "outcome": "lost", "facts": None}, "A log of clpv that does not say what it is of."),
        (
            {"rollout": "a/b/0", "outcome": "lost", "facts": {"pushes": [{}], "pots": []}},
            "A roll-out of clpv: a/b/0, two arms and a box, 1 push. Outcome: lost.",
        ),
    ],
)
def test_logs_that_say_less(tmp_path: Path, details: dict[str, Any], what: str) -> None:
    write_log(tmp_path / "one.mcap", poses(), details)
    assert describe(tmp_path / "one.mcap")["what"] == what


def test_a_damaged_log_of_clpv_is_refused_or_recovered(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    write_log(path, poses(), ROLLOUT)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(DataError, match=r"^one\.mcap: .*--recover") as caught:
        describe(path)
    assert "\n" not in str(caught.value)
    found = describe(path, recover=True)
    assert (found["written_by"], found["messages"]) == ("clpv", 40)


def test_a_recording_of_rerun(tmp_path: Path, clpv: Invoke) -> None:
    to = rr.RecordingStream("other", recording_id="one")
    to.save(tmp_path / "a b.rrd")
    to.log("x", rr.Scalars(1.0))
    to.flush()
    to.disconnect()
    command = f"clpv inspect '{tmp_path}/a b.rrd'"
    assert shown(clpv, tmp_path, "a b.rrd") == f'a b.rrd is a recording of rerun: "{command}" opens it.\n'
    found = json.loads(shown(clpv, tmp_path, "a b.rrd", "--json"))
    assert (found["format"], found["written_by"], found["look"]) == ("rerun", "rerun", [command])
    assert found["topics"] == []
    assert found["command"] == ""


@pytest.mark.parametrize("name", TABLES)
def test_our_own_tables(tmp_path: Path, clpv: Invoke, name: str) -> None:
    schema = Schema(name=name, version=2, columns=(Column(name="left_x"), Column(name="left_y"), Column(name="left_z")))
    write(tmp_path / "object", schema, dict.fromkeys(("left_x", "left_y", "left_z"), np.arange(3.0)), {})
    of, stage = TABLES[name]
    assert shown(clpv, tmp_path, "object") == (
        f'object is a table of clpv, version 2: {of}; "clpv show NAME --stage {stage}" shows it, of experiment NAME.\n'
    )
    found = json.loads(shown(clpv, tmp_path, "object", "--json"))
    assert (found["format"], found["written_by"]) == ("parquet", "clpv")
    assert found["look"] == [f"clpv show NAME --stage {stage}"]


def test_what_others_have_written_is_not_known(tmp_path: Path) -> None:
    schema = Schema(name="others", version=1, columns=(Column(name="a"),))
    write(tmp_path / "other.parquet", schema, {"a": np.arange(3.0)}, {})
    (tmp_path / "cut.parquet").write_bytes(b"PAR1" + bytes(20))
    (tmp_path / "text.mcap").write_text("nothing")
    (tmp_path / "empty.mcap").write_bytes(b"")
    for name in ("other.parquet", "cut.parquet", "text.mcap", "empty.mcap", "none.mcap", "."):
        assert recognise(tmp_path / name) is None
