"""The peers of `./dev bench posterior`: what is measured beside which, and the rows that come of it."""

import json
import shutil
import statistics
import subprocess
import sys

import numpy as np

from _driver import HOME, PEERS, Participant, instructions, lines_of, need_environment, note, python_of, take_turns

NAMES = ["numpy", "particles", "emcee", "sbi"]
DEFAULT = ["numpy", "particles", "emcee"]
TASKS = ["cart-pole", "pendulum", "acrobot masses"]
MCMC_EPISODES = 5

GOAL_NUMPY = 40.0        # times the throughput of every numpy variant
GOAL_WORST_TICK = 1000.0  # times below IBIS' worst tick
GOAL_EVEN = 3.0          # worst over median tick, counted work
# 1,024 draws of the exact posterior have a mean off by .03 deviations and a deviation off by .02; an online posterior
# of at least half the effective size by 1.4 times that. Among 30 statements five such deviations are never seen.
GOAL_MEAN, GOAL_SD = 0.2, 0.2


class Rows:
    """Prints rows as bench_table.hpp does, and keeps those with a goal."""

    def __init__(self):
        self.kept, self.title = [], ""

    def heading(self, text):
        self.title = text
        print(f"\n{text}")

    def row(self, what, figure, unit, goal=None, at_least=False):
        verdict = bound = ""
        if goal is not None:
            met = bool(figure >= goal if at_least else figure <= goal)
            bound, verdict = f"{'>=' if at_least else '<='} {goal:g}", "met" if met else "short"
            self.kept.append({"section": "peers", "heading": self.title, "row": what, "figure": float(figure),
                              "unit": unit, "goal": bound, "met": met})
        print(f"  {what:<76} {figure:10.4g} {unit:<8} {'goal ' + bound if bound else '':<16} {verdict}".rstrip(),
              flush=True)


# ---- episodes ----------------------------------------------------------------------------------------


def episodes(build, count):
    """Folders of the first `count` episodes of each task and noise level, made by bench_accuracy; none without it."""
    program = build / "bench/bench_accuracy"
    if not program.exists():
        return []
    folders = []
    for task in TASKS:
        folder = HOME / "episodes" / f"{task.replace(' ', '_')}_{count}"
        made = folder / "made"
        if not made.exists() or made.stat().st_mtime < program.stat().st_mtime:
            note(f"episodes of {task}")
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            subprocess.run([str(program), "--task", task, "--runs", str(count), "--export", str(folder)], check=True)
            made.touch()
        folders.append(folder)
    return folders


# ---- rounds: numpy, particles ------------------------------------------------------------------------


def median_ratio(times, peer, ours):
    return statistics.median(p / o for p, o in zip(times[peer], times[ours]))


def numpy_rows(rows, facts, times):
    version = next((f["numpy"] for f in facts.values() if "numpy" in f), "")
    for shape in ("one transition", "64 transitions"):
        ours = f"tiller residuals, {shape}"
        rows.heading(f"numpy {version}: squared residuals of 1,024 cart-poles, {shape} a call")
        rows.row("tiller, float32 lanes", 1e-6 / statistics.median(times[ours]), "M/s")
        for name in [n for n in times if n.startswith("numpy") and n.endswith(shape)]:
            rows.row(f"{name.split(',')[0]} (largest relative error {facts[name]['error']:.0e})",
                     1e-6 / statistics.median(times[name]), "M/s")
            rows.row(f"  tiller over {name.split(',')[0]}", median_ratio(times, name, ours), "x", GOAL_NUMPY,
                     at_least=True)


def ibis_rows(rows, facts, times, build):
    rows.heading("particles IBIS, pendulum, sigma 0.03, 400 ticks, 1,024 particles: CPU time of a tick")
    for which in ("median", "worst"):
        rows.row(f"tiller posterior, {which} tick", 1e6 * statistics.median(times[f"tiller posterior/{which}"]), "us")
    for name in [n.split("/")[0] for n in times if n.startswith("particles") and n.endswith("/median")]:
        found = facts[f"{name}/median"]
        off = np.max(np.abs(np.array(found["mean"]) - found["exact_mean"]) / found["exact_sd"])
        rows.row(f"{name}, median tick (mean off by {off:.2f} sd)", 1e6 * statistics.median(times[f"{name}/median"]),
                 "us")
        rows.row(f"  {name}: median tick over tiller's",
                 median_ratio(times, f"{name}/median", "tiller posterior/median"), "x")
        rows.row(f"{name}, worst tick", 1e6 * statistics.median(times[f"{name}/worst"]), "us")
        rows.row(f"  {name}: worst tick over tiller's",
                 median_ratio(times, f"{name}/worst", "tiller posterior/worst"), "x", GOAL_WORST_TICK, at_least=True)
    counts, trouble = instructions([build / "bench/bench_posterior_peers", "--ticks"])
    if counts:
        rows.row(f"tiller posterior, instructions of a tick, worst over median ({len(counts)} ticks)",
                 max(counts) / statistics.median(counts), "x", GOAL_EVEN)
    else:
        print(f"  instructions of a tick: not measured: {trouble}")


