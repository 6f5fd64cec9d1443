"""What `tiller gap` found, given back to the simulator: python -m tiller_tools.simulator_patch gap.json ROBOT -o OUT

ROBOT is the MJCF or URDF that the robot was imported from. The text stays as it is, comments included; attributes that
the model knows better are replaced, and a comment before each states its 95 % interval, for domain randomisation:

    <!-- tiller gap: damping 0.12, 95 %: 0.11 .. 0.13 -->

What the format cannot say is listed on standard error and in comments at the end.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from .table import ReportError, read_json, write_page

_POINT_INERTIA = 1e-9  # kg m^2 of a payload, which is a point: MuJoCo and Gazebo want more than nothing


@dataclass
class Value:
    """A parameter of the model found."""
    effect: str | None
    port: str
    name: str
    value: float
    low: float
    high: float

    def of(self, factor: float) -> "Value":
        low, high = sorted((self.low * factor, self.high * factor))
        return Value(self.effect, self.port, self.name, self.value * factor, low, high)

    def told(self) -> str:
        if self.low == self.high:
            return f"{self.value:.6g}, known"
        return f"{self.value:.6g}, 95 %: {self.low:.4g} .. {self.high:.4g}"


@dataclass
class Element:
    """A start tag of the description: where it stands, what it says."""
    tag: str
    start: int
    end: int
    attributes: dict[str, str]
    parents: tuple[int, ...]  # indices of the elements that it stands in, outermost first
    close: int = -1  # byte where its end tag begins; of an empty element where it ends


@dataclass
class Document:
    """The bytes of a description, its elements, and the changes to make."""
    path: Path
    data: bytes
    elements: list[Element] = field(default_factory=list)
    changes: list[tuple[int, int, str]] = field(default_factory=list)  # from, to, text
    set_: dict[int, dict[str, str]] = field(default_factory=dict)  # attributes by element
    comments: dict[int, list[str]] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "Document":
        try:
            document = cls(path, path.read_bytes())
        except OSError as error:
            raise ReportError(f"{path}: cannot be read: {error.strerror}") from None
        open_: list[int] = []
        parser = expat.ParserCreate()

        def start(tag: str, attributes: dict[str, str]) -> None:
            at = parser.CurrentByteIndex
            document.elements.append(Element(tag, at, _end_of_tag(document.data, at), attributes, tuple(open_)))
            open_.append(len(document.elements) - 1)

        def end(_tag: str) -> None:
            element = document.elements[open_.pop()]
            at = parser.CurrentByteIndex
            element.close = element.end if document.data[element.end - 2:element.end] == b"/>" else at

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            parser.Parse(document.data, True)
        except expat.ExpatError as error:
            raise ReportError(f"{path}:{error.lineno}: no XML: {expat.errors.messages[error.code]}") from None
        return document

    @property
    def root(self) -> str:
        return self.elements[0].tag

    def find(self, tags: tuple[str, ...], name: str, inside: str = "") -> int | None:
        """Index of the element of one of the tags whose name the robot file writes as `name`."""
        for i, e in enumerate(self.elements):
            if e.tag in tags and identifier(e.attributes.get("name", "")) == identifier(name) and \
                    (not inside or any(self.elements[p].tag == inside for p in e.parents)):
                return i
        return None

    def child(self, index: int, tag: str) -> int | None:
        for i, e in enumerate(self.elements):
            if e.tag == tag and e.parents and e.parents[-1] == index:
                return i
        return None

    def set(self, index: int, key: str, value: Value, what: str = "") -> None:
        self.set_.setdefault(index, {})[key] = f"{value.value:.9g}"
        self.comments.setdefault(index, []).append(f"tiller gap: {what or key} {value.told()}")

    def number(self, index: int, key: str) -> float | None:
        try:
            return float(self.elements[index].attributes[key])
        except (KeyError, ValueError):
            return None

    def insert(self, index: int, text: str, value: Value | None = None, what: str = "") -> None:
        """A child as the last one of the element."""
        e = self.elements[index]
        indent = self.indent(index)
        inner = "" if value is None else f"{indent}  {comment(f'tiller gap: {what} {value.told()}')}\n"
        if e.close == e.end:  # <body/>: opened
            self.changes.append((e.end - 2, e.end, f">\n{inner}{indent}  {text}\n{indent}</{e.tag}>"))
        else:
            line = self.data.rfind(b"\n", 0, e.close) + 1
            alone = not self.data[line:e.close].strip()
            lead = "" if alone else "\n"
            self.changes.append((line if alone else e.close, line if alone else e.close,
                                 f"{lead}{inner}{indent}  {text}\n{'' if alone else indent}"))

    def indent(self, index: int) -> str:
        start = self.elements[index].start
        line = self.data.rfind(b"\n", 0, start) + 1
        head = self.data[line:start].decode("utf-8", "replace")
        return head[:len(head) - len(head.lstrip())]

    def text(self, tail: list[str]) -> str:
        changes = list(self.changes)
        for index in sorted(set(self.set_) | set(self.comments)):
            e = self.elements[index]
            opened = [c for c in changes if c[0] == e.end - 2 and c[1] == e.end]  # a child was put into <x/>
            tag = self.data[e.start:e.end].decode()
            for key, value in self.set_.get(index, {}).items():
                tag = with_attribute(tag, key, value)
            if opened:
                changes.remove(opened[0])
                tag = tag[:-2].rstrip() + opened[0][2]
            before = "".join(f"{comment(c)}\n{self.indent(index)}" for c in self.comments.get(index, []))
            changes.append((e.start, e.end, before + tag))
        data = self.data
        for start, end, text in sorted(changes, key=lambda c: c[0], reverse=True):
            data = data[:start] + text.encode() + data[end:]
        return data.decode().rstrip("\n") + "\n" + "".join(f"{comment(line)}\n" for line in tail)


def _end_of_tag(data: bytes, at: int) -> int:
    quote = 0
    for i in range(at, len(data)):
        if quote:
            quote = 0 if data[i] == quote else quote
        elif data[i] in b"\"'":
            quote = data[i]
        elif data[i] == ord(">"):
            return i + 1
    return len(data)


def with_attribute(tag: str, key: str, value: str) -> str:
    """The start tag with one attribute replaced or added."""
    found = re.search(rf"(\s{re.escape(key)}\s*=\s*)(\"[^\"]*\"|'[^']*')", tag)
    if found:
        return tag[:found.start(2)] + quoteattr(value) + tag[found.end(2):]
    end = len(tag) - (2 if tag.endswith("/>") else 1)
    return f"{tag[:end].rstrip()} {key}={quoteattr(value)}{tag[end:]}"


def comment(text: str) -> str:
    return f"<!-- {escape(text).replace('--', '- -')} -->"


def identifier(name: str) -> str:
    """A name as the robot file has it: letters, digits and underscores."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


