"""How messages are decoded: a recording's own definitions, completed by the standard types where it lacks some.

A decoder is made for one type at a time, so that one damaged or legacy definition costs its own topics only. Legacy ROS
bags that call the header ``roslib/Header`` decode here, since missing types come from the standard ones. Not here:
where the bytes come from (`rosbag_files.py`, `mcap_files.py`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from struct import Struct
from typing import Any, Literal

Encoding = Literal["ros1", "cdr"]

STAMP = {"<": Struct("<iI"), ">": Struct(">iI")}
"""Seconds and nanoseconds of a header's stamp, in both byte orders."""

STAMP_OFFSET = 4
"""Bytes before the stamp where the header comes first: in ROS 1 its sequence number, in CDR the encapsulation."""

LARGEST_DEFINITION = 1_000_000
"""Characters of a definition that are parsed at most; the longest in use have some ten thousand."""

MOST_FIELDS = 500
"""Names that are listed for a type at most."""

TF = "geometry_msgs/TransformStamped[] transforms\n"
EXTRA = {"ros1": {"tf2_msgs/msg/TFMessage": TF, "tf/msg/tfMessage": TF}, "cdr": {}}
"""Types outside the standard sets of rosbags that recordings without definitions need."""

NUMBERS = re.compile(r"(u?int(8|16|32|64)|float(32|64|128)|byte|char|bool)$")


class UndecodableError(Exception):
    """A type cannot be decoded; the text ends a sentence about its topic."""


@dataclass(frozen=True, kw_only=True)
class Decoder:
    """How the messages of one type are decoded.

    Attributes:
        decode: bytes to message.
        fields: dotted names of its numbers, as `Topic.fields`.
        header: where its header is: first of all fields, elsewhere, or nowhere.
        encoding: ``ros1`` or ``cdr``.
    """

    decode: Callable[[bytes], Any]
    fields: tuple[str, ...]
    header: Literal["first", "inside", "none"]
    encoding: Encoding

    def stamp(self, raw: bytes) -> int:
        """Stamp of the header of an encoded message whose header comes first, nanoseconds."""
        order = ">" if self.encoding == "cdr" and raw[1] == 0 else "<"
        seconds, nanoseconds = STAMP[order].unpack_from(raw, STAMP_OFFSET)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)


def normal(name: str) -> str:
    """A type's name as ROS 2 writes it: ``geometry_msgs/msg/Pose`` also for ROS 1's ``geometry_msgs/Pose``."""
    from rosbags.typesys.msg import normalize_msgtype

    return normalize_msgtype(name)


@lru_cache(maxsize=256)
def decoder(name: str, definition: str, syntax: Literal["msg", "idl"], encoding: Encoding, digest: str = "") -> Decoder:
    """The decoder of a type, from the recording's definition and, for what that lacks, from the standard types.

    An empty definition means that the recording carries none. A digest (MD5 of ROS 1, RIHS01 of ROS 2) is compared
    where it is given; where the recording's definition does not match it but the standard type does, that one is taken.

    Raises UndecodableError where the type is neither defined nor standard, or the definition cannot be used.
    """
    try:
        return _decoder(name, definition, syntax, encoding, digest)
    except UndecodableError:
        if definition and digest and name in standard(encoding):
            return _decoder(name, "", syntax, encoding, digest)
        raise


def _decoder(name: str, definition: str, syntax: str, encoding: Encoding, digest: str) -> Decoder:
    from rosbags.typesys import Stores, get_typestore

    if len(definition) > LARGEST_DEFINITION:
        raise UndecodableError("the definition of its type is too long to be one.")
    try:
        needed = _closure(name, _parsed(name, definition, syntax), standard(encoding))
        store = get_typestore(Stores.EMPTY)
        store.register(needed)
        deserialize = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
        store.get_msgdef(name)
        if not _matches(store, name, digest):
            raise UndecodableError("the definition of its type does not match its digest: the recording is damaged.")
    except UndecodableError:
        raise
    except Exception as error:  # the parser and the code generator raise nearly anything on damaged text
        raise UndecodableError(
            f"the definition of its type {name} cannot be used ({first_line(error)}); copy or record it again."
        ) from error
    return Decoder(
        decode=lambda raw: deserialize(raw, name),
        fields=tuple(_numbers(name, needed)),
        header=_header(name, needed),
        encoding=encoding,
    )


