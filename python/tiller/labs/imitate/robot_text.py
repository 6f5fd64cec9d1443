"""Numbers in the text of a robot file, found and replaced by tomlkit; everything else stays as it is, comments too."""
from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from typing import Any

import tomlkit
from tomlkit.items import Float, Integer

from .problem import ImitationError

# What stands below [cost] and multiplies a term. A * is any name or index, a # an index: the terms of the catalogue.
WEIGHTS = ("state_weight.*", "terminal_weight.*", "bounds.*.weight", "input_weight.*", "input_rate_weight.*",
           "saturating_weight", "*.#.weight", "outputs.*.weight", "outputs.*.terminal_weight",
           "outputs.*.bound_weight")


def _steps(node: Any) -> list[str]:
    if isinstance(node, dict):
        return list(node)
    return [str(i) for i in range(len(node))] if isinstance(node, list) else []


def _below(node: Any, step: str) -> Any:
    return node[int(step)] if isinstance(node, list) else node[step]


def _matches(node: Any, pattern: Sequence[str], path: str) -> Iterator[tuple[str, float]]:
    if not pattern:
        if isinstance(node, int | float) and not isinstance(node, bool):
            yield path, float(node)
        return
    for step in _steps(node):
        if pattern[0] in ("*", step) or (pattern[0] == "#" and isinstance(node, list)):
            yield from _matches(_below(node, step), pattern[1:], f"{path}.{step}")


def weights(text: str) -> dict[str, float]:
    """The weights above zero that stand in the file as numbers, by their paths, in the order of WEIGHTS."""
    cost = tomlkit.parse(text).get("cost", {})
    return {path: value for pattern in WEIGHTS for path, value in _matches(cost, pattern.split("."), "cost")
            if value > 0}


def suggestion(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, 1)
    return (f"did you mean {near[0]}? " if near else "") + "there: " + ", ".join(known)


def number(text: str, path: str) -> float | None:
    node: Any = tomlkit.parse(text)
    for step in path.split("."):
        if step not in _steps(node):
            return None
        node = _below(node, step)
    return float(node) if isinstance(node, int | float) and not isinstance(node, bool) else None


def with_numbers(text: str, values: dict[str, float]) -> str:
    """The text with other numbers at these paths, with six digits."""
    document = tomlkit.parse(text)
    for path, value in values.items():
        node: Any = document
        *steps, last = path.split(".")
        for step in steps:
            node = _below(node, step)
        old = _below(node, last)
        if not isinstance(old, Integer | Float):
            raise ImitationError(f"{path} is no number in the file; write one in its place")
        new = tomlkit.item(float(f"{value:.6g}"))
        new._trivia = old._trivia  # spaces and comment
        node[int(last) if isinstance(node, list) else last] = new
    return tomlkit.dumps(document)


def without(text: str, path: str) -> str:
    """The text without what stands at the path, if it is there."""
    document = tomlkit.parse(text)
    node: Any = document
    *steps, last = path.split(".")
    for step in steps:
        if step not in _steps(node):
            return text
        node = _below(node, step)
    if last in _steps(node):
        del node[last]
    return tomlkit.dumps(document)


def acting(text: str, planner: str, policy: str) -> str:
    """The robot file that follows the policy file `policy`, its planner as the fallback."""
    document = tomlkit.parse(text)
    for section, key, value in (("planner", "kind", "policy"), ("planner", "fallback", planner),
                                ("policy", "file", policy)):
        if section not in document:
            document[section] = tomlkit.table()
        document[section][key] = value
    return tomlkit.dumps(document)
