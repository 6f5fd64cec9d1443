# programs: bench_peers bench_planners bench_rollout bench_pareto
"""./dev bench planning: tiller's planners against their peers, in one run on one core.

    --rounds N     rounds in which all take turns (15)
    --torch        also pytorch_mppi; its environment takes some three gigabytes
    --only PART    peers, planners, rollout or pareto; may be given more than once
    --plot FILE    where the closed-loop plot goes (build/bench_peers/pareto.png)
    --build DIR    the CMake build folder (build/release)

The peers live in environments of their own (build/bench_peers, from bench/peers/requirements_*.txt), made at the
first run. What cannot be installed or built leaves a row that says so. Each solver must first reach the known optimum
(cost within 1e-3; the QPs' first inputs within 1e-4); then all of them take turns for some rounds, pinned to one core,
and CPU time is read: figures are medians over the rounds, ratios medians of the rounds' ratios.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess

from _driver import (HOME, PEERS, ROOT, Participant, compile_peer, lines_of, need_environment, note, python_of,
                     site_packages, spread, take_turns)

# ---- programs of the peers -------------------------------------------------------------------------


def crocoddyl_program():
    if not need_environment("main"):
        return None
    prefix = site_packages("main") / "cmeel.prefix"
    eigen = next((p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if os.path.isdir(p)), "/usr/include")
    return compile_peer("crocoddyl_peer", [], [
        "-isystem", str(prefix / "include"), "-isystem", eigen, f"-L{prefix}/lib", "-lcrocoddyl", "-lmim_solvers",
        f"-Wl,--disable-new-dtags,-rpath,{prefix}/lib"])


def tinympc_program():
    if not need_environment("tinympc"):
        return None
    code = site_packages("tinympc") / "tinympc/codegen/codegen_src"
    sources = [code / "tinympc" / f for f in ("admm.cpp", "tiny_api.cpp", "rho_benchmark.cpp")]
    return compile_peer("tinympc_peer", sources, ["-march=native", f"-I{code}/include", f"-I{code}/include/Eigen",
                                                  f"-I{code}"])


def participants(build, torch):
    hover = HOME / "hover.txt"
    programs = []
    have_main = need_environment("main")
    if have_main:
        subprocess.run([str(python_of("main")), str(PEERS / "hover_problem.py"), str(hover)], check=True)
    if hover.exists():
        programs.append([build / "bench/bench_peers", hover])
    if (program := crocoddyl_program()) is not None:
        programs.append([program])
    if hover.exists() and (program := tinympc_program()) is not None:
        programs.append([program, hover])
    if have_main:
        programs.append([python_of("main"), PEERS / "osqp_peer.py", hover])
        programs.append([python_of("main"), PEERS / "mujoco_peer.py"])
    if need_environment("casadi"):
        programs.append([python_of("casadi"), PEERS / "casadi_peer.py"])
    if hover.exists() and need_environment("qp"):
        programs.append([python_of("qp"), PEERS / "qp_peers.py", hover])
    if torch and need_environment("torch"):
        programs.append([python_of("torch"), PEERS / "mppi_peer.py"])
    return [Participant(p) for p in programs]


# ---- the table -------------------------------------------------------------------------------------

# title, ours (the quickest that passes its check counts), peers, unit, goal for ours in that unit
ROWS = [
    ("iLQR, N=50, free: one iteration", ["tiller ilqr single free/iteration", "tiller ilqr multiple free/iteration"],
     ["crocoddyl DDP free/iteration", "crocoddyl FDDP free/iteration", "mim_solvers SQP free/iteration",
      "FATROP free/iteration"], "us", 5.0),
    ("iLQR, N=50, free: to the optimum", ["tiller ilqr single free", "tiller ilqr multiple free"],
     ["crocoddyl DDP free", "crocoddyl FDDP free", "mim_solvers SQP free", "FATROP free", "ALPAQA free"], "us",
     120.0),
    ("iLQR, N=50, |u| <= 20: to the optimum", ["tiller ilqr single box", "tiller ilqr multiple box"],
     ["crocoddyl BoxDDP box", "crocoddyl BoxFDDP box", "mim_solvers CSQP box", "FATROP box", "ALPAQA box"], "us",
     220.0),
    ("SQP, N=50, free: to the optimum", ["tiller sqp free"], ["mim_solvers SQP free", "FATROP free"], "us", None),
    ("SQP, N=50, |u| <= 20: to the optimum", ["tiller sqp box"], ["crocoddyl BoxFDDP box", "mim_solvers CSQP box",
                                                                 "FATROP box"], "us", None),
    ("MPPI, K=1536, N=50, fresh noise: one iteration", ["tiller mppi"], ["pytorch_mppi"], "us", 90.0),
    ("rollout step, f32 batch", ["tiller rollout"], ["MuJoCo rollout"], "ns", None),
    ("hover QP 12/4/10, first input to 1e-4", ["tiller qp riccati hover"],
     ["OSQP hover", "TinyMPC hover", "TinyMPC hover, 1e-3", "PIQP hover", "ProxQP hover", "Clarabel hover",
      "DAQP hover"], "us", 1.5),
    ("hover QP by OSQP inside tiller", ["tiller qp osqp hover"], ["OSQP hover"], "us", None),
]
SCALE = {"us": 1e6, "ns": 1e9}
NOT_HERE = {"pytorch_mppi": "needs --torch"}


def passed(facts):
    """Whether it reached what it should; peers' own limits are theirs."""
    if "optimum" in facts:
        return abs(facts["figure"] - facts["optimum"]) <= 1.001e-3 * facts["optimum"]
    if "of" in facts:
        return facts["unsolved"] == 0 and facts["error"] <= 1e-4
    return facts.get("error", 0.0) <= 1e-2


