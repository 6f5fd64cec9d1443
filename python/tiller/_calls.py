"""Calls with wrong arguments: whatever the package is called with, what it raises is a tiller.Error with a remedy."""
from __future__ import annotations

from ._errors import ArgumentError, ArgumentTypeError, Error

TYPE_CHECKING = False  # typing's own is not worth the time of its import

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any, ParamSpec, TypeVar

    P = ParamSpec("P")
    R = TypeVar("R")


def _signature(function: Any, name: str) -> str:
    """"Controller.tick(t, y = None)": of the extension's functions by their first line of help."""
    line = (function.__doc__ or "").split("\n")[0]
    if type(function).__name__.startswith("nb_"):
        text = line[line.find("("):].split(" -> ")[0].replace("(self, ", "(").replace("(self)", "()")
    else:
        from inspect import signature

        text = str(signature(function)).split(" -> ")[0].replace("(self, ", "(")
    return name + text.replace("tiller._core.", "").replace("_core.", "")


def _error(function: Any, name: str, problem: Exception) -> ArgumentError:
    # the extension's own text goes on with lines of signatures, and ends with what it was called with
    lines = str(problem).split("\n")
    text = lines[0].split(". The following")[0].removeprefix(f"{name.split('.')[-1]}(): ")
    if lines[-1].startswith("Invoked with types: "):
        text += f" ({lines[-1].removeprefix('Invoked with types: ').replace('tiller._core.', '')})"
    remedy = f"call {_signature(function, name)}"
    kind = ArgumentTypeError if isinstance(problem, TypeError) else ArgumentError
    error = kind(f"{name}: {text}; {remedy}", remedy=remedy)
    error.value = text
    return error


def public(function: Callable[P, R], name: str = "") -> Callable[P, R]:
    """`function`, whose complaints about its arguments are ArgumentErrors. `name`: "Class.method"."""
    called = (name or function.__qualname__).removesuffix(".__init__")

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except (TypeError, ValueError) as problem:
            if isinstance(problem, Error):
                raise
            raise _error(function, called, problem) from problem

    call.__doc__, call.__name__ = function.__doc__, function.__name__
    call.__module__, call.__qualname__ = function.__module__, called
    if not type(function).__name__.startswith("nb_"):
        call.__wrapped__ = function  # type: ignore[attr-defined]
    return call


def public_methods(kind: type) -> None:
    """The same for the methods of one of the extension's classes."""
    for name, member in list(vars(kind).items()):
        sort = type(member).__name__
        if not name.startswith("_") and sort in ("nb_method", "nb_func"):
            checked = public(member, f"{kind.__name__}.{name}")
            setattr(kind, name, checked if sort == "nb_method" else staticmethod(checked))
