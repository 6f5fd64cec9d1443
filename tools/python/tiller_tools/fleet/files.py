"""Files that are whole or not there, and errors that name them."""

from __future__ import annotations

import errno
import os
from pathlib import Path


class FleetError(Exception):
    """A sentence for the user: what is wrong, where, and what to do."""


class DiskFull(FleetError):
    """Nothing more can be written; what was written stays good."""


def replace_file(path: str | Path, data: bytes) -> None:
    """Puts `data` in the place of the file, or leaves it as it was: written beside it, synced, renamed over it."""
    path = Path(path)
    partial = path.with_name(f".{path.name}.tmp")
    try:
        with open(partial, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        kind = DiskFull if error.errno in (errno.ENOSPC, errno.EDQUOT) else FleetError
        raise kind(f"{path}: cannot be written: {error.strerror}; free space or permission is missing, "
                   "then run the same command again") from None


def read_bytes(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FleetError(f"{path}: cannot be read: {error.strerror}") from None
