"""./dev bench fleet: a thousand simulated robots with known answers (tiller fleet).

    ./dev bench fleet                    every section, seed 1
    ./dev bench fleet odd --seeds 1 2 3  one section, other fleets
    ./dev bench fleet --quick            60 robots in the place of 1,000

Sections:
    scaling     fits a second with two processes and two Dask workers, over twice those with one: in turns, log by log
    lost        a fit, a run and a Dask worker are killed: the results must be those of an undisturbed run, to the bit
    odd         which robots are named of a fleet with five odd ones
    coverage    share of the robots' true parameters inside their 90 % intervals; and of the population's own, over 200
                fleets of 30 robots whose evidence is exactly Gaussian
    peer        the population by reweighted draws and a random walk, which share no code with the sampler

Fits are kept in build/bench_fleet, so that a run that was cut goes on. Rows with a goal stand in the summary, short or
not. Needs Dask (bench/peers/requirements_dask.txt, installed on first use).
"""

import argparse
import contextlib
import json
import math
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import time

from _driver import ROOT, need_environment, note, python_of, summary

sys.path.insert(0, str(ROOT / "tools/python"))
import numpy as np  # noqa: E402

from tiller_tools.fleet import hierarchy, identify_fleet  # noqa: E402
from tiller_tools.fleet.jobs import Job  # noqa: E402
from tiller_tools.fleet.summaries import Coordinate, Evidence  # noqa: E402

FOLDER = ROOT / "build/bench_fleet"
SECTIONS = ("scaling", "lost", "odd", "coverage", "peer")
ROWS = []


def row(section, what, figure, unit, low=None, high=None):
    """Prints a row and keeps it; met within [low, high]."""
    goals = [f">= {low}"] * (low is not None) + [f"<= {high}"] * (high is not None)
    met = all(((low is None or figure >= low), (high is None or figure <= high)))
    verdict = ('met' if met else 'short') if goals else ''
    print(f"  {what:<70} {figure:10.4g} {unit:<10} {' '.join(goals):<18} {verdict}",
          flush=True)
    if goals:
        ROWS.append({"section": section, "heading": "tiller fleet", "row": what, "figure": figure, "unit": unit,
                     "goal": " ".join(goals), "met": met})


# ---- runs of the command ---------------------------------------------------------------------------


def command(args, *arguments, **how):
    env = dict(os.environ, TILLER_PYTHON=str(python_of("dask")))
    return subprocess.run([str(args.tiller), "fleet", *map(str, arguments)], env=env, text=True, check=True, **how)


def fleet(args, seed, robots=None):
    """The simulated fleet of a seed; made once."""
    robots = robots or args.robots
    folder = FOLDER / f"seed_{seed}_{robots}"
    if not (folder / "robot.toml").exists():
        command(args, "make", folder, "--robots", robots, "--seed", seed, stdout=subprocess.DEVNULL)
    return folder


def part(args, name, count):
    """A fleet of the first logs of seed 1, for runs that are repeated."""
    whole, folder = fleet(args, 1), FOLDER / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for path in [whole / "robot.toml", *sorted(whole.glob("robot_*.csv"))[:count]]:
        (folder / path.name).write_bytes(path.read_bytes())
    return folder


def identify(args, folder, out, *options):
    command(args, "identify", folder, "-o", out, "--quiet", *options, stdout=subprocess.DEVNULL, stderr=sys.stderr)


def results(out):
    return {p.name: p.read_bytes() for p in sorted((out / "results").glob("*.json"))}