def in_turns(rows, wanted, build, rounds):
    ours = build / "bench/bench_posterior_peers"
    if not ours.exists():
        print("  numpy, particles: not measured: this build has no bench_posterior_peers")
        return
    programs = [[ours]]
    if "numpy" in wanted:
        programs.append([sys.executable, PEERS / "numpy_peer.py"])
    pendulum = next((f for f in episodes(build, MCMC_EPISODES) if f.name.startswith("pendulum")), None)
    if "particles" in wanted and pendulum is not None and need_environment("posterior"):
        programs.append([python_of("posterior"), PEERS / "ibis_peer.py", pendulum])
    facts, times = take_turns([Participant(p) for p in programs], rounds)
    if not any(n.startswith("tiller") for n in times):
        print("  bench_posterior_peers gave no answer")
        return
    if "numpy" in wanted:
        numpy_rows(rows, facts, times)
    if any(n.startswith("particles") for n in times):
        ibis_rows(rows, facts, times, build)
    elif "particles" in wanted:
        print("\n  particles: not measured: could not be installed or run here")


# ---- emcee -------------------------------------------------------------------------------------------


def distance(a, b, sd):
    return float(np.max(np.abs(np.array(a) - b) / sd))


def widths(a, b):
    return float(np.max(np.abs(np.array(a) / np.array(b) - 1)))


def emcee_rows(rows, build):
    folders = episodes(build, MCMC_EPISODES)
    if not folders or not need_environment("posterior"):
        print("\n  emcee: not measured: no bench_accuracy in this build, or it could not be installed here")
        return
    note("emcee: 15 episodes, a minute")
    chains = lines_of([python_of("posterior"), PEERS / "mcmc_peer.py", *folders, "--episodes", MCMC_EPISODES])
    program = build / "bench/bench_posterior_peers"
    for task in TASKS:
        here = [c for c in chains if c["task"] == task]
        ours = {m["seed"]: m for m in lines_of([program, "--moments", task, "0.03", MCMC_EPISODES])
                } if program.exists() else {}
        seconds = statistics.mean(c["seconds"] for c in here)
        rows.heading(f"emcee, {task}, sigma 0.03: {len(here)} episodes, worst parameter and episode "
                     f"({seconds:.2g} CPU s an episode)")
        rows.row("emcee's means against quadrature's, deviations",
                 max(distance(c["mean"], c["exact_mean"], c["exact_sd"]) for c in here), "sd")
        rows.row("emcee's deviations against quadrature's", max(widths(c["sd"], c["exact_sd"]) for c in here), "")
        if len(ours) < len(here):
            print("  tiller: not measured: no bench_posterior_peers")
            continue
        rows.row("tiller's means against emcee's, deviations",
                 max(distance(ours[c["seed"]]["mean"], c["mean"], c["sd"]) for c in here), "sd", GOAL_MEAN)
        rows.row("tiller's deviations against emcee's", max(widths(ours[c["seed"]]["sd"], c["sd"]) for c in here), "",
                 GOAL_SD)


# ---- sbi ---------------------------------------------------------------------------------------------


def tiller_on(build, task, sigma, tests):
    """Mean log density at the truth and CPU seconds an episode of tiller's posterior on the same episodes."""
    out = HOME / "tiller_runs.csv"
    subprocess.run([str(build / "bench/bench_accuracy"), "--only", "table", "--task", task, "--sigma", str(sigma),
                    "--runs", str(tests), "--csv", str(out)], stdout=subprocess.DEVNULL, check=False)
    table = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()[1:]]
    ranks = np.array([[float(v) for v in line[9::2]] for line in table])
    return (statistics.mean(float(line[3]) for line in table), 1e-6 * statistics.mean(float(line[7]) for line in table),
            np.mean((ranks > 0.05) & (ranks < 0.95), axis=0))


def share(values):
    return ", ".join(f"{v:.2f}" for v in values)


def sbi_rows(rows, build, tests):
    folders = episodes(build, tests)
    if not folders or not need_environment("sbi"):
        print("\n  sbi: not measured: no bench_accuracy in this build, or it could not be installed here")
        return
    note("sbi: 16 trainings, about half an hour of CPU time")
    found = lines_of([python_of("sbi"), PEERS / "sbi_peer.py", *folders, "--tests", tests])
    (HOME / "sbi.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    for task, sigma in dict.fromkeys((f["task"], f["sigma"]) for f in found):
        here = [f for f in found if (f["task"], f["sigma"]) == (task, sigma)]
        rows.heading(f"sbi NPE, {task}, sigma {sigma:g}: mean log density at the truth, {here[0]['tests']} episodes "
                     f"(exact, noise unknown: {here[0]['exact']:.2f})")
        density, seconds, cover = tiller_on(build, task, sigma, here[0]["tests"])
        rows.row(f"tiller, noise unknown: cov90 {share(cover)}, {seconds:.2g} CPU s an episode", density, "nats")
        for f in here:
            rows.row(f"{f['estimator']}, {f['simulations']} simulations, noise known: cov90 {share(f['coverage'])}, "
                     f"{f['simulate_s'] + f['train_s']:.0f} CPU s once, {f['episode_s']:.2g} s an episode",
                     f["log_density"], "nats")
    print("  (a trained estimator answers any number of episodes of its task, noise level and excitation: it amortises)")


def run(wanted, build, rounds, tests):
    rows = Rows()
    if {"numpy", "particles"} & set(wanted):
        in_turns(rows, wanted, build, rounds)
    if "emcee" in wanted:
        emcee_rows(rows, build)
    if "sbi" in wanted:
        sbi_rows(rows, build, tests)
    else:
        print("\nsbi: not run; --peers sbi trains 16 estimators (about half an hour of CPU time, 6 GB for torch)")
    return rows.kept
