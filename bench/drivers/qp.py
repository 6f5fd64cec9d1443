# programs: bench_qp bench_qp_sizes
"""./dev bench qp: quadratic programs of model predictive control, against the solvers that install.

    --rounds N      rounds in which all take turns (9)
    --sizes A,B     of 4/1, 12/4, 24/8, 36/12 (states/inputs) and hover; all of them otherwise
    --horizons A,B  of 10, 30, 100
    --cases A,B     of the four below
    --only-sizes    without bench_qp's table
    --fresh         measure anew; otherwise rows of this build that an earlier run left are kept
    --build DIR     the CMake build folder (build/release)

First bench_qp, the table of the hover QP; then random linear systems of a fixed seed
(bench/planning/bench_qp_sizes.cpp) and the hover QP of ./dev bench planning: inputs within bounds, half of the states
within theirs (hover: all). Four cases each:

    cold        all of it anew: matrices, factors, condensing, and no start
    warm        closed loops with small pushes: of the program before, the start alone changes
    changing    starts across from one another, many bounds active, others each time
    infeasible  hard bounds that no inputs keep: until that is said

Every solver runs through its C or C++ interface, to 1e-8 by its own measure. A solver whose first inputs are off by
more than 1e-5, or that leaves a program unsolved, counts for nothing in the headline, which is the best of the others.
All take turns on one core; CPU time is read; a figure is the lower quartile of the rounds, the ratio that of the two.
"""

import argparse
import json
import pathlib
import subprocess

from _driver import (HOME, ROOT, PEERS, Participant, compile_peer, kept_rows, need_environment, note, python_of,
                     site_packages, spread, take_turns)

SIZES = {"4/1": (4, 1), "12/4": (12, 4), "24/8": (24, 8), "36/12": (36, 12)}
HORIZONS = (10, 30, 100)
CASES = ("cold", "warm", "changing", "infeasible")
DAQP = "daqp-0.11.0"
WITHIN = 1e-5


def daqp_objects():
    """DAQP's C source, compiled as its wheel is, but for this processor."""
    folder = HOME / DAQP / "csrc"
    archive = HOME / f"{DAQP}.tar.gz"
    if not archive.exists():
        subprocess.run([str(python_of("qp_c")), "-m", "pip", "download", "-q", "--disable-pip-version-check",
                        "--no-deps", "--no-binary", "daqp", DAQP.replace("-", "=="), "-d", str(HOME)], check=True)
    if not folder.exists():
        subprocess.run(["tar", "xzf", str(archive), "-C", str(HOME)], check=True)
    objects = []
    for source in sorted(folder.glob("src/*.c")):
        objects.append(HOME / DAQP / f"{source.stem}.o")
        if not objects[-1].exists():
            subprocess.run(["cc", "-O3", "-march=native", "-fassociative-math", "-fno-signed-zeros",
                            "-fno-trapping-math", f"-I{folder}/include", "-c", str(source), "-o", str(objects[-1])],
                           check=True)
    return folder / "include", objects


def peers_program():
    if not need_environment("casadi") or not need_environment("qp_c", "--no-deps"):
        return None
    casadi, acados = site_packages("casadi") / "casadi", site_packages("qp_c") / "acados/install"
    cmeel = site_packages("qp_c") / "cmeel.prefix"
    try:
        daqp, objects = daqp_objects()
    except (OSError, subprocess.CalledProcessError):
        note("DAQP's source does not come or compile here")
        return None
    system = [acados / "include/hpipm/include", acados / "include/blasfeo/include", casadi / "include/eigen3",
              cmeel / "include", casadi / "include", casadi / "include/osqp"]
    libraries = [acados / "lib/libhpipm.so", acados / "lib/libblasfeo.so", casadi / "libosqp.so",
                 cmeel / "lib/libqpOASES.so"]
    flags = ["-march=native", "-DPIQP_HAS_BLASFEO", f"-I{daqp}"]
    for folder in system:
        flags += ["-isystem", str(folder)]
    return compile_peer("qp_sizes_peer", objects, [
        *flags, *map(str, libraries), f"-Wl,--disable-new-dtags,-rpath,{acados}/lib:{casadi}:{cmeel}/lib"])


# ---- programs to solve -----------------------------------------------------------------------------


def random_file(build, size, horizon):
    states, inputs = SIZES[size]
    path = HOME / f"mpc_{states}_{inputs}_{horizon}.txt"
    source = ROOT / "bench/planning/bench_qp_sizes.cpp"
    if not path.exists() or path.stat().st_mtime < source.stat().st_mtime:
        subprocess.run([str(build / "bench/bench_qp_sizes"), "write", str(states), str(inputs), str(horizon),
                        str(path)], check=True)
    return path