# ---- Dask ------------------------------------------------------------------------------------------


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def cluster(workers):
    """A scheduler and single-threaded workers on this machine; yields the address and the workers' processes."""
    address, processes = f"tcp://127.0.0.1:{free_port()}", []
    dask = python_of("dask").parent / "dask"
    log = open(FOLDER / "dask.log", "a", encoding="utf-8")

    def start(*arguments):
        processes.append(subprocess.Popen([str(dask), *arguments], stdout=log, stderr=log, cwd=FOLDER))

    start("scheduler", "--host", "127.0.0.1", "--port", address.rsplit(":", 1)[1], "--no-dashboard")
    for _ in range(workers):
        start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    try:
        wait_for_workers(address, workers)
        yield address, processes[1:]
    finally:
        for process in processes[::-1]:
            process.terminate()
        for process in processes:
            process.wait()
        log.close()


def wait_for_workers(address, workers):
    code = (f"from distributed import Client\nc = Client('{address}', timeout='120s')\n"
            f"c.wait_for_workers({workers}, timeout=120)\n")
    subprocess.run([str(python_of("dask")), "-c", code], check=True, stderr=subprocess.DEVNULL)


# ---- scaling ---------------------------------------------------------------------------------------


def rates(args, ways, logs, rounds):
    """Way -> fits a second in each round. Ways take turns, so that what else the machine does meets all alike.

    The pools are driven as the command drives them, without its start and its page, which do not grow with the fleet.
    """
    code = ("import sys, time, json; sys.path.insert(0, sys.argv[1])\n"
            "from tiller_tools.fleet import dask_pool, jobs, pool, worker\n"
            "folder, tiller, count = sys.argv[2], sys.argv[3], int(sys.argv[4])\n"
            "version = worker.version_of(tiller)\n"
            "todo = jobs.jobs_of(jobs.find_robots(folder), 'identify')[:count]\n"
            "files = jobs.RobotFiles()\n"
            "packages = [jobs.pack(j, 'identify', [], version, files) for j in todo]\n"
            "for line in sys.stdin:\n"
            "    way, value = line.split()\n"
            "    one = pool.Pool(int(value), tiller, version) if way == 'pool' else "
            "dask_pool.DaskPool(value, [tiller], version)\n"
            "    done = []\n"
            "    begin = time.perf_counter()\n"
            "    one.run(iter(packages), lambda p, ran: done.append(ran['code']))\n"
            "    assert done == [0] * count, done\n"
            "    print(count / (time.perf_counter() - begin), flush=True)\n")
    found = {way: [] for way in ways}
    with subprocess.Popen([str(python_of("dask")), "-c", code, str(ROOT / "tools/python"), str(fleet(args, 1)),
                           str(args.tiller), str(logs)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          text=True) as process:
        for number in range(rounds):
            note(f"scaling: round {number + 1} of {rounds}")
            for way, ask in ways.items():
                process.stdin.write(ask + "\n")
                process.stdin.flush()
                found[way].append(float(process.stdout.readline()))
        process.stdin.close()
    return found


def scaling(args):
    logs, rounds = (10, 2) if args.quick else (40, 25)
    logs, rounds = (args.block or logs), (args.rounds or rounds)
    print(f"\n==== scaling: {rounds} rounds of {logs} logs; load of the machine at the start {os.getloadavg()[0]:.1f}")
    with cluster(1) as (one, _), cluster(2) as (two, _):
        ways = {"1 process": "pool 1", "2 processes": "pool 2", "1 worker": f"dask {one}", "2 workers": f"dask {two}"}
        found = rates(args, ways, logs, rounds)
    (FOLDER / "scaling.json").write_text(json.dumps(found), encoding="utf-8")
    for way, values in found.items():
        row("scaling", f"{way}: fits a second (median)", float(np.median(values)), "1/s")
    for one, two, of in (("1 process", "2 processes", "processes"), ("1 worker", "2 workers", "Dask workers")):
        share = 100 * np.array(found[two]) / (2 * np.array(found[one]))
        row("scaling", f"two {of} over twice one, median of the rounds", float(np.median(share)), "%", low=90)
        row("scaling", f"two {of}: quartiles' low", float(np.quantile(share, 0.25)), "%")
        row("scaling", f"two {of}: quartiles' high", float(np.quantile(share, 0.75)), "%")


# ---- what is lost ----------------------------------------------------------------------------------


def wait_for(condition, seconds=300):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError("nothing happened in five minutes")
        time.sleep(0.01)


def start_identify(args, folder, out, *options):
    env = dict(os.environ, TILLER_PYTHON=str(python_of("dask")))
    return subprocess.Popen([str(args.tiller), "fleet", "identify", folder, "-o", out, "--quiet", *options], env=env,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def children(pid):
    path = pathlib.Path(f"/proc/{pid}/task")
    tasks = list(path.iterdir()) if path.exists() else []
    found = [int(p) for task in tasks for p in (task / "children").read_text().split()]
    return found


def lost(args):
    folder = part(args, "lost", 12 if args.quick else 30)
    print("\n==== lost: killed in mid-run")
    identify(args, folder, folder / "serial", "--jobs", "1")
    serial = results(folder / "serial")

    run = start_identify(args, folder, folder / "killed", "--jobs", "2")
    killed = 0
    for count in (2, 5):  # two fits, then the run itself
        wait_for(lambda: len(results(folder / "killed")) >= count and children(run.pid))
        with contextlib.suppress(ProcessLookupError, IndexError):
            os.kill(children(run.pid)[0], signal.SIGKILL)
            killed += 1
    wait_for(lambda: len(results(folder / "killed")) >= 8)
    run.kill()
    run.wait()
    before = len(results(folder / "killed"))
    identify(args, folder, folder / "killed", "--jobs", "2")
    different = sum(serial[n] != results(folder / "killed").get(n) for n in serial)
    what = f"pool: {killed} fits and the run killed after {before} of {len(serial)}: results that differ"
    row("lost", what, different,
        "logs", high=0)

    with cluster(2) as (address, workers):
        run = start_identify(args, folder, folder / "dask", "--scheduler", address)
        wait_for(lambda: len(results(folder / "dask")) >= 5)
        workers[0].kill()
        run.wait()
    different = sum(serial[n] != results(folder / "dask").get(n) for n in serial)
    row("lost", "Dask: one of two workers killed: results that differ from the serial run", different, "logs", high=0)
    same = (folder / "dask/fleet.json").read_bytes() == (folder / "serial/fleet.json").read_bytes()
    row("lost", "Dask: the fleet's result differs from the serial run's", float(not same), "", high=0)


# ---- who is odd, and how sure the fleet is -----------------------------------------------------------


def fitted(args, seed):
    """(result, truth) of the fleet of a seed, through the command."""
    folder = fleet(args, seed)
    note(f"fitting the fleet of seed {seed} (what is fitted is kept)")
    command(args, "identify", folder, "--jobs", str(args.jobs), stdout=subprocess.DEVNULL)
    read = lambda path: json.loads(path.read_text(encoding="utf-8"))
    return read(folder / "fleet_identify/fleet.json"), read(folder / "truth.json")


def odd(args):
    for seed in args.seeds:
        result, truth = fitted(args, seed)
        print(f"\n==== odd: seed {seed}, {len(result['robots'])} robots")
        named, strange = set(result["odd"]), set(truth["odd"])
        by_name = {r["robot"]: r for r in result["robots"]}
        for name, what in truth["odd"].items():
            tails = by_name[name]["tails"]
            print(f"  {name} {what['text']}: {'named' if name in named else 'not named'}, "
                  f"chance {min(tails.values()):.1e} by {min(tails, key=tails.get)}")
        row("odd", f"seed {seed}: odd robots named, of {len(strange)}", len(named & strange), "", low=len(strange))
        row("odd", f"seed {seed}: sound robots named", len(named - strange), "", high=0)


def robots_inside(result, truth):
    """(sound robots x parameters) whether the truth is inside the 90 % interval: within the fleet, and alone."""
    rows = [r for r in result["robots"] if r["robot"] not in truth["odd"]]
    inside = lambda r, key: [v["interval_90"][0] < t < v["interval_90"][1]
                             for v, t in zip(r[key], truth["robots"][r["robot"]])]
    return np.array([inside(r, "parameters") for r in rows]), np.array([inside(r, "alone") for r in rows])


def narrowing(result):
    """Median over the robots of the interval's width over that of their logs alone, by parameter."""
    width = lambda r, key: [v["interval_90"][1] - v["interval_90"][0] for v in r[key]]
    return np.median([np.array(width(r, "parameters")) / np.array(width(r, "alone")) for r in result["robots"]], axis=0)


def coverage(args):
    for seed in args.seeds:
        result, truth = fitted(args, seed)
        print(f"\n==== coverage: seed {seed}")
        within, alone = robots_inside(result, truth)
        for k, name in enumerate(truth["parameters"]):
            row("coverage", f"seed {seed}: {name} of the robots inside 90 %, within the fleet",
                100 * within[:, k].mean(), "%", 87, 93)
            row("coverage", f"seed {seed}: {name} inside 90 % of the logs alone", 100 * alone[:, k].mean(), "%")
            row("coverage", f"seed {seed}: {name}: width within the fleet over alone", narrowing(result)[k], "")
        for k, p in enumerate(result["population"]["parameters"]):
            true_mean, true_sd = truth["population"]["mean"][k], math.sqrt(truth["population"]["covariance"][k][k])
            low, high = p["centre_coordinate_90"]
            what = f"seed {seed}: {p['name']}: truth in the interval of the"
            row("coverage", f"{what} centre", float(low < true_mean < high), "")
            low, high = p["spread"]["interval_90"]
            row("coverage", f"{what} spread", float(low < true_sd < high), "")
    populations(40 if args.quick else 200)


def small_fleet(seed, robots=30):
    """Evidence that is exactly Gaussian, of robots from a known population."""
    rng = np.random.default_rng(seed)
    mean, covariance = np.array([0.2, -0.1]), np.array([[0.01, 0.006], [0.006, 0.04]])
    theta = rng.multivariate_normal(mean, covariance, robots)
    parts = []
    for t in theta:
        root = rng.normal(size=(2, 2)) * 0.08 + 0.05 * np.eye(2)
        noise = root @ root.T + 1e-4 * np.eye(2)
        lam = np.linalg.inv(noise)
        parts.append(Evidence(lam, lam @ rng.multivariate_normal(t, noise)))
    return parts, theta, mean, covariance


def populations(count):
    flat = [Coordinate(name, "", False, 0.0, 0.5, True) for name in "ab"]
    inside = {"robots": [], "centre": [], "spread": []}
    for seed in range(1, count + 1):
        parts, theta, mean, covariance = small_fleet(seed)
        draws = hierarchy.sample(hierarchy.fleet_of(parts, flat), seed)
        sd = np.sqrt(np.diagonal(draws.flat("covariance"), axis1=1, axis2=2))
        for name, values, true in (("robots", draws.flat("theta"), theta), ("centre", draws.flat("mean"), mean),
                                   ("spread", sd, np.sqrt(np.diag(covariance)))):
            low, high = np.quantile(values, [0.05, 0.95], axis=0)
            inside[name].append(np.ravel((low < true) & (true < high)))
    print(f"\n==== coverage: {count} fleets of 30 robots, Gaussian evidence")
    for name, values in inside.items():
        row("coverage", f"{name} inside 90 %", 100 * float(np.mean(values)), "%", 87, 93)


# ---- a peer ----------------------------------------------------------------------------------------


class Reweighted:
    """log p(logs | mu, T) from draws of each robot's posterior, each over its prior (Hogg, Myers and Bovy 2010)."""

    def __init__(self, results_of_robots, medians, deviations):
        self.draws = [np.log(np.array(r["samples"])) for r in results_of_robots]
        z = [(d - np.log(medians)) / deviations for d in self.draws]
        self.log_prior = [-0.5 * (v**2).sum(axis=1) - np.log(deviations).sum() for v in z]

    def __call__(self, mean, sd, correlation):
        total = 0.0
        for draws, prior in zip(self.draws, self.log_prior):
            a, b = ((draws - mean) / sd).T
            rest = 1 - correlation**2
            log = -0.5 * (a * a - 2 * correlation * a * b + b * b) / rest
            log += -np.log(sd).sum() - 0.5 * math.log(rest) - prior
            top = log.max()
            total += top + math.log(np.exp(log - top).mean())
        return total


def random_walk(likelihood, start, steps, seed):
    """Draws of (mean, log sd, atanh correlation): flat in the mean, half-t with 2 degrees in the deviations, uniform in
    the correlation."""
    rng = np.random.default_rng(seed)

    def log_density(v):
        sd, correlation = np.exp(v[2:4]), math.tanh(v[4])
        prior = (v[2:4] - 1.5 * np.log1p((sd / np.array([0.4, 1.0]))**2 / 2)).sum() + math.log(1 - correlation**2)
        return likelihood(v[:2], sd, correlation) + prior

    at, now, kept, step = np.array(start), None, [], np.array([0.006, 0.025, 0.08, 0.09, 0.12])
    now = log_density(at)
    for _ in range(steps):
        to = at + step * rng.standard_normal(5) * rng.choice([0.3, 1.0])
        new = log_density(to)
        if math.log(rng.random() + 1e-300) < new - now:
            at, now = to, new
        kept.append(at)
    return np.array(kept[steps // 5:])


def peer(args):
    folder, count = fleet(args, args.seeds[0]), 25 if args.quick else 100
    _, truth = fitted(args, args.seeds[0])
    names = [n for n in truth["robots"] if n not in truth["odd"]][:count]
    stored = [json.loads((folder / f"fleet_identify/results/{n}.json").read_text()) for n in names]
    result = identify_fleet.analyse([(Job(n, n, pathlib.Path(), ()), s) for n, s in zip(names, stored)], 0.05, 1)
    print(f"\n==== peer: {count} robots of seed {args.seeds[0]}, draws reweighted against Gaussian evidence")
    likelihood = Reweighted([s["result"] for s in stored], np.array([0.5, 0.03]), np.array([0.4, 1.0]))
    note("peer: random walk")
    draws = random_walk(likelihood, [math.log(0.5), math.log(0.03), math.log(0.06), math.log(0.2), 0.3],
                        600 if args.quick else 6000, 1)
    for k, p in enumerate(result["population"]["parameters"]):
        for what, ours, theirs in (("centre", np.mean(p["centre_coordinate_90"]), draws[:, k]),
                                   ("spread", p["spread"]["median"], np.exp(draws[:, 2 + k]))):
            off = abs(ours - np.median(theirs)) / theirs.std()
            row("peer", f"{p['name']}: {what} off the peer's, in the peer's deviations", float(off), "sd", high=0.5)


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("section", nargs="?", choices=SECTIONS)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--block", type=int, help="logs of a round of scaling")
    parser.add_argument("--rounds", type=int, help="of scaling")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--tiller", type=pathlib.Path, default=ROOT / "build/release/tools/tiller")
    args = parser.parse_args([a for a in arguments if a != "--"])
    if args.quick:
        args.robots = min(args.robots, 60)
    return args


def main():
    args = parse(sys.argv[1:])
    FOLDER.mkdir(parents=True, exist_ok=True)
    if not args.tiller.exists():
        sys.exit(f"{args.tiller}: not built; ./dev build tools/tiller")
    if not need_environment("dask"):
        return 1
    for section in [args.section] if args.section else SECTIONS:
        globals()[section](args)
        (FOLDER / f"rows_{section}.json").write_text(json.dumps([r for r in ROWS if r["section"] == section], indent=1))
    summary(ROWS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
