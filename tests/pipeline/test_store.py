"""The store: nothing that a crash, a damaged disk or another writer leaves behind is trusted."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import store as module
from pipeline.errors import EXIT_FAILED, StoreError
from pipeline.store import Artifact, Store, file_digest, write_atomically

HERE = Path(__file__).resolve().parents[2]
KEY = "a" * 64


class Crash(BaseException):
    """Stands for the end of the process."""


@pytest.fixture
def store(tmp_path):
    made = Store(folder=tmp_path / "runs" / ".store")
    made.prepare()
    return made


def put(store, content=b"content"):
    """Store some bytes."""
    with store.scratch() as folder:
        path = folder / "file"
        path.write_bytes(content)
        return store.add(path)


def record_of(*artifacts, key=KEY, **more):
    outputs = {f"a{i}": {"digest": a.digest, "size": a.size} for i, a in enumerate(artifacts)}
    return {"key": key, "outputs": outputs, **more}


def files(store, pattern="**/*"):
    return sorted(path for path in store.folder.glob(pattern) if path.is_file())


def test_an_object_is_named_by_its_bytes_and_cannot_be_written(store):
    artifact = put(store)
    path = store.path(artifact.digest)
    assert artifact == Artifact(digest=file_digest(path), size=7)
    assert path == store.folder / "objects" / artifact.digest[:2] / artifact.digest
    assert path.read_bytes() == b"content"
    assert path.stat().st_mode & 0o222 == 0
    assert store.holds(artifact)


def test_the_same_bytes_are_one_object(store):
    assert put(store) == put(store)
    assert len(files(store)) == 1


def damage_truncate(path):
    path.write_bytes(path.read_bytes()[:-1])


def damage_flip(path):
    found = bytearray(path.read_bytes())
    found[0] ^= 1
    path.write_bytes(found)


def damage_remove(path):
    path.unlink()


def damage_folder(path):
    path.unlink()
    path.mkdir()


def damage_dangling(path):
    path.unlink()
    path.symlink_to("nothing")


@pytest.mark.parametrize("damage", [damage_truncate, damage_flip, damage_remove, damage_folder, damage_dangling])
def test_a_damaged_object_is_not_held(store, damage):
    artifact = put(store)
    path = store.path(artifact.digest)
    path.chmod(0o644)
    damage(path)
    assert not store.holds(artifact)


@pytest.mark.parametrize("damage", [damage_truncate, damage_flip, damage_remove, damage_dangling])
def test_a_damaged_object_is_mended_by_adding_it_again(store, damage):
    path = store.path(put(store).digest)
    path.chmod(0o644)
    damage(path)
    assert store.holds(put(store))


def test_an_object_of_another_size_is_not_held(store):
    artifact = put(store)
    assert not store.holds(Artifact(digest=artifact.digest, size=artifact.size + 1))


def test_the_first_record_stays(store):
    first, second = put(store, b"1"), put(store, b"2")
    assert store.record(KEY, record_of(first)) == record_of(first)
    assert store.record(KEY, record_of(second)) == record_of(first)
    assert store.action(KEY) == record_of(first)
    assert store.record(KEY, record_of(second), replace=True) == record_of(second)
    assert store.outputs(store.action(KEY)) == {"a0": second}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "null",
        "[]",
        '"text"',
        "\udcff",
        json.dumps({"key": KEY}),
        json.dumps({"key": KEY, "outputs": None}),
        json.dumps({"key": KEY, "outputs": {"a": {"digest": "0"}}}),
        json.dumps({"key": KEY, "outputs": {"a": 3}}),
        json.dumps({"key": "b" * 64, "outputs": {}}),
    ],
)
def test_a_record_that_cannot_be_read_is_none_and_is_replaced(store, text):
    path = store.folder / "actions" / f"{KEY}.json"
    path.write_text(text, errors="surrogateescape")
    assert store.action(KEY) is None
    fresh = record_of(put(store))
    assert store.record(KEY, fresh) == fresh
    assert store.action(KEY) == fresh


def test_a_file_system_without_links(store, monkeypatch):
    def refuse(self, target):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    first, second = record_of(put(store, b"1")), record_of(put(store, b"2"))
    assert store.record(KEY, first) == first
    assert store.record(KEY, second) == first


def crash_at(monkeypatch, call):
    """Have the process end at the n-th step that touches the disk; returns how many there were."""
    count = [0]

    def counted(original):
        def step(*args, **kwargs):
            count[0] += 1
            if count[0] == call:
                raise Crash
            return original(*args, **kwargs)

        return step

    monkeypatch.setattr(module, "_sync", counted(module._sync))
    monkeypatch.setattr(module.shutil, "rmtree", lambda *args, **kwargs: None)  # a dead process tidies nothing
    for name in ("replace", "hardlink_to", "mkdir", "chmod", "write_text"):
        monkeypatch.setattr(Path, name, counted(getattr(Path, name)))
    return count


def consistent(store):
    """Whatever stands in the store holds: objects have the bytes of their names, records the objects they name."""
    for path in files(store, "objects/**/*"):
        assert file_digest(path) == path.name
    for path in files(store, "actions/*"):
        record = store.action(path.stem)
        assert record is not None
        assert all(store.holds(artifact) for artifact in store.outputs(record).values())


def test_a_crash_at_any_step_leaves_nothing_to_trust(store, monkeypatch):
    call, crashes = 0, 0
    while True:
        call += 1
        content = f"content {call}".encode()
        key = f"{call:064d}"
        with monkeypatch.context() as patched:
            count = crash_at(patched, call)
            try:
                artifact = put(store, content)
                store.record(key, record_of(artifact, key=key))
            except Crash:
                crashes += 1
        consistent(store)
        # The next process does the same and is not disturbed by what is left.
        artifact = put(store, content)
        assert store.record(key, record_of(artifact, key=key))["key"] == key
        assert store.holds(artifact)
        if count[0] < call:
            break
    assert crashes >= 10


def dead_process():
    done = subprocess.Popen([sys.executable, "-c", ""])
    done.wait()
    return done.pid


def test_leftovers_of_the_dead_are_cleared_and_those_of_the_living_are_not(store):
    host = socket.gethostname()
    tmp = store.folder / "tmp"
    kept = [f"{host}~{os.getpid()}~1", f"{host}~1~1", f"elsewhere~{dead_process()}~1", f"{host}~x~1", "stray", host]
    cleared = [f"{host}~{dead_process()}~1", f"{host}~{dead_process()}~2"]
    for name in (*kept, *cleared):
        (tmp / name).mkdir()
        (tmp / name / "half").write_text("half")
        (tmp / name / "half").chmod(0o444)
    store.prepare()
    assert sorted(path.name for path in tmp.iterdir()) == sorted(kept)


def test_leftovers_of_a_process_of_another_user_are_kept(store, monkeypatch):
    def refuse(process, signal):
        raise PermissionError

    monkeypatch.setattr(module.os, "kill", refuse)
    folder = store.folder / "tmp" / f"{socket.gethostname()}~1~1"
    folder.mkdir()
    store.prepare()
    assert folder.exists()


def test_scratch_is_removed_even_after_an_error(store):
    def fail():
        with store.scratch() as folder:
            (folder / "file").write_text("x")
            raise ValueError("x")

    with pytest.raises(ValueError, match="x"):
        fail()
    assert list((store.folder / "tmp").iterdir()) == []


def test_two_scratch_folders_are_two(store):
    with store.scratch() as one, store.scratch() as two:
        assert one != two


@pytest.mark.parametrize("blocked", ["runs", "runs/.store", "runs/.store/objects", "runs/.store/tmp"])
def test_a_file_in_the_way(tmp_path, monkeypatch, blocked):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / blocked
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")
    with pytest.raises(StoreError, match=r"^runs/\.store cannot be written") as caught:
        Store(folder=tmp_path / "runs" / ".store").prepare()
    assert caught.value.exit_code == EXIT_FAILED
    assert str(caught.value).endswith("make the runs folder writable, with room to spare.")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("step", ["mkdir", "chmod", "replace", "hardlink_to", "write_text"])
def test_a_full_disk_is_one_sentence(store, monkeypatch, step):
    artifact = put(store)
    with store.scratch() as folder:
        (folder / "file").write_bytes(b"other")

        def refuse(self, *args, **kwargs):
            raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patched:
            patched.setattr(Path, step, refuse)
            if step == "hardlink_to":
                patched.setattr(Path, "replace", refuse)
            with pytest.raises(StoreError, match="No space left on device"):  # noqa: PT012
                store.add(folder / "file")
                store.record(KEY, record_of(artifact))
    consistent(store)


def test_what_cannot_be_removed_is_left(store, monkeypatch):
    folder = store.folder / "tmp" / f"{socket.gethostname()}~{dead_process()}~1"
    folder.write_text("a file, not a folder")
    store.prepare()
    assert folder.exists()


WRITER = """
import sys
from pathlib import Path
from pipeline.store import Store
store = Store(folder=Path(sys.argv[1]))
store.prepare()
sys.stdin.readline()
for turn in range(30):
    key = f"{turn:064d}"
    with store.scratch() as folder:
        (folder / "own").write_text(f"{sys.argv[2]} {turn}")
        (folder / "shared").write_text(f"shared {turn}" * 1000)
        found = {name: store.add(folder / name) for name in ("own", "shared")}
    outputs = {name: {"digest": a.digest, "size": a.size} for name, a in found.items()}
    standing = store.record(key, {"key": key, "writer": sys.argv[2], "outputs": outputs})
    print(standing["writer"])
