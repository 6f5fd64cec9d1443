# programs: tiller_command tiller_python
"""./dev bench pushed: how a robot is held against forces that its model does not contain, beside other ways to hold it.

    --seeds N         runs of each arm in each world (20)
    --first N         seed to begin with (1); tuning uses 1001 and up
    --peer-seeds N    runs of do-mpc, of the same seeds (5)
    --tuning-seeds N  runs of each setting of an arm that is tuned (2; do-mpc 1)
    --plant NAME      this plant alone; may be given more than once
    --world NAME      this world alone; likewise. Settings are tuned on all worlds
    --arm NAME        this arm alone; likewise
    --jobs N          runs at the same time (1)
    --rows FILE       where finished runs are kept (build/bench_peers/pushed.jsonl); a run that was cut goes on
    --build DIR       the CMake build folder (build/release)

The plants' equations are written out here: a pendulum that is held aside, and a cart whose pole is up. A seed draws
the true parameters, the sensors' noise and the force, which are the same for every arm. The force is a fifth of the
motor's largest: constant, in gusts (of 0.67 of that in standard deviation) or as a sine.

    today        the robot file with `ilqr` and a filter that learns the parameters
    disturbance  the same, `disturbance = true` and inputs that count from the steady one
    integrator   today, whose target is shifted by the integral of the measured error
    L1           today, with an L1 adaptive controller on top (Hovakimyan and Cao 2010): a predictor of the
                 velocities, a piecewise constant law, a filter of first order
    do-mpc       its model predictive control and moving horizon estimation of state, parameters and force

Inputs count from the steady one in `integrator` and `L1` too, which otherwise keep an offset of the cost's. Gains and
bandwidths are those that do best on the tuning seeds, by the mean of the RMS errors' logarithms over the worlds.

A run takes 12 s. Static error: the mean of the held coordinate's error over the last 3 s. RMS: over the last 5 s.
Ratios of RMS are medians over the seeds of each seed's ratio.
"""

import argparse
import concurrent.futures
import json
import math
import pathlib
import re
import sys
import tomllib

import numpy as np

from _driver import (HOME, PEERS, ROOT, Participant, held_against_forces, kept_rows, need_environment, note, python_of,
                     summary, with_forces)

TODAY, WITH, INTEGRATOR, L1, DO_MPC = ARMS = ("today", "disturbance", "integrator", "L1", "do-mpc")
FIRST_TUNING = 1001
STEP_S, RUN_S, MEAN_S, RMS_S = 1e-4, 12.0, 3.0, 5.0
FORCE_STEP_S = 1e-3
GRAVITY_M_S2 = 9.81
NONE, CONSTANT, GUSTS = "none", "constant", "gusts 1 s"
WORLDS = {NONE: None, CONSTANT: None, GUSTS: None, "sine 0.2 Hz": 0.2, "sine 1 Hz": 1.0}
SETTINGS = {
    TODAY: [{}],
    WITH: [{}],
    INTEGRATOR: [{"gain_per_s": g} for g in (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)],
    L1: [{"bandwidth_rad_s": w} for w in (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)],
    # the force's walk in forces that matter a root of a second, how fast parameters settle, periods
    DO_MPC: [{"drift": d, "memory": m, "window": 20} for d in (0.5, 2.0, 8.0, 32.0) for m in (1.0, 1000.0)],
}


# ---- plants ----------------------------------------------------------------------------------------


class Pendulum:
    """m l^2 angle'' = u + d - b angle' - m g l sin(angle): it hangs at 0, and begins there."""

    file, held, target, unit = "pendulum", 0, 0.8, "mrad"
    limit, farthest, sensor_sd = 3.0, 0.5, (0.002,)  # farthest: of a target that is shifted
    start_sd = (0.01, 0.01)
    length_m = 0.5
    ranges = {"mass_kg": (0.3, 0.7), "damping_Nms": (0.01, 0.09)}
    nominal = {"mass_kg": 0.5, "damping_Nms": 0.05}
    targets = (0.8, 0.0)
    change = [(r"^target = .*$", "target = { angle_rad = 0.8 }"), (r'^kind = "cem"$', 'kind = "ilqr"'),
              (r"low = -1\.5, high = 1\.5", "low = -3, high = 3"),
              (r'^name = "pendulum"$', 'name = "pendulum"\nseed = {seed}')]

    @classmethod
    def advance(cls, x, u, force, p):
        """Semi-implicit Euler; `force` has a value for each FORCE_STEP_S."""
        angle, rate = x
        weight = p["mass_kg"] * GRAVITY_M_S2 * cls.length_m
        per_inertia = STEP_S / (p["mass_kg"] * cls.length_m**2)
        damping, sin = p["damping_Nms"], math.sin
        for d in force:
            push = u + d
            for _ in range(STEPS_A_FORCE):
                rate += per_inertia * (push - damping * rate - weight * sin(angle))
                angle += STEP_S * rate
        return [angle, rate]

    @classmethod
    def acceleration(cls, q, v, u):
        """Of the nominal pendulum, and what a unit of the input does to it."""
        p = cls.nominal
        inertia = p["mass_kg"] * cls.length_m**2
        turn = u - p["damping_Nms"] * v[0] - p["mass_kg"] * GRAVITY_M_S2 * cls.length_m * math.sin(q[0])
        return np.array([turn / inertia]), np.array([1 / inertia])

    @staticmethod
    def stays(errors, x):
        return bool(np.max(np.abs(errors)) < 0.5)