# The one parameter by which each effect is said; no two share a name at a port, but for kinds that cannot be said.
_SAID = {"viscous_friction": "damping_SI", "coulomb_friction": "friction_SI", "joint_inertia": "inertia_SI",
         "linear_spring": "stiffness_SI", "actuator_gain": "gain_error", "payload": "mass_kg"}


def _value(effect: str | None, port: str, name: str, p: dict) -> Value:
    low, high = (p["mean"] if v is None else v for v in p["interval_95"])
    return Value(effect, port, name, p["mean"], low, high)


def _own_values(parameters: list[dict]) -> list[Value]:
    """Of the robot file's own parameters and effects those that were fitted. An effect's kind is known by its
    parameters where all at its port are such as _SAID has."""
    kinds = {name: kind for kind, name in _SAID.items()}
    at_port: dict[str, set[str]] = {}
    for p in parameters:
        port, dot, name = p["name"].rpartition(".")
        if dot:
            at_port.setdefault(port, set()).add(name)
    values = []
    for p in parameters:
        port, dot, name = p["name"].rpartition(".")
        if p["fixed"] or p["mean"] is None:
            continue
        kind = None if not dot else kinds[name] if at_port[port] <= set(kinds) else "effect"
        values.append(_value(kind, port, name, p))
    return values


def values_of(result: dict, path: Path) -> list[Value]:
    """What the best explanation says: of the robot file's parameters, then of the effects that were found."""
    if result.get("format") != "tiller-gap":
        raise ReportError(f"{path}: is no result of `tiller gap -o FOLDER`")
    if result["verdict"] not in ("named", "ambiguous", "partly_explained"):
        raise ReportError(f"{path}: nothing was named ({result['verdict']})")
    best = result["ranking"][0]
    values = _own_values([p for p in best["parameters"] if p["of"] == "robot_file"])
    found = [p for p in best["parameters"] if p["of"] == "effect"]
    for e in best["effects"]:
        wanted = f"{e['port']}.{_SAID[e['kind']]}" if e["kind"] in _SAID else None
        own = [p for p in found if p["name"] == wanted or (wanted is None and p["name"].startswith(e["port"] + "."))]
        for p in own[:1] if wanted else own:
            values.append(_value(e["kind"], e["port"], p["name"].rpartition(".")[2], p))
            found.remove(p)
    return values


# ---- what each format can say --------------------------------------------------------------------


