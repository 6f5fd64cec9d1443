# programs: tiller_command
"""./dev bench disturbance: robots in a world that their model does not contain, with what they learn and how they hold.

    --seeds N       runs of each pair of robot and world (100)
    --first N       seed to begin with (1); tuning uses 1001 and up
    --robot NAME    this robot alone; may be given more than once
    --world NAME    this world alone; likewise
    --arm NAME      this way of learning alone; likewise
    --jobs N        runs at the same time (1)
    --rows FILE     where finished runs are kept (build/bench_peers/disturbance.jsonl); a run that was cut goes on
    --build DIR     the CMake build folder (build/release)

Plants are the ODE stand-ins, with true parameters drawn by the seed. A world is an effect of the stand-in that the robot
file does not have, or a parameter of it that is not the model's; docs/evidence/disturbances.md tells what is held for
the truth there. A row of each run: whether the 90 % interval of each parameter holds the truth at the end, how wide it is,
and by how much the held coordinate is off (RMS of the second half; offset: its mean). Two arms: the robot file as it is
shipped, and with the lines that docs/guide/disturbances.md adds to it.
"""

import argparse
import concurrent.futures
import csv
import json
import pathlib
import re
import subprocess
import tempfile

import numpy as np

from _driver import HOME, ROOT, held_against_forces, kept_rows, note, summary, with_forces

SHARE_LOW, SHARE_HIGH = 0.86, 0.94
PLAIN, WITH = "plain", "disturbance"
ARMS = (PLAIN, WITH)


def of_joint(kind, port, **values):
    lines = "\n".join(f"{key} = {value}" for key, value in values.items())
    return f'\n[[sim.effects]]\nkind = "{kind}"\nport = "{port}"\n{lines}\n'


def plant_with(**parameters):
    return "\n[sim.parameters]\n" + "".join(f"{name} = {value:.9g}\n" for name, value in parameters.items())


def forces(port, force):
    """A force that matters at the joint: a fifth of what its motor has."""
    return {
        "none": "",
        "constant": of_joint("constant_offset", port, force_SI=force),
        "gusts 0.1 s": of_joint("wind_gusts", port, force_SI=0.67 * force, correlation_s=0.1),
        "gusts 1 s": of_joint("wind_gusts", port, force_SI=0.67 * force, correlation_s=1.0),
        "gusts 5 s": of_joint("wind_gusts", port, force_SI=0.67 * force, correlation_s=5.0),
        "sine 0.2 Hz": of_joint("periodic_force", port, force_SI=force, frequency_Hz=0.2),
        "sine 1 Hz": of_joint("periodic_force", port, force_SI=force, frequency_Hz=1.0),
        "shove": of_joint("shove", port, force_SI=force, begin_s=4.0, for_s=1.0),
        "Coulomb": of_joint("coulomb_friction", port, friction_SI=0.5 * force),
        "drifting friction": of_joint("friction_drift", port, friction_SI=0.5 * force, heat_J=1.0),
    }


def worlds_of_a_pendulum(port, force, mass_kg):
    """A tenth of what hangs there swings on a string of half the arm, at 1 Hz alone; a flywheel at the hinge, which gravity
    does not see. The mass is what gravity pulls at in both."""
    return forces(port, force) | {
        "swinging load": plant_with(mass_kg=0.9 * mass_kg) + of_joint("hung_load", port, mass_kg=0.1 * mass_kg, length_m=0.25),
        "inertia 10 %": of_joint("joint_inertia", port, inertia_SI=0.1 * mass_kg * 0.5**2),
    }


def worlds_of_a_cart(port, force, _):
    """A tenth of the cart hangs below it and swings; the cart is heavier than it was weighed, all of what the motor moves by
    9 %. The pole's own moment will not do: a pole of another length and mass has it."""
    return forces(port, force) | {
        "swinging load": plant_with(cart_mass_kg=0.9) + of_joint("hung_load", port, mass_kg=0.1, length_m=0.25),
        "inertia 10 %": plant_with(cart_mass_kg=1.1),
    }


def worlds_of_a_hopper(port, force, _):
    """Ground of 10 kN/m, into which the foot sinks 17 mm where it presses with 170 N, four times the weight; the model's has
    a hundred times that."""
    some = ("none", "constant", "gusts 1 s", "Coulomb")
    return {name: text for name, text in forces(port, force).items() if name in some} | {
        "soft ground": plant_with(ground_stiffness_N_m=1e4, ground_damping_Ns_m=100.0),
        "inertia 10 %": plant_with(body_inertia_kgm2=0.11),
    }


