"""A black-box simulator as processes that answer requests in lines (docs/guide/simulator.md#the-lines)."""
from __future__ import annotations

import contextlib
import json
import os
import queue
import select
import signal
import subprocess
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from .problem import Array, InferenceError

KEPT_ERRORS = 2000  # bytes of stderr


class _Lost(Exception):
    """The process died or was late; why."""


class _Process:
    """One simulator: no shell, a process group of its own."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.timeout_s, self.folder = told["timeout_s"], told["folder"] or None
        self.errors = tempfile.TemporaryFile()
        try:
            self.process = subprocess.Popen(told["command"], cwd=self.folder, stdin=subprocess.PIPE,
                                            stdout=subprocess.PIPE, stderr=self.errors, start_new_session=True)
        except OSError as problem:
            raise InferenceError(f"cannot start {told['command'][0]} in {told['folder'] or '.'}: {problem.strerror}; "
                                 f"{_remedy(problem)}") from None
        self.text = b""
        hello = {key: told[key] for key in ("inputs", "measurements", "period_s")}
        names = [p["name"] for p in told["parameters"]]
        try:
            answer = self.ask({"tiller_simulator": 1, "parameters": names} | hello, told["start_s"])
        except _Lost as why:
            self.stop()
            raise InferenceError(f"the simulator {why} before it had greeted; run its command by hand; it must greet, "
                                 f"and stay{self.last_words()}") from None
        if answer.get("tiller_simulator") != 1:
            self.stop()
            raise InferenceError(f"the simulator's line {answer!r:.160}: is not {{\"tiller_simulator\": 1}}; greet "
                                 "with that version, once, before the first answer")

    def ask(self, request: dict[str, Any], timeout_s: float | None = None) -> dict[str, Any]:
        limit_s = timeout_s or self.timeout_s
        due = time.monotonic() + limit_s
        assert self.process.stdin and self.process.stdout
        try:
            self.process.stdin.write(json.dumps(request).encode() + b"\n")
            self.process.stdin.flush()
        except OSError:
            raise _Lost(self.ending() or "reads no more requests") from None
        while b"\n" not in self.text:
            if not select.select([self.process.stdout], [], [], max(0.0, due - time.monotonic()))[0]:
                raise _Lost(f"did not answer within {limit_s:g} s")
            more = os.read(self.process.stdout.fileno(), 1 << 16)
            if not more:
                raise _Lost(self.ending() or "closed its stdout")
            self.text += more
        line, self.text = self.text.split(b"\n", 1)
        with contextlib.suppress(ValueError):
            answer = json.loads(line)
            if isinstance(answer, dict):
                return answer
        raise InferenceError(f"the simulator's line {line[:160]!r}: is no JSON object; print nothing but answers on "
                             f"stdout, one a line, and everything else on stderr{self.last_words()}")

    def ending(self) -> str:
        """Of one that has ended, or does at once; empty: it has not."""
        try:
            code = self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            return ""
        return f"ended with exit code {code}" if code >= 0 else f"was ended by signal {-code} ({signal.strsignal(-code)})"

    def last_words(self) -> str:
        size = self.errors.seek(0, os.SEEK_END)
        self.errors.seek(max(0, size - KEPT_ERRORS))
        text = self.errors.read().decode(errors="replace").strip()
        return f"\n  its last words on stderr: {text}" if text else ""

    def kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)

    def stop(self) -> None:
        self.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe:
                with contextlib.suppress(OSError):
                    pipe.close()


def _remedy(problem: OSError) -> str:
    if isinstance(problem, PermissionError):
        return "make it executable (chmod +x), or name its interpreter in front of it"
    return ("check folder and name; a program without a slash in its name is looked for in PATH, one with a slash from "
            "that folder on")


class Pool:
    """Simulates draws side by side. A draw fails where an answer is an error or not finite, or where the process died
    or was late; the process then is started anew."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.told, self.restarts, self.lock, self.closed = told, 0, threading.Lock(), False
        self.running: set[_Process] = set()
        self.names = [p["name"] for p in told["parameters"]]
        self.idle: queue.SimpleQueue[_Process | None] = queue.SimpleQueue()
        for _ in range(told["processes"]):
            self.idle.put(None)
        self.workers = ThreadPoolExecutor(told["processes"])

    def __call__(self, params: Array, starts: Array, seeds: np.ndarray) -> tuple[Array, list[str]]:
        tasks = [self.workers.submit(self._draw, *row) for row in zip(params, starts, seeds)]
        try:
            answers = [task.result() for task in tasks]
        except BaseException:
            self.close()
            raise
        return np.stack([y for y, _ in answers]), [failure for _, failure in answers]

    def _draw(self, params: Array, starts: Array, seed: int) -> tuple[Array, str]:
        """All pieces of one draw."""
        process, rows, failure = self.idle.get(), [], ""
        try:
            process = process or _Process(self.told)
            self.running.add(process)
            for piece, (start, inputs) in enumerate(zip(starts, self.told["inputs_by_piece"])):
                request = {"id": piece, "seed": int(seed), "parameters": params.tolist(), "start": start.tolist(),
                           "inputs": inputs}
                rows.append(self._measured(process.ask(request), piece))
        except _Lost as why:
            assert process
            process.stop()
            self.running.discard(process)
            failure, process = f"the simulator {why}{process.last_words()}", None
            self._count(params, failure)
        except ValueError as why:
            failure = str(why)
        finally:
            if self.closed and process:
                process.stop()
            self.idle.put(process)
        shape = sum(self.told["lengths"]), len(self.told["measurements"])
        return (np.full(shape, np.nan) if failure else np.concatenate(rows)), failure

    def _measured(self, answer: dict[str, Any], piece: int) -> Array:
        """ValueError: a simulation that failed."""
        if answer.get("id") != piece:
            raise InferenceError(f"the simulator's \"id\" is not {piece}; answer requests in the order in which they "
                                 "come")
        if "error" in answer:
            raise ValueError(str(answer["error"]) or "an error without words")
        shape = self.told["lengths"][piece], len(self.told["measurements"])
        try:
            rows = np.array(answer["measured"], float).reshape(shape)
        except (KeyError, TypeError, ValueError):
            raise InferenceError(f"\"measured\" of the simulator's answer is not {shape[0]} rows of {shape[1]} "
                                 "numbers; answer with a row at the end of each period") from None
        if not np.isfinite(rows).all():
            raise ValueError(f"not finite from period {int(np.argmin(np.isfinite(rows).all(axis=1))) + 1} on")
        return rows

    def _count(self, params: Array, failure: str) -> None:
        with self.lock:
            self.restarts += 1
            if self.restarts > self.told["restarts"]:
                at = ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, params))
                raise InferenceError(f"after {self.told['restarts']} restarts {failure}, this time at {at}; let it "
                                     "answer {\"id\": ..., \"error\": ...} where it cannot simulate, raise timeout_s "
                                     "or restarts, or narrow the priors")

    def close(self) -> None:
        """Kills what runs, and waits for no answer."""
        self.closed = True
        for process in list(self.running):
            process.kill()
        self.workers.shutdown(wait=True, cancel_futures=True)
        while not self.idle.empty():
            idle = self.idle.get()
            if idle:
                idle.stop()
