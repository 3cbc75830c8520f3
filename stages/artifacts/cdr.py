"""Messages of one size in CDR, the encoding of ROS 2: a whole column of them at once, the same bytes as rosbags makes.

The messages of a column differ in their stamps and numbers only: where these lie is worked out once, and numpy fills
them into copies of the rest. No part of the paper, and no files: arrays in, bytes out, and back.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little-endian. A value of 8 bytes begins at a multiple of 8 bytes behind it, and so on."""

COUNT = Struct("<I")
"""What precedes a text (its bytes, the closing zero counted) and a sequence (its elements)."""


@dataclass(frozen=True, kw_only=True)
class Field:
    """A stamp's part, a number or a list of numbers that differs from message to message.

    Attributes:
        name: of the array that it comes from.
        code: numpy's code of its type.
        shape: ``()`` for a number, else ``(count,)``.
        offset: of its first byte in the message.
        part: which part of a row of the array it is; none: all of it.
    """

    name: str
    code: str
    shape: tuple[int, ...]
    offset: int
    part: int | None = None

    @property
    def key(self) -> str:
        """What it is called in records of numpy: other than its name, this is its alone."""
        return str(self.offset)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How the messages of a column are laid out; each method gives the layout with something appended.

    Attributes:
        template: the message with zeros where its fields lie.
        fields: what differs from message to message, in order.
    """

    template: bytes = ENCAPSULATION
    fields: tuple[Field, ...] = ()

    def stamp(self) -> Layout:
        """With a stamp: the fields ``seconds`` and ``nanoseconds``; all stamps of a message are the same."""
        return self._field("seconds", "<i4", 4, ())._field("nanoseconds", "<u4", 4, ())

    def text(self, value: str) -> Layout:
        """With a text that is the same in all messages."""
        content = value.encode() + b"\x00"
        return self.count(len(content))._bytes(content)

    def texts(self, values: Sequence[str]) -> Layout:
        """With a sequence of texts that is the same in all messages."""
        layout = self.count(len(values))
        for value in values:
            layout = layout.text(value)
        return layout

    def count(self, number: int) -> Layout:
        """With an unsigned 32-bit number that is the same in all messages."""
        return self._aligned(COUNT.size)._bytes(COUNT.pack(number))

    def numbers(self, name: str, count: int, part: int | None = None) -> Layout:
        """With a field of `count` 64-bit floats, one or more; `part`: which of several in a row of the array."""
        return self._field(name, "<f8", 8, (count,), part)

    def truth(self, name: str) -> Layout:
        """With a field that is true or false."""
        return self._field(name, "?", 1, ())

    @property
    def dtype(self) -> np.dtype[Any]:
        """One message as a record of numpy."""
        return np.dtype(
            {
                "names": [field.key for field in self.fields],
                "formats": [(field.code, field.shape) for field in self.fields],
                "offsets": [field.offset for field in self.fields],
                "itemsize": len(self.template),
            }
        )

    def encode(self, rows: int, values: Mapping[str, NDArray[Any]]) -> list[bytes]:
        """Messages; `values` maps the names of all fields to arrays, shape (rows, [parts,] [count])."""
        size = len(self.template)
        content = bytearray(self.template * rows)
        records = np.ndarray(rows, self.dtype, content)
        for field in self.fields:
            records[field.key] = values[field.name] if field.part is None else values[field.name][:, field.part]
        whole = bytes(content)
        return [whole[start : start + size] for start in range(0, rows * size, size)]

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """The fields' arrays, shape (n,), (n, count) or (n, parts, count), of n messages.

        Raises ValueError, with the message's number from 1, where one is not of this layout.
        """
        size = len(self.template)
        for number, message in enumerate(messages, start=1):
            if len(message) != size:
                raise ValueError(f"message {number} has {len(message)} bytes instead of {size}")
        content = b"".join(messages)
        records = np.ndarray(len(messages), self.dtype, content)
        raw = np.ndarray((len(messages), size), np.uint8, content)
        same = np.frombuffer(self.template, np.uint8)
        constant = np.ones(size, dtype=np.bool_)
        for field in self.fields:
            constant[field.offset : field.offset + self.dtype[field.key].itemsize] = False
        differs = (raw[:, constant] != same[constant]).any(axis=1)
        if differs.any():
            raise ValueError(f"message {int(np.argmax(differs)) + 1} is not laid out as the others")
        parts: dict[str, list[NDArray[Any]]] = {}
        whole: dict[str, NDArray[Any]] = {}
        for field in self.fields:
            if field.part is None:
                whole[field.name] = np.ascontiguousarray(records[field.key])
            else:
                parts.setdefault(field.name, []).append(records[field.key])
        return {**whole, **{name: np.stack(columns, axis=1) for name, columns in parts.items()}}

    def _field(self, name: str, code: str, size: int, shape: tuple[int, ...], part: int | None = None) -> Layout:
        aligned = self._aligned(size)
        field = Field(name=name, code=code, shape=shape, offset=len(aligned.template), part=part)
        count = shape[0] if shape else 1
        return Layout(template=aligned.template + bytes(size * count), fields=(*aligned.fields, field))

    def _aligned(self, size: int) -> Layout:
        """With zeros up to where a value of this size may begin."""
        return self._bytes(bytes((len(ENCAPSULATION) - len(self.template)) % size))

    def _bytes(self, content: bytes) -> Layout:
        return Layout(template=self.template + content, fields=self.fields)


def encode_texts(values: Iterable[str]) -> list[bytes]:
    """Messages of one text each, std_msgs/msg/String."""
    return [Layout().text(value).template for value in values]


def decode_texts(messages: Sequence[bytes]) -> tuple[str, ...]:
    """The texts of messages of one text each; raises ValueError, with the message's number from 1, where one is not."""
    found = []
    for number, message in enumerate(messages, start=1):
        text = message[len(ENCAPSULATION) + COUNT.size : -1].decode(errors="replace")
        if Layout().text(text).template != message:
            raise ValueError(f"message {number} is not a text")
        found.append(text)
    return tuple(found)
