"""Reads the CSV files that tiller writes, and says clearly what is wrong with one that it cannot use."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np


class ReportError(Exception):
    """What is wrong, where, and what to do; shown to the user as it is."""


class Table:
    """Columns of equal length by name. Missing values ("" or "nan") are NaN."""

    def __init__(self, path: Path, names: list[str], values: np.ndarray):
        self.path = path
        self.names = names
        self._values = values  # (rows x columns)
        self._index = {name: i for i, name in enumerate(names)}

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._index:
            raise ReportError(
                f"{self.path}: no column '{name}'; the header has: {', '.join(self.names)}")
        return self._values[:, self._index[name]]

    def after_prefix(self, prefix: str) -> list[str]:
        """Names without `prefix` of the columns that begin with it, in file order."""
        return [name[len(prefix):] for name in self.names if name.startswith(prefix)]


def _number(text: str, path: Path, line: int, column: str) -> float:
    if text == "":
        return float("nan")
    try:
        return float(text)
    except ValueError:
        raise ReportError(f"{path}:{line}: column '{column}': '{text}' is not a number") from None


def read_table(path: str | Path, required: tuple[str, ...] = (), text: tuple[str, ...] = ()) -> Table:
    """Reads a CSV with a header. Columns in `text` are skipped (words such as a state's name)."""
    path = Path(path)
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return _parse(path, csv.reader(file), required, text)
    except FileNotFoundError:
        raise ReportError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise ReportError(f"{path}: not a text file") from None
    except OSError as error:
        raise ReportError(f"{path}: cannot be read: {error.strerror}") from None


def _parse(path: Path, reader, required: tuple[str, ...], text: tuple[str, ...]) -> Table:
    header = next(reader, None)
    if not header:
        raise ReportError(f"{path}: the file is empty; expected a header line that begins with time_s")
    header = [name.strip() for name in header]
    for name in required:
        if name not in header:
            raise ReportError(f"{path}:1: no column '{name}'; the header has: {', '.join(header)}")
    for name in header:
        if header.count(name) > 1:
            raise ReportError(f"{path}:1: column '{name}' appears {header.count(name)} times")
    keep = [i for i, name in enumerate(header) if name not in text]
    rows = []
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            raise ReportError(
                f"{path}:{reader.line_num}: {len(row)} values where the header names {len(header)}")
        rows.append([_number(row[i], path, reader.line_num, header[i]) for i in keep])
    if not rows:
        raise ReportError(f"{path}: no rows below the header")
    return Table(path, [header[i] for i in keep], np.array(rows))


def read_json(path: str | Path) -> dict:
    path = Path(path)
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except FileNotFoundError:
        raise ReportError(f"{path}: no such file") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ReportError(f"{path}: not valid JSON: {error}") from None
    except OSError as error:
        raise ReportError(f"{path}: cannot be read: {error.strerror}") from None


def write_page(path: str | Path, text: str) -> None:
    """Writes the page, or says why not; a half-written page never replaces a whole one."""
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise ReportError(
            f"{path}: cannot be written: {error.strerror}; name another file with -o") from None
