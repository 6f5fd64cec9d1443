"""Exceptions of the package. Each carries the name of a status, what was wrong, and what to do about it."""
from __future__ import annotations

# What to do about each status of tiller/status.def; a test holds the two lists together.
REMEDIES: dict[str, str] = {
    "ok": "nothing is wrong",
    "null_argument": "pass the argument that is missing",
    "version_mismatch": "reinstall tiller: package and library are of different versions",
    "memory_too_small": "report it: the package gives the block that tiller_size() asks for",
    "memory_misaligned": "report it: the package aligns the block",
    "bad_dimension": "check the counts in the robot file: `tiller check FILE` names the one at fault",
    "bad_prior": "give the parameter a finite value or a range with low < high in [parameters]",
    "bad_limit": "write low < high, both finite, in [limits]",
    "bad_effect": "`tiller effects` lists the kinds and where each may stand",
    "bad_planner": "`tiller help planner` lists the settings and their ranges",
    "bad_posterior": "`tiller help posterior` lists the settings and their ranges",
    "bad_noise": "write positive deviations in [measurement] and [noise]",
    "bad_period": "write period_s between 1e-4 and 1, substeps between 1 and 64",
    "bad_model": "the model lacks what was asked for; docs/guide/own_model.md tells what a table needs",
    "wrong_state": "look at Controller.info.state: SAFE is left by reset(), and one thread at a time may call",
    "bad_cost": "`tiller help cost` lists the terms; weights and targets are finite",
    "bad_seed": "give a finite start state",
    "no_model": "tiller.model_names() lists the built-in models; a file goes into [model] file",
    "sensor_stale": "send measurements at the control period, or raise [safety] sensor_timeout_s",
    "sensor_not_finite": "check the sensor; NaN marks a value that is missing, infinity is refused",
    "sensor_out_of_range": "check the sensor against low and high in [measurement]",
    "sensor_jump": "check the sensor against rate_per_s in [measurement]",
    "sensor_frozen": "check the sensor's cable; [safety] frozen_ticks sets the patience",
    "time_backwards": "pass times that increase from tick to tick",
    "plan_not_finite": "check the start state and the parameters' ranges with `tiller run --sim`",
    "posterior_degenerate": "widen the priors or the noise; `tiller gap` looks for missing physics",
    "command_not_finite": "report it with the robot file: the gate has held the command back",
    "transport_closed": "open the transport again, and see that the other end runs",
    "bus_off": "check the bus's wiring and bit rate with `tiller can doctor`",
    "actuator_fault": "clear the drive's fault, then reset()",
    "stopped": "call reset(), then arm(), once it is safe to move",
    "io_error": "read the operating system's message",
    "bad_message": "check that both ends use the same message types",
    "contact": "see what pushes the robot; [safety] contact_force is the limit of what counts as a contact",
    "state_not_finite": "check the parameters' ranges, or take more substeps",
    "command_limited": "nothing: the command was cut to its limit",
    "rate_limited": "nothing: the command was cut to its rate limit",
    "deadline_missed": "ask for less: fewer rollouts, particles or iterations; `tiller check` measures a tick",
    "no_new_measurement": "nothing: the last measurement is still fresh",
    "tempered": "nothing: the posterior takes in the data in steps",
    "iteration_capped": "nothing, or ask for fewer rollouts",
    "queue_full": "read faster, or write less",
    "record_overwritten": "read records sooner, or raise [recorder] ticks",
    "bounds_relaxed": "widen the bounds, lengthen the horizon, or start within them",
    "program_unsolved": "raise [planner] qp_iterations, or shorten the horizon",
    "model_inadequate": "look at Controller.info.inadequate_channel, then run tiller.gap() on a log",
    "measurement_outlier": "nothing: the measurement was treated as missing",
}


class Error(Exception):
    """Base of what the package raises: `status` (a name of tiller.Status), `code` (its number) and `remedy`."""

    status: str = "bad_argument"
    code: int = -1
    remedy: str = ""

    def __init__(self, message: str, *, status: str = "bad_argument", code: int = -1, remedy: str = "") -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.remedy = remedy


class ArgumentError(Error, ValueError):
    """An argument's value or shape: `argument` is its name, `value` what was passed."""

    argument: str = ""
    value: str = ""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument's type."""


class StatusError(Error, RuntimeError):
    """A call that the library refused."""


class RobotFileError(Error, ValueError):
    """A robot file: `problems` has a line for each, with file, line, key, value and remedy."""

    problems: list[str]

    def __init__(self, message: str, *, remedy: str = "") -> None:
        super().__init__(message, status="bad_robot_file", remedy=remedy)
        self.problems = [line for line in message.splitlines() if line.strip()]


class CommandError(Error, RuntimeError):
    """A `tiller` command that failed: `exit_code`, and `output` with everything that it printed."""

    exit_code: int = 0
    output: str = ""


class MissingExtra(Error, ImportError):
    """A package that only an extra of the installation brings."""


def make_argument_error(function: str, argument: str, value: str, expected: str, remedy: str,
                        is_type: bool) -> ArgumentError:
    """The exception for an argument; called by the extension too."""
    kind = ArgumentTypeError if is_type else ArgumentError
    error = kind(f"{function}: {argument} is {value}; expected {expected}; {remedy}", remedy=remedy)
    error.argument, error.value = argument, value
    return error


def make_status_error(name: str, code: int, text: str, where: str, field: str) -> StatusError:
    """The exception for a status; called by the extension too."""
    remedy = REMEDIES.get(name, "")
    place = f"{where}: {field}" if field else where
    return StatusError(f"{place}: {name}: {text}; {remedy}", status=name, code=code, remedy=remedy)


def make_robot_file_error(problems: str) -> RobotFileError:
    """The exception for a robot file; called by the extension too."""
    text = problems.strip()
    last = text.splitlines()[-1] if text else ""
    return RobotFileError(text, remedy=last.split("; ", 1)[-1] if "; " in last else "see the problems listed")


def missing_extra(module: str, extra: str, what: str) -> MissingExtra:
    """The exception for a package that is not installed."""
    remedy = f'pip install "tiller[{extra}]"'
    return MissingExtra(f"{what} needs the package {module}, which is not installed; {remedy}",
                        status="missing_extra", remedy=remedy)
