"""A CSV of the arrays in a MAT, NPZ or Parquet file: python -m tiller_tools.arrays_csv run.npz -o run.csv

A vector becomes a column of its name, a matrix one column for each of its shorter side, "name.0", "name.1", ... The
length that most vectors have is the log's; scalars and whatever has another length are left out. A cell array or a list
of runs holds several logs: run.mat#2 takes element 2 (from 0) of each.
"""

from __future__ import annotations

import argparse
import collections
import sys
import zipfile
from pathlib import Path

import numpy as np

from .table import ReportError, write_page


def _load_mat(path: Path) -> dict:
    try:
        import scipy.io
    except ImportError:
        raise ReportError(f"{path}: reading MAT needs the Python package scipy: run ./dev setup") from None
    try:
        data = scipy.io.loadmat(path)
    except NotImplementedError:
        raise ReportError(f"{path}: MAT of version 7.3 is HDF5; save it with -v7") from None
    return {name: value for name, value in data.items() if not name.startswith("__")}


def _load_parquet(path: Path) -> dict:
    try:
        import pyarrow.parquet
    except ImportError:
        raise ReportError(f"{path}: reading Parquet needs the Python package pyarrow: "
                          "pip install pyarrow in build/venv, or export the log as CSV") from None
    table = pyarrow.parquet.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}


def load(path: Path) -> dict:
    """Name -> array."""
    try:
        with open(path, "rb") as file:
            first = file.read(6)
        if first[:4] == b"PAR1":
            return _load_parquet(path)
        if first[:2] == b"PK":
            with np.load(path, allow_pickle=False) as data:
                return {name: data[name] for name in data.files}
        return _load_mat(path)
    except FileNotFoundError:
        raise ReportError(f"{path}: no such file") from None
    except (OSError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise ReportError(f"{path}: cannot be read: {error}") from None


def _element(value: np.ndarray, element: int) -> np.ndarray:
    """Of a cell array the one that was asked for, nothing where it has fewer; of anything else itself."""
    if value.dtype != object:
        return value
    cells = value.ravel()
    return np.asarray(cells[element]) if element < len(cells) else np.empty(0)


def _check_element(arrays: dict, element: int | None, path: Path) -> None:
    runs = max((np.asarray(v).size for v in arrays.values() if np.asarray(v).dtype == object), default=0)
    if element is None and runs > 1:
        raise ReportError(f"{path}: holds {runs} runs; name one, from {path}#0 to {path}#{runs - 1}")
    if element is not None and element >= runs:
        raise ReportError(f"{path}: there is no #{element}: " +
                          (f"its runs are #0 to #{runs - 1}" if runs else "it holds one log, without cell arrays of runs"))


def columns_of(arrays: dict, element: int | None, path: Path) -> dict:
    """Name -> values of one length."""
    _check_element(arrays, element, path)
    numbers = {}
    for name, value in arrays.items():
        inner = _element(np.asarray(value), element or 0)
        if inner.dtype.kind in "fiub" and 0 < inner.ndim <= 2 and inner.size > 1:
            numbers[name] = np.squeeze(inner.astype(float))
    lengths = collections.Counter(max(value.shape) for value in numbers.values())
    if not lengths:
        raise ReportError(f"{path}: holds no vector of numbers; it has: {', '.join(sorted(arrays)) or 'nothing'}")
    rows = max(lengths, key=lambda n: (lengths[n], n))
    columns = {}
    for name, value in numbers.items():
        if max(value.shape) != rows:
            continue
        if value.ndim == 1:
            columns[name] = value
            continue
        table = value if value.shape[0] == rows else value.T
        columns.update({f"{name}.{i}": table[:, i] for i in range(table.shape[1])})
    return columns


def convert(path: Path, element: int | None) -> str:
    """The CSV's text."""
    columns = columns_of(load(path), element, path)
    lines = [",".join(columns)]
    for row in zip(*columns.values()):
        lines.append(",".join("" if np.isnan(v) else f"{v:.12g}" for v in row))
    return "\n".join(lines) + "\n"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tiller_tools.arrays_csv", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", help="MAT (to version 7), NPZ or Parquet; FILE#k: element k of its runs")
    parser.add_argument("-o", "--out", required=True)
    options = parser.parse_args(argv)
    name, mark, number = options.file.rpartition("#")
    chosen = bool(mark) and number.isdigit()
    try:
        write_page(options.out, convert(Path(name if chosen else options.file), int(number) if chosen else None))
    except ReportError as error:
        print(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