def reached(facts):
    """What a solver came to, in words."""
    if "optimum" in facts:
        return f"cost {facts['figure']:.4f} of {facts['optimum']} in {facts['iterations']} its"
    if "of" in facts:
        return f"u0 off by {facts['error']:.1e}, {facts['unsolved']} of {facts['of']} unsolved"
    return ", ".join(f"{k} {v:.3g}" for k, v in facts.items() if isinstance(v, (int, float)))


def peer_table(facts, times):
    met = short = 0
    report = []
    for title, ours, peers, unit, goal in ROWS:
        scale = SCALE[unit]
        print(f"\n{title}")
        able = [n for n in ours if n in times and passed(facts[n])]
        best = min(able, key=lambda n: statistics.median(times[n]), default=None)
        for name in ours:
            if name not in times:
                continue
            low, high = spread(times[name])
            figure = statistics.median(times[name]) * scale
            verdict = ""
            if goal is not None and (name == best or best is None):
                good = name == best and figure <= goal
                met, short = met + good, short + (not good)
                verdict = f"goal <= {goal:g}  {'met' if good else 'short'}"
            print(f"  {name:<42} {figure:9.4g} {unit} [{low * scale:.4g}, {high * scale:.4g}]  {verdict:<20} "
                  f"{reached(facts[name])}{'' if passed(facts[name]) else '  NOT REACHED'}")
            report.append({"row": title, "name": name, "figure": figure, "unit": unit, "goal": goal, **facts[name]})
        if best is None:
            print(f"  {'tiller':<42} {'none that reaches it in this build':<40} short")
            short += goal is None or not any(n in times for n in ours)
        ahead = []
        for name in peers:
            if name not in times:
                print(f"  {name:<42} {'not measured: ' + NOT_HERE.get(name, 'could not be installed or built here')}")
                continue
            low, high = spread(times[name])
            figure = statistics.median(times[name]) * scale
            ratio = ""
            if not passed(facts[name]):
                ratio = "NOT REACHED"
            elif best:
                r = statistics.median(p / o for p, o in zip(times[name], times[best]))
                good = r >= 1.0
                met, short = met + good, short + (not good)
                ratio = f"{r:7.3g} x ours  {'met' if good else 'short'}"
                ahead.append((r, name))
            print(f"  {name:<42} {figure:9.4g} {unit} [{low * scale:.4g}, {high * scale:.4g}]  {ratio:<20} "
                  f"{reached(facts[name])}")
            report.append({"row": title, "name": name, "figure": figure, "unit": unit, **facts[name]})
        if ahead:
            print("  best peer: {1}, {0:.3g} x ours".format(*min(ahead)))
    print(f"\n{met} rows met, {short} short (a peer's row is met where tiller is the quicker)")
    return report


# ---- closed loop -----------------------------------------------------------------------------------

