"""rollout(): many trajectories of a robot's model at once."""
from __future__ import annotations

import os

from . import _core
from ._calls import public
from ._errors import make_argument_error

TYPE_CHECKING = False  # typing's own is not worth the time of its import

if TYPE_CHECKING:
    from typing import Any

    import numpy as np
    import numpy.typing as npt


def _numbers(value: object, name: str, ndims: tuple[int, int], last: tuple[int, ...], names: list[str],
             dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """`value` as a contiguous array of one of two numbers of dimensions that ends with the lengths `last`."""
    import numpy as np

    shape = {"x0": "(n) or (B, n)", "U": "(H, n) or (B, H, n)", "params": "(n) or (B, n)", "history": f"({last[0]}, n)"}
    what = f"{shape[name]}, n = {last[-1]} ({', '.join(names)})"
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.empty(0, object)
    if array.dtype.kind not in "fiu":
        raise make_argument_error("rollout", name, f"{value!r:.60}", f"numbers of shape {what}",
                                  "pass an array of real numbers", True)
    if array.ndim not in ndims or array.shape[array.ndim - len(last):] != last:
        raise make_argument_error("rollout", name, f"an array of shape {array.shape}", f"shape {what}",
                                  "pass rows in the order of Robot.states, inputs or params", False)
    return np.ascontiguousarray(array, dtype=dtype)


def _batch(arrays: dict[str, npt.NDArray[Any]], shared: dict[str, int]) -> int:
    sizes = {name: a.shape[0] for name, a in arrays.items() if a.ndim > shared[name]}
    if len(set(sizes.values())) > 1:
        name = min(sizes, key=lambda n: sizes[n])
        raise make_argument_error("rollout", name, f"{sizes[name]} rows", f"as many as the others have ({sizes})",
                                  "pass the same number of rows, or one row for all", False)
    return next(iter(sizes.values()), 1)


@public
def rollout(robot: _core.Robot, x0: npt.ArrayLike, U: npt.ArrayLike, params: npt.ArrayLike | None = None, *,
            history: npt.ArrayLike | None = None, dtype: npt.DTypeLike = "float64", threads: int | None = None,
            out: npt.NDArray[Any] | None = None) -> npt.NDArray[Any]:
    """Trajectories of the robot's model, effects included, under open-loop inputs.

    x0       (nx) or (B, nx) start states
    U        (H, nu) or (B, H, nu) inputs, each held for Robot.period_s
    params   (np) or (B, np), in the order of Robot.params; None: Robot.prior_centre
    history  (rows, nu) commands before the first, newest first, where the robot has an input delay; None: zeros
    dtype    float64, or float32 for twice the lanes
    threads  None: as many as this process has processors. The result does not depend on it, to the last bit
    out      (B, H + 1, nx) to write into

    Returns (B, H + 1, nx), the start states first; (H + 1, nx) where nothing has a batch. The interpreter's lock is
    released meanwhile, and Ctrl-C ends the call within some 20 ms of work. What is not finite in the arguments is
    refused; a trajectory that diverges comes back as it is.
    """
    import numpy as np

    if not isinstance(robot, _core.Robot):
        raise make_argument_error("rollout", "robot", f"{robot!r:.60}", "a tiller.Robot",
                                  "pass tiller.Robot.from_toml(...)", True)
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise make_argument_error("rollout", "dtype", repr(dtype), "float64 or float32", "pass one of them", False)
    nx, nu, n_params = len(robot.states), len(robot.inputs), len(robot.params)
    state = _numbers(x0, "x0", (1, 2), (nx,), robot.states, kind)
    controls = _numbers(U, "U", (2, 3), (nu,), robot.inputs, kind)
    given = robot.prior_centre if params is None else params
    values = _numbers(given, "params", (1, 2), (n_params,), robot.params, kind)
    rows = _core.history_rows(robot)
    before = _numbers(np.zeros((rows, nu)) if history is None else history, "history", (2, 2), (rows, nu),
                      robot.inputs, kind)
    arrays = {"x0": state, "U": controls, "params": values}
    count = _batch(arrays, {"x0": 1, "U": 2, "params": 1})
    horizon = controls.shape[-2]
    if horizon < 1:
        raise make_argument_error("rollout", "U", f"an array of shape {controls.shape}", "one step at least",
                                  "pass a row for each period", False)
    single = state.ndim == 1 and controls.ndim == 2 and values.ndim == 1
    way = np.empty((count, horizon + 1, nx), kind) if out is None else out
    fits = isinstance(way, np.ndarray) and way.shape == (count, horizon + 1, nx) and way.dtype == kind
    if not (fits and way.flags.c_contiguous and way.flags.writeable):
        shown = f"{way.dtype} of shape {way.shape}" if isinstance(way, np.ndarray) else f"{way!r:.60}"
        raise make_argument_error("rollout", "out", shown,
                                  f"{kind} of shape {(count, horizon + 1, nx)}, contiguous and writable",
                                  "pass such an array, or None", False)
    workers = len(os.sched_getaffinity(0)) if threads is None else int(threads)
    if not 1 <= workers <= 256:
        raise make_argument_error("rollout", "threads", repr(threads), "1 to 256, or None", "pass None", False)
    _core.rollout(robot, state, controls, values, before, way, workers)
    return way[0] if single and out is None else way