class CartPole:
    """A rod on a cart: A x'' + h cos(a) a'' = u + d - c x' + h sin(a) a'^2 and h cos(a) x'' + J a'' = g h sin(a).

    A is the whole mass, h the rod's first moment, J its inertia about the hinge; it stands at a = 0, and begins there.
    """

    file, held, target, unit = "cart_pole", 0, 0.0, "mm"
    limit, farthest, sensor_sd = 20.0, 2.0, (0.0005, 0.002)
    start_sd = (0.001, 0.01, 0.01, 0.01)
    cart_mass_kg = 1.0
    ranges = {"pole_mass_kg": (0.06, 0.14), "half_length_m": (0.3, 0.7), "damping_Ns_m": (0.12, 0.28)}
    nominal = {"pole_mass_kg": 0.1, "half_length_m": 0.5, "damping_Ns_m": 0.2}
    targets = (0.0, 0.0, 0.0, 0.0)
    # no one sequence of inputs holds up a pole for all hypotheses: each answers its own state
    change = [(r"angle_rad = 3\.14159\d+", "angle_rad = 0.0"),
              (r'^kind = "mppi"$', 'kind = "ilqr"\nclosed_loop = true'),
              (r"^seed = 1\n\n\[model\]", "seed = {seed}\n\n[model]")]

    @classmethod
    def coefficients(cls, p):
        """(A, h, J)"""
        mass, half = p["pole_mass_kg"], p["half_length_m"]
        return cls.cart_mass_kg + mass, mass * half, 4 / 3 * mass * half**2

    @classmethod
    def advance(cls, x, u, force, p):
        place, angle, speed, rate = x
        whole, moment, inertia = cls.coefficients(p)
        damping, sin, cos = p["damping_Ns_m"], math.sin, math.cos
        for d in force:
            ahead = u + d
            for _ in range(STEPS_A_FORCE):
                s, coupling = sin(angle), moment * cos(angle)
                push, turn = ahead - damping * speed + moment * s * rate * rate, moment * GRAVITY_M_S2 * s
                scale = STEP_S / (whole * inertia - coupling * coupling)
                speed += scale * (inertia * push - coupling * turn)
                rate += scale * (whole * turn - coupling * push)
                place += STEP_S * speed
                angle += STEP_S * rate
        return [place, angle, speed, rate]

    @classmethod
    def acceleration(cls, q, v, u):
        whole, moment, inertia = cls.coefficients(cls.nominal)
        s, coupling = math.sin(q[1]), moment * math.cos(q[1])
        scale = 1 / (whole * inertia - coupling**2)
        push = u - cls.nominal["damping_Ns_m"] * v[0] + moment * s * v[1]**2
        turn = moment * GRAVITY_M_S2 * s
        return (np.array([inertia * push - coupling * turn, whole * turn - coupling * push]) * scale,
                np.array([inertia, -coupling]) * scale)

    @staticmethod
    def stays(errors, x):
        return bool(np.max(np.abs(errors)) < 3.0 and abs(x[1]) < 0.8)


PLANTS = {"pendulum": Pendulum, "cart-pole": CartPole}
PERIOD_S = 0.02
STEPS_A_FORCE = round(FORCE_STEP_S / STEP_S)
FORCES_A_PERIOD = round(PERIOD_S / FORCE_STEP_S)
TICKS = round(RUN_S / PERIOD_S)
SHARE = 0.2  # of the motor's largest force


