"""PySINDy on the sealed data: worlds of the first seeds of every cell, its answers, its rates beside ours."""

import csv
import json
import os
import subprocess

from _driver import ONE_THREAD, PEERS, need_environment, note, python_of

GOAL_RATIO = 2.0   # our exact rate over its best
LEAST_R = 3.0      # weaker effects are nobody's
SEEDS = 2          # of every kind, plant and noise

# Names that positions alone may not tell apart count as one, for it as for us.
CLASSES = [{"input_delay", "actuator_lag"}, {"tilt", "sensor_bias"}, {"stribeck_friction", "lugre_friction"}]


def class_of(name):
    return min(next((c for c in CLASSES if name in c), {name}))


def is_exact(truth, answer):
    return answer is not None and {class_of(n) for n in answer} == {class_of(n) for n in truth}


def worlds(args, out):
    """Folders of the cases; made where they are not."""
    program = args.build / "bench/bench_gap_export"
    command = [program, "--out", out, "--seeds", str(SEEDS), *(["--tune"] if args.tune else []), *args.rest]
    if not program.exists() or subprocess.run([str(c) for c in command], check=False).returncode:
        note("bench_gap_export made not all worlds")
    return sorted(p.parent.parent for p in out.glob("*/sealed/case.json"))


def our_exact(path):
    """Whether we were exact, by case."""
    if not path.exists():
        return {}
    with open(path, encoding="utf-8", newline="") as file:
        return {row["id"].replace("/", "-"): row["outcome"] == "exact" for row in csv.DictReader(file)}


def judged(folders, lines):
    """[(case, noise, {method: exact})] of the cases that are strong enough; the seals are broken here."""
    cases = []
    for line in lines:
        said = json.loads(line)
        sealed = json.loads((folders[said["case"]] / "sealed/case.json").read_text(encoding="utf-8"))
        if sealed["r"] < LEAST_R:
            continue
        truth = [e["kind"] for e in sealed["effects"]]
        cases.append((said["case"], sealed["noise_sd"], {m: is_exact(truth, a) for m, a in said["answers"].items()}))
    return cases


def rows_of(cases, ours):
    rows = []

    def row(what, figure, unit="", goal=None):
        met = goal is not None and figure >= goal
        print(f"  {what:<58} {figure:10.4g} {unit:<8} {f'goal >= {goal:g}' if goal else '':<16} "
              f"{'' if goal is None else 'met' if met else 'short'}".rstrip(), flush=True)
        if goal is not None:
            rows.append({"section": "sindy", "heading": "PySINDy", "row": what, "figure": figure, "unit": unit,
                         "goal": f">= {goal:g}", "met": met})

    rate = lambda hits: sum(hits) / len(hits) if hits else float("nan")
    best = 0.0
    for method in cases[0][2]:
        for noise in sorted({c[1] for c in cases}):
            row(f"{method}, exact at noise {noise:g}", rate([c[2][method] for c in cases if c[1] == noise]))
        overall = rate([c[2][method] for c in cases])
        row(f"{method}, exact", overall)
        best = max(best, overall)
    same = [ours[c[0]] for c in cases if c[0] in ours]
    if not same:
        print("  not compared: run the section 'sealed' first")
        return rows
    ours_rate = rate(same)
    row(f"tiller gap on {len(same)} of these cases, exact", ours_rate)
    shared = [c for c in cases if c[0] in ours]
    best = max(rate([c[2][m] for c in shared]) for m in cases[0][2])
    row("our exact rate over its best", ours_rate / best if best > 0 else float("inf"), "", GOAL_RATIO)
    return rows


def run(args):
    """(rows, whether it came to its end)"""
    if not need_environment("sindy"):
        print("  NOT MEASURED: PySINDy does not install here")
        return [], True
    folders = {p.name: p for p in worlds(args, args.out / ("sindy_tuning" if args.tune else "sindy_worlds"))}
    if not folders:
        print("  NOT MEASURED: no worlds; build bench_gap_export")
        return [], False
    done = subprocess.run([str(python_of("sindy")), str(PEERS / "gap_sindy.py"), *map(str, folders.values())],
                          stdout=subprocess.PIPE, text=True, check=False, env=dict(os.environ, **ONE_THREAD))
    cases = judged(folders, done.stdout.splitlines())
    if not cases:
        print("  NOT MEASURED: no case of r >= 3 was answered")
        return [], False
    return rows_of(cases, our_exact(args.out / ("tuning.csv" if args.tune else "results.csv"))), done.returncode == 0
