"""compile_cost.py FILE COMPILER ARGUMENTS...: runs the compiler and writes to FILE, as JSON, the object that it made,
the most memory that one of its processes had and its seconds. Exits with its code."""

import json
import os
import resource
import subprocess
import sys


def main(file: str, *command: str) -> int:
    code = subprocess.run(command, check=False).returncode
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    if code == 0 and "-o" in command:
        cost = {"folder": os.getcwd(), "object": command[command.index("-o") + 1],
                "memory_bytes": used.ru_maxrss * 1024, "seconds": used.ru_utime}
        with open(file, "w", encoding="utf-8") as out:
            json.dump(cost, out)
    return code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