def force_of(world, most, seed):
    """The force at every FORCE_STEP_S of a run."""
    rng = np.random.default_rng([seed, 2])
    time_s = FORCE_STEP_S * np.arange(TICKS * FORCES_A_PERIOD)
    if world == CONSTANT:
        return np.full(time_s.shape, most * rng.choice([-1.0, 1.0]))
    if world == GUSTS:
        kept, noise = math.exp(-FORCE_STEP_S), rng.standard_normal(time_s.size)
        force = np.empty(time_s.size)
        force[0] = noise[0]
        for k in range(1, time_s.size):
            force[k] = kept * force[k - 1] + math.sqrt(1 - kept**2) * noise[k]
        return 0.67 * most * force
    if world == NONE:
        return np.zeros(time_s.shape)
    return most * np.sin(2 * math.pi * (WORLDS[world] * time_s + rng.random()))


# ---- arms ------------------------------------------------------------------------------------------


def text_of(plant, arm, seed):
    text = (ROOT / f"robots/{plant.file}.toml").read_text(encoding="utf-8")
    for pattern, to in plant.change:
        text, count = re.subn(pattern, to.replace("{seed}", str(seed)), text, count=1, flags=re.M)
        assert count == 1, pattern
    if arm == WITH:
        text = with_forces(text)
    if arm in (WITH, INTEGRATOR, L1):
        text = held_against_forces(text)
    return text


class Tiller:
    """The controller alone."""

    def __init__(self, plant, arm, settings, seed):
        import tiller

        self.plant = plant
        self.controller = tiller.Controller(tiller.Robot.from_text(text_of(plant, arm, seed)))
        self.controller.arm()

    def command(self, t, y, _):
        return float(self.controller.tick(t, np.array(y)).value[0])

    def facts(self):
        info = self.controller.info
        return {"state": info.state.name, "fault": info.first_fault.name, "adequacy": info.adequacy.name,
                "relearned": info.relearned, "parameters": info.param_mean.tolist()}

    def leave(self):
        pass


class Integrator(Tiller):
    """The target moves against the integral of the error, which stands still while the motor is at its limit."""

    def __init__(self, plant, arm, settings, seed):
        super().__init__(plant, arm, settings, seed)
        self.gain, self.shift, self.free = settings["gain_per_s"], 0.0, True

    def command(self, t, y, used):
        if self.free:
            self.shift -= self.gain * PERIOD_S * (y[self.plant.held] - self.plant.target)
            self.shift = min(max(self.shift, -self.plant.farthest), self.plant.farthest)
        target = np.array(self.plant.targets)
        target[self.plant.held] += self.shift
        self.controller.set_target(target)
        u = super().command(t, y, used)
        self.free = abs(u) < 0.999 * self.plant.limit
        return u


class Adaptive(Tiller):
    """v^' = f(q, v, u) + sigma + a (v^ - v), sigma = -a e^(a T) / (e^(a T) - 1) (v^ - v), u = u0 - C(s) B'sigma / B'B.

    f is the nominal model's acceleration, B what the input does to it; v are differences of readings. C has one pole.
    Of a constant force sigma finds the share e^(a T): a is so small that it is nearly all.
    """

    POLE_RAD_S = -0.1

    def __init__(self, plant, arm, settings, seed):
        super().__init__(plant, arm, settings, seed)
        kept = math.exp(self.POLE_RAD_S * PERIOD_S)
        self.law_per_s = -self.POLE_RAD_S * kept / (kept - 1)
        self.share = 1 - math.exp(-settings["bandwidth_rad_s"] * PERIOD_S)
        self.before = self.predicted = None
        self.added = 0.0

    def command(self, t, y, used):
        q, u0 = np.array(y), super().command(t, y, used)
        if self.before is not None:
            v = (q - self.before) / PERIOD_S
            self.predicted = v if self.predicted is None else self.predicted
            off = self.predicted - v
            sigma = self.law_per_s * off
            _, direction = self.plant.acceleration(q, v, 0.0)
            self.added += self.share * (-float(direction @ sigma / (direction @ direction)) - self.added)
        self.before = q
        u = min(max(u0 + self.added, -self.plant.limit), self.plant.limit)
        if self.predicted is not None:
            change, _ = self.plant.acceleration(q, v, u)
            self.predicted = self.predicted + PERIOD_S * (change + sigma + self.POLE_RAD_S * off)
        return u


