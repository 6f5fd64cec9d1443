"""Values in the text of a robot file, replaced by tomlkit; everything else stays as it is, comments too."""
from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit


def steps_below(node: Any) -> list[str]:
    if isinstance(node, dict):
        return list(node)
    return [str(i) for i in range(len(node))] if isinstance(node, list) else []


def below(node: Any, step: str) -> Any:
    return node[int(step)] if isinstance(node, list) else node[step]


def suggestion(name: str, known: Sequence[str], above: str = "") -> str:
    near = difflib.get_close_matches(name, known, 1)
    return f"did you mean {above}{near[0]}? " if near else ""


def replace(node: Any, key: str, value: Any) -> None:
    """The value alone: spaces and comment of the old one stay."""
    new = tomlkit.item(value)
    at: Any = int(key) if isinstance(node, list) else key
    if key in steps_below(node):
        new._trivia = below(node, key)._trivia
        node[at] = new
    else:
        node[at] = new


def with_words(text: str, values: Mapping[str, Mapping[str, Any]]) -> str:
    """The text with these values: {section: {key: value}}; a section or key that is not there is added."""
    document = tomlkit.parse(text)
    for section, keys in values.items():
        if section not in document:
            document[section] = tomlkit.table()
        for key, value in keys.items():
            replace(document[section], key, value)
    return tomlkit.dumps(document)
