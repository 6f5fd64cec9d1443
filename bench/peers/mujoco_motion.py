"""Commands for the machines of mujoco_machine.py, and how strong an effect may be there, for mujoco_worlds.py."""

import math

import numpy as np
from mujoco_machine import PERIOD, PLANTS

SECONDS = 8.0
MOST_REACH = 2.4   # rad or m from rest

# kind: (where it sits, plants that can hide it; None: all)
KINDS = {
    "viscous_friction": "joint", "coulomb_friction": "joint", "stribeck_friction": "joint",
    "asymmetric_friction": "joint", "quadratic_drag": "joint", "load_friction": "motor", "lugre_friction": "joint",
    "linear_spring": "joint", "cubic_spring": "joint", "constant_offset": "joint", "cogging": "motor",
    "torque_ripple": "motor", "joint_inertia": "motor", "backlash": "motor", "actuator_gain": "input",
    "actuator_lag": "input", "input_delay": "input", "dead_zone": "input", "saturation": "input",
    "rate_limit": "input", "sensor_bias": "gravity_sensor", "sensor_scale": "gravity_sensor", "tilt": "gravity_body",
    "payload": "gravity_body", "square_spring": "joint", "hard_stop": "joint", "position_friction": "motor",
    "supply_sag": "input", "elastic_joint": "motor",
}

# ---- excitation ------------------------------------------------------------------------------------


class Excitation:
    """Commands of a run: sums of sines with steps, or a PD controller that follows a sum of sines."""

    def __init__(self, plant, nominal, kind, dice):
        self.facts, self.kind = PLANTS[plant], kind
        self.inertia, self.weight = effort(plant, nominal)
        self.size = 1.0
        self.tones = [[(dice.uniform(0.15, 1.0) * (2.2 if n else 1), dice.uniform(0, 2 * math.pi),
                        dice.uniform(0.4, 1.0) / (1 + n)) for n in range(4)] for _ in self.facts["motors"]]
        self.steps = [dice.uniform(-1, 1, size=16) for _ in self.facts["motors"]]
        # a drive's own limit: what turns unstable stays finite
        self.limit = [3 * (w + 60 * m * reach) for m, w, reach in zip(self.inertia, self.weight, self.facts["track"])]

    def wave(self, i, t):
        norm = sum(size for *_, size in self.tones[i])
        return sum(size * math.sin(2 * math.pi * hz * t + phase) for hz, phase, size in self.tones[i]) / norm

    def slope(self, i, t):
        return (self.wave(i, t + 1e-4) - self.wave(i, t - 1e-4)) / 2e-4

    def command(self, t, shown, rate):
        out = []
        for i, j in enumerate(self.facts["motors"]):
            reach = self.facts["track"][i] * self.size
            if self.kind == "open_loop":
                scale = self.size * max(self.weight[i], 3.0 * self.inertia[i] * reach)
                out.append(scale * (0.4 * self.wave(i, t) + 0.15 * self.steps[i][int(2 * t) % 16]))
            else:
                w = 2 * math.pi * 0.8
                gain = self.inertia[i] * w * w + self.weight[i]
                error = min(t, 1.0) * reach * self.wave(i, t) - (shown[j] - self.facts["rest"][j])
                out.append(gain * error + 1.4 * self.inertia[i] * w * (reach * self.slope(i, t) - rate[j]))
        return [min(max(u, -most), most) for u, most in zip(out, self.limit)]


def effort(plant, p):
    """Inertia and weight that each motor works against."""
    if plant == "pendulum":
        return [p["mass_kg"] * p["length_m"] ** 2], [0.9 * p["mass_kg"] * 9.81 * p["length_m"]]
    if plant == "cart_pole":
        return [p["cart_mass_kg"] + p["pole_mass_kg"]], [0.0]
    if plant == "linear_axis":
        return [p["mass_kg"]], [0.0]
    m1, m2, l1, l2 = (p[n] for n in ("upper_mass_kg", "lower_mass_kg", "upper_length_m", "lower_length_m"))
    return ([m1 * l1 * l1 / 3 + m2 * (l1 * l1 + l2 * l2 / 3), m2 * l2 * l2 / 3],
            [9.81 * (m1 * l1 / 2 + m2 * l1), 9.81 * m2 * l2 / 2])


