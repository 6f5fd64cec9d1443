# programs: bench_package
"""./dev bench package: the wheel of the Python package, in empty environments.

    --no-peers     without mujoco.rollout and JAX
    --no-tests     without pytest on every CPython
    --ticks N      compared bit by bit with the C interface (10000)

From `pip install` of the built wheel to the first closed loop; size; time of an import; what a tick costs more than one
through the C interface, and whether the commands have the same bits; views; batched rollouts beside the kernel alone
and beside mujoco.rollout and JAX; mypy --strict; the package's tests on every CPython that is here.
"""
import argparse
import json
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from _driver import CORE, PEERS, ROOT, lines_of, need_environment, note, python_of, summary

WHEELS, PROGRAM = ROOT / "build/wheels", ROOT / "build/release/bench/bench_package"
VERSIONS = ["3.11", "3.12", "3.13"]
LANES, STEPS = 4096, 50
PAIRS = 21  # of runs in turns: a processor's clock wanders by half, which is more than what is sought
LOOP = """
import time; begin = time.time()
import tiller
robot = tiller.Robot.from_toml("pendulum")
controller, plant = tiller.Controller(robot), tiller.Plant(robot)
controller.arm()
for m in tiller.lockstep(plant, seconds=4):
    plant.step(controller.tick(m.t, m))
assert abs(plant.true_state[0] - 3.14159) < 0.2, plant.true_state
"""
IMPORT = """
import time; wall, used = time.perf_counter(), time.process_time()
import tiller
print(time.perf_counter() - wall, time.process_time() - used)
"""
TICKS = """
import sys, time, statistics, tiller
robot = tiller.Robot.from_toml(sys.argv[1])
controller = tiller.Controller(robot); controller.arm()
lines = [l.split(";") for l in sys.stdin if l.strip()]
import numpy as np
given = [(int(m.split()[0]) * 1e-6, np.array([float.fromhex(v) for v in m.split()[1:]])) for m, _ in lines]
wanted = [[float.fromhex(v) for v in u.split()] for _, u in lines]
clock, tick, ns, got = time.perf_counter_ns, controller.tick, [], []
for t, y in given:
    begin = clock(); command = tick(t, y); ns.append(clock() - begin)
    got.append(command.value.tolist())
empty = []
for _ in range(1000):
    begin = clock(); empty.append(clock() - begin)
print(statistics.median(ns) - statistics.median(empty), sum(g != w for g, w in zip(got, wanted)), len(got),
      sum(any(w) for w in wanted))
"""
VIEWS = """
import gc, numpy as np, tiller
robot = tiller.Robot.from_toml("pendulum")
controller, plant = tiller.Controller(robot), tiller.Plant(robot); controller.arm()
take = lambda c: [c.posterior.particles, c.posterior.weights, c.posterior.mean, c.posterior.sd, c.plan,
                  c.info.state_mean, c.info.param_sd]
for m in tiller.lockstep(plant, 0.4): plant.step(controller.tick(m.t, m))
first = take(controller); before = [v.copy() for v in first]
for m in tiller.lockstep(plant, 0.4): plant.step(controller.tick(m.t, m))
again = take(controller)
same = [np.shares_memory(a, b) for a, b in zip(first, again)]
moved = [not np.array_equal(a, b) for a, b in zip(first, before)]
free = [not v.flags.owndata and not v.flags.writeable for v in first]
print(sum(not (a and b and c) for a, b, c in zip(same, moved, free)))
"""
ROLLOUT = """
import sys, time, numpy as np, tiller
lanes, steps, threads = map(int, sys.argv[2:5])
robot = tiller.Robot.from_toml(sys.argv[1])
x0, out = np.full((lanes, 4), 0.1), np.empty((lanes, steps + 1, 4))
U = 0.01 * (np.arange(lanes * steps) % 97).reshape(lanes, steps, 1) - 0.5
best = 1e300
for _ in range(10):
    begin = time.perf_counter_ns(); tiller.rollout(robot, x0, U, out=out, threads=threads)
    best = min(best, time.perf_counter_ns() - begin)
print(best / (lanes * steps))
"""
# a tick that is over soon, so that what the binding adds shows
QUICK = {"horizon = 50": "horizon = 4", "knots = 10": "knots = 2", "rollouts = 256": "rollouts = 16",
         "particles = 8": "particles = 1", "iterations = 3": "iterations = 1",
         'kind = "cem"': 'kind = "random_shooting"'}