# robot -> seconds, held coordinate, its target, parameters, changes of the robot file, worlds
ROBOTS = {
    "pendulum held": {
        "file": "pendulum", "seconds": 10, "held": "angle_rad", "target": 0.3, "port": "joint", "force": 0.3,
        "parameters": ["mass_kg", "damping_Nms"], "worlds": worlds_of_a_pendulum, "steady": True,
        "change": [(r"target = \{ angle_rad = [0-9.]+ \}", "target = { angle_rad = 0.3 }")],
    },
    "pendulum": {
        "file": "pendulum", "seconds": 10, "held": "angle_rad", "target": 3.141592653589793, "port": "joint", "force": 0.3,
        "parameters": ["mass_kg", "damping_Nms"], "worlds": worlds_of_a_pendulum, "steady": True, "change": [],
    },
    "cart_pole": {
        "file": "cart_pole", "seconds": 10, "held": "position_m", "target": 0.0, "port": "cart", "force": 2.0,
        "parameters": ["pole_mass_kg", "half_length_m", "cart.damping_SI"], "worlds": worlds_of_a_cart, "steady": True,
        "change": [],
    },
    # its gait has no input that holds the target
    "hopper": {
        "file": "hopper", "seconds": 10, "held": "x_m_s", "target": 0.5, "port": "hip", "force": 4.0,
        "parameters": ["body_mass_kg", "leg_stiffness_N_m", "ground_friction"], "worlds": worlds_of_a_hopper, "steady": False,
        "change": [],
    },
}
# what a parameter is of another kind of motion: the mass that the motor has to turn
OTHER_TRUTHS = {"inertia 10 %": {"mass_kg": 1.1}}
WORLDS = {robot: list(spec["worlds"](spec["port"], spec["force"], 1.0)) for robot, spec in ROBOTS.items()}


def text_of(robot, arm):
    spec = ROBOTS[robot]
    text = (ROOT / f"robots/{spec['file']}.toml").read_text(encoding="utf-8")
    for pattern, to in spec["change"]:
        text, count = re.subn(pattern, to, text)
        assert count == 1, pattern
    if arm == WITH:
        text = with_forces(text)
        text = held_against_forces(text) if spec["steady"] else text
    return text


def log_of(build, text, seconds, seed):
    """(rows of the log, what was said)"""
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        (folder / "run.toml").write_text(text, encoding="utf-8")
        done = subprocess.run([build / "tools/tiller", "run", folder / "run.toml", "--sim", "--seconds", str(seconds), "--seed",
                               str(seed), "--quiet", "--log", folder / "run.csv"], capture_output=True, text=True, check=False)
        if not (folder / "run.csv").exists():
            return [], done.stderr.strip()[-300:]
        with open(folder / "run.csv", encoding="utf-8") as file:
            return list(csv.DictReader(file)), ""


def drawn_of(build, robot, seed):
    """What this seed draws: the plant is asked, in a run of a few periods."""
    rows, said = log_of(build, text_of(robot, PLAIN), 0.2, seed)
    assert rows, said
    return {name: float(rows[-1]["true." + name]) for name in ROBOTS[robot]["parameters"]}


