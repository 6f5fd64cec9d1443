"""What JAX has compiled is kept from run to run, so that only a laboratory's first run on a robot waits for it."""
from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path

FOLDER = "JAX_COMPILATION_CACHE_DIR"  # JAX's own; where it is set, it is left alone
MOST_BYTES = 200_000_000
SMALLEST = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1", "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1"}


def _processor() -> str:
    """Of this processor's instructions: machine code of another one must not be taken."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    return f"{platform.machine()}-{hashlib.sha256(flags.encode()).hexdigest()[:8]}"


def _make_room(folder: Path) -> None:
    """Removes what has not been used for longest."""
    entries = sorted(((p.stat().st_mtime, p.stat().st_size, p) for p in folder.iterdir()), reverse=True)
    kept = 0
    for _, size, path in entries:
        kept += size
        if kept > MOST_BYTES:
            path.unlink(missing_ok=True)


def keep() -> None:
    """Before JAX is imported. A folder that cannot be made or written is no error: everything is compiled anew."""
    if os.environ.get(FOLDER) is not None:
        return
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tiller" / f"jax-{_processor()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _make_room(folder)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        os.environ.update({FOLDER: str(folder), **SMALLEST})