class DoMpc:
    """In an environment and a process of its own."""

    def __init__(self, plant, arm, settings, seed):
        name = next(n for n, p in PLANTS.items() if p is plant)
        robot = tomllib.loads(text_of(plant, TODAY, seed))
        self.plant, self.last, self.seconds = plant, {}, []
        self.process = Participant([python_of("pushed"), PEERS / "pushed_peer.py"])
        given = {"plant": name, "robot": robot, "force": SHARE * plant.limit, "settings": settings}
        if not self.process.ask(json.dumps(given)).get("begun"):
            note(f"do-mpc does not begin: {name}, {settings}")

    def command(self, t, y, used):
        self.last = self.process.ask(json.dumps([list(y), used]))
        self.seconds.append(self.last.get("seconds", math.nan))
        return self.last.get("u", math.nan)

    def facts(self):
        return {"state": "ACTIVE" if self.last else "gone", "parameters": self.last.get("parameters"),
                "step_ms": 1e3 * float(np.median(self.seconds))}

    def leave(self):
        self.process.leave()


MAKE = {TODAY: Tiller, WITH: Tiller, INTEGRATOR: Integrator, L1: Adaptive, DO_MPC: DoMpc}


# ---- runs ------------------------------------------------------------------------------------------


def draw(plant, seed):
    """(true parameters, where it begins, noise of every reading): the same for every arm and world."""
    rng = np.random.default_rng([seed, 0])
    truth = {n: float(rng.uniform(*r)) for n, r in plant.ranges.items()}
    start = [float(sd * rng.standard_normal()) for sd in plant.start_sd]
    noise = np.random.default_rng([seed, 1]).standard_normal((TICKS, len(plant.sensor_sd))) * plant.sensor_sd
    return truth, start, noise


def trace(plant, world, arm, settings, seed):
    """(true states at the ticks, inputs, what the arm says of itself)"""
    truth, x, noise = draw(plant, seed)
    force = force_of(world, SHARE * plant.limit, seed).tolist()
    controller = MAKE[arm](plant, arm, settings, seed)
    states, inputs, used = [], [], 0.0
    for k in range(TICKS):
        states.append(x)
        used = controller.command(k * PERIOD_S, [x[i] + noise[k, i] for i in range(noise.shape[1])], used)
        if not math.isfinite(used) or not np.all(np.abs(x) < 1e3):
            break
        inputs.append(used)
        x = plant.advance(x, used, force[k * FORCES_A_PERIOD:(k + 1) * FORCES_A_PERIOD], truth)
    facts = controller.facts()
    controller.leave()
    return np.array(states), np.array(inputs), {"truth": truth, **facts}


def run(build, name, world, arm, seed, settings):
    if (package := str(build / "python_package")) not in sys.path:
        sys.path.insert(0, package)
    plant = PLANTS[name]
    states, inputs, facts = trace(plant, world, arm, settings, seed)
    errors = states[:, plant.held] - plant.target
    last = lambda seconds: errors[-round(seconds / PERIOD_S):]
    stays = len(inputs) == TICKS and plant.stays(last(RMS_S), states[-1])
    return {"plant": name, "world": world, "arm": arm, "seed": seed, "settings": settings, "stays": stays,
            "static": float(abs(np.mean(last(MEAN_S)))) if stays else math.inf,
            "rms": float(np.sqrt(np.mean(last(RMS_S)**2))) if stays else math.inf,
            "at_limit": float(np.mean(np.abs(inputs) > 0.999 * plant.limit)) if inputs.size else 0.0, **facts}


def key_of(name, world, arm, seed, settings):
    return name, world, arm, seed, json.dumps(settings, sort_keys=True)


def key_of_row(row):
    return key_of(row["plant"], row["world"], row["arm"], row["seed"], row["settings"])


def measure(asked, rows, wanted, what):
    wanted = [w for w in wanted if key_of(*w) not in rows]
    if not wanted:
        return
    note(f"{what}: {len(wanted)} runs to do")
    with open(asked.rows, "a", encoding="utf-8") as file, concurrent.futures.ProcessPoolExecutor(asked.jobs) as pool:
        going = [pool.submit(run, asked.build.resolve(), *w) for w in wanted]
        for count, done in enumerate(concurrent.futures.as_completed(going), 1):
            row = done.result()
            rows[key_of_row(row)] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            if count % 50 == 0:
                note(f"{what}: {count} of {len(wanted)}")


def tune(asked, rows, name, arm):
    """The settings that do best on the tuning seeds."""
    choices = SETTINGS[arm]
    if len(choices) == 1:
        return choices[0]
    seeds = range(FIRST_TUNING, FIRST_TUNING + (1 if arm == DO_MPC else asked.tuning_seeds))
    runs = [(name, world, arm, seed, s) for s in choices for world in WORLDS for seed in seeds]
    measure(asked, rows, runs, f"{name}, {arm}, tuning")
    score = lambda s: float(np.mean([math.log(rows[key_of(name, world, arm, seed, s)]["rms"])
                                     for world in WORLDS for seed in seeds]))
    best = min(choices, key=score)
    told = ", ".join(f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in best.items())
    print(f"  {arm}: {told}, by {len(seeds)} tuning seed{'s' * (len(seeds) > 1)} and {len(choices)} settings; RMS "
          f"{1e3 * math.exp(score(best)):.3g} {PLANTS[name].unit} in the worlds' geometric mean")
    return best