def run(build, robot, world, arm, seed):
    spec = ROBOTS[robot]
    truth = drawn_of(build, robot, seed)
    text = text_of(robot, arm) + spec["worlds"](spec["port"], spec["force"], truth.get("mass_kg", 0.0))[world]
    rows, said = log_of(build, text, spec["seconds"], seed)
    if not rows:
        note(f"{robot}, {world}, {arm}, seed {seed}: {said}")
        return None
    last, half = rows[-1], rows[len(rows) // 2:]
    number = lambda name, of=last: float(of[name] or "nan")
    off = np.array([number("true." + spec["held"], r) - spec["target"] for r in half])
    if spec["held"].endswith("_rad"):
        off -= 2.0 * np.pi * np.round(off / (2.0 * np.pi))
    found = {"robot": robot, "world": world, "arm": arm, "seed": seed, "state": last["state"],
             "rms": float(np.sqrt(np.mean(off**2))), "offset": float(np.mean(off)), "truth": truth,
             "holds": {}, "width": {}, "error": {}}
    for name in spec["parameters"]:
        low, high, true = number("q05." + name), number("q95." + name), truth[name]
        found["holds"][name] = bool(low <= true <= high)
        found["width"][name] = high - low
        found["error"][name] = 0.5 * (low + high) - true
    return found


def key_of(row):
    return row["robot"], row["world"], row["arm"], row["seed"]


def tell(rows, robot, world, arm, seeds, table):
    of = [rows[robot, world, arm, s] for s in seeds if (robot, world, arm, s) in rows]
    if not of:
        return
    texts = []
    for name in ROBOTS[robot]["parameters"]:
        share = float(np.mean([r["holds"][name] for r in of]))
        texts.append(f"{name} {share:.2f} (width {np.median([r['width'][name] for r in of]):.3g}, off "
                     f"{np.median(np.abs([r['error'][name] for r in of])):.2g})")
        times = OTHER_TRUTHS.get(world, {}).get(name)
        if times:
            other = np.mean([abs(r["error"][name] - (times - 1.0) * r["truth"][name]) <= 0.5 * r["width"][name] for r in of])
            texts[-1] += f", {other:.2f} hold {times} times that"
        if arm == WITH:
            table.append({"section": "disturbance", "heading": f"{robot}, {world}", "row": f"{name}, 90 % intervals that hold",
                          "figure": share, "unit": f"of {len(of)}", "goal": f"{SHARE_LOW} .. {SHARE_HIGH}",
                          "met": SHARE_LOW <= share <= SHARE_HIGH})
    print(f"  {world:<18} {arm:<12} {'; '.join(texts)}; off by {1e3 * np.median([r['rms'] for r in of]):.1f}, mean "
          f"{1e3 * np.median(np.abs([r['offset'] for r in of])):.1f} mrad, mm or mm/s; ACTIVE "
          f"{sum(r['state'] == 'ACTIVE' for r in of)} of {len(of)}")


def compare(rows, robot, world, seeds, table):
    """How the two arms hold and know on the same seeds; a run that did not end ACTIVE holds nothing."""
    of = {arm: [rows.get((robot, world, arm, s)) for s in seeds] for arm in ARMS}
    if any(r is None for arm in ARMS for r in of[arm]):
        return
    rms = {arm: np.median([r["rms"] if r["state"] == "ACTIVE" else np.inf for r in of[arm]]) for arm in ARMS}
    still = world == "none"
    ratio = float(rms[WITH] / rms[PLAIN]) if np.isfinite(rms[PLAIN]) else 0.0
    most = 1.01 if still else 0.6
    table.append({"section": "disturbance", "heading": f"{robot}, {world}", "row": "RMS over that of the arm without, medians",
                  "figure": ratio, "unit": "", "goal": f"<= {most}", "met": ratio <= most})
    for name in ROBOTS[robot]["parameters"] if still else ():
        wide = float(np.median([r["width"][name] for r in of[WITH]]) / np.median([r["width"][name] for r in of[PLAIN]]))
        table.append({"section": "disturbance", "heading": f"{robot}, {world}", "row": f"{name}, width over that without",
                      "figure": wide, "unit": "", "goal": "<= 1.05", "met": wide <= 1.05})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--robot", action="append", choices=sorted(ROBOTS))
    parser.add_argument("--world", action="append", choices=sorted({w for of in WORLDS.values() for w in of}))
    parser.add_argument("--arm", action="append", choices=list(ARMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=pathlib.Path, default=HOME / "disturbance.jsonl")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    asked = parser.parse_args()
    robots, arms = asked.robot or list(ROBOTS), asked.arm or list(ARMS)
    places = {robot: [w for w in WORLDS[robot] if w in (asked.world or WORLDS[robot])] for robot in robots}
    seeds = range(asked.first, asked.first + asked.seeds)
    rows = kept_rows(asked.rows, key_of)
    wanted = [(robot, world, arm, seed) for seed in seeds for robot in robots for world in places[robot] for arm in arms
              if (robot, world, arm, seed) not in rows]
    if wanted:
        note(f"{len(wanted)} runs to do")
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    with open(asked.rows, "a", encoding="utf-8") as file, concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        for found in pool.map(lambda w: run(asked.build.resolve(), *w), wanted):
            if found is None:
                continue
            rows[key_of(found)] = found
            file.write(json.dumps(found) + "\n")
            file.flush()
    table = []
    for robot in robots:
        print(f"{robot}, {len(seeds)} seeds from {asked.first}")
        for world in places[robot]:
            for arm in arms:
                tell(rows, robot, world, arm, seeds, table)
            compare(rows, robot, world, seeds, table)
    summary(table)


if __name__ == "__main__":
    main()
