"""PySINDy on worlds with a hidden effect: which effects its sparse regressions name.

    gap_sindy.py FOLDERS... [--methods stlsq,frols,ssr] [--settings FILE.json]

Each folder has robot.toml and log_*.csv as bench_gap_export writes them; the sealed answer is not opened. One line of
JSON a folder: {"case": name, "answers": {method: [effects]}}.

What it is given, to be at its best: the nominal model's inverse dynamics (so that only the missing force is sought),
the directions in which its uncertain parameters may move (free, not counted), derivatives by Savitzky and Golay with a
window that goes by the noise, a weak form (the equation against test functions of 0.6 s, which its own finite
differences do not survive without), a library of the catalogue's terms as far as an expression linear in coefficients
can have them, with the pitch of periodic terms, the speed of Stribeck's, the width of a dead zone and the limit of a
saturation each scanned beforehand, and joints one by one. Settings were tuned on seeds from 100001 on and are frozen
below.
"""

import argparse
import json
import pathlib
import sys
import tomllib
import warnings

import numpy as np
import pysindy as ps
from scipy.signal import savgol_filter

warnings.filterwarnings("ignore")

# Tuned on seeds 100001 of friction, offset, lag and delay on pendulum and cart-pole at three noises: window of the
# derivatives by noise (samples of 15, 25 and 41), threshold of STLSQ over the force's size (0.15, 0.3, 0.5), share by
# which one more term must lower the held-out error for the greedy ones (0.05, 0.15, 0.35).
SETTINGS = {"window": {"0.0003": 25, "0.002": 41, "0.01": 41}, "stlsq": 0.5, "alpha": 1e-3, "frols": 0.35, "ssr": 0.35,
            "nothing": 0.03}
TEST_FUNCTION_S, STRIDE_S = 0.6, 0.1
MOST_TERMS = 4
MASS_BOUND = 0.07   # share by which the nominal masses may be off, and a little
LEAST_SHARE = 0.3   # of a term that the nominal parameters' directions must leave
GRAVITY = 9.81


# ---- data ------------------------------------------------------------------------------------------


def central(prior):
    """The value that a robot file's prior is about."""
    if isinstance(prior, (int, float)):
        return float(prior), False
    for kind in ("normal", "log_normal"):
        if kind in prior:
            return float(prior[kind][0]), True
    low, high = prior["uniform"]
    return 0.5 * (low + high), True


class World:
    def __init__(self, folder):
        self.name = folder.name
        robot = tomllib.loads((folder / "robot.toml").read_text(encoding="utf-8"))
        self.model = robot["model"]["name"]
        self.period = robot["model"]["period_s"]
        values = {k: central(v) for k, v in robot["parameters"].items()}
        self.parameters = {k: v[0] for k, v in values.items()}
        self.uncertain = [k for k, v in values.items() if v[1]]
        self.noise = min(v["sd"] for v in robot["measurement"].values())
        self.logs = []
        for path in sorted(folder.glob("log_*.csv")):
            names = path.open(encoding="utf-8").readline().strip().split(",")
            table = np.genfromtxt(path, delimiter=",", skip_header=1)
            self.logs.append({n: table[:, i] for i, n in enumerate(names)})
        plant = PLANTS[self.model]
        self.positions, self.inputs, self.drives = plant["positions"], plant["inputs"], plant["drives"]


# ---- nominal inverse dynamics: force at each joint that the motion needs, less the commands -------------


def pendulum(p, q, v, a, u):
    inertia = p["mass_kg"] * p["length_m"] ** 2
    return [inertia * a[0] + p["mass_kg"] * GRAVITY * p["length_m"] * np.sin(q[0]) + p.get("damping_Nms", 0) * v[0] - u[0]]


def cart_pole(p, q, v, a, u):
    mass, moment = p["cart_mass_kg"] + p["pole_mass_kg"], p["pole_mass_kg"] * p["half_length_m"]
    inertia = 4 / 3 * p["pole_mass_kg"] * p["half_length_m"] ** 2
    s, c = np.sin(q[1]), np.cos(q[1])
    return [mass * a[0] + moment * c * a[1] - moment * s * v[1] ** 2 - u[0],
            moment * c * a[0] + inertia * a[1] - moment * GRAVITY * s]


def linear_axis(p, q, v, a, u):
    return [p["mass_kg"] * a[0] - u[0]]


