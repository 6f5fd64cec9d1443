"""Where the lines of a robot's stick figure are: forward kinematics of the links that [figure] of its robot file names.

run_facts_json writes them as they are read: a value is a list of terms [factor, name], whose name is a state, a
parameter or "" (a constant). Everything here is computed for all rows of a log at once.
"""

from __future__ import annotations

import numpy as np


def rotation_about(axis, angle: np.ndarray) -> np.ndarray:
    """(rows x 3 x 3) by Rodrigues' formula; `axis` is a unit vector."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def rotation_of_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """(rows x 3 x 3) of quaternions (rows x 4) of any length above 0; NaN where it is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), 2, 0)


class Values:
    """States and parameters by name, each for all rows (or one number for all of them)."""

    def __init__(self, rows: int, named: dict):
        self.rows, self._named = rows, named

    def value(self, terms: list) -> np.ndarray:
        total = np.zeros(self.rows)
        for factor, name in terms:
            total = total + factor * (self._named[name] if name else 1.0)
        return total

    def point(self, three: list) -> np.ndarray:
        return np.stack([self.value(terms) for terms in three], axis=1)


def names_of(figure: dict) -> set[str]:
    """The states and parameters that it depends on."""
    found = set()

    def walk(node) -> None:
        if isinstance(node, dict):
            for value in node.values():
                walk(value)
        elif isinstance(node, list):
            if len(node) == 2 and isinstance(node[1], str):
                found.add(node[1])
            else:
                for value in node:
                    walk(value)

    walk(figure["links"])
    return found - {""}


def poses(figure: dict, values: Values) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each link its rotation (rows x 3 x 3) and its origin (rows x 3) in the world."""
    placed: list[tuple[np.ndarray, np.ndarray]] = []
    world = (np.broadcast_to(np.eye(3), (values.rows, 3, 3)), np.zeros((values.rows, 3)))
    for link in figure["links"]:
        above, at = placed[link["parent"]] if link["parent"] >= 0 else world
        if "quaternion" in link:
            turned = rotation_of_quaternion(np.stack([values.value(terms) for terms in link["quaternion"]], axis=1))
        else:
            roll, pitch, yaw = (values.value(terms) for terms in link["rpy_rad"])
            turned = (rotation_about((0, 0, 1), yaw) @ rotation_about((0, 1, 0), pitch)
                      @ rotation_about((1, 0, 0), roll))
        rotation = above @ turned
        origin = at + _turned(above, values.point(link["position_m"]))
        axis = np.array(link["axis"], float)
        origin = origin + _turned(rotation, values.value(link["slide_m"])[:, None] * axis)
        placed.append((rotation @ rotation_about(axis, values.value(link["turn_rad"])), origin))
    return placed


def _turned(rotation: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", rotation, vector)


class Sketch:
    """The points of a figure and the shapes between them.

    Shapes: ["line", point, point, ...], ["circle", centre, rim, rim a quarter on], ["box", corner, its three
    neighbours], with points by index.
    """

    def __init__(self, figure: dict):
        self._figure = figure
        self._points: list[tuple] = []  # (link, three values or a function of Values)
        self._known: dict[str, int] = {}
        self.shapes: list[list] = []
        origin = [[], [], []]
        for i, link in enumerate(figure["links"]):
            if link["joined"]:
                self.shapes.append(["line", self._point(link["parent"], origin), self._point(i, origin)])
            for line in link["lines_m"]:
                self.shapes.append(["line", *(self._point(i, point) for point in line)])
            for circle in link["circles"]:
                self.shapes.append(["circle", *self._circle(i, circle)])
            for box in link["boxes"]:
                self.shapes.append(["box", *self._box(i, box)])
        self.tip = self._tip()

    def _tip(self) -> int:
        """The point whose way is worth seeing: the end of the longest chain, or where a body is that moves by itself."""
        links, deepest, depths = self._figure["links"], -1, []
        for i, link in enumerate(links):
            depths.append(1 + (depths[link["parent"]] if link["parent"] >= 0 else 0))
            drawn = link["joined"] or link["lines_m"] or link["circles"] or link["boxes"]
            if drawn and (deepest < 0 or depths[i] >= depths[deepest]):
                deepest = i
        if deepest < 0:
            return 0
        link, origin = links[deepest], [[], [], []]
        moves = link["parent"] < 0 and any(name for terms in link["position_m"] for _, name in terms)
        if moves or not (link["lines_m"] or link["circles"]):
            return self._point(deepest, origin)
        return self._point(deepest, link["circles"][-1]["at_m"] if link["circles"] else link["lines_m"][-1][-1])

    @property
    def point_count(self) -> int:
        return len(self._points)

    def _point(self, link: int, three: list) -> int:
        key = f"{link} {three}"
        if key not in self._known:
            self._known[key] = len(self._points)
            self._points.append((link, three))
        return self._known[key]

    def _circle(self, link: int, circle: dict) -> list[int]:
        normal = np.array(circle["normal"])
        across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        across /= np.linalg.norm(across)
        return [self._point(link, circle["at_m"])] + [
            self._point(link, [at + _scaled(circle["radius_m"], c) for at, c in zip(circle["at_m"], direction)])
            for direction in (across, np.cross(normal, across))]

    def _box(self, link: int, box: dict) -> list[int]:
        corner = [at + _scaled(size, -0.5) for at, size in zip(box["at_m"], box["size_m"])]
        return [self._point(link, corner)] + [
            self._point(link, [at + (size if k == axis else []) for k, (at, size) in
                               enumerate(zip(corner, box["size_m"]))]) for axis in range(3)]

    def points(self, values: Values) -> np.ndarray:
        """(rows x points x 3) in the world."""
        placed = poses(self._figure, values)
        out = np.empty((values.rows, len(self._points), 3))
        for i, (link, three) in enumerate(self._points):
            local = values.point(three)
            out[:, i] = local if link < 0 else placed[link][1] + _turned(placed[link][0], local)
        return out


def _scaled(terms: list, by: float) -> list:
    return [[factor * by, name] for factor, name in terms]


def outline(shape: list, points: np.ndarray) -> list[np.ndarray]:
    """The lines of a shape, each (points x 3), of one frame's points."""
    kind, at = shape[0], points[shape[1:]]
    if kind == "line":
        return [at]
    if kind == "circle":
        angle = np.linspace(0, 2 * np.pi, 33)[:, None]
        return [at[0] + np.cos(angle) * (at[1] - at[0]) + np.sin(angle) * (at[2] - at[0])]
    a, b, c = (at[k] - at[0] for k in (1, 2, 3))
    face = [at[0], at[0] + a, at[0] + a + b, at[0] + b, at[0]]
    return [np.array(face), np.array(face) + c] + [np.array([p, p + c]) for p in face[:4]]
