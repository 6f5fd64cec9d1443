"""The bill of materials of a release, CycloneDX 1.6 in JSON, checked against its schema.

Declared are the packages that `./dev` installs: apt_* of the script `dev`, tools/dev/requirements*.txt, the wheel's
dependencies in pyproject.toml. Versions are those of the machine that builds; of what is not installed here, none.
"""

import datetime
import hashlib
import importlib.metadata
import pathlib
import re
import subprocess
import uuid

try:
    import tomllib
except ImportError:  # Python 3.10 and older
    tomllib = None

# What is compiled into a program or linked by it: headers, libraries and sources. All else builds or tests.
INSIDE = {"libeigen3-dev": "headers", "libxsimd-dev": "headers", "libode-dev": "library", "libtinyxml2-dev": "library",
          "libtomlplusplus-dev": "headers", "libcli11-dev": "headers", "nlohmann-json3-dev": "headers",
          "zlib1g-dev": "library", "libglib2.0-dev": "library", "liblcm1": "library",
          "osqp": "C sources", "nanobind": "sources", "jaxlib": "headers", "lcm": "library"}
LISTS = {"apt_build": "build", "apt_deb": "build", "apt_wheel_cross": "build", "apt_test": "test",
         "apt_cross_small": "test", "apt_fuzz": "test", "apt_mcdc": "test", "apt_style": "test"}
FILES = {"requirements.txt": "build", "requirements_wheel.txt": "build", "requirements_site.txt": "documentation",
         "requirements_release.txt": "release", "requirements_recipes.txt": "test", "requirements_coverage.txt": "test"}


def apt_lists(root):
    """{package: what its list is for}, the first list that has it."""
    text, found = (root / "dev").read_text(encoding="utf-8"), {}
    for name, purpose in LISTS.items():
        words = re.search(rf'^{name}="(.*?)"', text, re.M | re.S).group(1).split()
        for word in words:
            found.setdefault(word, purpose)
    return found


def apt_version(package):
    command = ["dpkg-query", "-W", "-f", "${Version}", package]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or None if done.returncode == 0 else None


def pip_lists(root):
    found = {}
    for name, purpose in FILES.items():
        for line in (root / "tools/dev" / name).read_text(encoding="utf-8").splitlines():
            pinned = re.match(r"([A-Za-z0-9_.-]+)(?:\[[^\]]*\])?==(\S+)", line)
            if pinned:
                found.setdefault(pinned.group(1), (pinned.group(2), purpose))
    return found


def wheel_needs(root):
    """[(package, specifier, extra or "")] of pyproject.toml."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lists = {"": project["dependencies"], **project["optional-dependencies"]}
    for extra, needs in lists.items():
        for need in needs:
            name, specifier = re.match(r"([A-Za-z0-9_.-]+)\s*(.*)", need).groups()
            yield name, specifier, extra


def pip_licence(package):
    try:
        said = importlib.metadata.metadata(package)
    except importlib.metadata.PackageNotFoundError:
        return None
    return said.get("License-Expression")


def system():
    text = pathlib.Path("/etc/os-release").read_text(encoding="utf-8")
    return re.search(r"^ID=(\S+)", text, re.M).group(1).strip('"')


def write(root, version, commit, when, files, out):
    """The bill of `files`, which lie beside `out`."""
    from cyclonedx.factory.license import LicenseFactory
    from cyclonedx.model import HashAlgorithm, HashType, Property
    from cyclonedx.model.bom import Bom
    from cyclonedx.model.component import Component, ComponentScope, ComponentType
    from cyclonedx.output import OutputFormat, make_outputter
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator
    from packageurl import PackageURL

    licences, bom = LicenseFactory(), Bom()
    bom.serial_number = uuid.uuid5(uuid.NAMESPACE_URL, f"tiller {version} {commit}")
    bom.metadata.timestamp = datetime.datetime.fromtimestamp(when, datetime.timezone.utc)
    whole = Component(name="tiller", version=version, type=ComponentType.LIBRARY, bom_ref="tiller",
                      licenses=[licences.make_from_string("BSD-3-Clause")],
                      purl=PackageURL("generic", None, "tiller", version),
                      properties=[Property(name="tiller:commit", value=commit)])
    bom.metadata.component = whole

    def component(kind, name, stated, purpose, licence=None, qualifiers=None):
        inside = INSIDE.get(name)
        part = Component(
            name=name, version=stated, type=ComponentType.LIBRARY, bom_ref=f"{kind}:{name}",
            scope=ComponentScope.REQUIRED if inside else ComponentScope.EXCLUDED,
            licenses=[licences.make_from_string(licence)] if licence else [],
            purl=PackageURL(kind, system() if kind == "deb" else None, name, stated, qualifiers),
            properties=[Property(name="tiller:purpose", value=inside or purpose)])
        bom.components.add(part)
        return part

    parts = [component("deb", name, apt_version(name), purpose) for name, purpose in sorted(apt_lists(root).items())]
    parts += [component("pypi", name, stated, purpose, pip_licence(name))
              for name, (stated, purpose) in sorted(pip_lists(root).items())]
    known = {part.name for part in parts if part.bom_ref.value.startswith("pypi:")}
    for name, specifier, extra in wheel_needs(root):
        if name not in known:
            known.add(name)
            part = component("pypi", name, None, f"wheel{f', extra {extra}' if extra else ''}: {name}{specifier}",
                             pip_licence(name))
            part.scope = ComponentScope.OPTIONAL if extra else ComponentScope.REQUIRED
            parts.append(part)
    bom.register_dependency(whole, [part for part in parts if part.scope != ComponentScope.EXCLUDED])
    for path in files:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        bom.components.add(Component(name=path.name, version=version, type=ComponentType.FILE,
                                     bom_ref=f"file:{path.name}", scope=ComponentScope.REQUIRED,
                                     hashes=[HashType(alg=HashAlgorithm.SHA_256, content=digest)]))
    text = make_outputter(bom, OutputFormat.JSON, SchemaVersion.V1_6).output_as_string(indent=1)
    fault = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if fault is not None:
        raise SystemExit(f"release: the bill of materials does not hold to CycloneDX's schema: {fault}")
    out.write_text(text + "\n", encoding="utf-8")
    return len(bom.components)
