"""The files of a release (./dev release):

    release.py check ROOT [VERSION]                    refuses, with the reasons
    release.py source ROOT OUT                         the source archive
    release.py finish ROOT OUT URL [ARTEFACT ...]      copies what was built; recipes, library, bill, notes, sums
    release.py tag ROOT OUT                            an annotated tag of this machine's repository
"""

import gzip
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile

import release_facts
import release_recipes
import release_sbom

WHOLE = {"deb": r"\.deb$", "wheel": r"\.whl$"}  # without one of these a release is partial, and gets no tag


def git(root, *arguments):
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.rstrip()


def refusals(root, wanted):
    version = release_facts.version(root)
    if wanted and wanted != version:
        yield f"CMakeLists.txt states {version}, and {wanted} is asked for; `git grep -nF {version}` finds the places"
    yield from release_facts.disagreements(root)
    yield from release_facts.broken_policy(root)
    yield from release_facts.undated(root)
    changed = git(root, "status", "--porcelain").splitlines()
    if changed:
        yield f"the tree is not clean ({len(changed)} files, the first: {changed[0][3:]}); commit or stash them"
    tag = f"v{version}"
    released = git(root, "tag", "--list", tag) and git(root, "rev-parse", f"{tag}^{{commit}}")
    if released and released != git(root, "rev-parse", "HEAD"):
        yield f"the tag {tag} is of another commit; a released version stays what it is: raise the version"


def check(root, wanted=None):
    faults = list(refusals(root, wanted))
    if faults:
        sys.exit("\n".join(f"release: {fault}" for fault in faults))
    print(f"release: {release_facts.version(root)}, {git(root, 'rev-parse', '--short', 'HEAD')}")


def archive_of(root, out):
    return out / f"tiller-{release_facts.version(root)}.tar.gz"


def source(root, out):
    """git's archive, packed without a name or a time: the same bytes from the same commit."""
    out.mkdir(parents=True, exist_ok=True)
    archive = archive_of(root, out)
    prefix = f"tiller-{release_facts.version(root)}/"
    tar = subprocess.run(["git", "-C", str(root), "-c", "core.autocrlf=false", "archive", "--format=tar",
                          f"--prefix={prefix}", "HEAD"], check=True, capture_output=True).stdout
    with open(archive, "wb") as file, gzip.GzipFile("", "wb", 9, file, 0) as packed:
        packed.write(tar)
    print(f"{archive}: {archive.stat().st_size / 1e6:.1f} MB")


def pack(folder, archive):
    """A folder's files without owners and times: the same bytes from the same files."""
    def plain(entry):
        entry.mtime, entry.uid, entry.gid, entry.uname, entry.gname, entry.mode = 0, 0, 0, "", "", 0o644
        return entry

    with open(archive, "wb") as file, gzip.GzipFile("", "wb", 9, file, 0) as packed:
        with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as tar:
            for path in sorted(p for p in folder.rglob("*") if p.is_file()):
                tar.add(path, path.relative_to(folder), filter=plain)
    shutil.rmtree(folder)


def library(root, out):
    """The core as a PlatformIO library."""
    subprocess.run([sys.executable, str(root / "tools/packaging/recipes/platformio/pack.py"), str(root),
                    str(out / "library")], check=True, stdout=subprocess.DEVNULL)
    pack(out / "library", out / f"tiller-platformio-{release_facts.version(root)}.tar.gz")


def sum_of(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def notes(root, names):
    """The changelog's newest section with links that lead out of docs/project, and what the release holds."""
    date, text = release_facts.notes(root)
    version = release_facts.version(root)
    link = lambda m: f"]({os.path.normpath('docs/project/' + m[1])})"
    text = re.sub(r"\]\((?![a-z]+:|#)([^)]+)\)", link, text)
    missing = [name for name, pattern in WHOLE.items() if not any(re.search(pattern, n) for n in names)]
    partial = f"\nThis is a part of a release: without {' and '.join(missing)}.\n" if missing else ""
    numbers = ", ".join(f"{macro} {n}" for (_, macro), n in
                        zip(release_facts.CONTRACTS, release_facts.contracts(root)))
    listed = "".join(f"- {name}\n" for name in names)
    return (f"# tiller {version}\n\n{date}, commit {git(root, 'rev-parse', 'HEAD')}. {numbers}.\n{partial}\n{text}\n\n"
            f"Steps from earlier versions: docs/project/upgrade.md. What is stable: docs/project/abi_policy.md.\n\n"
            f"## Files\n\n{listed}\n`sha256sum -c SHA256SUMS` checks them.\n")


def copy_artefacts(root, out, artefacts):
    version = release_facts.version(root)
    for path in artefacts:
        if not re.search(rf"[-_]{re.escape(version)}[-_+]", path.name):
            sys.exit(f"release: {path} is not of version {version}; build it anew")
        shutil.copy(path, out)


def finish(root, out, url, *artefacts):
    version = release_facts.version(root)
    copy_artefacts(root, out, [pathlib.Path(a) for a in artefacts])
    library(root, out)
    archive = archive_of(root, out)
    release_recipes.write(root, archive, f"{url}/{archive.name}", out / "recipes")
    pack(out / "recipes", out / f"tiller-recipes-{version}.tar.gz")
    when = int(git(root, "show", "-s", "--format=%ct", "HEAD"))
    files = sorted(p for p in out.iterdir() if p.is_file() and p.suffix in (".gz", ".deb", ".whl"))
    bill = out / f"tiller-{version}.cdx.json"
    components = release_sbom.write(root, version, git(root, "rev-parse", "HEAD"), when, files, bill)
    names = [p.name for p in (*files, bill)]
    (out / "RELEASE_NOTES.md").write_text(notes(root, names), encoding="utf-8")
    summed = (*files, bill, out / "RELEASE_NOTES.md")
    (out / "SHA256SUMS").write_text("".join(f"{sum_of(p)}  {p.name}\n" for p in summed), encoding="utf-8")
    print(f"{out}: {len(summed)} files, {components} components in the bill of materials")


def tag(root, out):
    version, names = release_facts.version(root), [p.name for p in out.iterdir()]
    for name, pattern in WHOLE.items():
        if not any(re.search(pattern, n) for n in names):
            sys.exit(f"release: no {name} in {out}: a part of a release gets no tag")
    git(root, "tag", "-a", f"v{version}", "--cleanup=verbatim", "-F", str(out / "RELEASE_NOTES.md"))
    print(f"tagged v{version}; to publish: git push origin v{version}")


def main(command, root, *arguments):
    root = pathlib.Path(root).resolve()
    if command == "check":
        check(root, *arguments)
    else:
        out = pathlib.Path(arguments[0]).resolve()
        {"source": source, "finish": finish, "tag": tag}[command](root, out, *arguments[1:])


if __name__ == "__main__":
    main(*sys.argv[1:])