def record(machine, excitation, noise_sd, dice):
    """Rows (time, shown, commands) and the true states of a run."""
    facts = machine.facts
    machine.reset(facts["rest"], [0.0] * len(facts["rest"]))
    rows, truth, last, rate = [], [], None, [0.0] * len(facts["states"])
    for k in range(round(SECONDS / PERIOD) + 1):
        shown = [q + noise_sd * dice.standard_normal() for q in machine.shown()]
        if last is not None:  # a filtered difference, as a drive's firmware takes it
            rate = [0.5 * r + 0.5 * (q - l) / PERIOD for r, q, l in zip(rate, shown, last)]
        last = shown
        if not all(abs(q - rest) < 20 for q, rest in zip(shown, facts["rest"])):
            return None, None  # it runs away
        command = excitation.command(k * PERIOD, shown, rate)
        rows.append((k * PERIOD, shown, command))
        truth.append((machine.position(), machine.velocity()))
        machine.period(command)
    return rows, truth


def rollout_r(bare, machine, rows, truth, noise_sd):
    """RMS over 1 s rollouts of the machine without its effects against what the sensors show with them."""
    points, squares, count = round(1 / PERIOD), 0.0, 0
    clean = shown_clean(machine, truth)
    for start in range(0, len(rows) - points, points):
        bare.reset(*truth[start])
        for k in range(start, start + points):
            bare.period(rows[k][2])
            for a, b in zip(bare.position(), clean[k + 1]):
                squares += (a - b) ** 2
                count += 1
    r = math.sqrt(squares / count) / noise_sd
    return r if math.isfinite(r) else 1e9


def shown_clean(machine, truth):
    out = []
    for q, _ in truth:
        q = list(q)
        for kind, port, e in machine.effects:
            if kind == "sensor_bias":
                q[port] += e["bias_SI"]
            elif kind == "sensor_scale":
                q[port] *= 1 + e["scale_error"]
        out.append(q)
    return out


def shrink(bare, excitation, noise_sd):
    """Makes the motion smaller until the plant without effects stays within reach: no joint turns over."""
    for _ in range(12):
        rows, states = record(bare, excitation, noise_sd, np.random.default_rng(0))
        if rows is not None and np.max(np.abs(np.array([q for q, _ in states]) - bare.facts["rest"])) < MOST_REACH:
            return
        excitation.size *= 0.75


# ---- effects ---------------------------------------------------------------------------------------


def typical(machine, excitation, noise_sd):
    """Sizes of a motion without effects, by joint and motor."""
    rows, truth = record(machine, excitation, noise_sd, np.random.default_rng(0))
    q = np.array([t[0] for t in truth])
    v = np.array([t[1] for t in truth])
    u = np.array([r[2] for r in rows])
    a = np.diff(v, axis=0) / PERIOD
    rms = lambda x: np.sqrt(np.mean(x ** 2, axis=0))
    return {"position": rms(q - np.array(machine.facts["rest"])), "reach": rms(q), "velocity": rms(v),
            "input": rms(u), "peak": np.abs(u).max(axis=0), "rate": rms(np.diff(u, axis=0) / PERIOD),
            "acceleration": rms(a)}


def inertia_at(plant, p, j):
    if plant == "cart_pole" and j == 1:
        return p["pole_mass_kg"] * p["half_length_m"] ** 2 * 4 / 3
    return effort(plant, p)[0][PLANTS[plant]["motors"].index(j)]


