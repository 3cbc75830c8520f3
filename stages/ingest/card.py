"""Dataset cards, datasets/<name>/dataset.toml: where data come from, under which licence, what is in them.

Read for people (`clpv show`) and written when recordings are ingested; no result depends on a card.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import DataError

FILE = "dataset.toml"


def card_path(root: Path, name: str) -> Path:
    """Where the card of a dataset lies in a project."""
    return root / "datasets" / name / FILE


def read_card(root: Path, name: str) -> dict[str, str]:
    """What a card says, as texts by name, its list of files as a count; empty where there is no card.

    Raises DataError where the card is no TOML.
    """
    path = card_path(root, name)
    if not path.is_file():
        return {}
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DataError(f"datasets/{name}/{FILE}", f"is not valid TOML: {error}.") from None
    facts = {}
    for key, value in document.items():
        if key == "files" and isinstance(value, dict):
            facts[key] = f"{len(value)} with sha256"
        elif isinstance(value, dict):
            facts[key] = ", ".join(f"{inner} {shown}" for inner, shown in value.items())
        else:
            facts[key] = str(value)
    return facts


def card_text(
    name: str,
    files: Mapping[str, str],
    demonstrations: Sequence[tuple[str, str, int]],
    selections: Mapping[str, str],
    before: Mapping[str, str],
) -> str:
    """The text of a card for recordings that were just ingested.

    Arguments:
        before: facts of the card that it replaces: what people wrote in it (title, source, licence) stays.
        files: path relative to the project -> sha256.
        demonstrations: (name, split, samples) of each.
        selections: what was read of them, e.g. ``left`` -> ``/left/pose``.
    """
    splits = [split for _, split, _ in demonstrations]
    words = {
        "title": f"Recorded demonstrations: {name}",
        "source": "recorded by you: say with which robot, where and when",
        "licence": "not stated: say under which licence others may use it",
    }
    lines = [
        f"name = {toml(name)}",
        *(f"{key} = {toml(before.get(key, text))}" for key, text in words.items()),
        "",
        "[selections]",
        *(f"{key} = {toml(value)}" for key, value in selections.items()),
        "",
        "[counts]",
        f"demonstrations = {len(demonstrations)}",
        f"train = {splits.count('train')}",
        f"test = {splits.count('test')}",
        f"samples = {sum(samples for _, _, samples in demonstrations)}",
        "",
        "[split]",
        *(f"{toml(demo)} = {toml(split)}" for demo, split, _ in demonstrations),
        "",
        "# sha256 of each file; of a folder, over the sorted relative paths and digests of its files.",
        "[files]",
        *(f"{toml(path)} = {toml(digest)}" for path, digest in files.items()),
    ]
    return "\n".join(lines) + "\n"


def toml(value: Any) -> str:
    """A text, number, boolean or list as TOML, which writes these as JSON does."""
    # DEL is the one character that JSON leaves as it is and TOML does not allow.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