def say(text, **how):
    return subprocess.run([str(t) for t in text], capture_output=True, text=True, check=True, **how).stdout


def pinned():
    os.sched_setaffinity(0, {CORE})


def row(rows, heading, what, figure, unit, goal=None):
    met = None if goal is None else figure <= goal
    text = "" if goal is None else f"goal <= {goal:<6g} {'met' if met else 'short'}"
    print(f"  {what:<68} {figure:10.4g} {unit:<6} {text}", flush=True)
    if goal is not None:
        rows.append({"section": "package", "heading": heading, "row": what, "figure": figure, "unit": unit,
                     "goal": f"<= {goal:g}", "met": met})


def interpreter(version):
    pyenv = pathlib.Path.home() / ".pyenv/versions"
    here = [shutil.which(f"python{version}"), *map(str, pyenv.glob(f"{version}.*/bin/python"))]
    for python in filter(None, here):
        # A version manager's shim is there for versions that it does not run.
        asked = subprocess.run([python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
                               capture_output=True, text=True, check=False)
        if asked.returncode == 0 and asked.stdout.strip() == version:
            return python
    return None


def wheel_of(version):
    tag = "cp311-cp311" if version == "3.11" else "cp312-abi3"
    return next(iter(sorted(WHEELS.glob(f"tiller-*-{tag}-*{os.uname().machine}.whl"))), None)


def processor_s():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def empty_environment(folder, version):
    """(python of a new environment with the wheel in it, seconds that the installation took)."""
    say([interpreter(version), "-m", "venv", folder])
    begin = time.monotonic()
    say([folder / "bin/python", "-m", "pip", "install", "--no-cache-dir", "--disable-pip-version-check", "-q",
         wheel_of(version)])
    return folder / "bin/python", time.monotonic() - begin


def clean(python):
    """An environment without anything that would lead to the source tree or its build."""
    home = python.parent.parent
    return {"env": {"PATH": f"{python.parent}:/usr/bin:/bin", "HOME": str(home)}, "cwd": home}


def measure_installation(rows, python, install_s):
    heading = "from an empty environment"
    print(heading)
    begin, used = time.monotonic(), processor_s()
    say([python, "-c", LOOP], **clean(python))
    row(rows, heading, "processor time of the loop of 4 s", processor_s() - used, "s")
    row(rows, heading, "pip install of the wheel and its one dependency", install_s, "s")
    row(rows, heading, "pip install to the end of the first closed loop", install_s + time.monotonic() - begin, "s", 60)
    for wheel in sorted(WHEELS.glob("*.whl")):
        row(rows, heading, f"size of {wheel.name}", wheel.stat().st_size / 1e6, "MB", 12)
    times = [[float(t) for t in say([python, "-c", IMPORT], **clean(python)).split()] for _ in range(11)]
    wall, used = (1e3 * statistics.median(column) for column in zip(*times))
    row(rows, heading, "import tiller, median of 11 processes", wall, "ms", 150)
    row(rows, heading, "import tiller, processor time", used, "ms")


def measure_ticks(rows, python, ticks, folder):
    heading = "a tick beside the C interface's"
    print(heading)
    quick = folder / "quick.toml"
    text = (ROOT / "robots/pendulum.toml").read_text(encoding="utf-8")
    for old, new in QUICK.items():
        assert old in text
        text = text.replace(old, new)
    quick.write_text(text + "\n[posterior]\nparticles = 16\nwindow = 16\nmoves_per_tick = 0\n", encoding="utf-8")
    more, base = [], []
    for _ in range(PAIRS):
        c_ns = json.loads(say([PROGRAM, "ticks", quick, 4000], preexec_fn=pinned))["tick_ns"]
        lines = say([PROGRAM, "commands", quick, 4000])
        python_ns = float(say([python, "-c", TICKS, quick], input=lines, preexec_fn=pinned, **clean(python)).split()[0])
        more.append((python_ns - c_ns) / 1e3)
        base.append(c_ns / 1e3)
    row(rows, heading, "a quick tick through the C interface, median", statistics.median(base), "us")
    low, middle, high = statistics.quantiles(more)
    row(rows, heading, f"what Controller.tick takes beyond it, median of {PAIRS} pairs", middle, "us", 2)
    print(f"    quartiles {low:.2f} and {high:.2f} us")
    for robot in ("pendulum", "cart_pole", "furuta"):
        path = ROOT / f"robots/{robot}.toml"
        many = ticks if robot == "pendulum" else max(100, ticks // 20)
        lines = say([PROGRAM, "commands", path, many])
        _, wrong, compared, moving = say([python, "-c", TICKS, path], input=lines, **clean(python)).split()
        assert int(compared) == many and int(moving) > many // 2, (compared, moving)
        row(rows, heading, f"commands of {robot} with other bits, of {compared} ticks", float(wrong), "", 0)
    row(rows, heading, "views that are copies, of 7", float(say([python, "-c", VIEWS], **clean(python))), "", 0)


def measure_rollouts(rows, python, peers):
    heading = f"rollouts of a cart-pole, {LANES} lanes x {STEPS} steps, double precision"
    print(heading)
    path, sizes = ROOT / "robots/cart_pole.toml", [str(LANES), str(STEPS)]
    kernel, package = [], []
    for _ in range(PAIRS):
        kernel.append(json.loads(say([PROGRAM, "rollout", path, *sizes], preexec_fn=pinned))["kernel_ns"])
        package.append(float(say([python, "-c", ROLLOUT, path, *sizes, 1], preexec_fn=pinned, **clean(python))))
    low, middle, high = statistics.quantiles([p / k for p, k in zip(package, kernel)])
    row(rows, heading, "the kernel alone, one thread, median", statistics.median(kernel), "ns")
    row(rows, heading, "tiller.rollout, one thread, median", statistics.median(package), "ns")
    row(rows, heading, f"tiller.rollout over the kernel, median of {PAIRS} pairs", middle, "", 1.2)
    print(f"    quartiles {low:.3f} and {high:.3f}; fastest {min(package):.1f} over {min(kernel):.1f} ns")
    threads = len(os.sched_getaffinity(0))
    row(rows, heading, f"tiller.rollout, {threads} threads",
        float(say([python, "-c", ROLLOUT, path, *sizes, threads], **clean(python))), "ns")
    if not peers or not need_environment("rollout"):
        return
    for name in ("mujoco", "jax"):
        found = lines_of([python_of("rollout"), PEERS / "rollout_peer.py", name, *sizes])
        if found:
            row(rows, heading, f"{name}, one processor", found[0]["ns"], "ns")
            print(f"    {found[0]['ns'] / statistics.median(package):.1f} times tiller.rollout's time")
        else:
            note(f"{name} did not run")


def run_tests(rows, folder):
    heading = "tests on every CPython"
    print(heading)
    for version in VERSIONS:
        if interpreter(version) is None or wheel_of(version) is None:
            print(f"  not tested: no CPython {version} here, or no wheel for it")
            continue
        python, _ = empty_environment(folder / version, version)
        say([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "pytest", "gymnasium", "mypy",
             "pandas", "matplotlib"])
        where = dict(os.environ, TILLER_C_LOOP=str(PROGRAM), PATH=f"{python.parent}:{os.environ['PATH']}")
        done = subprocess.run([str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", str(ROOT / "tests/python")],
                              capture_output=True, text=True, check=False, cwd=folder, env=where)
        said = (done.stdout.strip().splitlines() or ["nothing"])[-1]
        print(f"  {version}: {said}")
        if done.returncode != 0:
            print(done.stdout[-3000:])
        row(rows, heading, f"pytest on CPython {version}, exit code", float(done.returncode), "", 0)
        if version == "3.12":
            typed = subprocess.run([str(python), "-m", "mypy", "--strict", "--config-file", "pyproject.toml"], cwd=ROOT,
                                   capture_output=True, text=True, check=False)
            row(rows, heading, "mypy --strict on package, stubs, examples, exit code", float(typed.returncode), "", 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--no-tests", action="store_true")
    parser.add_argument("--ticks", type=int, default=10000)
    options = parser.parse_args()
    if wheel_of("3.12") is None:
        note("no wheel in build/wheels: ./dev wheel")
        subprocess.run([str(ROOT / "dev"), "wheel"], check=False)
    version = next((v for v in ("3.12", "3.13", "3.11") if interpreter(v) and wheel_of(v)), None)
    if version is None:
        sys.exit("package: no wheel was built; ./dev wheel says why")
    rows = []
    with tempfile.TemporaryDirectory(prefix="tiller-package-") as scratch:
        folder = pathlib.Path(scratch)
        python, install_s = empty_environment(folder / "clean", version)
        measure_installation(rows, python, install_s)
        measure_ticks(rows, python, options.ticks, folder)
        measure_rollouts(rows, python, not options.no_peers)
        if not options.no_tests:
            run_tests(rows, folder)
    summary(rows)


if __name__ == "__main__":
    main()