def make_effect(kind, port, s, t, plant, nominal, shape):
    """Parameters for a strength s of 0 to 1; `shape`: numbers in 0 .. 1 that are no strength."""
    facts = PLANTS[plant]
    j = port if KINDS[kind] in ("joint", "motor") else min(port, len(facts["joints"]) - 1)
    if kind in ("backlash", "elastic_joint") or KINDS[kind] == "input":
        j = facts["motors"][port]
    force = t["input"][facts["motors"].index(j)] if j in facts["motors"] else \
        inertia_at(plant, nominal, j) * t["acceleration"][j]
    v, q, inertia = t["velocity"][j], t["position"][j], inertia_at(plant, nominal, j)
    sign = 1 if shape[0] < 0.5 else -1
    pitch = (2 * math.pi / (5 + int(10 * shape[1]))) if facts["turns"][j] else q * (0.3 + 0.5 * shape[1])
    phase = 2 * math.pi * shape[2]
    friction = 0.7 * s * force
    if kind == "viscous_friction": return {"damping_SI": 0.7 * s * force / v}
    if kind == "coulomb_friction": return {"friction_SI": friction}
    if kind == "stribeck_friction":
        return {"friction_SI": 0.6 * friction, "stiction_extra_SI": friction * (0.4 + 0.6 * shape[1]),
                "stribeck_velocity_SI": v * (0.1 + 0.25 * shape[2])}
    if kind == "asymmetric_friction":
        low = friction * (0.1 + 0.4 * shape[1])
        return {"forward_SI": friction if sign > 0 else low, "backward_SI": low if sign > 0 else friction}
    if kind == "quadratic_drag": return {"drag_SI": 0.7 * s * force / v ** 2}
    if kind == "load_friction": return {"coefficient": 0.4 * s}
    if kind == "lugre_friction":
        return {"friction_SI": 0.6 * friction, "stiction_extra_SI": friction * (0.2 + 0.5 * shape[1]),
                "stribeck_velocity_SI": v * (0.1 + 0.25 * shape[2]),
                "bristle_stiffness_SI": friction / (q * (0.02 + 0.08 * shape[3])) + 1e-6}
    if kind == "linear_spring": return {"stiffness_SI": 0.8 * s * force / t["reach"][j]}
    if kind == "cubic_spring": return {"stiffness_SI3": 0.8 * s * force / t["reach"][j] ** 3}
    if kind == "constant_offset": return {"force_SI": sign * 0.7 * s * force}
    if kind == "cogging":
        return {"cosine_SI": 0.7 * s * force * math.cos(phase), "sine_SI": 0.7 * s * force * math.sin(phase),
                "spatial_period_SI": pitch}
    if kind == "torque_ripple":
        return {"cosine": 0.5 * s * math.cos(phase), "sine": 0.5 * s * math.sin(phase), "spatial_period_SI": pitch}
    if kind == "joint_inertia": return {"inertia_SI": 0.6 * s * inertia}
    if kind == "backlash":
        return {"gap_SI": 0.25 * s * q, "rotor_inertia_SI": inertia * (0.02 + 0.1 * shape[1])}
    if kind == "square_spring": return {"stiffness_SI2": 0.8 * s * force / t["reach"][j] ** 2}
    if kind == "hard_stop":
        stiffness = 8 * force / t["reach"][j]
        return {"position_SI": t["reach"][j] * (1.4 - (1.1 + 0.3 * shape[1]) * s), "stiffness_SI": stiffness,
                "damping_SI": 0.1 * math.sqrt(stiffness * inertia)}
    if kind == "position_friction":
        swing = friction * (0.4 + 0.5 * shape[3])
        return {"friction_SI": friction, "cosine_SI": swing * math.cos(phase), "sine_SI": swing * math.sin(phase),
                "spatial_period_SI": pitch}
    if kind == "supply_sag":
        return {"droop_per_SI": 1.5 * s / t["input"][port], "recovery_s": 0.2 + 0.8 * shape[1]}
    if kind == "elastic_joint":
        rotor = inertia * (0.03 + 0.2 * shape[1])
        soft = inertia * (2 * math.pi * (1.5 + shape[2])) ** 2 / s
        stiffness = min(soft, rotor * (2 * math.pi * 60) ** 2)
        return {"stiffness_SI": stiffness, "rotor_inertia_SI": rotor, "damping_SI": 0.1 * math.sqrt(stiffness * rotor)}
    if kind == "actuator_gain": return {"gain_error": sign * 0.4 * s}
    if kind == "actuator_lag": return {"time_constant_s": 0.15 * s}
    if kind == "input_delay": return {"delay_s": 0.1 * s}
    if kind == "dead_zone": return {"width_SI": 0.8 * s * t["input"][port]}
    if kind == "saturation": return {"limit_SI": t["peak"][port] * (1 - 0.8 * s)}
    if kind == "rate_limit": return {"rate_SI_s": t["rate"][port] * (3.0 - 2.7 * s)}
    if kind == "sensor_bias": return {"bias_SI": sign * 0.15 * s}
    if kind == "sensor_scale": return {"scale_error": sign * 0.15 * s}
    if kind == "tilt": return {"angle_rad": sign * 0.25 * s}
    return {"mass_kg": 0.6 * s * min(x for n, x in nominal.items() if n.endswith("_kg"))}


def ports_of(kind, plant):
    """[(index in the machine, name in the answer)] where the kind may sit."""
    facts, place = PLANTS[plant], KINDS[kind]
    joints = list(enumerate(facts["joints"]))
    if kind in ("linear_spring", "cubic_spring", "square_spring", "hard_stop"):  # the spring's zero is where the plant rests
        return [(i, n) for i, n in joints if facts["rest"][i] == 0]
    if place == "joint":
        return joints
    if kind in ("backlash", "elastic_joint"):
        return [(k, facts["inputs"][k]) for k, j in enumerate(facts["motors"])]
    if place == "motor":
        return [(j, facts["joints"][j]) for j in facts["motors"]]
    if place == "input":
        return list(enumerate(facts["inputs"]))
    gravity = [(i, n) for i, n in enumerate(facts["states"]) if facts["gravity"][i]]
    if place == "gravity_sensor":
        return gravity
    return [(0, "body")] if gravity else []
