"""Experiment files as texts: a parameter set in one, its comments kept. Nothing is read or written."""

from __future__ import annotations

import json
import tomllib
from typing import Any

from pipeline.errors import UsageError
from pipeline.values import flatten


def edited(text: str, location: str, value: Any) -> str:
    """An experiment file with one parameter set: its line replaced where it has one, else added to its table."""
    table, _, key = location.rpartition(".")
    head = f"[{table}]"
    line = f"{key} = {json.dumps(value, ensure_ascii=False)}"
    lines = text.splitlines()
    if table and head not in lines:
        lines += ["", head]
    begin = lines.index(head) + 1 if table else 0
    end = next((i for i in range(begin, len(lines)) if lines[i].startswith("[")), len(lines))
    standing = [i for i in range(begin, end) if lines[i].partition("=")[0].strip() == key]
    if standing:
        lines[standing[0]] = line
    else:
        lines.insert(begin, line)
    text_now = "\n".join(lines) + "\n"
    try:
        reached = _leaves(text_now) == {**_leaves(text), location: value}
    except tomllib.TOMLDecodeError:
        reached = False
    if not reached:
        raise UsageError(
            f"--set {location}: a new file takes plain values in plain tables only; edit the file for the rest."
        )
    return text_now


def _leaves(text: str) -> dict[str, Any]:
    """What a TOML text sets, by dotted name; empty tables set nothing."""
    return {name: value for name, value in flatten(tomllib.loads(text)).items() if value != {}}