def two_link_arm(p, q, v, a, u):
    upper = p["upper_mass_kg"] * p["upper_com_m"] + p["lower_mass_kg"] * p["upper_length_m"]
    lower = p["lower_mass_kg"] * p["lower_com_m"]
    j1 = (p["upper_inertia_kgm2"] + p["upper_mass_kg"] * p["upper_com_m"] ** 2
          + p["lower_mass_kg"] * p["upper_length_m"] ** 2)
    j2 = p["lower_inertia_kgm2"] + p["lower_mass_kg"] * p["lower_com_m"] ** 2
    h = p["upper_length_m"] * lower
    c, s = np.cos(q[1]), np.sin(q[1])
    pull = lower * GRAVITY * np.sin(q[0] + q[1])
    m12 = j2 + h * c
    return [(j1 + j2 + 2 * h * c) * a[0] + m12 * a[1] - h * s * v[1] * (2 * v[0] + v[1]) + upper * GRAVITY * np.sin(q[0])
            + pull - u[0], m12 * a[0] + j2 * a[1] + h * s * v[0] ** 2 + pull - u[1]]


PLANTS = {
    "pendulum": {"inverse": pendulum, "positions": ["angle_rad"], "inputs": ["torque_Nm"], "drives": [0]},
    "cart_pole": {"inverse": cart_pole, "positions": ["position_m", "angle_rad"], "inputs": ["force_N"],
                  "drives": [0, None]},
    "linear_axis": {"inverse": linear_axis, "positions": ["position_m"], "inputs": ["force_N"], "drives": [0]},
    "two_link_arm": {"inverse": two_link_arm, "positions": ["shoulder_rad", "elbow_rad"],
                     "inputs": ["shoulder_Nm", "elbow_Nm"], "drives": [0, 1]},
}


# ---- motion, library, weak form --------------------------------------------------------------------


def smooth(x, window, order, period):
    return savgol_filter(x, window, 4, deriv=order, delta=period, mode="interp")


def motion(world, log, window):
    """Position, velocity, acceleration (joints x rows), commands in the middle of their period's start."""
    q = np.array([smooth(log[n], window, 0, world.period) for n in world.positions])
    v = np.array([smooth(log[n], window, 1, world.period) for n in world.positions])
    a = np.array([smooth(log[n], window, 2, world.period) for n in world.positions])
    # a row's command holds until the next: at the row's instant the mean of two acts, smoothed as the motion is
    raw = np.array([0.5 * (log[n] + np.concatenate([log[n][:1], log[n][:-1]])) for n in world.inputs])
    u = np.array([smooth(x, window, 0, world.period) for x in raw])
    du = np.array([smooth(x, window, 1, world.period) for x in raw])
    cut = slice(window, q.shape[1] - window)
    return q[:, cut], v[:, cut], a[:, cut], u[:, cut], du[:, cut]


def weak(rows, period):
    """Against bumps (1 - s^2)^2 of 0.6 s, one every 0.1 s; rows: (terms x samples)."""
    half, stride = int(0.5 * TEST_FUNCTION_S / period), max(1, int(STRIDE_S / period))
    s = np.arange(-half, half + 1) / (half + 1)
    bump = (1 - s ** 2) ** 2
    bump /= bump.sum()
    return np.array([np.convolve(r, bump, mode="valid")[::stride] for r in rows])


def terms_of(world, joint, q, v, a, u, du, scan):
    """{(effect, detail): samples} at a joint."""
    x, w, acc = q[joint], v[joint], a[joint]
    sign, turns = np.sign(w), "rad" in world.positions[joint]
    terms = {("viscous_friction", ""): w, ("coulomb_friction", ""): sign, ("constant_offset", ""): np.ones_like(w),
             ("quadratic_drag", ""): w * np.abs(w), ("linear_spring", ""): x, ("cubic_spring", ""): x ** 3,
             ("joint_inertia", ""): acc,
             ("stribeck_friction", ""): sign * np.exp(-(w / scan["stribeck"]) ** 2)}
    phase = 2 * np.pi * x / scan["pitch"]
    terms[("cogging", "c")], terms[("cogging", "s")] = np.cos(phase), np.sin(phase)
    if turns:
        terms[("tilt", "")] = np.cos(q[0] + q[1]) if world.model == "two_link_arm" and joint == 1 else np.cos(x)
        terms[("sensor_scale", "")] = x * np.cos(x)
        if world.model != "pendulum":  # there it is the mass itself
            terms[("payload", "")] = np.sin(x)
    drive = world.drives[joint]
    if drive is not None:
        f = u[drive]
        terms.update({("load_friction", ""): sign * np.abs(f), ("actuator_gain", ""): f, ("input_delay", ""): du[drive],
                      ("dead_zone", ""): np.clip(f, -scan["dead"], scan["dead"]),
                      ("saturation", ""): f - np.clip(f, -scan["limit"], scan["limit"]),
                      ("rate_limit", ""): du[drive] * np.abs(du[drive])})
        phase = 2 * np.pi * x / scan["ripple"]
        terms[("torque_ripple", "c")], terms[("torque_ripple", "s")] = f * np.cos(phase), f * np.sin(phase)
    return terms


