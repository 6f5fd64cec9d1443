"""Checks gap.json against its schema: by jsonschema where it is installed, else by what the schema uses of the language."""

import json
import os
from pathlib import Path

SCHEMA = Path(os.environ["TILLER_PYTHON_PACKAGE"]) / "tiller_tools" / "gap.schema.json"
_TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def _is_type(value, name: str) -> bool:
    if name in ("number", "integer"):
        return not isinstance(value, bool) and isinstance(value, (int, float) if name == "number" else int)
    return isinstance(value, _TYPES[name])


def _problems(value, schema: dict, path: str) -> list:
    if "const" in schema and value != schema["const"]:
        return [f"{path}: {value!r} is not {schema['const']!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{path}: {value!r} is none of {schema['enum']}"]
    types = schema.get("type", [])
    types = [types] if isinstance(types, str) else types
    if types and not any(_is_type(value, name) for name in types):
        return [f"{path}: {value!r} is no {' or '.join(types)}"]
    found = []
    if isinstance(value, dict):
        found += [f"{path}: lacks {key}" for key in schema.get("required", []) if key not in value]
        for key, item in value.items():
            part = schema.get("properties", {}).get(key, schema.get("additionalProperties"))
            if isinstance(part, dict):
                found += _problems(item, part, f"{path}.{key}")
            elif "properties" in schema and part is None:
                found.append(f"{path}.{key}: is not in the schema")
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            found.append(f"{path}: has {len(value)} items")
        for i, item in enumerate(value):
            found += _problems(item, schema.get("items", {}), f"{path}[{i}]")
    return found


def problems(result: dict) -> list:
    """Sentences; empty: valid."""
    schema = json.loads(SCHEMA.read_text())
    found = _problems(result, schema, "gap")
    try:
        import jsonschema
        found += [error.message for error in jsonschema.Draft202012Validator(schema).iter_errors(result)]
    except ImportError:
        pass
    return found
