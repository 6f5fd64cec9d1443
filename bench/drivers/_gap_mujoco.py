"""Hidden effects in machines that MuJoCo simulates (bench/peers/mujoco_worlds.py): `tiller gap` on each, judged here.

A line of mujoco.csv for each case; a run that was cut goes on from there. Outcomes have the names of
harness/gap_scoring/gap_score.hpp.
"""

import concurrent.futures
import csv
import itertools
import json
import math
import os
import queue
import shutil
import subprocess
import threading
import time

from _driver import ONE_THREAD, PEERS, need_environment, note, python_of

NOISES = [3e-4, 2e-3, 1e-2]
PLANTS = {"pendulum": ["open_loop", "pd_tracking"], "cart_pole": ["pd_tracking"],
          "two_link_arm": ["open_loop", "pd_tracking"], "linear_axis": ["pd_tracking"]}
KINDS = ["viscous_friction", "coulomb_friction", "stribeck_friction", "asymmetric_friction", "quadratic_drag",
         "load_friction", "lugre_friction", "linear_spring", "cubic_spring", "constant_offset", "cogging",
         "torque_ripple", "joint_inertia", "backlash", "actuator_gain", "actuator_lag", "input_delay", "dead_zone",
         "saturation", "rate_limit", "sensor_bias", "sensor_scale", "tilt", "payload",
         "square_spring", "hard_stop", "position_friction", "supply_sag", "elastic_joint"]
# what a plant cannot show: nothing there depends on where it is against gravity
NOT_IN = {"linear_axis": {"sensor_bias", "sensor_scale", "tilt", "payload"}}
FIELDS = ["id", "plant", "truth", "noise_sd", "excitation", "seed", "r", "outcome", "verdict", "answer",
          "nominal_sigma", "remaining_sigma", "cpu_s", "parameters"]
NULLS_A_SEED = 2  # of every plant and noise


def cases_of(args):
    """Every case, seed by seed, so that a run that is cut has looked at everything a little."""
    first = 100001 if args.tune else 31
    for seed in range(first, first + args.seeds):
        for plant, excitations in PLANTS.items():
            for noise_sd in NOISES:
                for n, kind in enumerate([*KINDS, *[None] * NULLS_A_SEED]):
                    if kind in NOT_IN.get(plant, ()) or (args.kinds and kind not in args.kinds):
                        continue
                    name = kind or f"null_{n - len(KINDS)}"
                    yield {"id": f"{plant}-{name}-{noise_sd:g}-{seed}", "plant": plant, "kinds": [kind] if kind else [],
                           "noise_sd": noise_sd, "excitation": excitations[(n + seed) % len(excitations)],
                           "seed": seed}


# ---- judging ---------------------------------------------------------------------------------------


def names_of(explanation):
    return sorted(f"{e['kind']}@{e['port'] or 'body'}" for e in explanation["effects"])


def same_kind(a, b, kinds):
    """Equal, or aliases by the catalogue either way round."""
    x, y = a.split("@")[0], b.split("@")[0]
    return a == b or y in kinds.get(x, {}).get("aliases", []) or x in kinds.get(y, {}).get("aliases", [])


def elementary(names):
    """Friction of two levels written as the Coulomb friction and the constant force that it is."""
    parts = []
    for name in names:
        kind, _, port = name.partition("@")
        parts += [f"coulomb_friction@{port}", f"constant_offset@{port}"] if kind == "asymmetric_friction" else [name]
    return parts


def same_structure(one, other, kinds):
    """Whether the effects of two sets pair up, each with its equal or its alias."""
    one, other = elementary(one), elementary(other)
    return len(one) == len(other) and any(all(same_kind(a, b, kinds) for a, b in zip(one, order))
                                          for order in itertools.permutations(other))


