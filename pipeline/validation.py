"""Validation at the edge: plain tables from TOML into frozen parameter classes, errors with their dotted location."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
import typing
from collections.abc import Mapping
from typing import Annotated, Any

from pipeline.errors import ParameterError, choices
from pipeline.stage import Stage

LONGEST = 60
"""Characters of a wrong value that a message shows."""

_MISSING = ("missing", "missing_argument", "missing_keyword_only_argument")


def validate(stage: Stage, given: Mapping[str, Any]) -> Any:
    """The stage's parameters made of a plain table.

    Raises ParameterError for the first thing that is wrong: unknown name, missing name, wrong type, value out of range.
    """
    return validate_as(stage.parameters, stage.name, given)


def validate_as(declared: Any, location: str, given: Mapping[str, Any]) -> Any:
    """A declared class of parameters, or one of a union of such told apart by `kind`, made of a plain table.

    Raises ParameterError, as `validate`; `location` is the dotted place of the table.
    """
    from pydantic import ValidationError

    if not isinstance(given, Mapping):
        raise ParameterError(location, f"must be a table, not {given!r}.")
    given = dict(given)
    members = _members(declared)
    if len(members) > 1:
        given.setdefault("kind", _kind(members[0]))
        kinds = {_kind(member): member for member in members}
        if not isinstance(given["kind"], str) or given["kind"] not in kinds:
            raise ParameterError(
                f"{location}.kind", f"there is no kind {given['kind']!r}; {choices(str(given['kind']), kinds)}"
            )
        chosen = kinds[given["kind"]]
    else:
        chosen = members[0]
    text = json.dumps(given, default=_plain)
    try:
        # From JSON, so that lists become tuples while strict types stay strict.
        return _adapter(chosen).validate_json(text)
    except ValidationError as error:
        problems = error.errors(include_url=False)
        # A name that is misspelt is a better message than that the right one is missing.
        first = next((problem for problem in problems if problem["type"] not in _MISSING), problems[0])
        raise _translate(location, chosen, json.loads(text), first) from None


def _plain(value: Any) -> Any:
    """An array as lists, anything else that JSON does not know as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


@functools.cache
def _adapter(cls: type) -> Any:
    from pydantic import TypeAdapter

    return TypeAdapter(cls)


def _members(declared: Any) -> tuple[type, ...]:
    if typing.get_origin(declared) is Annotated:
        declared = typing.get_args(declared)[0]
    if typing.get_origin(declared) in (typing.Union, types.UnionType):
        return typing.get_args(declared)
    return (declared,)


def _kind(cls: type) -> str:
    return str(next(f.default for f in dataclasses.fields(cls) if f.name == "kind"))


def _translate(stage: str, cls: type, given: Any, problem: Any) -> ParameterError:
    """One of pydantic's findings as a sentence at its dotted location."""
    location = _location(given, problem["loc"])
    dotted = ".".join((stage, *map(str, location)))
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        owner = _owner(cls, given, location[:-1])
        return ParameterError(dotted, f"unknown parameter; {choices(str(location[-1]), _names(owner))}")
    if kind in _MISSING and isinstance(problem["loc"][-1], str):
        return ParameterError(dotted, "must be given.")
    if kind == "union_tag_invalid":
        valid = [text.strip("' ") for text in str(context["expected_tags"]).split(",")]
        return ParameterError(
            f"{dotted}.kind", f"there is no kind {context['tag']!r}; {choices(context['tag'], valid)}"
        )
    if kind == "union_tag_not_found":
        return ParameterError(f"{dotted}.kind", "must be given.")
    if kind in ("too_short", "too_long", *_MISSING):
        exactly = _entries(cls, given, location)
        limit = exactly or context.get("min_length", context.get("max_length"))
        bound = "" if exactly else "at least " if kind == "too_short" else "at most "
        noun = "entry" if limit == 1 else "entries"
        return ParameterError(dotted, f"must have {bound}{limit} {noun}, not {len(_at(given, location))}.")
    if kind == "literal_error":
        return ParameterError(dotted, f"must be {context['expected']}, not {problem['input']!r}.")
    message = str(context.get("error", problem["msg"])).removeprefix("Input ").rstrip(".")
    message = message.replace("an object", "a table")  # as TOML calls it
    value = json.dumps(problem["input"], default=str)
    shown = value if len(value) <= LONGEST else f"{value[:LONGEST]}…"
    return ParameterError(dotted, f"{message}." if kind == "value_error" else f"{message}, not {shown}.")


def _location(given: Any, loc: tuple[Any, ...]) -> list[Any]:
    """Pydantic's location without the names of union members that it puts between."""
    location: list[Any] = []
    here = given
    told = False  # the member's name has been passed: a field of the same name may follow
    for index, part in enumerate(loc):
        inside = (isinstance(here, dict) and part in here) or (
            isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        if inside:
            here, told = here[part], False
            location.append(part)
        elif index == len(loc) - 1 and isinstance(here, dict) and (told or here.get("kind") != part):
            location.append(part)
        else:
            told = True
    return location


def _at(given: Any, location: list[Any]) -> Any:
    """What is given at a location."""
    return functools.reduce(lambda here, part: here[part], location, given)


def _entries(cls: Any, given: Any, location: list[Any]) -> int | None:
    """How many entries the list at a location must have; none: no one number is declared."""
    named = max((depth for depth, part in enumerate(location) if isinstance(part, str)), default=-1)
    if named < 0:
        return None
    owner = _owner(cls, given, location[:named])
    hint = typing.get_type_hints(owner, include_extras=True).get(location[named])
    for part in location[named + 1 :]:
        arguments = _tuple(hint)
        if not arguments:
            return None
        hint = arguments[0 if Ellipsis in arguments else min(part, len(arguments) - 1)]
    for limits in getattr(hint, "__metadata__", ()):
        shortest = getattr(limits, "min_length", None)
        if shortest and shortest == getattr(limits, "max_length", None):
            return int(shortest)
    arguments = _tuple(hint)
    return len(arguments) if arguments and Ellipsis not in arguments else None


def _tuple(hint: Any) -> tuple[Any, ...]:
    """The types of the entries of a tuple, or of the tuple among the members of a union; none: there is no tuple."""
    return next((typing.get_args(member) for member in _members(hint) if typing.get_origin(member) is tuple), ())


def _owner(cls: Any, given: Any, location: list[Any]) -> Any:
    """The parameter class that stands at a location."""
    here = given
    for part in location:
        here = here[part]
        if isinstance(part, str):
            cls = typing.get_type_hints(cls).get(part, cls)
        else:
            arguments = [a for a in typing.get_args(cls) if a is not Ellipsis]
            cls = arguments[min(part, len(arguments) - 1)] if arguments else cls
        while typing.get_origin(cls) is Annotated:
            cls = typing.get_args(cls)[0]
        for member in _members(cls):
            if (
                dataclasses.is_dataclass(member)
                and isinstance(here, dict)
                and here.get("kind") == _kind_or_none(member)
            ):
                cls = member
                break
    return cls


def _kind_or_none(cls: Any) -> str | None:
    return next((str(f.default) for f in dataclasses.fields(cls) if f.name == "kind"), None)


def _names(cls: Any) -> list[str]:
    return [f.name for f in dataclasses.fields(cls)] if dataclasses.is_dataclass(cls) else []
