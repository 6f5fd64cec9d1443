# programs: tiller_command
"""./dev bench tx40: a measured six-axis arm, imported from its URDF, fitted and judged by `tiller gap` in one run.

    ./dev bench tx40 --tx40 FOLDER      pos_read_data.csv, curr_data.csv, tx40_mdh_modified.urdf; also TILLER_TX40

    --only KINDS        effects that `tiller gap` considers beside those of the robot file (all)
    --max-effects N     of one explanation (3)
    --out FOLDER        log, model, gap.json (build/tx40)

The robot file has viscous and Coulomb friction, an offset and a rotor at each joint, with wide priors. A judge that shares
nothing with tiller (pinocchio and least squares) tells what the fitted values leave of each motor's measured torque, beside
the published values and its own fits. The data are not shipped (docs/evidence/measured.md). A short row is no error.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys

from _driver import HOME, ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, rows_of, summary

TILLER = ROOT / "build/release/tools/tiller"
JOINTS = [f"joint_{j + 1}" for j in range(6)]
# Rotors that the URDF leaves out, as small as they may be: link 6 has no inertia about its axis at all.
ARMATURE = dict(zip(JOINTS, [0.1, 0.1, 0.05, 0.02, 0.02, 0.005]))
# figaroh-examples' configuration, joints 1 to 4; joints 5 and 6 share one friction, which no joint has by itself
PUBLISHED = {"damping_SI": [8.05, 5.53, 1.97, 1.11], "friction_SI": [7.14, 8.26, 6.34, 2.48]}
WORDS = {"damping_SI": "viscous", "friction_SI": "Coulomb"}


def row(lines, what, figure, unit, goal=None):
    """A line as bench_table.hpp prints it; `goal` is (sign, bound)."""
    text = f"  {what:<76} {figure:10.4g} {unit:<8}"
    if goal:
        met = figure <= goal[1] if goal[0] == "<=" else figure >= goal[1]
        text += f" goal {goal[0]} {goal[1]:g}   {'met' if met else 'short'}"
    print(text, flush=True)
    lines.append(text)


def run(*command, **more):
    return subprocess.run([str(c) for c in command], text=True, check=False, **more)


def prepare(folder, out):
    """Log, URDF, robot file and model in `out`; whether they are there."""
    done = run(sys.executable, "-m", "tiller_tools.convert", "tx40", folder.resolve(), out.resolve(), cwd=ROOT / "tools/python",
               stdout=subprocess.DEVNULL)
    armature = ",".join(f"{joint}={value}" for joint, value in ARMATURE.items())
    return done.returncode == 0 and run(TILLER, "import", out / "tx40.urdf", "-o", out / "model", "--armature", armature,
                                        "--force", stdout=subprocess.DEVNULL).returncode == 0


def fitted(explanation):
    """joint -> key -> value of the robot file's own effects."""
    values = {p["name"]: p["mean"] for p in explanation["parameters"] if p["of"] == "robot_file"}
    return {key: [values[f"{joint}.{key}"] for joint in JOINTS] for key in
            ("damping_SI", "friction_SI", "force_SI", "inertia_SI")}


def judge(folder, values, out):
    file = out / "fitted.json"
    file.write_text(json.dumps(dict(values, armature=list(ARMATURE.values()))), encoding="utf-8")
    done = run(python_of("robots"), PEERS / "tx40_judge.py", folder, file, stdout=subprocess.PIPE, env=dict(os.environ, **ONE_THREAD))
    return json.loads(done.stdout) if done.returncode == 0 else None


def tell(result, left):
    lines = ["TX40 by tiller gap"]
    print(lines[0])
    best = result["ranking"][0]
    named = [f"{e['kind']}@{e['port']}" for e in best["effects"]] if result["verdict"] in ("named", "partly_explained") else []
    print(f"  {result['verdict']}: {result['sentence']}")
    row(lines, "time", result["cost"]["cpu_s"], "s")
    row(lines, "memory", result["cost"]["memory_bytes"] / 1e6, "MB")
    values = fitted(best)
    for key, published in PUBLISHED.items():
        for joint, value, known in zip(JOINTS, values[key], published):
            row(lines, f"{joint} {WORDS[key]} {value:.4g} beside {known:g}: off by", 100 * abs(value / known - 1), "%", ("<=", 10))
    wrong = [name for name in named if name.split("@")[1] in JOINTS[:4]]
    row(lines, "names at joints 1 to 4 beside friction, offset and rotor", len(wrong), "", ("<=", 0))
    for j, joint in enumerate(JOINTS):
        row(lines, f"{joint}: torque left at the motor, least squares {left['least squares'][j]:.4g}, with the wrist's "
            f"{left['least squares, wrist'][j]:.4g}, published {left['published, viscous as sums'][j]:.4g}", left["tiller"][j], "",
            ("<=", 1.1 * left["published, viscous as sums"][j]))
    return lines


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="./dev bench tx40 --tx40 FOLDER [OPTIONS]", allow_abbrev=False)
    parser.add_argument("--tx40", metavar="FOLDER", default=os.environ.get("TILLER_TX40", ""))
    parser.add_argument("--only", default="")
    parser.add_argument("--max-effects", type=int, default=3)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "build/tx40")
    return parser.parse_args()


def main():
    args = parse()
    if not args.tx40:
        print("  NOT MEASURED: no data of the TX40; name their folder with --tx40 (docs/evidence/measured.md)")
        return 0
    HOME.mkdir(parents=True, exist_ok=True)
    args.out.mkdir(parents=True, exist_ok=True)
    folder = pathlib.Path(args.tx40)
    if not need_environment("robots") or not prepare(folder, args.out):
        return 1
    note("tiller gap (the first run compiles the model, about a minute)")
    only = ["--only", args.only] if args.only else []
    done = run(TILLER, "gap", args.out / "tx40.toml", args.out / "tx40.csv", "--json", "--max-effects", args.max_effects, *only,
               stdout=subprocess.PIPE)
    if done.returncode > 3 or not done.stdout:
        return 1
    (args.out / "gap.json").write_text(done.stdout, encoding="utf-8")
    result = json.loads(done.stdout)
    if not result["ranking"]:
        print(f"  unfit: {'; '.join(result['reasons'])}")
        return 1
    answer = judge(folder, fitted(result["ranking"][0]), args.out)
    if answer is None:
        return 1
    lines = tell(result, answer["left"])
    summary(rows_of("tx40", lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
