#!/usr/bin/env python3
"""The documentation site: docs/, README, the C interface and the Python tools' docstrings, with search.

    site.py ROOT OUT        OUT/html is the site; needs the packages of requirements_site.txt and no network

Pages are copied and their links followed: one to a file outside docs/ leads to a page that shows the file. Fails where
a link leads nowhere, or a page cannot be reached from the first.
"""

import ast
import html.parser
import os
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.parse

import notebooks

LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s]+)\)")
FORMULA = re.compile(r"(\w\[\w+\])\((?=[^)]* )")  # network[member](sin q, ...): no link, though it looks like one
FOLDERS = {"guide": "How to", "reference": "Reference", "theory": "Theory", "evidence": "Evidence",
           "project": "Project"}
PICTURES = {".png", ".svg", ".jpg"}
LANGUAGES = {".h": "c", ".c": "c", ".hpp": "cpp", ".cpp": "cpp", ".py": "python", ".toml": "toml", ".json": "json",
             ".sh": "sh", ".def": "c", ".csv": "text", ".md": "markdown"}
LARGEST = 200_000  # characters of a file that is shown


class Site:
    def __init__(self, root, out):
        self.root, self.source = root, out / "pages"
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(root / "docs", self.source)
        self.shown = {}  # file outside docs -> its page

    def page_of(self, path):
        """The page that shows a file or folder outside docs/, made on first use."""
        if path not in self.shown:
            page = self.source / "source" / (str(path.relative_to(self.root)).replace("/", "_") + ".md")
            page.parent.mkdir(exist_ok=True)
            self.shown[path] = page
            page.write_text(self.show(path), encoding="utf-8")
        return self.shown[path]

    def show(self, path):
        name = path.relative_to(self.root)
        if path.is_dir():
            names = sorted(p.name + "/" * p.is_dir() for p in path.iterdir() if not p.name.startswith((".", "__")))
            return f"# {name}/\n\n" + "".join(f"- `{n}`\n" for n in names)
        text = path.read_text(encoding="utf-8", errors="replace")
        cut = "\n\nThe rest is left out.\n" if len(text) > LARGEST else "\n"
        fence = "`" * 6
        return f"# {name}\n\n{fence}{LANGUAGES.get(path.suffix, 'text')}\n{text[:LARGEST]}\n{fence}{cut}"

    def follow(self, page, origin):
        """Rewrites the links of a page that was at `origin` in the tree."""
        def one(match):
            target, _, anchor = match[2].partition("#")
            if not target or re.match(r"[a-z]+:", target):
                return match[0]
            path = (origin.parent / urllib.parse.unquote(target)).resolve()
            if not path.exists() or not path.is_relative_to(self.root):
                return match[0]  # mkdocs names it as dead
            if path.is_relative_to(self.root / "docs") and path.is_file():
                there = self.source / path.relative_to(self.root / "docs")
            else:
                there, anchor = self.page_of(path), ""
            return f"{match[1]}({relative(there, page)}{'#' + anchor if anchor else ''})"

        text = page.read_text(encoding="utf-8")
        parts = re.split(r"(^```.*?^```)", text, flags=re.M | re.S)
        prose = lambda part: LINK.sub(one, FORMULA.sub(r"\1\\(", part))
        page.write_text("".join(p if p.startswith("```") else prose(p) for p in parts), encoding="utf-8")


def relative(there, page):
    return os.path.relpath(there, page.parent)


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


def api_page(path, root):
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


# ---- docstrings ------------------------------------------------------------------------------------


def signature(node):
    return f"{node.name}({ast.unparse(node.args)})" + (f" -> {ast.unparse(node.returns)}" if node.returns else "")


def documented(tree):
    """(heading, docstring) of public functions and classes with their methods."""
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            if ast.get_docstring(node):
                name = f"class {node.name}" if isinstance(node, ast.ClassDef) else signature(node)
                yield name, ast.get_docstring(node)
            for inner in getattr(node, "body", []) if isinstance(node, ast.ClassDef) else []:
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_") and ast.get_docstring(inner):
                    yield f"{node.name}.{signature(inner)}", ast.get_docstring(inner)


