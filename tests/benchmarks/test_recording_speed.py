"""How fast recordings are read beside a bare rosbags loop, and in how much memory a large one.

The bare loop deserialises the same topics with AnyReader and keeps nothing. Both sides are timed in turn, several
times, and the best of each counts: two cores are shared with others.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import recording_writers as writers
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from support import CHECKOUT

from stages.ingest.readers.formats import open_recording
from stages.ingest.selections.selection import parse

LEAST = 0.8
"""Part of the bare loop's throughput that is asked for."""

ROUNDS = 3
MESSAGES = 20_000

LARGE = 2_000_000_000
MOST_MEMORY = 400
"""Megabytes that reading a 2 GB bag may take, all of Python included."""


def bare(path: Path, topics: set[str]) -> int:
    stores = Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_JAZZY
    count = 0
    with AnyReader([path], default_typestore=get_typestore(stores)) as reader:
        chosen = [connection for connection in reader.connections if connection.topic in topics]
        for connection, _, raw in reader.messages(connections=chosen):
            reader.deserialize(raw, connection.msgtype)
            count += 1
    return count


def ours(path: Path, layout: str) -> int:
    with open_recording(path) as recording:
        topics = recording.topics()
        found = [parse(text, "left").resolve(topics, path.name) for text in writers.SELECTIONS[layout]]
        return sum(len(samples.log_time) for samples in recording.read([one.request for one in found]))


def seconds(run: Callable[[], int]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


@pytest.mark.parametrize("layout", ["pose", "endpoint"])
@pytest.mark.parametrize(
    "container", ["ros1", "ros1-bz2", "ros1-lz4", "ros2-sqlite3", "ros2-mcap", "ros2-mcap-storage", "mcap"]
)
def test_reading_keeps_up_with_a_bare_loop(tmp_path: Path, container: str, layout: str) -> None:
    arms = writers.two_arms(MESSAGES // 2)
    path = writers.write(tmp_path, container, layout, arms)
    topics = set(writers.SELECTIONS[layout])
    assert bare(path, topics) == ours(path, layout) == MESSAGES
    pairs = [(seconds(lambda: bare(path, topics)), seconds(lambda: ours(path, layout))) for _ in range(ROUNDS)]
    theirs, mine = (min(times) for times in zip(*pairs, strict=True))
    print(f"{container}, {layout}: {MESSAGES / mine:,.0f} messages/s, {theirs / mine:.2f} x the bare loop")
    assert theirs / mine >= LEAST


def large(builder: writers.Builder) -> Iterator[writers.Message]:
    """Two arms at 100 Hz, and a camera that makes the bag large: random pixels, which no compression shrinks."""
    pixels = np.random.default_rng(0).integers(0, 256, 1_000_000, dtype=np.uint8)
    frames = LARGE // len(pixels)
    arms = writers.two_arms(10_000)
    every = len(arms.log) // (frames // 2)
    name = "sensor_msgs/msg/Image"
    for k, (topic, kind, log, message) in enumerate(writers.LAYOUTS["pose"](builder, arms)):
        yield topic, kind, log, message
        if k % (2 * every) == 0:
            for _ in range(2):
                header = builder.header(log, "camera")
                yield (
                    "/camera/image",
                    name,
                    log,
                    builder.make(
                        name,
                        header=header,
                        height=1000,
                        width=1000,
                        encoding="mono8",
                        is_bigendian=0,
                        step=1000,
                        data=pixels,
                    ),
                )


CHILD = """
import json, resource, sys, time
from stages.cli import app
began = time.perf_counter()
arms = ["--left", "/left/pose", "--right", "/right/pose"]
app(["ingest", "large", sys.argv[1], *arms, "--json"], standalone_mode=False)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps([peak, time.perf_counter() - began]), file=sys.stderr)
"""
"""The whole of `clpv ingest NAME SOURCE`, digests of the file included, in a process of its own."""


@pytest.mark.parametrize("container", ["ros1", "ros2-sqlite3", "mcap"])
def test_a_large_bag_is_read_in_little_memory(tmp_path: Path, container: str) -> None:
    if container == "ros1":
        path = writers.write_ros1(tmp_path / "large.bag", large, chunk=2**20)
    elif container == "mcap":
        path = writers.write_mcap(tmp_path / "large.mcap", large, compression="none", chunk=2**20)
    else:
        path = writers.write_ros2(tmp_path / "large", large)
    file = path if path.is_file() else next(path.glob("*.db3"))
    assert file.stat().st_size >= LARGE
    environment = {**os.environ, "CLPV_ROOT": str(tmp_path), "PYTHONPATH": str(CHECKOUT)}
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(path)], capture_output=True, text=True, check=True, env=environment
    )
    peak, took = json.loads(done.stderr.splitlines()[-1])
    card = tomllib.loads((tmp_path / "datasets/large/dataset.toml").read_text())
    file.unlink()
    print(f"{container}: a 2 GB recording ingested in {took:.1f} s and {peak:.0f} MB")
    assert 5_000 < card["counts"]["samples"] <= 10_000  # the rest at both ends is trimmed
    assert peak <= MOST_MEMORY
