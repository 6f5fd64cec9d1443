# programs: bench_posterior bench_residual bench_accuracy bench_misspecified bench_methods bench_episodes bench_table1
# bench_posterior_peers
"""./dev bench posterior: whether the posterior can be trusted, what it costs, and its peers, in one table.

    ./dev bench posterior                          every section but the long peer
    ./dev bench posterior accuracy --runs 100      one section; what follows goes to its program
    ./dev bench posterior peers --peers numpy,emcee
    ./dev bench posterior --quick                  a fixed small part, two minutes, nothing from the network

Sections:
    cost           updates of the engines, time and memory (bench_posterior)
    residual       one-step residuals in lanes (bench_residual)
    accuracy       online posteriors beside exact ones, calibration, short runs, encoders only (bench_accuracy)
    table1         the rows of Online BayesSim's Table I, contact among them: online, batch, rejection ABC; a line of
                   build/table1.csv for each seed, so that a run that was cut goes on (bench_table1)
    misspecified   friction, delay, drift, outliers that the model lacks; adequacy (bench_misspecified)
    methods        REPS, SimOpt, rejection ABC on the same episodes (bench_methods)
    episodes       closed loop over episodes (bench_episodes)
    peers          numpy, particles, emcee (bench_posterior_peers and bench/peers), and sbi if named

    --peers LIST   of numpy, particles, emcee, sbi; sbi alone takes half an hour of CPU time and 6 GB for torch
    --rounds N     rounds in which tiller and its peers take turns (7)
    --tests N      episodes that sbi is judged on (50)
    --build DIR    the CMake build folder (build/release)

Every row with a goal stands in the summary at the end, short or not. A short row is no error; a program that fails is.
"""

import argparse
import json
import pathlib
import sys

import _posterior_peers as peers
from _driver import HOME, ROOT, note, rows_of, run_table, summary  # noqa: F401

PROGRAMS = {name: f"bench_{name}" for name in ("residual", "accuracy", "table1", "misspecified", "methods",
                                               "episodes")}
PROGRAMS["cost"] = "bench_posterior"
SECTIONS = ["cost", "residual", "accuracy", "table1", "misspecified", "methods", "episodes", "peers"]
TITLES = {"cost": "what an update costs", "residual": "one-step residuals", "accuracy": "against exact posteriors",
          "table1": "the rows of Table I", "misspecified": "where the model is wrong", "methods": "likelihood-free methods",
          "episodes": "closed loop over episodes"}
# What --quick asks for; a section that is not here is left out of it.
QUICK = {"accuracy": ["--runs", "20", "--short", "300"], "residual": []}


def run_program(section, build, arguments):
    print(f"\n==== {TITLES[section]}: {PROGRAMS[section]} {' '.join(arguments)}", flush=True)
    return run_table(section, build / "bench" / PROGRAMS[section], arguments)


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--peers", default="")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--tests", type=int, default=50)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args, rest = parser.parse_known_args([a for a in arguments if a != "--"])
    # values of a program's own options look like sections: --runs 100
    named = [s for s in args.sections if s in SECTIONS]
    args.rest = arguments[arguments.index(named[0]) + 1:] if len(named) == 1 and (rest or len(args.sections) > 1) else []
    if rest and not args.rest:
        parser.error(f"'{' '.join(rest)}' goes to a program: name its section first, and only that one")
    if len(named) != len(args.sections) and not args.rest:
        parser.error(f"no section '{next(s for s in args.sections if s not in SECTIONS)}'; there are: {' '.join(SECTIONS)}")
    if named == ["peers"]:
        args.rest = []
    args.wanted = [p for p in args.peers.split(",") if p]
    if unknown := [p for p in args.wanted if p not in peers.NAMES]:
        parser.error(f"no peer '{unknown[0]}'; there are: {' '.join(peers.NAMES)}")
    args.sections = named or (["peers"] if args.wanted else list(QUICK) if args.quick else SECTIONS)
    return args


def main():
    args = parse(sys.argv[1:])
    HOME.mkdir(parents=True, exist_ok=True)
    rows, good = [], True
    for section in args.sections:
        if section == "peers":
            print("\n==== peers: in turns on one core, CPU time", flush=True)
            rows += peers.run(args.wanted or peers.DEFAULT, args.build, args.rounds, args.tests)
            continue
        arguments = args.rest or (QUICK.get(section, []) if args.quick else [])
        found, ended = run_program(section, args.build, arguments)
        rows += found
        good = good and ended
    summary(rows)
    (HOME / "posterior.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    note(f"rows: {HOME / 'posterior.json'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