class Patch:
    """Puts values into a document; what it cannot say goes to `left`."""

    joints: tuple[str, ...] = ()

    def __init__(self, document: Document, frame: str):
        self.document, self.frame = document, frame
        self.done: list[str] = []
        self.left: list[str] = []

    def apply(self, values: list[Value]) -> None:
        for v in values:
            what = v.name if v.effect is None else f"{v.effect} ({v.port}) {v.name}"
            reason = self.parameter(v) if v.effect is None else self.effect(v)
            if reason is None:
                self.done.append(f"{what} {v.told()}")
            elif reason:
                self.left.append(f"{what} {v.told()}: {reason}")

    def parameter(self, v: Value) -> str | None:
        """None: written; else why not, or nothing where that is no loss."""
        if v.name.endswith("_mass_kg"):
            return self.mass(v, v.name[:-len("_mass_kg")])
        if v.name.endswith("_gain"):
            return self.gain(v, v.name[:-len("_gain")])
        if v.value == 0 and v.low == v.high:
            return ""
        return "is no number of the description"

    def effect(self, v: Value) -> str | None:
        makers = {("viscous_friction", "damping_SI"): "damping", ("coulomb_friction", "friction_SI"): "friction",
                  ("joint_inertia", "inertia_SI"): "armature", ("linear_spring", "stiffness_SI"): "stiffness"}
        if (v.effect, v.name) in makers:
            return self.joint(v, makers[v.effect, v.name])
        if (v.effect, v.name) == ("actuator_gain", "gain_error"):
            factor = Value(v.effect, v.port, "gain", 1 + v.value, 1 + v.low, 1 + v.high)
            return self.gain(factor, v.port)
        if (v.effect, v.name) == ("payload", "mass_kg"):
            return self.payload(v)
        return f"{'an MJCF' if self.document.root == 'mujoco' else 'a URDF'} has no such effect"

    def find_joint(self, port: str) -> int | None:
        return self.document.find(self.joints, port)

    def no_joint(self, port: str) -> str:
        return f"{self.document.path.name} has no joint of that name ({port}); is it in a file that this one includes?"

    def mass(self, v: Value, link: str) -> str | None:
        raise NotImplementedError

    def gain(self, v: Value, port: str) -> str | None:
        raise NotImplementedError

    def joint(self, v: Value, what: str) -> str | None:
        raise NotImplementedError

    def payload(self, v: Value) -> str | None:
        raise NotImplementedError


