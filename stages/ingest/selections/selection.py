"""Selections: expressions that say which numbers of a recording are an arm's pose or force.

`/topic`, `/topic:field.path`, `/topic:data[0:3]`, `/topic:x,y,z`, `/tf:parent->child`, `/joint_states:fk(link)`; of
tables `left_` (prefix), `left_x,left_y,left_z`, `observation.state[0:3]`, `observation.state:a,b,c`, `table:fk(link)`.
An expression is parsed once, resolved once against the topics of a recording, and compiled into an extractor. Nothing
is read here, and nothing is done about bad numbers (`cleaning.py`). Tables are in `columns.py`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.errors import DataError, ParameterError
from stages.ingest.names import SHOWN, listed, nearest
from stages.ingest.recording import Topic
from stages.ingest.selections import layouts
from stages.ingest.selections.columns import resolve_columns, resolve_elements, resolve_joints
from stages.ingest.selections.extractors import Flag, JointPositions, Leaves, Numbers, Part, Step, Transforms
from stages.ingest.selections.kinematics import Robot
from stages.ingest.selections.resolved import MEANT, NEEDED, Quantity, Resolved, chain_to, layout_of, resolved

TABLE, ROWS = "table", "rows"
"""Name and type of the one topic of a file of rows."""

NOUNS = {"pose": "position", "force": "force", "number": "number"}


@dataclass(frozen=True, kw_only=True)
class Selection:
    """A parsed expression.

    Attributes:
        text: as written. location: dotted place of the parameter.
        head: topic or column of lists before the first colon; "" where there is no colon.
        paths: what is named behind the colon.
        frames: parent and child. link: end of the chain for forward kinematics.
    """

    text: str
    location: str
    head: str
    paths: tuple[str, ...] = ()
    frames: tuple[str, str] | None = None
    link: str = ""

    def resolve(
        self, topics: Sequence[Topic], source: str, robot: Robot | None = None, quantity: Quantity = "pose"
    ) -> Resolved:
        """What to read from the recording called `source`, which has these topics.

        Raises DataError, with the nearest names that there are, where there is no such topic, field, link or column or
        it is no number; ParameterError where it needs a robot description and there is none.
        """
        place = f"{source}, {self.text}"
        table = _table(topics)
        if table is not None:
            return self._resolve_rows(table, place, robot, quantity)
        by_name = {topic.name: topic for topic in topics}
        name = self.head or self.text
        if name not in by_name:
            raise DataError(place, f"there is no topic {name!r}; {nearest(name, by_name)}")
        topic = by_name[name]
        if topic.problem:
            raise DataError(place, topic.problem)
        if topic.count == 0:
            raise DataError(place, "the topic has no messages: select another, or record it again.")
        if self.frames is not None:
            if "transforms[].transform.translation.x" not in topic.fields:
                raise DataError(
                    place, f"messages of type {topic.type} are no transforms between frames; TFMessage is needed."
                )
            return resolved(place, topic, Transforms(*self.frames), 7, "quaternion")
        if self.link:
            if layouts.find(topic.fields, ("position",)) is None:
                raise DataError(place, f"messages of type {topic.type} hold no joint positions; JointState is needed.")
            chain = chain_to(self.link, robot, place)
            return resolved(place, topic, JointPositions(chain.drivers), len(chain.drivers), "joints", chain=chain)
        if quantity == "pose" and topic.type.endswith("/JointState"):
            raise DataError(
                place,
                f"holds joint positions, no pose: name a link of ingest.urdf, such as {topic.name}:fk(left_hand).",
            )
        if len(self.paths) > 1:
            return self._resolve_numbers(topic, place, quantity)
        return self._resolve_field(topic, self.paths[0] if self.paths else "", place, quantity)

    def fits(self, topics: Sequence[Topic], quantity: Quantity = "pose") -> bool:
        """Whether a recording with these topics has the topic or the columns that are named."""
        table = _table(topics)
        if table is None:
            return (self.head or self.text) in {topic.name for topic in topics}
        if self.link:
            return True
        try:
            self._resolve_rows(table, "", None, quantity)
        except DataError:
            return False
        return True

    def _resolve_rows(self, table: Topic, place: str, robot: Robot | None, quantity: Quantity) -> Resolved:
        if table.problem:
            raise DataError(place, table.problem)
        if table.count == 0:
            raise DataError(place, "the table has no rows.")
        if self.frames is not None:
            raise DataError(place, f"a table has no frames: name columns; {nearest('x', table.fields)}")
        if self.link:
            return resolve_joints(table, self.link, robot, place)
        if self.head and self.head != TABLE:
            return resolve_elements(table, self.head, self.paths, place, quantity)
        return resolve_columns(table, ",".join(self.paths) or self.text, place, quantity)

    def _resolve_numbers(self, topic: Topic, place: str, quantity: Quantity) -> Resolved:
        """Several paths, each to one number."""
        steps = [_steps(path, self.location) for path in self.paths]
        for path, step in zip(self.paths, steps, strict=True):
            found = layouts.find(topic.fields, step)
            if found is None or found.below != ("",):
                raise DataError(place, _no_field(path, topic, "number"))
        return resolved(place, topic, Numbers(steps), len(steps), layout_of(len(steps), place, quantity))

    def _resolve_field(self, topic: Topic, path: str, place: str, quantity: Quantity) -> Resolved:
        """One path: to a message that holds one position, to numbers of an array, or to a number."""
        steps = _steps(path, self.location) if path else ()
        found = layouts.find(topic.fields, steps)
        if found is None:
            raise DataError(place, _no_field(path, topic, quantity))
        if steps and isinstance(steps[-1], slice):
            width = steps[-1].stop - steps[-1].start
            return resolved(place, topic, Part(steps, width), width, layout_of(width, place, quantity))
        length = layouts.array_length(found.below)
        if length is not None:
            if length not in NEEDED[quantity]:
                example = f"{topic.name}:{path}[0:{NEEDED[quantity][0]}]"
                raise DataError(place, f"is an array: name {MEANT[quantity]} of it, such as {example}.")
            return resolved(place, topic, Part(steps, length), length, layout_of(length, place, quantity))
        if quantity == "number":
            return _resolve_number(topic, steps, found.below, place)
        if found.below == ("",):
            raise DataError(place, f"is one number: name {MEANT[quantity]}, joined by commas.")
        triples = layouts.candidates(found.below, quantity)
        if not triples:
            raise DataError(place, _no_field(path, topic, quantity))
        if len(triples) > 1:
            prefix = f"{path}." if path else ""
            several = [f"{topic.name}:{prefix}{triple.removesuffix('.position')}" for triple in triples[:SHOWN]]
            raise DataError(place, f"holds more than one {NOUNS[quantity]}: choose {' or '.join(several)}.")
        layout, leaves = layouts.pose_leaves(found.below, triples[0])
        if quantity == "force":
            layout, leaves = "position", leaves[:3]
        return resolved(place, topic, Leaves(steps, leaves), len(leaves), layout)


def parse(text: str, location: str) -> Selection:
    """A selection from its expression; `location` is the dotted place of the parameter.

    Raises ParameterError where it is none.
    """
    text = text.strip()
    head, rest = _split(text)
    if not text or (rest is not None and not (head and rest)):
        raise ParameterError(location, f"{text!r} is no selection, such as /topic, /topic:field.path or left_.")
    if rest is None:
        return Selection(text=text, location=location, head="")
    if "->" in rest:
        parent, _, child = (part.strip() for part in rest.partition("->"))
        if not parent or not child:
            raise ParameterError(location, f"{text!r} names no pair of frames, such as /tf:base_link->left_hand.")
        return Selection(text=text, location=location, head=head, frames=(parent, child))
    match = re.fullmatch(r"fk\(\s*(.+?)\s*\)", rest)
    if match is not None:
        return Selection(text=text, location=location, head=head, link=match[1])
    paths = tuple(path.strip() for path in rest.split(","))
    if not all(paths):
        raise ParameterError(location, f"{text!r} has a comma too many.")
    return Selection(text=text, location=location, head=head, paths=paths)


def _resolve_number(topic: Topic, steps: Sequence[Step], below: Sequence[str], place: str) -> Resolved:
    numbers = [name for name in below if "[" not in name]
    if len(numbers) != 1:
        raise DataError(place, f"is not one number: name one; {nearest('data', topic.fields)}")
    path = (*steps, *(numbers[0].split(".") if numbers[0] else ()))
    return resolved(place, topic, Flag(Numbers([path])), 1, "number")


def _table(topics: Sequence[Topic]) -> Topic | None:
    return next((topic for topic in topics if topic.name == TABLE and topic.type == ROWS), None)


def _split(text: str) -> tuple[str, str | None]:
    """What stands before and behind the first colon that is not in brackets; none where there is no such colon."""
    depth = 0
    for index, letter in enumerate(text):
        depth += (letter == "[") - (letter == "]")
        if letter == ":" and depth == 0:
            return text[:index].strip(), text[index + 1 :].strip()
    return text, None


def _steps(path: str, location: str) -> tuple[Step, ...]:
    try:
        return layouts.steps_of(path)
    except ValueError as error:
        raise ParameterError(location, f"{error}.") from None


def _no_field(path: str, topic: Topic, quantity: str) -> str:
    if quantity == "pose" and any(field.startswith("transforms[]") for field in topic.fields):
        return f"messages of type {topic.type} hold transforms: name a pair, such as {topic.name}:parent->child."
    lists = [field for field in topic.fields if "[]" in field and (field.endswith(("[]", ".x")))]
    if not path and lists and quantity != "number":
        name, _, rest = lists[-1].partition("[]")
        example, what = (f"{name}[0]", "one of them") if rest else (f"{name}[0:3]", "numbers of one")
        return (
            f"messages of type {topic.type} hold no {NOUNS[quantity]} but arrays: name {what}, such as "
            f"{topic.name}:{example}."
        )
    if not path:
        held = f"; it holds {listed(topic.fields)}" if topic.fields else ""
        return f"messages of type {topic.type} hold no {NOUNS[quantity]}: select another topic{held}."
    valid = (layouts.candidates(topic.fields, quantity) if quantity != "number" else ()) or topic.fields
    return f"messages of type {topic.type} hold no {NOUNS[quantity]} at {path!r}; {nearest(path, valid)}"
