"""Pages of the interfaces for the site: C headers as they stand, and the public names of the Python package."""

import ast
import re

FIRST = ["Robot", "Controller", "Plant", "lockstep", "rollout", "Posterior", "Info", "Measurement", "Command"]


# ---- the C interface -------------------------------------------------------------------------------


def sections(header):
    """(title, text) of a header that divides itself by /* ---- title ---- */."""
    parts = re.split(r"^/\* -{3,} (.*?) -*-? ?\*/$", header, flags=re.M)
    return [("Overview", parts[0])] + list(zip((p.strip(" -") for p in parts[1::2]), parts[2::2]))


def names_of(text):
    """Functions and types that a section declares."""
    functions = re.findall(r"^[a-z].*?\b(tiller_\w+)\(", text, flags=re.M)
    types = re.findall(r"^\} (tiller_\w+_t);|^typedef .*\b(tiller_\w+_t);", text, flags=re.M)
    return list(dict.fromkeys([a or b for a, b in types] + functions))


def header_page(path, root):
    header = path.read_text(encoding="utf-8")
    out = [f"# {path.name}\n", f"The header is the manual; this is all of `{path.relative_to(root)}`.\n"]
    for title, text in sections(header):
        if not text.strip():
            continue
        out += [f"## {title}\n"]
        names = names_of(text)
        if names:
            out += [", ".join(f"`{n}`" for n in names) + "\n"]
        out += ["```c", text.strip("\n"), "```\n"]
    return "\n".join(out)


# ---- the Python package ----------------------------------------------------------------------------


def call_text(text, start):
    """From an opening bracket on to the one that closes it; brackets in literals do not count."""
    depth, literal, i = 0, False, start
    while True:
        c = text[i]
        if literal:
            i += c == "\\"
            literal = c != '"'
        elif c == '"':
            literal = True
        depth += (c in "([{") * (not literal)
        depth -= (c in ")]}") * (not literal)
        if depth == 0:
            return text[start:i + 1]
        i += 1


def bound_texts(bindings):
    """{"Class" or "Class.member": docstring} of the extension's sources."""
    found = {}
    for path in sorted(bindings.glob("*.cpp")):
        text, owner = path.read_text(encoding="utf-8"), ""
        calls = re.compile(r"nb::class_<[^(]*?>\s*(?:\w+)?(?=\()|\bm\.def(?=\()|\.def(?:_prop_ro|_static)?(?=\()|"
                           r"\bTILLER_SCALAR(?=\([a-z_]+, [a-z])|\bcontroller\b(?=\s*\.def)")
        for match in calls.finditer(text):
            if match[0] == "controller":
                owner = "Controller"
                continue
            call = call_text(text, match.end())
            literals = re.findall(r'"((?:[^"\\]|\\.)*)"', call)
            ending = re.search(r'((?:"(?:[^"\\]|\\.)*"\s*)+)\)$', call)
            words = "".join(re.findall(r'"((?:[^"\\]|\\.)*)"', ending[1])) if ending else ""
            words = words.replace('\\"', '"').replace("\\n", "\n")
            if match[0].startswith("nb::class_"):
                owner = literals[0]
                found[owner] = words if len(literals) > 1 else ""
            elif match[0] == "TILLER_SCALAR":
                found[f"{owner}.{re.match(r'.([a-z_]+)', call)[1]}"] = words
            elif literals:
                name = ("" if match[0] == "m.def" else owner + ".") + literals[0]
                found[name] = words if words != literals[0] else ""
    return found


def is_property(node):
    return any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)


def type_text(node):
    """A reader's words for the stub's."""
    text = ast.unparse(node)
    for own, word in (("_Doubles", "ndarray"), ("npt.ArrayLike", "array"), ("_Path", "path"), ("_core.", "")):
        text = text.replace(own, word)
    return re.sub(r"npt\.NDArray\[[\w.]+\]", "ndarray", text)


def signature(node, name):
    given = re.sub(r"^self(, )?", "", type_text(node.args))
    return f"{name}({given})" + (f" -> {type_text(node.returns)}" if node.returns else "")


def class_text(node, texts):
    own = ast.get_docstring(node) or texts.get(node.name, "")
    out = [f"## {node.name}\n"] + ([own + "\n"] if own else [])
    rows = []
    for inner in node.body:
        if not isinstance(inner, ast.FunctionDef):
            continue
        is_made_by_readers = inner.name == "__init__" and node.name in FIRST
        if inner.name.startswith("_") and not is_made_by_readers:
            continue
        told = ast.get_docstring(inner) or texts.get(f"{node.name}.{inner.name}", "")
        if is_property(inner):
            kind = type_text(inner.returns) if inner.returns else ""
            rows.append(f"| `{inner.name}` | `{kind}` | {' '.join(told.split()).replace('|', chr(92) + '|')} |")
        else:
            name = node.name if inner.name == "__init__" else f"{node.name}.{inner.name}"
            out.append(f"**`{signature(inner, name)}`**\n" + f"\n{told}\n" * bool(told))
    if rows:
        out += ["| read | type | meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"]
    values = [n.targets[0].id for n in node.body if isinstance(n, ast.Assign)]
    if values:
        out += [", ".join(f"`{v}`" for v in values) + "\n"]
    return "\n".join(out)


def python_page(package):
    """What `from tiller import ...` gives, the names that a loop needs first; nothing of private modules."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in
             [package / "_core.pyi", *sorted(package.glob("*.py"))]}
    init = trees[package / "__init__.py"]
    public = next(ast.literal_eval(n.value) for n in init.body
                  if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "__all__")
    texts = bound_texts(package.parent / "bindings")
    where = {}
    for path, tree in reversed(trees.items()):  # the stub's own wins; of a function of both the documented one
        for node in tree.body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and (node.name not in where or
                                                                     not ast.get_docstring(where[node.name])):
                where[node.name] = node
    order = [n for n in FIRST if n in public] + sorted((n for n in public if n not in FIRST), key=str.lower)
    out = ["# Python: Robot, Controller, Plant\n", f"```python\n{ast.get_docstring(init)}\n```\n",
           "[The guide](../guide/python.md) shows them at work. Environments for Gymnasium are in `tiller.envs`.\n"]
    for name in order:
        node = where[name]
        if isinstance(node, ast.ClassDef):
            out.append(class_text(node, texts))
        else:
            told = ast.get_docstring(node) or texts.get(name, "")
            out += [f"## {name}\n", f"**`{signature(node, name)}`**\n"] + [f"```text\n{told}\n```\n"] * bool(told)
    return "\n".join(out)