"""


def test_writers_at_once_agree_on_the_first(store):
    command = [sys.executable, "-c", WRITER, str(store.folder)]
    writers = [
        subprocess.Popen([*command, str(n)], cwd=HERE, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for n in range(3)
    ]
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    answers = [writer.communicate(timeout=60)[0].split() for writer in writers]
    assert [len(answer) for answer in answers] == [30, 30, 30]
    assert answers[0] == answers[1] == answers[2]
    consistent(store)
    assert list((store.folder / "tmp").iterdir()) == []


def test_write_atomically(tmp_path, monkeypatch):
    path = tmp_path / "below" / "file.json"
    write_atomically(path, "one")
    write_atomically(path, "two\n")
    assert path.read_text() == "two\n"
    for step in ("write_bytes", "replace"):
        with monkeypatch.context() as patched:
            patched.setattr(
                Path, step, lambda *args, **kwargs: (_ for _ in ()).throw(OSError(errno.EIO, "Input error"))
            )
            with pytest.raises(StoreError, match="cannot be written: Input error"):
                write_atomically(path, "three")
        assert path.read_text() == "two\n"
    assert list(path.parent.iterdir()) == [path]


def test_write_atomically_below_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").write_text("")
    with pytest.raises(StoreError, match=r"^runs/try/manifest\.json cannot be written: "):
        write_atomically(tmp_path / "runs" / "try" / "manifest.json", "")