class UrdfPatch(Patch):
    joints = ("joint",)

    def mass(self, v: Value, link: str) -> str | None:
        index = self.document.find(("link",), link)
        inertial = self.document.child(index, "inertial") if index is not None else None
        mass = self.document.child(inertial, "mass") if inertial is not None else None
        if inertial is None or mass is None:
            return f"link '{link}' has no <inertial>"
        self.scale_inertia(self.document.child(inertial, "inertia"), v, self.document.number(mass, "value"))
        self.document.set(mass, "value", v, "mass")
        return None

    def scale_inertia(self, inertia: int | None, v: Value, before: float | None) -> None:
        """The shape stays, as in the model: the inertia goes with the mass."""
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            old = self.document.number(inertia, key) if inertia is not None else None
            if inertia is not None and old and before:
                self.document.set_.setdefault(inertia, {})[key] = f"{old * v.value / before:.9g}"

    def gain(self, v: Value, port: str) -> str | None:
        return "a URDF's joints take forces as they are; scale the commands"

    def joint(self, v: Value, what: str) -> str | None:
        index = self.find_joint(v.port)
        if index is None:
            return self.no_joint(v.port)
        if what == "stiffness":
            return "a URDF has no springs"
        dynamics = self.document.child(index, "dynamics")
        if dynamics is None:
            added = [c for c in self.document.changes if f'<dynamics tiller="{index}"' in c[2]]
            attributes = "" if not added else re.search(r'tiller="\d+"([^/]*)/>', added[0][2]).group(1)
            for c in added:
                self.document.changes.remove(c)
            self.document.insert(index, f'<dynamics tiller="{index}"{attributes} {what}="{v.value:.9g}"/>')
            self.document.comments.setdefault(index, []).append(f"tiller gap: {what} {v.told()}")
            return None
        self.document.set(dynamics, what, v)
        return None

    def payload(self, v: Value) -> str | None:
        if not self.frame:
            return "no frame is known that carries it: [sim] frame, or --frame"
        link = self.document.find(("link",), self.frame)
        if link is None:
            return f"{self.document.path.name} has no link '{self.frame}'"
        name = self.document.elements[link].attributes["name"]
        inertia = " ".join(f'{k}="{_POINT_INERTIA:g}"' for k in ("ixx", "iyy", "izz"))
        self.document.insert(0, f'<link name="tiller_payload"><inertial><mass value="{v.value:.9g}"/>'
                                f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>', v, "payload")
        self.document.insert(0, f'<joint name="tiller_payload_joint" type="fixed"><parent link={quoteattr(name)}/>'
                                '<child link="tiller_payload"/></joint>')
        return None


class MjcfPatch(Patch):
    joints = ("joint", "freejoint")
    _ACTUATORS = ("motor", "general", "position", "velocity", "intvelocity", "cylinder", "muscle", "damper")

    def find_joint(self, port: str) -> int | None:
        return self.document.find(self.joints, port, "worldbody")

    def mass(self, v: Value, link: str) -> str | None:
        body = self.document.find(("body",), link)
        if body is None:
            return f"{self.document.path.name} has no body of that name; is it in a file that this one includes?"
        inertial = self.document.child(body, "inertial")
        if inertial is None:
            return "its mass is that of its geoms: give the body an <inertial>, or scale their density"
        before = self.document.number(inertial, "mass")
        for key in ("diaginertia", "fullinertia"):
            old = self.document.elements[inertial].attributes.get(key)
            if old and before:
                self.document.set_.setdefault(inertial, {})[key] = \
                    " ".join(f"{float(n) * v.value / before:.9g}" for n in old.split())
        self.document.set(inertial, "mass", v)
        return None

    def gain(self, v: Value, port: str) -> str | None:
        joint = re.sub(r"_(Nm|N|rad|m|rad_s|m_s)$", "", identifier(port))
        for i, e in enumerate(self.document.elements):
            if e.tag in self._ACTUATORS and any(self.document.elements[p].tag == "actuator" for p in e.parents) and \
                    (identifier(e.attributes.get("joint", "")) in (joint, identifier(port))
                     or identifier(e.attributes.get("name", "")) in (joint, identifier(port))):
                gear = [float(n) for n in e.attributes.get("gear", "1").split()] or [1.0]
                if "gear" not in e.attributes and self._has_default(e, "gear"):
                    return "its gear stands in a <default>: write it at the actuator"
                rest = "".join(f" {n:.9g}" for n in gear[1:])
                told = v.of(gear[0])
                self.document.set(i, "gear", told)
                self.document.set_[i]["gear"] += rest
                return None
        return f"{self.document.path.name} has no actuator of joint '{joint}'"

    def _has_default(self, element: Element, key: str) -> bool:
        return any(e.tag == element.tag and key in e.attributes
                   and any(self.document.elements[p].tag == "default" for p in e.parents)
                   for e in self.document.elements)

    def joint(self, v: Value, what: str) -> str | None:
        index = self.find_joint(v.port)
        if index is None:
            return self.no_joint(v.port)
        self.document.set(index, {"friction": "frictionloss"}.get(what, what), v)
        return None

    def payload(self, v: Value) -> str | None:
        if not self.frame:
            return "no frame is known that carries it: [sim] frame, or --frame"
        at, place = self.document.find(("body",), self.frame), "0 0 0"
        if at is None:
            site = self.document.find(("site",), self.frame)
            if site is None:
                return f"{self.document.path.name} has no body or site '{self.frame}'"
            place = self.document.elements[site].attributes.get("pos", place)
            at = self.document.elements[site].parents[-1]
        inertia = " ".join([f"{_POINT_INERTIA:g}"] * 3)
        self.document.insert(at, f'<body name="tiller_payload" pos="{place}"><inertial pos="0 0 0" '
                                 f'mass="{v.value:.9g}" diaginertia="{inertia}"/></body>', v, "payload")
        return None


def patch(gap_json: str | Path, description: str | Path, out: str | Path, frame: str = "") -> Patch:
    """Writes the description with what the result says; raises ReportError with a sentence for the user."""
    document = Document.read(Path(description))
    kinds = {"robot": UrdfPatch, "mujoco": MjcfPatch}
    if document.root not in kinds:
        raise ReportError(f"{description}: its root is <{document.root}>; a URDF's is <robot>, an MJCF's <mujoco>")
    made = kinds[document.root](document, frame)
    made.apply(values_of(read_json(gap_json), Path(gap_json)))
    text = document.text(["tiller gap: not said here: " + line for line in made.left])
    write_page(out, re.sub(r'<dynamics tiller="\d+"', "<dynamics", text))
    return made


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.simulator_patch",
                                     description="An MJCF or URDF with what `tiller gap` found.")
    parser.add_argument("json", help="what `tiller gap -o FOLDER` left")
    parser.add_argument("description", help="the MJCF or URDF that the robot was imported from")
    parser.add_argument("-o", "--out", required=True, help="file to write")
    parser.add_argument("--frame", default="", help="link, body or site that carries the payload")
    options = parser.parse_args(argv)
    try:
        made = patch(options.json, options.description, options.out, options.frame)
    except ReportError as error:
        print(f"simulator patch: {error}", file=sys.stderr)
        return 1
    for line in made.done:
        print(line)
    for line in made.left:
        print(f"not said in {options.out}: {line}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