def judge(truth, result):
    """(outcome, sets of names)"""
    verdict, kinds = result["verdict"], result.get("catalogue", {})
    ranking = result.get("ranking", [])
    sets = [names_of(ranking[i]) for i in result.get("ambiguity", [])]
    if verdict in ("unfit", "no_gap"):
        return {"unfit": "unfit", "no_gap": "none"}[verdict], sets
    if verdict == "unnamed" or not sets:
        return "unnamed", sets
    if not truth:
        return "wrong", sets
    if sorted(truth) in sets:
        one_class = all(same_structure(s, truth, kinds) for s in sets)
        return ("exact" if one_class and verdict != "partly_explained" else "in_set"), sets
    part = any(0 < len(s) < len(truth) and all(any(same_kind(a, b, kinds) for b in truth) for a in s) for s in sets)
    return ("part" if part else "wrong"), sets


def covered(sealed, result):
    """(parameters inside of their 95 % intervals, parameters) of an answer that is the truth."""
    if not sealed["effects"]:
        return 0, 0
    values = {f"{e['port'] if e['port'] != 'body' else 'body'}.{n}": v for e in sealed["effects"]
              for n, v in e["parameters"].items()}
    found = [(p["interval_95"], values[p["name"]]) for p in result["ranking"][result["ambiguity"][0]]["parameters"]
             if p["name"] in values]
    return sum(low <= v <= high for (low, high), v in found if low is not None), len(found)


# ---- running ---------------------------------------------------------------------------------------