def _matches(store: Any, name: str, digest: str) -> bool:
    """Whether a type is the one that a digest was made of; true where there is no digest that is known."""
    if re.fullmatch(r"[0-9a-f]{32}", digest):
        return bool(store.generate_msgdef(name)[1] == digest)
    if re.fullmatch(r"RIHS01_[0-9a-f]{64}", digest):
        return bool(store.hash_rihs01(name) == digest)
    return True


@lru_cache(maxsize=2)
def standard(encoding: Encoding) -> Mapping[str, Any]:
    """Definitions of the standard types of ROS 1 Noetic or ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = dict(get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_JAZZY).fielddefs)
    for name, text in EXTRA[encoding].items():
        types.update(get_types_from_msg(text, name))
    return types


def first_line(error: BaseException, limit: int = 160) -> str:
    """What a library said, short enough to stand in brackets."""
    text = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return text if len(text) <= limit else text[: limit - 1] + "…"


def _parsed(name: str, definition: str, syntax: str) -> dict[str, Any]:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if not definition.strip():
        return {}
    if syntax == "msg":
        return dict(get_types_from_msg(definition, name))
    rule = "=" * 80 + "\n"
    texts = [definition]
    if definition.startswith(rule):
        texts = [part.partition("\n")[2] for part in definition.split(rule)[1:]]
    types: dict[str, Any] = {}
    for text in texts:
        types.update(get_types_from_idl(text))
    return types


def _closure(name: str, own: Mapping[str, Any], rest: Mapping[str, Any]) -> dict[str, Any]:
    """`name` and all types that it is made of, the recording's own first."""
    needed: dict[str, Any] = {}
    open_names = [name]
    while open_names:
        current = open_names.pop()
        if current in needed:
            continue
        definition = own.get(current, rest.get(current))
        if definition is None:
            what = f"its type {name}" if current == name else f"the type {current} within its type {name}"
            raise UndecodableError(
                f"{what} is neither defined in the recording nor a standard one; record it as MCAP or with ROS 2 Iron "
                "or later, which store definitions."
            )
        needed[current] = definition
        open_names.extend(reference for _, field in definition[1] if (reference := _reference(field)))
    return needed


def _reference(field: Any) -> str:
    """The message type that a field refers to, also as an array; empty for a number or a string."""
    from rosbags.interfaces import Nodetype

    kind, content = field
    if kind == Nodetype.NAME:
        return str(content)
    return "" if kind == Nodetype.BASE else _reference(content[0])


def _numbers(name: str, types: Mapping[str, Any], prefix: str = "", depth: int = 0) -> list[str]:
    from rosbags.interfaces import Nodetype

    names: list[str] = []
    if depth > 12:
        return names
    for field, (kind, content) in types[name][1]:
        suffix, (inner, what) = "", (kind, content)
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            inner, what = content[0]
            suffix = f"[{content[1]}]" if kind == Nodetype.ARRAY else "[]"
        if inner == Nodetype.BASE:
            if NUMBERS.match(what[0]):
                names.append(f"{prefix}{field}{suffix}")
        elif not str(what).endswith("/Header"):
            names += _numbers(what, types, f"{prefix}{field}{suffix}.", depth + 1)
        if len(names) > MOST_FIELDS:
            break
    return names[:MOST_FIELDS]


def _header(name: str, types: Mapping[str, Any]) -> Literal["first", "inside", "none"]:
    for position, (field, description) in enumerate(types[name][1]):
        if field == "header" and _is_header(description, types):
            return "first" if position == 0 else "inside"
    return "none"


def _is_header(description: Any, types: Mapping[str, Any]) -> bool:
    from rosbags.interfaces import Nodetype

    kind, content = description
    if kind != Nodetype.NAME or not str(content).endswith("/Header"):
        return False
    return "stamp" in _names(types[content])


def _names(definition: Any) -> Iterator[str]:
    return (field for field, _ in definition[1])