# ---- the table -------------------------------------------------------------------------------------


def ratio(ours, theirs):
    """(median over the seeds of both, how many)"""
    both = sorted(set(ours) & set(theirs))
    if not both:
        return None, 0
    of = [ours[s]["rms"] / theirs[s]["rms"] if math.isfinite(ours[s]["rms"]) else math.inf for s in both]
    return float(np.median(of)), len(both)


def tell(plant, heading, found, world, table):
    """`found`: arm -> seed -> row."""

    def goal(what, figure, unit, bound):
        table.append({"section": "pushed", "heading": f"{heading}, {world}", "row": what, "figure": figure,
                      "unit": unit, "goal": f"<= {bound:g}", "met": figure <= bound})

    for arm, of in found.items():
        rms, static = (1e3 * np.array([r[figure] for r in of.values()]) for figure in ("rms", "static"))
        steps = [r["step_ms"] for r in of.values() if "step_ms" in r]
        active = sum(r["state"] == "ACTIVE" and r["stays"] for r in of.values())
        print(f"  {world:<12} {arm:<12} RMS {np.median(rms):8.2f}   static {np.median(static):8.3f}, worst "
              f"{np.max(static):8.3f} {plant.unit:<5} ACTIVE {active} of {len(of)}"
              f"{f'   {np.median(steps):.0f} ms a step' if steps else ''}")
    ours = found.get(WITH)
    if not ours:
        return
    if world == CONSTANT:
        static, bound = [1e3 * r["static"] for r in ours.values()], 1e3 * plant.sensor_sd[plant.held]
        what = f"static error, median of {len(static)}; goal: the sensor's sd"
        goal(what, float(np.median(static)), plant.unit, bound)
        goal(f"static error, worst of {len(static)}", max(static), plant.unit, bound)
    today, count = ratio(ours, found.get(TODAY, {}))
    if count and world != CONSTANT:
        goal(f"RMS over today's, {count} seeds", today, "x", 1.01 if world == NONE else 0.6)
    peers = {arm: ratio(ours, found[arm]) for arm in (INTEGRATOR, L1, DO_MPC) if found.get(arm)}
    if peers and world != NONE:
        worst, (figure, count) = max(peers.items(), key=lambda p: p[1][0])
        goal(f"RMS over the best peer's, {worst}, {count} seeds", figure, "x", 1.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--peer-seeds", type=int, default=5)
    parser.add_argument("--tuning-seeds", type=int, default=2)
    parser.add_argument("--plant", action="append", choices=list(PLANTS))
    parser.add_argument("--world", action="append", choices=list(WORLDS))
    parser.add_argument("--arm", action="append", choices=ARMS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=pathlib.Path, default=HOME / "pushed.jsonl")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build/release")
    asked = parser.parse_args()
    if asked.first + asked.seeds > FIRST_TUNING:
        sys.exit(f"pushed: seeds from {FIRST_TUNING} on are for tuning")
    if not list((asked.build / "python_package/tiller").glob("_core*.so")):
        sys.exit("pushed: this build has no Python package (./dev build release tiller_python)")
    worlds, arms = asked.world or list(WORLDS), list(asked.arm or ARMS)
    if DO_MPC in arms and not need_environment("pushed"):
        print("do-mpc is not measured: it does not install here")
        arms.remove(DO_MPC)
    asked.rows.parent.mkdir(parents=True, exist_ok=True)
    rows, table = kept_rows(asked.rows, key_of_row), []
    seeds = list(range(asked.first, asked.first + asked.seeds))
    for name in asked.plant or PLANTS:
        print(f"{name}, {len(seeds)} seeds from {asked.first}")
        settings = {arm: tune(asked, rows, name, arm) for arm in arms}
        of = lambda arm: seeds[:asked.peer_seeds] if arm == DO_MPC else seeds
        measure(asked, rows, [(name, world, arm, seed, settings[arm]) for seed in seeds for world in worlds
                              for arm in arms if seed in of(arm)], name)
        for world in worlds:
            key = lambda arm, seed: key_of(name, world, arm, seed, settings[arm])
            found = {arm: {seed: rows[key(arm, seed)] for seed in of(arm)} for arm in arms}
            tell(PLANTS[name], name, found, world, table)
    summary(table)


if __name__ == "__main__":
    main()