def python_page(package):
    out = [f"# Python: {package.name}\n"]
    for path in sorted(package.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if not ast.get_docstring(tree):
            continue
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__")
        out += [f"## {name}\n", f"```text\n{ast.get_docstring(tree)}\n```\n"]
        out += [f"### `{heading}`\n\n```text\n{text}\n```\n" for heading, text in documented(tree)]
    return "\n".join(out)


# ---- the gallery -----------------------------------------------------------------------------------


def gallery(root, source):
    """A page for each example of the Python package, with its picture and a notebook; a page that leads to them."""
    folder = source / "gallery"
    folder.mkdir()
    notebooks.write_notebooks(folder)
    index = ["# Gallery\n", "Each page is a script of `examples/python`, cell by cell, and a notebook for Jupyter. "
             "They need `tiller[pages]` ([the Python package](../guide/python.md)).\n"]
    for path in notebooks.examples():
        text, name = path.read_text(encoding="utf-8"), path.stem
        title, picture = notebooks.title(text), f"../images/gallery/{name}.png"
        index.append(f"## [{title}]({name}.md)\n\n[![{title}]({picture})]({name}.md)\n")
        cells = notebooks.cells(text)
        page = [cells[0][1], f"\n![{title}]({picture})\n", f"[The notebook]({name}.ipynb)\n"]
        page += [f"```python\n{part}\n```\n" if kind == "code" else f"**{part}**\n" for kind, part in cells[1:]]
        (folder / f"{name}.md").write_text("\n".join(page), encoding="utf-8")
    (folder / "index.md").write_text("\n".join(index), encoding="utf-8")


# ---- the site --------------------------------------------------------------------------------------


def title_of(page):
    found = re.search(r"^# (.+)$", page.read_text(encoding="utf-8"), flags=re.M)
    return re.sub(r"[`*]", "", found[1]).replace('"', "'") if found else page.stem


def navigation(source):
    lines = ["nav:", '  - "tiller": index.md']
    groups = {"gallery": "Gallery", **FOLDERS, "api": "Interfaces", "source": "Files"}
    for folder, name in groups.items():
        pages = sorted((source / folder).glob("*.md"), key=lambda page: (page.stem != "index", title_of(page)))
        if pages:
            lines.append(f'  - "{name}":')
            lines += [f'      - "{title_of(p)}": {folder}/{p.name}' for p in pages]
    return "\n".join(lines)


CONFIG = """site_name: tiller
docs_dir: pages
site_dir: html
use_directory_urls: false
theme: {{name: readthedocs, highlightjs: false, navigation_depth: 2, include_homepage_in_sidebar: false}}
plugins: [search]
markdown_extensions: [tables, fenced_code, toc]
validation: {{nav: {{omitted_files: warn, not_found: warn}}, links: {{not_found: warn, anchors: warn}}}}
{navigation}
"""


class Links(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, _tag, attributes):
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.links.append(value)
            if name in ("id", "name") and value:
                self.ids.add(value)


def crawl(site):
    """Sentences about dead links, pages that nothing leads to, and what would need a network."""
    pages = {p: Links(p.read_text(encoding="utf-8")) for p in site.rglob("*.html")}
    reached, waiting, faults = set(), [site / "index.html"], []
    while waiting:
        page = waiting.pop()
        if page in reached:
            continue
        reached.add(page)
        for link in pages[page].links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            there = (page.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else page
            there = there / "index.html" if there.is_dir() else there
            if not there.exists():
                faults.append(f"{page.relative_to(site)}: {link} leads nowhere")
            elif there in pages:
                if parts.fragment and urllib.parse.unquote(parts.fragment) not in pages[there].ids:
                    faults.append(f"{page.relative_to(site)}: {link}: the page has no such place")
                waiting.append(there)
    alone = [p for p in pages if p not in reached and p.name not in ("404.html", "search.html")]
    faults += [f"{p.relative_to(site)}: nothing leads there" for p in alone]
    for page in reached:
        outside = re.findall(r'<(?:script|img|link rel="stylesheet")[^>]*(?:src|href)="(?:https?:)?//[^"]*"',
                             page.read_text(encoding="utf-8"))
        faults += [f"{page.relative_to(site)}: needs a network: {o}" for o in outside]
    return faults, len(reached)


def write_pages(root, out):
    site = Site(root, out)
    (site.source / "index.md").write_text((root / "README.md").read_text(encoding="utf-8"), encoding="utf-8")
    site.follow(site.source / "index.md", root / "README.md")
    for page in sorted((root / "docs").rglob("*.md")):
        site.follow(site.source / page.relative_to(root / "docs"), page)
    api = site.source / "api"
    api.mkdir()
    for name in ("tiller.h", "model.h", "transport.h"):
        (api / f"{name}.md").write_text(api_page(root / "runtime/include/tiller" / name, root), encoding="utf-8")
    for package in (root / "python/tiller", root / "tools/python/tiller_tools"):
        if package.is_dir():
            (api / f"{package.name}.md").write_text(python_page(package), encoding="utf-8")
    gallery(root, site.source)
    (out / "mkdocs.yml").write_text(CONFIG.format(navigation=navigation(site.source)), encoding="utf-8")


def main(root, out):
    root, out = pathlib.Path(root).resolve(), pathlib.Path(out).resolve()
    write_pages(root, out)
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f", str(out / "mkdocs.yml")]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    print(built.stdout + built.stderr, end="")
    if built.returncode != 0:
        return 1
    faults, pages = crawl(out / "html")
    for fault in faults:
        print(fault)
    print(f"site: {pages} pages, {len(faults)} faults: {out / 'html/index.html'}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
