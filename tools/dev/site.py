#!/usr/bin/env python3
"""The documentation site: docs/, README, the C interface and the Python package's names, with search.

    site.py ROOT OUT [FOLDER]   OUT/html is the site; needs mkdocs and no network. FOLDER: of sites of several versions,
                                which this one joins

The navigation is docs/README.md: its headings and its links, in their order; a page of docs/ that it leaves out is an
error. Pages are copied and their links followed: one to a file outside docs/ leads to a page that shows the file. Fails
where a link leads nowhere, or a page cannot be reached from the first. The site works from its files, search too.
"""

import html.parser
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.parse

import notebooks
import release_facts
import site_api
import site_versions

LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s]+)\)")
FORMULA = re.compile(r"(\w\[\w+\])\((?=[^)]* )")  # network[member](sin q, ...): no link, though it looks like one
LANGUAGES = {".h": "c", ".c": "c", ".hpp": "cpp", ".cpp": "cpp", ".py": "python", ".toml": "toml", ".json": "json",
             ".sh": "sh", ".def": "c", ".csv": "text", ".md": "markdown"}
LARGEST = 200_000  # characters of a file that is shown
HEADERS = ("tiller.h", "model.h", "transport.h")
HERE = pathlib.Path(__file__).resolve().parent


class Site:
    def __init__(self, root, out):
        self.root, self.source = root, out / "pages"
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(root / "docs", self.source)
        (self.source / "README.md").rename(self.source / "contents.md")  # mkdocs would take it for the first page
        api, gallery = self.source / "api", self.source / "gallery"
        self.shown = {root / "docs/README.md": self.source / "contents.md",
                      root / "README.md": self.source / "index.md", root / "python/tiller": api / "python.md",
                      root / "examples/python": gallery / "index.md"}
        self.shown |= {root / "runtime/include/tiller" / name: api / f"{name}.md" for name in HEADERS}
        self.shown |= {path: gallery / f"{path.stem}.md" for path in notebooks.examples()}

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
            if path not in self.shown and path.is_relative_to(self.root / "docs") and path.is_file():
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


def navigation(contents):
    """mkdocs' list out of the headings and the links of the page of contents."""
    lines, first = ["nav:", '  - "Overview": index.md', '  - "Contents": contents.md'], []
    for line in contents.read_text(encoding="utf-8").splitlines():
        heading, entry = re.match(r"## (.+)", line), re.match(r"- \[(.+?)\]\(([^)#]+)\)", line)
        if heading:
            lines.append(f'  - "{heading[1]}":')
        if entry:
            lines.append(f'      - "{entry[1].replace("`", "")}": {entry[2]}')
            first.append(entry[2])
    twice = {page for page in first if first.count(page) > 1}
    if twice:
        sys.exit(f"docs/README.md: twice in the navigation: {', '.join(sorted(twice))}")
    return "\n".join(lines)


CONFIG = """site_name: tiller
docs_dir: pages
site_dir: html
use_directory_urls: false
theme: {{name: readthedocs, highlightjs: false, navigation_depth: 2, include_homepage_in_sidebar: false}}
plugins: [search]
extra_css: [site.css]
extra_javascript: [versions.js, site_versions.js]
markdown_extensions: [tables, fenced_code, toc]
not_in_nav: |
  /source/
  /gallery/
validation: {{nav: {{omitted_files: warn, not_found: warn}}, links: {{not_found: warn, anchors: warn}}}}
{navigation}
"""


def make_search_local(site):
    """A page opened from its file may not fetch: the index becomes a script, and site_search.js reads it."""
    search = site / "search"
    entries = json.loads((search / "search_index.json").read_text(encoding="utf-8"))["docs"]
    shown = [[e["location"], e["title"], e["text"]] for e in entries
             if not e["location"].startswith("source/") and (e["text"] or "#" not in e["location"])]
    for unused in ("lunr.js", "worker.js", "search_index.json"):
        (search / unused).unlink()
    (search / "index.js").write_text(f"window.siteIndex = {json.dumps(shown, ensure_ascii=False)};\n", encoding="utf-8")
    shutil.copy(HERE / "site_search.js", search / "main.js")


def make_tables_scroll(site):
    """A table that is wider than the page gets a bar of its own, and the keys move it."""
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        text = text.replace("<table>", '<div class="table" tabindex="0"><table>').replace("</table>", "</table></div>")
        page.write_text(text, encoding="utf-8")


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
    shutil.copy(root / "README.md", site.source / "index.md")
    for name in ("site.css", "site_versions.js"):
        shutil.copy(HERE / name, site.source)
    version = release_facts.version(root)
    site_versions.write_list(site.source, version, [{"version": version, "pages": []}])
    for page in [root / "README.md", *sorted((root / "docs").rglob("*.md"))]:
        site.follow(site.shown.get(page) or site.source / page.relative_to(root / "docs"), page)
    api = site.source / "api"
    api.mkdir()
    for name in HEADERS:
        header = root / "runtime/include/tiller" / name
        (api / f"{name}.md").write_text(site_api.header_page(header, root), encoding="utf-8")
    (api / "python.md").write_text(site_api.python_page(root / "python/tiller"), encoding="utf-8")
    gallery(root, site.source)
    (out / "mkdocs.yml").write_text(CONFIG.format(navigation=navigation(site.source / "contents.md")), encoding="utf-8")


def main(root, out, folder=None):
    root, out = pathlib.Path(root).resolve(), pathlib.Path(out).resolve()
    write_pages(root, out)
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f", str(out / "mkdocs.yml")]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    print(built.stdout + built.stderr, end="")
    if built.returncode != 0:
        return 1
    make_search_local(out / "html")
    make_tables_scroll(out / "html")
    faults, pages = crawl(out / "html")
    for fault in faults:
        print(fault)
    print(f"site: {pages} pages, {len(faults)} faults: {out / 'html/index.html'}")
    if folder and not faults:
        versions = site_versions.add(out / "html", release_facts.version(root), pathlib.Path(folder).resolve())
        print(f"site: {pathlib.Path(folder) / 'index.html'} has {', '.join(versions)}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:4]))
