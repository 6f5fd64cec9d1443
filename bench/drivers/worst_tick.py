"""./dev bench worst_tick: the input that costs a tick the most instructions on a Cortex-M7, for every planner.

    --inputs N       inputs that each seed tries (60): half of them random, half near the best so far
    --seeds N        searches per planner (1)
    --planner NAME   only this one
    --write          put the worst found of each planner into tests/cortex_m/worst_ticks.csv
    --again IMAGE    search nothing: run what stands there again, of the planners that this image has

tests/cortex_m/worst_tick.cpp searches, in an image with every planner (CMake preset cortex-m7-planners) under
qemu-system-arm -icount: a pendulum's start, plant, goals, pushes, noise, outliers and silence of its sensor, 24 ticks
an input. A finished search is a line of build/bench/worst_tick.csv and is not run again while the image stays the same.
"""

import argparse
import csv
import hashlib
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PRESET = "cortex-m7-planners"
IMAGE = ROOT / "build" / PRESET / "tests/cortex_m/tiller_worst_tick"
ROWS = ROOT / "build/bench/worst_tick.csv"
RECORD = ROOT / "tests/cortex_m/worst_ticks.csv"
# What a change of the code or of the compiler may move before the search has to be run anew with --write.
TOLERANCE = 0.05
FIELDS = ["image", "planner", "kind", "seed", "inputs", "median", "random", "most", "tick", "values"]


def planners():
    text = (ROOT / "runtime/include/tiller/planners.def").read_text(encoding="utf-8")
    return re.findall(r"^TILLER_PLANNER\((\w+),", text, re.MULTILINE)


def build():
    subprocess.run(["cmake", "--preset", PRESET], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", "--preset", PRESET, "--target", "tiller_worst_tick"], cwd=ROOT, check=True,
                   stdout=subprocess.DEVNULL)
    return hashlib.sha256(IMAGE.read_bytes()).hexdigest()[:16]


def emulate(image, *numbers):
    arguments = ",".join(["enable=on,target=native,arg=tiller"] + [f"arg={number}" for number in numbers])
    return subprocess.run(["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none",
                           "-icount", "shift=7", "-semihosting-config", arguments, "-kernel", str(image)],
                          text=True, check=False, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT).stdout  # semihosting writes to the standard error


def search(kind, inputs, seed):
    out = emulate(IMAGE, kind, inputs, seed)
    best = re.findall(r"^planner \d+ input \d+ most (\d+) tick (\d+) values ([\d ]+)$", out, re.MULTILINE)[-1]
    median, random = re.search(r"median (\d+) random (\d+) most", out).groups()
    return {"median": median, "random": random, "most": best[0], "tick": best[1], "values": best[2]}


def run_again(image):
    """Fails where a recorded input takes another number of instructions than recorded, by more than TOLERANCE, or not
    the same number twice."""
    good, count = True, 0
    with RECORD.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        out = emulate(image, row["kind"], 0, *row["values"].split())
        if "refused: " in out:  # this image is without the planner
            continue
        told = int(re.search(r" most (\d+) tick", out)[1])
        again = count > 0 or emulate(image, row["kind"], 0, *row["values"].split()) == out  # once is enough
        share = told / int(row["most"]) - 1.0
        count += 1
        good = good and again and abs(share) <= TOLERANCE
        print(f"{row['planner']}: {told} instructions, recorded {row['most']} ({100 * share:+.2f} %)"
              f"{'' if again else ', and not the same twice'}")
    return good and count > 0


def finished():
    if not ROWS.exists():
        return []
    with ROWS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def keep(row):
    ROWS.parent.mkdir(parents=True, exist_ok=True)
    new = not ROWS.exists()
    with ROWS.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--planner", choices=planners())
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--again", type=pathlib.Path)
    args = parser.parse_args()
    if args.again:
        return 0 if run_again(args.again) else 1
    image = build()
    worst = []
    print("| planner | median | most, random inputs | most, found | at tick |\n|---|---|---|---|---|", flush=True)
    for kind, planner in enumerate(planners()):
        if args.planner not in (None, planner):
            continue
        rows = []
        for seed in range(1, args.seeds + 1):
            same = {"image": image, "planner": planner, "kind": str(kind), "seed": str(seed),
                    "inputs": str(args.inputs)}
            row = next((row for row in finished() if same.items() <= row.items()), None)
            if row is None:
                row = {**same, **search(kind, args.inputs, seed)}
                keep(row)
            rows.append(row)
        most = max(rows, key=lambda row: int(row["most"]))
        most["random"] = max(rows, key=lambda row: int(row["random"]))["random"]
        worst.append(most)
        million = [f"{int(most[key]) / 1e6:.2f} million" for key in ("median", "random", "most")]
        print(f"| {planner} | {' | '.join(million)} | {most['tick']} |", flush=True)
    if args.write:
        with RECORD.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, FIELDS[1:], lineterminator="\n", extrasaction="ignore")
            writer.writeheader()
            writer.writerows(worst)
    return 0


if __name__ == "__main__":
    sys.exit(main())
