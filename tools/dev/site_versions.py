"""Sites of several versions side by side: FOLDER/0.2.0, FOLDER/0.3.0, and a first page that leads to the newest.

Each site has versions.js, which lists all of them with their pages; it is written anew for all when one is added.
"""

import html
import json
import re
import shutil

NAME = re.compile(r"\d+\.\d+\.\d+")


def order(version):
    return [int(n) for n in version.split(".")]


def pages(site):
    every = (str(p.relative_to(site)) for p in site.rglob("*.html"))
    return sorted(page for page in every if not page.startswith("source/"))


def write_list(site, here, every):
    site.joinpath("versions.js").write_text(
        f"window.siteVersions = {json.dumps({'here': here, 'all': every})};\n", encoding="utf-8")


def add(site, version, folder):
    """Puts the site of this version into the folder, in the place of an earlier one of the same version."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / version, ignore_errors=True)
    shutil.copytree(site, folder / version)
    names = (p.name for p in folder.iterdir() if p.is_dir() and NAME.fullmatch(p.name))
    versions = sorted(names, key=order, reverse=True)
    every = [{"version": v, "pages": pages(folder / v)} for v in versions]
    for v in versions:
        write_list(folder / v, v, every)
    newest = html.escape(versions[0])
    folder.joinpath("index.html").write_text(
        f'<!doctype html><meta charset="utf-8"><title>tiller</title>'
        f'<meta http-equiv="refresh" content="0; url={newest}/index.html"><a href="{newest}/index.html">tiller {newest}</a>\n', encoding="utf-8")
    return versions
