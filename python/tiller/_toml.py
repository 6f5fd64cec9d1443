"""Writes the TOML that robot files need from dictionaries: numbers, text, flags, lists and tables."""
from __future__ import annotations

import json
from collections.abc import Mapping, Sequence


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(float(value))  # nan and inf are TOML's words too
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return _value(float(value))  # type: ignore[arg-type]  # numpy's numbers


def _key(key: object) -> str:
    text = str(key)
    return text if text.replace("_", "").replace("-", "").isalnum() else json.dumps(text)


def dumps(document: Mapping[str, object]) -> str:
    """A document whose first level is sections, or lists of sections; below them tables are written in line."""
    lines: list[str] = []
    for name, section in document.items():
        parts = section if isinstance(section, list) else [section]
        for part in parts:
            if not isinstance(part, Mapping):
                raise TypeError(f"{name} is {part!r}; a robot file has sections: write a dictionary")
            lines.append(f"[[{_key(name)}]]" if isinstance(section, list) else f"[{_key(name)}]")
            lines.extend(f"{_key(k)} = {_value(v)}" for k, v in part.items())
            lines.append("")
    return "\n".join(lines)