class Makers:
    """Processes of mujoco_worlds.py, one for each worker."""

    def __init__(self, count):
        self.free = queue.Queue()
        for _ in range(count):
            self.free.put(subprocess.Popen([str(python_of("mujoco")), str(PEERS / "mujoco_worlds.py")],
                                           stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                           env=dict(os.environ, **ONE_THREAD)))

    def make(self, case):
        process = self.free.get()
        try:
            process.stdin.write(json.dumps(case) + "\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())
        finally:
            self.free.put(process)

    def leave(self):
        while not self.free.empty():
            process = self.free.get()
            process.stdin.close()
            process.wait()


def run_case(case, makers, args):
    folder = args.out / "mujoco" / case["id"]
    made = makers.make(dict(case, folder=str(folder)))
    row = {k: case[k] for k in ("id", "plant", "noise_sd", "excitation", "seed")}
    if made["error"]:
        return dict(row, truth="+".join(case["kinds"]), outcome="not_made", verdict=made["error"])
    sealed = json.loads((folder / "sealed/case.json").read_text(encoding="utf-8"))
    truth = sorted(f"{e['kind']}@{e['port']}" for e in sealed["effects"])
    logs = sorted(folder.glob("log_*.csv"))
    done = subprocess.run([str(args.build / "tools/tiller"), "gap", str(folder / "robot.toml"), *map(str, logs),
                           "--json", "--threads", "1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False,
                          env=dict(os.environ, **ONE_THREAD))
    try:
        result = json.loads(done.stdout)
    except json.JSONDecodeError:
        return dict(row, truth="+".join(truth) or "none", r=f"{made['r']:.4g}", outcome="failed",
                    verdict=done.stderr.strip()[:200])
    outcome, sets = judge(truth, result)
    hits = covered(sealed, result) if outcome == "exact" else (0, 0)
    (folder / "gap.json").write_text(done.stdout, encoding="utf-8")
    if outcome == "exact" or (not truth and outcome == "none"):
        shutil.rmtree(folder)
    figure = lambda part, key: math.nan if part.get(key) is None else part[key]
    return dict(row, truth="+".join(truth) or "none", r=f"{made['r']:.4g}", outcome=outcome, verdict=result["verdict"],
                answer=" or ".join("+".join(s) for s in sets), nominal_sigma=f"{figure(result['gate'], 'nominal_sigma'):.4g}",
                remaining_sigma=f"{figure(result, 'remaining_sigma'):.4g}", cpu_s=f"{figure(result['cost'], 'cpu_s'):.3g}",
                parameters=f"{hits[0]}/{hits[1]}")


def run_cases(cases, path, args):
    """Rows of all cases, those of an earlier run included."""
    rows = []
    if path.exists():
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    done = {row["id"] for row in rows}
    wanted = {case["id"] for case in cases}
    rows = [row for row in rows if row["id"] in wanted]
    left = [case for case in cases if case["id"] not in done]
    makers, lock, started, told = Makers(args.jobs), threading.Lock(), time.monotonic(), 0
    with open(path, "a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if file.tell() == 0:
            writer.writeheader()
        with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
            for future in concurrent.futures.as_completed([pool.submit(run_case, c, makers, args) for c in left]):
                with lock:
                    rows.append(future.result())
                    writer.writerow(rows[-1])
                    file.flush()
                    told += 1
                if told % 20 == 0:
                    rest = (time.monotonic() - started) / told * (len(left) - told)
                    note(f"mujoco: {told} of {len(left)} cases, {rest / 60:.0f} min left")
    makers.leave()
    return rows


# ---- table -----------------------------------------------------------------------------------------


class Table:
    """Rows in the form of the other sections; those with a goal are kept."""

    def __init__(self, section):
        self.section, self.rows = section, []

    def heading(self, text):
        self.title = text
        print(f"\n{text}", flush=True)

    def row(self, what, figure, unit="", goal=""):
        bound = float(goal.split()[1]) if goal else 0.0
        met = bool(goal) and (figure >= bound if goal.startswith(">=") else figure <= bound)
        verdict = ("met" if met else "short") if goal else ""
        wanted = f"goal {goal}" if goal else ""
        print(f"  {what:<76} {figure:10.4g} {unit:<8} {wanted:<16} {verdict}".rstrip(), flush=True)
        if goal:
            self.rows.append({"section": self.section, "heading": self.title, "row": what, "figure": figure,
                              "unit": unit, "goal": goal, "met": met})


def share(rows, outcomes):
    return 100.0 * sum(row["outcome"] in outcomes for row in rows) / len(rows) if rows else math.nan


BANDS = [("r >= 3", 3.0, math.inf, ">= 97", "<= 1"), ("1.5 <= r < 3", 1.5, 3.0, ">= 90", "<= 2"),
         ("r < 1.5", 0.0, 1.5, "", "<= 2")]


def tell_bands(table, title, hidden, measure):
    """Rates by the strength of the effect: what a fit of the nominal model cannot hide has to be named."""
    table.heading(f"one hidden effect, {title}")
    for name, low, high, exact_goal, wrong_goal in BANDS:
        band = [row for row in hidden if row[measure] and low <= float(row[measure]) < high]
        if not band:
            continue
        table.row(f"{name}: exact, n = {len(band)}", share(band, ["exact"]), "%", exact_goal)
        table.row(f"{name}: truth in the reported set", share(band, ["exact", "in_set"]), "%")
        table.row(f"{name}: wrong", share(band, ["wrong"]), "%", wrong_goal)


def tell(rows):
    table = Table("mujoco")
    made = [row for row in rows if row["outcome"] not in ("not_made", "failed")]
    hidden = [row for row in made if row["truth"] != "none"]
    tell_bands(table, "r of the plant without the effect", hidden, "r")
    tell_bands(table, "r of the nominal model as fitted", hidden, "nominal_sigma")
    table.heading("one hidden effect, parameters and time")
    counts = [tuple(map(int, row["parameters"].split("/"))) for row in hidden if row["parameters"]]
    if all_of := sum(n for _, n in counts):
        table.row(f"parameters inside of their 95 % intervals, n = {all_of}", 100 * sum(h for h, _ in counts) / all_of,
                  "%", ">= 92")
    seconds = sorted(float(row["cpu_s"]) for row in hidden if row["cpu_s"])
    if seconds:
        table.row("median processor time", seconds[len(seconds) // 2], "s", "<= 3")
        table.row("slowest", seconds[-1], "s", "<= 15")
    nulls = [row for row in made if row["truth"] == "none"]
    if nulls:
        table.heading("nothing hidden")
        table.row(f"false alarms, n = {len(nulls)}", 100.0 - share(nulls, ["none"]), "%", "<= 1")
    if len(made) < len(rows):
        print(f"  {len(rows) - len(made)} cases were not made or gave no answer; mujoco.csv says why")
    return table.rows


def run(args):
    """(rows, whether it came to its end)"""
    if not need_environment("mujoco"):
        print("  NOT MEASURED: MuJoCo does not install here")
        return [], True
    cases = list(cases_of(args))
    rows = run_cases(cases, args.out / ("mujoco_tuning.csv" if args.tune else "mujoco.csv"), args)
    return tell(rows), all(row["outcome"] != "failed" for row in rows)