# Figures of solvers that have no package to run here: (name, cost, us a step), quoted, another run of like hardware.
QUOTED = [("acados SQP_RTI (quoted)", 103.8, 58.0), ("GRAMPC (quoted)", 172.0, 150.0),
          ("box-DDP, 5 its (quoted)", 146.0, 30.0)]
GOAL_COST, GOAL_US = 104.0, 20.0


def front(points):
    """Those that no other beats in both."""
    best, keep = float("inf"), []
    for p in sorted(points, key=lambda p: (p["us"], p["cost"])):
        if p["cost"] < best:
            best = p["cost"]
            keep.append(p)
    return keep


def crocoddyl_points():
    program = crocoddyl_program()
    if program is None:
        return []
    found = {}
    for p in lines_of([program, "closed-loop"]):
        found.setdefault((p["planner"], p["settings"]), []).append(p)
    return [{**ps[0], "us": statistics.median(p["us"] for p in ps)} for ps in found.values()]


def pareto(build, plot):
    note("closed loops")
    ours = lines_of([build / "bench/bench_pareto"])
    peers = crocoddyl_points()
    print("\nclosed loop, cart-pole from hanging, 400 steps, N=50, |u| <= 20, exact model: cost against CPU time a step")
    print(f"  {'planner':<22} {'settings':<44} {'cost':>8} {'worst':>8} {'us/step':>8} {'99 %':>8}")
    for planner in dict.fromkeys(p["planner"] for p in ours + peers):
        for p in front([p for p in ours + peers if p["planner"] == planner]):
            print(f"  {planner:<22} {p['settings']:<44} {p['cost']:8.4g} {p.get('worst_cost', p['cost']):8.4g} "
                  f"{p['us']:8.4g} {p.get('p99_us', float('nan')):8.4g}")
    for name, cost, us in QUOTED:
        print(f"  {name:<67} {cost:8.4g} {'':>8} {us:8.4g}")
    good = [p for p in ours if p["cost"] <= GOAL_COST]
    quickest = min(good, key=lambda p: p["us"], default=None)
    within = min((p for p in ours if p["us"] <= GOAL_US), key=lambda p: p["cost"], default=None)
    if quickest:
        print(f"  quickest with cost <= {GOAL_COST:g}: {quickest['planner']} {quickest['settings']}: "
              f"{quickest['us']:.4g} us  goal <= {GOAL_US:g}  {'met' if quickest['us'] <= GOAL_US else 'short'}")
    else:
        print(f"  no planner reaches cost <= {GOAL_COST:g}  short")
    if within:
        print(f"  cheapest within {GOAL_US:g} us: {within['planner']} {within['settings']}: cost {within['cost']:.4g}  "
              f"goal <= {GOAL_COST:g}  {'met' if within['cost'] <= GOAL_COST else 'short'}")
    points = {"tiller": ours, "peers": peers, "quoted": [{"planner": n, "cost": c, "us": u} for n, c, u in QUOTED]}
    (HOME / "pareto.json").write_text(json.dumps(points, indent=1), encoding="utf-8")
    if need_environment("main"):
        subprocess.run([str(python_of("main")), str(PEERS / "plot_pareto.py"), str(HOME / "pareto.json"), str(plot)],
                       check=False)
        note(f"plot: {plot}")
    return points


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--torch", action="store_true")
    parser.add_argument("--only", action="append", choices=["peers", "planners", "rollout", "pareto"])
    parser.add_argument("--plot", type=pathlib.Path, default=HOME / "pareto.png")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    args = parser.parse_args()
    parts = args.only or ["peers", "planners", "rollout", "pareto"]
    HOME.mkdir(parents=True, exist_ok=True)
    if "peers" in parts:
        facts, times = take_turns(participants(args.build, args.torch), args.rounds)
        print(f"tiller against its peers: one core, CPU time, medians of {args.rounds} rounds [quartiles]")
        report = peer_table(facts, times)
        (HOME / "planning.json").write_text(json.dumps({"rows": report, "times": times}, indent=1), encoding="utf-8")
    for part in ("planners", "rollout"):
        if part in parts:
            print(f"\n---- bench_{part}", flush=True)
            subprocess.run([str(args.build / f"bench/bench_{part}")], check=True)
    if "pareto" in parts:
        pareto(args.build, args.plot)


if __name__ == "__main__":
    main()
