"""What a pendulum's model lacks, from logs of a real one (data/dfki_simple_pendulum)."""
import pathlib

import tiller

ROOT = pathlib.Path(__file__).resolve().parents[2]


def main() -> tiller.GapResult:
    """Runs `tiller gap` on the measured logs; its result."""
    logs = sorted((ROOT / "data/dfki_simple_pendulum").glob("*_measured.csv"))
    result = tiller.gap(ROOT / "robots/dfki_pendulum_bare.toml", logs, max_effects=1)
    print(result.sentence)
    for one in result.rows()[:3]:
        print("  ", {key: value for key, value in list(one.items())[:5]})
    print(f"exit code {result.exit_code}, {result.folder}")
    return result


if __name__ == "__main__":
    assert main().exit_code in (0, 1, 2)
