# programs: bench_network_step bench_learned_worlds
"""./dev bench learned: what is learnt rather than derived: forces, policies, costs, posteriors of black boxes.

    ./dev bench learned                          every section that this build has
    ./dev bench learned policies --seeds 5       one section; what follows goes to its program
    ./dev bench learned --quick                  a fixed small part

Sections:
    step        what a network costs in a rollout (bench_network_step)
    dynamics    learned forces on data in which something without a name is hidden (dynamics_rows.py, on JAX)
    policies    policy search with moment matching: the paper's pendulum and cart-pole (policies_rows.py, on JAX)
    local       local linear models with a prior, against none; guided policies (local_rows.py, on JAX)
    distill     small policies beside the planners that taught them (distill_rows.py, on JAX)
    imitate     costs from demonstrations (imitate_rows.py, on JAX)
    simulator   posteriors of black-box simulators beside exact ones (labs_rows.py, on JAX)

Only by name, since it installs torch:
    dynamics-peers   the data of `dynamics`, learnt by PETS' ensemble (mbrl-lib) and by GPyTorch

    --build DIR    the CMake build folder (build/release)

A program keeps a line for each seed in build/<program>.csv, so that a run that was cut goes on. Every row with a goal
stands in the summary at the end, short or not. A short row is no error; a program that fails is.
"""

import argparse
import csv
import json
import os
import pathlib
import statistics
import subprocess
import sys

from _driver import HOME, ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, run_table, summary

PROGRAMS = {"step": "bench_network_step"}
SCRIPTS = {"dynamics": "dynamics_rows.py", "policies": "policies_rows.py", "local": "local_rows.py",
           "distill": "distill_rows.py", "imitate": "imitate_rows.py", "simulator": "labs_rows.py"}


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("section", nargs="?", choices=[*PROGRAMS, *SCRIPTS, "dynamics-peers"])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args, rest = parser.parse_known_args([a for a in arguments if a != "--"])
    if rest and not args.section:
        parser.error(f"'{' '.join(rest)}' goes to a program: name its section first")
    args.rest = rest + (["--quick"] if args.quick else [])
    return args


def dynamics_peers(args):
    """The worlds of `dynamics`, learnt by others; a row each in build/dynamics_peers.csv."""
    worlds, rows = ROOT / "build/learned_worlds", ROOT / "build/dynamics_peers.csv"
    if script(args, "dynamics") or not need_environment("dynamics"):
        return 1
    # mbrl-lib pins a hydra that Python 3.11 refuses; its networks run on a later one.
    subprocess.run([python_of("dynamics"), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps",
                    "hydra-core==1.3.2", "omegaconf==2.3.0"], check=False)
    done = subprocess.run([python_of("dynamics"), PEERS / "dynamics_peer.py", worlds, rows],
                          env=dict(os.environ, **ONE_THREAD), check=False)
    with open(rows, encoding="utf-8") as file:
        found = list(csv.reader(file))
    for name in dict.fromkeys(row[1] for row in found):
        own = [row for row in found if row[1] == name]
        ratio, covered, seconds = (statistics.median(float(row[i]) for row in own) for i in (4, 5, 6))
        print(f"  {name:12s} {len(own):3d} cases: rollouts of 1 s, over the model without anything learnt: median "
              f"{ratio:.3g}; 90 % hold {covered:.2f}; {seconds:.0f} s of CPU each")
    return done.returncode


def script(args, section):
    """A laboratory's bench in Python: `./dev setup` installs what it needs. It keeps a line for each seed."""
    path = ROOT / "bench/learned" / SCRIPTS[section]
    paths = os.pathsep.join(filter(None, (str(args.build / "python_package"), os.environ.get("PYTHONPATH"))))
    print(f"\n==== {section}: {path.name} {' '.join(args.rest)}", flush=True)
    return subprocess.run([sys.executable, path, *args.rest], cwd=ROOT,
                          env=dict(os.environ, PYTHONPATH=paths, **ONE_THREAD), check=False).returncode


def main():
    args = parse(sys.argv[1:])
    HOME.mkdir(parents=True, exist_ok=True)
    if args.section == "dynamics-peers":
        return dynamics_peers(args)
    if args.section in SCRIPTS:
        return script(args, args.section)
    rows, good = [], True
    for section in [args.section] if args.section else PROGRAMS:
        program = args.build / "bench" / PROGRAMS[section]
        print(f"\n==== {section}: {program.name} {' '.join(args.rest)}", flush=True)
        found, ended = run_table(section, program, args.rest)
        rows += found
        good = good and ended
    summary(rows)
    (HOME / "learned.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    note(f"rows: {HOME / 'learned.json'}")
    if not args.section:
        good = all([script(args, section) == 0 for section in SCRIPTS]) and good
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