def hover_file():
    """The hover QP of hover_problem.py as such a file; None where its environment does not install."""
    hover, path = HOME / "hover.txt", HOME / "mpc_hover.txt"
    if not hover.exists():
        if not need_environment("main"):
            return None
        subprocess.run([str(python_of("main")), str(PEERS / "hover_problem.py"), str(hover)], check=True)
    head, *arrays, states, first = hover.read_text(encoding="ascii").splitlines()
    horizon, u_max, x_max, count = head.split()[:4]
    cases = [line for name in ("cold", "warm") for line in (f"{name} {count}", states, first)]
    path.write_text("\n".join([f"12 4 {horizon} {u_max}", *arrays, " ".join([x_max] * 12), *cases]) + "\n",
                    encoding="ascii")
    return path


# ---- rows ------------------------------------------------------------------------------------------


def measure(build, peers, file, case, rounds):
    programs = [[build / "bench/bench_qp_sizes", file, case]] + ([[peers, file, case]] if peers else [])
    facts, times = take_turns([Participant(p) for p in programs], rounds)
    return {"facts": facts, "times": times}


def counts(facts):
    return facts["unsolved"] == 0 and facts["error"] <= WITHIN


def show(row):
    """Prints it; True: met, False: short, None: nothing to compare with."""
    low = {name: spread(times)[0] * 1e6 for name, times in row["times"].items()}
    able = sorted((name for name in low if name != "tiller" and counts(row["facts"][name])), key=low.get)
    ours = row["facts"]["tiller"]
    upper = spread(row["times"]["tiller"])[1] * 1e6
    met = counts(ours) and (not able or low["tiller"] <= low[able[0]])
    best = "no peer solves them"
    if able:
        best = f"{able[0]} {low[able[0]]:.4g} us, {low[able[0]] / low['tiller']:.3g} x ours"
    print(f"  {row['size']:>6} N={row['horizon']:<4} {row['case']:<11} {low['tiller']:9.4g} us [to {upper:.4g}]  "
          f"{'met  ' if met else 'short'}  best peer: {best}")
    for name in low:
        if name == "tiller":
            continue
        f = row["facts"][name]
        said = "" if counts(f) else f"  ({f['unsolved']} of {f['of']} unsolved, u0 off by {f['error']:.1e})"
        print(f"           {name:<15} {low[name]:10.4g} us{said}")
    print(f"           residual {ours['residual']:.1e}, {ours['iterations']:g} steps, {ours['unsolved']} unsolved",
          flush=True)
    return met if able else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--sizes", default=",".join(["hover", *SIZES]))
    parser.add_argument("--horizons", default=",".join(map(str, HORIZONS)))
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--only-sizes", action="store_true")
    parser.add_argument("--fresh", action="store_true")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    HOME.mkdir(parents=True, exist_ok=True)
    if not args.only_sizes:
        subprocess.run([str(args.build / "bench/bench_qp")], check=True)
    peers = peers_program()
    kept, stamp = HOME / "qp.jsonl", (args.build / "bench/bench_qp_sizes").stat().st_mtime
    key = lambda r: (r["size"], r["horizon"], r["case"])
    rows = {} if args.fresh else {k: r for k, r in kept_rows(kept, key).items() if r["build"] == stamp}
    kept.write_text("".join(json.dumps(r) + "\n" for r in rows.values()), encoding="utf-8")
    wanted = [(size, int(horizon), case) for size in args.sizes.split(",")
              for horizon in (args.horizons.split(",") if size != "hover" else [10])
              for case in (CASES if size != "hover" else CASES[:2]) if case in args.cases.split(",")]
    print(f"\nMPC programs, one core, CPU time a program, lower quartiles of {args.rounds} rounds by turns")
    verdicts = []
    for size, horizon, case in wanted:
        row = rows.get((size, horizon, case))
        if row is None:
            file = hover_file() if size == "hover" else random_file(args.build, size, horizon)
            if file is None:
                print(f"  {size:>6} not measured: its environment does not install here")
                continue
            note(f"{size}, N = {horizon}, {case}")
            row = {"size": size, "horizon": horizon, "case": case, "build": stamp,
                   **measure(args.build, peers, file, case, args.rounds)}
            with open(kept, "a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")
        verdicts.append(show(row))
    print(f"\n{verdicts.count(True)} rows met, {verdicts.count(False)} short, against the best peer of each row; "
          f"{verdicts.count(None)} without a peer")


if __name__ == "__main__":
    main()