class Problem:
    """The regression at one joint: fit and held-out rows, free directions taken out, columns of length one."""

    def __init__(self, world, joint, settings):
        self.world, self.joint = world, joint
        inverse = PLANTS[world.model]["inverse"]
        window = settings["window"][min(settings["window"], key=lambda k: abs(np.log(float(k) / world.noise)))]
        self.motions = [motion(world, log, window) for log in world.logs]
        self.force, self.free = [], []
        for q, v, a, u, _ in self.motions:
            base = inverse(world.parameters, q, v, a, u)[joint]
            self.force.append(base)
            slopes = []
            for name in world.uncertain:
                moved = dict(world.parameters, **{name: world.parameters[name] * 1.001})
                slopes.append((inverse(moved, q, v, a, u)[joint] - base) / 0.001)
            self.free.append(np.array(slopes).reshape(len(slopes), base.size))
        drive = world.drives[joint]
        every = lambda pick: np.concatenate([pick(m) for m in self.motions])
        x, w = every(lambda m: m[0][joint]), every(lambda m: m[1][joint])
        scan = {"stribeck": 0.1 * np.std(w), "pitch": 1.0, "ripple": 1.0, "dead": 0.0, "limit": 0.0}
        spread = x.max() - x.min()
        turns = "rad" in world.positions[joint]
        pitches = 2 * np.pi / np.arange(1, 41) if turns else spread / np.geomspace(0.5, 30, 60)
        loads = np.abs(every(lambda m: m[3][drive])) if drive is not None else np.array([1.0])
        self.scan = scan
        for key, names, choices in (
                ("stribeck", ["stribeck_friction"], np.std(w) * np.array([0.03, 0.1, 0.3])), ("pitch", ["cogging"], pitches),
                ("ripple", ["torque_ripple"], pitches), ("dead", ["dead_zone"], np.quantile(loads, [0.1, 0.25, 0.5])),
                ("limit", ["saturation"], np.quantile(loads, [0.5, 0.75, 0.9]))):
            if key in ("ripple", "dead", "limit") and drive is None:
                continue
            scan[key] = min(choices, key=lambda c, k=key, n=names: self.misfit(dict(scan, **{k: c}), n))
        self.names, self.fit, self.held = self.rows(scan)

    def rows(self, scan):
        """Names, then (y, columns) to fit and held out, less what the uncertain parameters' directions explain. Terms
        of which they leave nearly nothing go: what is left is the noise of the accelerations, and y has the same."""
        names, parts = None, []
        for motions, force, free in zip(self.motions, self.force, self.free):
            terms = terms_of(self.world, self.joint, *motions, scan)
            names = list(terms)
            parts.append(weak(np.vstack([free, force[None], np.array(list(terms.values()))]), self.world.period))
        held = max(1, len(parts) // 3)
        n = len(self.world.uncertain)
        fit, test = np.hstack(parts[:-held]), np.hstack(parts[-held:])
        before = (fit[n:] ** 2).mean(axis=1)
        if n:
            # known to some per cent: a ridge of that size keeps them from doing an effect's work
            gram = fit[:n] @ fit[:n].T
            share = np.linalg.solve(gram + np.eye(n) * (fit[n] ** 2).mean() / 0.03 ** 2, fit[:n] @ fit[n:].T)
            alone = np.linalg.lstsq(fit[:n].T, fit[n:].T, rcond=None)[0]
            left = ((fit[n:] - alone.T @ fit[:n]) ** 2).mean(axis=1)
            self.moved = float(np.abs(share[:, 0]).max())
            fit, test = fit[n:] - share.T @ fit[:n], test[n:] - share.T @ test[:n]
        else:
            left, self.moved = before, 0.0
        keep = [i for i in range(len(names)) if left[i + 1] > LEAST_SHARE ** 2 * before[i + 1] > 0]
        rows = [0] + [i + 1 for i in keep]
        return [names[i] for i in keep], fit[rows], test[rows]

    def misfit(self, scan, effects):
        names, fit, _ = self.rows(scan)
        keep = [i + 1 for i, n in enumerate(names) if n[0] in effects]
        if not keep:
            return (fit[0] ** 2).sum()
        columns = fit[keep].T
        weights = np.linalg.lstsq(columns, fit[0], rcond=None)[0]
        return ((fit[0] - columns @ weights) ** 2).sum()

    def scaled(self):
        """Columns of unit size, y over the size of the force itself."""
        size = np.sqrt((self.fit[1:] ** 2).mean(axis=1)) + 1e-12
        force = np.sqrt((self.fit[0] ** 2).mean()) + 1e-12
        return (self.fit[1:] / size[:, None]).T, self.fit[0] / force, (self.held[1:] / size[:, None]).T, self.held[0] / force


def effects_of(problem, chosen):
    """Names behind the chosen columns."""
    found = {problem.names[i][0] for i in chosen}
    if problem.moved > MASS_BOUND and problem.world.drives[problem.joint] is not None and not found:
        # masses far beyond their bounds are a weight at the bob, or a motor's gain
        return {"payload" if problem.world.model == "pendulum" else "actuator_gain"}
    if "stribeck_friction" in found:
        found.discard("coulomb_friction")
    if {"coulomb_friction", "constant_offset"} <= found and len(found) == 2:
        return {"asymmetric_friction"}
    return found


def held_out_error(x, y, x_held, y_held, chosen):
    if not len(chosen):
        return (y_held ** 2).mean()
    weights = np.linalg.lstsq(x[:, chosen], y, rcond=None)[0]
    return ((y_held - x_held[:, chosen] @ weights) ** 2).mean()


def greedy(optimiser, problem, gain):
    """The shortest stretch of the optimiser's path after which no more terms bring `gain`."""
    x, y, x_held, y_held = problem.scaled()
    optimiser.fit(x, y[:, None])
    supports = sorted({tuple(np.flatnonzero(np.abs(np.ravel(c)) > 0)) for c in optimiser.history_}, key=len)
    best, best_error = [], held_out_error(x, y, x_held, y_held, [])
    for support in supports:
        if len(support) > MOST_TERMS or len(support) <= len(best):
            continue
        error = held_out_error(x, y, x_held, y_held, list(support))
        if error < best_error * (1 - gain) ** (len(support) - len(best)):
            best, best_error = list(support), error
    return best


def stlsq(problem, settings):
    x, y, x_held, y_held = problem.scaled()
    optimiser = ps.STLSQ(threshold=settings["stlsq"], alpha=settings["alpha"])
    optimiser.fit(x, y[:, None])
    chosen = list(np.flatnonzero(np.abs(np.ravel(optimiser.coef_)) > 0))
    error, nothing = held_out_error(x, y, x_held, y_held, chosen), held_out_error(x, y, x_held, y_held, [])
    return chosen if error < nothing * (1 - settings["nothing"]) else []


METHODS = {
    "stlsq": stlsq,
    "frols": lambda p, s: greedy(ps.FROLS(max_iter=8, alpha=s["alpha"]), p, s["frols"]),
    "ssr": lambda p, s: greedy(ps.SSR(max_iter=40, alpha=s["alpha"]), p, s["ssr"]),
}


def answers(folder, methods, settings):
    world = World(folder)
    found = {m: set() for m in methods}
    for joint in range(len(world.positions)):
        problem = Problem(world, joint, settings)
        for method in methods:
            found[method] |= effects_of(problem, METHODS[method](problem, settings))
    return {m: sorted(f) for m, f in found.items()}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=pathlib.Path)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--settings", type=pathlib.Path, help="in the place of the frozen ones; for tuning")
    args = parser.parse_args()
    settings = dict(SETTINGS, **(json.loads(args.settings.read_text(encoding="utf-8")) if args.settings else {}))
    for folder in args.folders:
        try:
            found = answers(folder, args.methods.split(","), settings)
        except (KeyError, ValueError, np.linalg.LinAlgError) as problem:
            print(f"{folder.name}: {problem!r}", file=sys.stderr)
            found = {m: None for m in args.methods.split(",")}
        print(json.dumps({"case": folder.name, "answers": found}), flush=True)


if __name__ == "__main__":
    main()
