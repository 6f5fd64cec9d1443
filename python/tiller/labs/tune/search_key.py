"""A number of the robot file that is searched, and what may be searched."""
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import tomlkit

from ... import _core
from ..._errors import Error
from ..robot_text import below, replace, steps_below, suggestion

SECTIONS = ("planner", "cost", "posterior", "parameters", "effects", "noise")
FREE_NAMES = ("parameters", "effects")


def number_text(value: float) -> str:
    """The shortest that reads back as this value, as the files of tiller have it."""
    texts = [f"{value:.{digits}g}" for digits in range(1, 18)]
    return min((text for text in texts if float(text) == value), key=len, default=texts[-1])


@dataclass
class SearchKey:
    """Its coordinate runs from 0 at `low` to 1 at `high`, evenly in the value or in its logarithm."""
    path: str
    low: float
    high: float
    log: bool = False
    whole: bool = False  # rounded to a multiple of `multiple`
    multiple: int = 1

    def __str__(self) -> str:
        return f"{self.path}={'log:' if self.log else ''}{number_text(self.low)}:{number_text(self.high)}"

    def coordinate(self, value: float) -> float:
        if self.log:
            return math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def value(self, at: float) -> float:
        v = self.low * (self.high / self.low) ** at if self.log else self.low + at * (self.high - self.low)
        v = min(max(v, self.low), self.high)
        if not self.whole:
            return v
        n = self.multiple
        return min(max(n * math.floor(v / n + 0.5), n * math.ceil(self.low / n)), n * math.floor(self.high / n))

    def text(self, at: float) -> str:
        """Six digits: far finer than an episode can tell apart."""
        v = self.value(at)
        return number_text(v if self.whole else float(f"{v:.6g}"))


def _refuse(argument: str, why: str) -> Error:
    return Error(f"--search {argument}: {why}")


def parse_search(argument: str) -> SearchKey:
    """"planner.horizon=20:80", "planner.noise_sd.force_N=log:0.5:10"."""
    path, _, bounds = argument.partition("=")
    log = bounds.startswith("log:")
    try:
        low, high = (float(word) for word in bounds.removeprefix("log:").split(":"))
        good = bool(path) and math.isfinite(low) and math.isfinite(high)
    except ValueError:
        good = False
    if not good:
        raise _refuse(argument, "is no KEY=LOW:HIGH; write such as planner.horizon=20:80, or KEY=log:LOW:HIGH for even "
                      "steps of the logarithm")
    if not low < high:
        raise _refuse(argument, "the low end is not below the high one; write the smaller number first")
    if log and not low > 0:
        raise _refuse(argument, "a logarithm wants a low end above 0; raise it, or leave log: out")
    return SearchKey(path, low, high, log)


def find(document: Any, path: str) -> tuple[Any, str]:
    """(table or list, key) of the number at the path; a table of a single number stands for it. Raises KeyError with a
    sentence."""
    node: Any = document
    above, so_far = None, ""
    for step in path.split("."):
        known = steps_below(node)
        if step not in known:
            raise KeyError(f"the file has no '{step}'{' in ' + so_far if so_far else ''}; {suggestion(step, known)}"
                           f"there: {', '.join(known)}")
        above, node, key = node, below(node, step), step
        so_far += ("." if so_far else "") + step
    only = steps_below(node)
    if isinstance(node, dict) and len(only) == 1 and _is_number(node[only[0]]):
        above, node, key = node, node[only[0]], only[0]
    if not _is_number(node):
        raise KeyError(f"{path} holds several values; name one: {', '.join(f'{path}.{s}' for s in steps_below(node))}"
                       if steps_below(node) else f"{path} is no number in the file; name one that is")
    return above, key


def _is_number(node: Any) -> bool:
    return isinstance(node, int | float) and not isinstance(node, bool)


def number_at(text: str, path: str) -> float | None:
    """None: the file leaves it to its default."""
    try:
        node, key = find(tomlkit.parse(text), path)
    except KeyError:
        return None
    return float(below(node, key))


def written(text: str, path: str) -> str:
    """The number as it stands in the file; "": left to the default."""
    try:
        node, key = find(tomlkit.parse(text), path)
    except KeyError:
        return ""
    return str(below(node, key).as_string())


def with_numbers(text: str, values: dict[str, str]) -> str:
    """The text with these numbers; a key of a [section] that is not there yet is added to it. Raises KeyError."""
    document: Any = tomlkit.parse(text)
    for path, value in values.items():
        number = tomlkit.value(value)
        try:
            node, key = find(document, path)
        except KeyError:
            section, _, key = path.partition(".")
            if "." in key or not key or key in document.get(section, {key: 0}):
                raise
            node = document[section]
        replace(node, key, number)
    return tomlkit.dumps(document)


def check_search(text: str, key: SearchKey) -> None:
    """Whether the file can take the key: a section that may be searched, a key of the schema, within its range. Fills
    `whole` and `multiple`. Raises Error."""
    section, name = [*key.path.split("."), ""][:2]
    if section not in SECTIONS:
        raise _refuse(str(key), f"'{section}' is not searched; {suggestion(section, SECTIONS)}sections: "
                      f"{', '.join(SECTIONS)} (limits, safety and the plant are yours to set)")
    settings = _core.number_settings()
    spec = settings.get(f"{section}.{name}")
    if section not in FREE_NAMES and name:
        if spec is None:
            known = [k.split(".", 1)[1] for k in settings if k.split(".", 1)[0] == section]
            raise _refuse(str(key), f"[{section}] has no key '{name}'; {suggestion(name, known, section + '.')}known: "
                          f"{', '.join(known)}")
        if spec["number"]:
            _fit(key, spec)
    addable = spec is not None and spec["number"] and not spec["named"] and key.path.count(".") == 1
    try:
        if not addable or section not in tomlkit.parse(text):
            find(tomlkit.parse(text), key.path)
    except KeyError as problem:
        raise _refuse(str(key), problem.args[0]) from None


def _fit(key: SearchKey, spec: dict[str, Any]) -> None:
    key.whole, key.multiple = spec["whole"], spec["multiple"]
    low, high, is_open = spec["low"], spec["high"], spec["low_open"]
    if low < high and (key.low < low or key.high > high or (is_open and key.low == low)):
        raise _refuse(str(key), f"the file takes {number_text(low)}{' (not itself)' if is_open else ''} to "
                      f"{number_text(high)} there; narrow the range")
    if key.whole and math.floor(key.high / key.multiple) <= math.ceil(key.low / key.multiple):
        raise _refuse(str(key), f"holds fewer than two multiples of {key.multiple}; widen the range")


def default_search(robot: _core.Robot, text: str) -> list[SearchKey]:
    """The horizon within half and twice, the planner's noise within a quarter and four times, the weights of inputs and
    of their changes within a tenth and ten times; of each what the file has and the planner reads."""
    settings = _core.number_settings(_core.training_facts(robot)["planner"])
    offers = [("planner.horizon", 0.5, 2.0, False)]
    for name in robot.inputs:
        offers += [(f"planner.noise_sd.{name}", 0.25, 4.0, True), (f"cost.input_weight.{name}", 0.1, 10.0, True),
                   (f"cost.input_rate_weight.{name}", 0.1, 10.0, True)]
    keys = []
    for path, down, up, log in offers:
        own = number_at(text, path)
        if own is None or own <= 0 or not settings[".".join(path.split(".")[:2])]["read"]:
            continue
        key = SearchKey(path, own * down, own * up, log)
        try:
            check_search(text, key)
        except Error:
            continue
        keys.append(key)
    return keys
