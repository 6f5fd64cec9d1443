"""python -m tiller_tools.laboratory NAME ...: what `tiller NAME` becomes where NAME is a laboratory."""

from __future__ import annotations

import sys


def main(arguments: list[str]) -> int:
    try:
        from tiller.labs.__main__ import main as run
    except ModuleNotFoundError as problem:
        print(f"tiller {arguments[0]}: {problem}, for {sys.executable}; pip install 'tiller[labs]', or set "
              "TILLER_PYTHON to an interpreter that has it", file=sys.stderr)
        return 1
    return run(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
