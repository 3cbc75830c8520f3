"""The store: content-addressed objects and action records, written so that a crash leaves nothing to trust.

``objects/ab/abcd…`` is a file named by its sha256, or a folder named by that of its listing; ``actions/<key>.json``
says which objects a stage key led to, and in which environment. Both appear whole or not at all: temporary file, fsync,
rename or link. There are no locks; the first writer of an action record wins. Digests are checked on read.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import socket
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import StoreError

FOLDER = Path("runs") / ".store"


@dataclass(frozen=True, kw_only=True)
class Artifact:
    """A file or a folder of files in the store: sha256 and size in bytes."""

    digest: str
    size: int


@dataclass(frozen=True, kw_only=True)
class Store:
    """A folder of objects and action records."""

    folder: Path

    def prepare(self) -> None:
        """Make the folders, and clear what killed processes of this machine left behind. Raises StoreError."""
        with self._writing():
            for name in ("objects", "actions", "tmp"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
            for leftover in (self.folder / "tmp").iterdir():
                if _abandoned(leftover.name):
                    shutil.rmtree(leftover, ignore_errors=True)

    @contextlib.contextmanager
    def scratch(self) -> Iterator[Path]:
        """A folder of one's own on the store's file system, removed at the end."""
        folder = self.folder / "tmp" / f"{socket.gethostname()}~{os.getpid()}~{uuid.uuid4().hex}"
        with self._writing():
            folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def busy(self) -> bool:
        """Whether a process is computing into the store: its results may not be named by a record yet."""
        return any(not _abandoned(path.name) for path in (self.folder / "tmp").glob("*"))

    def path(self, digest: str) -> Path:
        """Where the object of a digest lies, or would."""
        return self.folder / "objects" / digest[:2] / digest

    def holds(self, artifact: Artifact) -> bool:
        """Whether the object is there and its bytes are those of its digest."""
        path = self.path(artifact.digest)
        try:
            return size(path) == artifact.size and digest(path) == artifact.digest
        except OSError:
            return False

    def add(self, path: Path) -> Artifact:
        """Move a file or a folder (of the same file system) into the store. Raises StoreError."""
        with self._writing():
            artifact = Artifact(digest=digest(path), size=size(path))
            target = self.path(artifact.digest)
            target.parent.mkdir(parents=True, exist_ok=True)
            for file in sorted(path.iterdir()) if path.is_dir() else [path]:
                file.chmod(0o444)
                _sync(file)
            if path.is_dir():
                if self.holds(artifact):
                    return artifact
                shutil.rmtree(target, ignore_errors=True)
                _sync(path)
            path.replace(target)
            _sync(target.parent)
        return artifact

    def action(self, key: str) -> dict[str, Any] | None:
        """The record of a key, or none where there is none that can be read."""
        try:
            record: dict[str, Any] = json.loads((self.folder / "actions" / f"{key}.json").read_text(encoding="utf-8"))
            self.outputs(record)
            return record if record["key"] == key else None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def record(self, key: str, record: Mapping[str, Any], *, replace: bool = False) -> dict[str, Any]:
        """Write a record; where there is one already it stays, unless `replace`. Returns the one that stands.

        Raises StoreError.
        """
        target = self.folder / "actions" / f"{key}.json"
        with self.scratch() as folder, self._writing():
            temporary = folder / "action.json"
            temporary.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", encoding="utf-8")
            _sync(temporary)
            if not replace:
                try:
                    target.hardlink_to(temporary)
                except OSError:
                    # One stands there, or the file system knows no links. One that cannot be read is replaced.
                    replace = self.action(key) is None
            if replace:
                temporary.replace(target)
            _sync(target.parent)
        return self.action(key) or dict(record)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """What the file system refuses becomes a StoreError."""
        try:
            yield
        except OSError as error:
            raise StoreError(
                f"{_relative(self.folder)} cannot be written ({error.strerror}): "
                "make the runs folder writable, with room to spare."
            ) from None

    def outputs(self, record: Mapping[str, Any]) -> dict[str, Artifact]:
        """The artifacts of a record, by name."""
        return {name: Artifact(**entry) for name, entry in record["outputs"].items()}


def file_digest(path: Path) -> str:
    """The sha256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest(path: Path) -> str:
    """The sha256 of a file, or of a folder: over the names and digests of its files, sorted."""
    if not path.is_dir():
        return file_digest(path)
    listing = "".join(f"{file_digest(file)}  {file.name}\n" for file in sorted(path.iterdir()))
    return hashlib.sha256(listing.encode()).hexdigest()


def size(path: Path) -> int:
    """Bytes of a file, or of all files of a folder."""
    return sum(file.stat().st_size for file in path.iterdir()) if path.is_dir() else path.stat().st_size


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, text as UTF-8. Raises StoreError."""
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside a file: what is written there takes the file's place at the end, whole, or not at all.

    Raises StoreError where that cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        _sync(temporary)
        temporary.replace(path)
    except OSError as error:
        raise StoreError(f"{_relative(path)} cannot be written: {error.strerror}.") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Have the file system keep a file's bytes, or a folder's entries."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _abandoned(name: str) -> bool:
    """Whether the process that made a scratch folder was on this machine and is gone."""
    host, _, rest = name.partition("~")
    process = rest.partition("~")[0]
    if host != socket.gethostname() or not process.isdecimal():
        return False
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


def _relative(path: Path) -> str:
    """A path from the project's folder on: what a message shows."""
    parts = path.parts
    return "/".join(parts[len(parts) - parts[::-1].index("runs") - 1 :]) if "runs" in parts else path.name
