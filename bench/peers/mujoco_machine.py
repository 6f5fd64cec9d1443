"""Plants with effects in MuJoCo, for mujoco_worlds.py: friction is MuJoCo's own constraint, play a second body between
two stops, lag MuJoCo's activation. What MuJoCo lacks acts through qfrc_applied, once in every physics step."""

import math

import mujoco
import numpy as np

STEP = 5e-4        # of the physics
PERIOD = 0.01      # of commands and rows
PER_PERIOD = round(PERIOD / STEP)

# joint names as in the robot file's model, excursion wanted, and whether gravity depends on the position
PLANTS = {
    "pendulum": {"states": ["angle_rad"], "rates": ["rate_rad_s"], "inputs": ["torque_Nm"], "joints": ["joint"],
                 "motors": [0], "turns": [True], "gravity": [True], "rest": [0.0], "track": [1.4]},
    "cart_pole": {"states": ["position_m", "angle_rad"], "rates": ["velocity_m_s", "rate_rad_s"],
                  "inputs": ["force_N"], "joints": ["cart", "pole"], "motors": [0], "turns": [False, True],
                  "gravity": [False, True], "rest": [0.0, math.pi], "track": [0.6]},
    "two_link_arm": {"states": ["shoulder_rad", "elbow_rad"], "rates": ["shoulder_rad_s", "elbow_rad_s"],
                     "inputs": ["shoulder_Nm", "elbow_Nm"], "joints": ["shoulder", "elbow"], "motors": [0, 1],
                     "turns": [True, True], "gravity": [True, True], "rest": [0.0, 0.0], "track": [1.0, 1.2]},
    "linear_axis": {"states": ["position_m"], "rates": ["velocity_m_s"], "inputs": ["force_N"], "joints": ["axis"],
                    "motors": [0], "turns": [False], "gravity": [False], "rest": [0.0], "track": [0.3]},
}

def draw_parameters(plant, dice):
    """(nominal values, true values, priors as written): masses are weighed, lengths measured exactly."""
    low_high = {
        "pendulum": {"mass_kg": (0.25, 0.9), "length_m": (0.3, 0.7)},
        "cart_pole": {"cart_mass_kg": (0.6, 1.6), "pole_mass_kg": (0.1, 0.3), "half_length_m": (0.25, 0.6)},
        "two_link_arm": {"upper_mass_kg": (0.8, 1.5), "lower_mass_kg": (0.4, 1.0), "upper_length_m": (0.3, 0.5),
                         "lower_length_m": (0.3, 0.5)},
        "linear_axis": {"mass_kg": (2.0, 20.0)},
    }[plant]
    nominal, truth, priors = {}, {}, {}
    for name, (low, high) in low_high.items():
        value = float(f"{math.exp(dice.uniform(math.log(low), math.log(high))):.4g}")
        nominal[name] = truth[name] = value
        priors[name] = f"{value:g}"
        if name.endswith("_kg"):
            off = float(np.clip(0.025 * dice.standard_normal(), -0.05, 0.05))
            truth[name] = value * (1 + off)
            priors[name] = (f"{{ normal = [{value:g}, {0.025 * value:g}], low = {0.9 * value:g}, "
                            f"high = {1.1 * value:g} }}")
    if plant == "two_link_arm":
        for values in (nominal, truth):
            for link in ("upper", "lower"):
                values[f"{link}_com_m"] = 0.5 * values[f"{link}_length_m"]
                values[f"{link}_inertia_kgm2"] = nominal[f"{link}_mass_kg"] * values[f"{link}_length_m"] ** 2 / 12
        for name, value in nominal.items():
            priors.setdefault(name, f"{value:.12g}")
    return nominal, truth, priors


def point(at, mass):
    return f'<body pos="0 0 {at!r}"><inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-12 1e-12 1e-12"/></body>'


def joint(name, kind, axis, play, child):
    """The joint, or a rotor on a motor's joint and the joint's own way from it: between two stops, or on a spring."""
    plain = f'<joint name="{name}" type="{kind}" axis="{axis}" armature="0"/>'
    if play is None:
        return f'<body>{plain}{child}</body>'
    if "gap_SI" in play:
        held = (f'limited="true" range="{-play["gap_SI"] / 2!r} {play["gap_SI"] / 2!r}" solreflimit="0.002 1" '
                'solimplimit="0.99 0.999 0.0001"')
    else:
        held = f'stiffness="{play["stiffness_SI"]!r}" damping="{play["damping_SI"]!r}"'
    return (f'<body><joint name="{name}" type="{kind}" axis="{axis}" armature="{play["rotor_inertia_SI"]!r}"/>'
            f'<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>'
            f'<body><joint name="{name}_play" type="{kind}" axis="{axis}" {held}/>{child}</body></body>')


def mjcf(plant, p, options):
    """The model: angles as in the robot file's model, counter-clockwise seen with x to the right and z up."""
    play = options.get("play", {})
    tip = options.get("payload", 0.0)
    # a positive angle about -y turns down towards +x; the cart's rod leans towards +x about +y
    if plant == "pendulum":
        child = (f'<inertial pos="0 0 {-p["length_m"]!r}" mass="{p["mass_kg"] + tip!r}" '
                 'diaginertia="1e-12 1e-12 1e-12"/>')
        body = joint("joint", "hinge", "0 -1 0", play.get(0), child)
    elif plant == "linear_axis":
        child = (f'<inertial pos="0 0 0" mass="{p["mass_kg"] + tip!r}" diaginertia="1e-3 1e-3 1e-3"/>')
        body = joint("axis", "slide", "1 0 0", play.get(0), child)
    elif plant == "cart_pole":
        h, m = p["half_length_m"], p["pole_mass_kg"]
        pole = (f'<body><joint name="pole" type="hinge" axis="0 1 0"/><inertial pos="0 0 {h!r}" mass="{m!r}" '
                f'diaginertia="{m * h * h / 3!r} {m * h * h / 3!r} 1e-9"/>{point(2 * h, tip) if tip else ""}</body>')
        child = f'<inertial pos="0 0 0" mass="{p["cart_mass_kg"]!r}" diaginertia="1e-3 1e-3 1e-3"/>{pole}'
        body = joint("cart", "slide", "1 0 0", play.get(0), child)
    else:
        def link(name, rest):
            m, com, i = p[f"{name}_mass_kg"], p[f"{name}_com_m"], p[f"{name}_inertia_kgm2"]
            return f'<inertial pos="0 0 {-com!r}" mass="{m!r}" diaginertia="{i!r} {i!r} 1e-9"/>{rest}'
        lower = link("lower", point(-p["lower_length_m"], tip) if tip else "")
        elbow = joint("elbow", "hinge", "0 -1 0", play.get(1), lower)
        upper = link("upper", f'<body pos="0 0 {-p["upper_length_m"]!r}">{elbow[6:]}')
        body = joint("shoulder", "hinge", "0 -1 0", play.get(0), upper)
    angle = options.get("tilt", 0.0)
    gx, gz = 9.81 * math.sin(angle), -9.81 * math.cos(angle)
    lags = options.get("lag", {})
    motors = ""
    for k, j in enumerate(PLANTS[plant]["motors"]):
        lag = f' dyntype="filter" dynprm="{lags[k]!r}"' if k in lags else ""
        motors += f'<general joint="{PLANTS[plant]["joints"][j]}" gear="1"{lag}/>'
    return (f'<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/>'
            f'<option timestep="{STEP!r}" integrator="RK4" gravity="{gx!r} 0 {gz!r}" '
            'iterations="50" tolerance="1e-12"/>'
            f'<worldbody>{body}</worldbody><actuator>{motors}</actuator></mujoco>')


class Machine:
    """A plant with its effects: [(kind, port, parameters)]."""

    def __init__(self, plant, parameters, effects):
        self.facts = PLANTS[plant]
        self.effects = effects
        options = {"play": {}, "lag": {}}
        for kind, port, e in effects:
            if kind in ("backlash", "elastic_joint"):
                options["play"][self.facts["motors"][port]] = e
            elif kind == "payload":
                options["payload"] = e["mass_kg"]
            elif kind == "tilt":
                options["tilt"] = e["angle_rad"]
            elif kind == "actuator_lag":
                options["lag"][port] = e["time_constant_s"]
        self.model = mujoco.MjModel.from_xml_string(mjcf(plant, parameters, options))
        self.data = mujoco.MjData(self.model)
        self.address = [self.model.joint(n).qposadr[0] for n in self.facts["joints"]]
        self.dof = [self.model.joint(n).dofadr[0] for n in self.facts["joints"]]
        # of the joint's own motion: the rotor's, and where there is play the way in the gap on top
        self.parts = [[a, self.model.joint(n + "_play").qposadr[0]] if j in options["play"] else [a]
                      for j, (a, n) in enumerate(zip(self.address, self.facts["joints"]))]
        self.load_dof = [part[-1] for part in self.parts]
        self.native()

    def native(self):
        """Effects that MuJoCo has by itself."""
        m = self.model
        m.dof_solref[:] = [1.2e-3, 1.0]
        m.dof_solimp[:, :3] = [0.95, 0.999, 1e-4]
        for kind, port, e in self.effects:
            d = self.load_dof[port] if port < len(self.load_dof) else 0
            if kind == "viscous_friction":
                m.dof_damping[d] = e["damping_SI"]
            elif kind == "coulomb_friction":
                m.dof_frictionloss[d] = e["friction_SI"]
            elif kind == "joint_inertia":
                m.dof_armature[d] = e["inertia_SI"]
            elif kind == "linear_spring":
                m.jnt_stiffness[d] = e["stiffness_SI"]

    def reset(self, position, velocity):
        mujoco.mj_resetData(self.model, self.data)
        for part, d, q, v in zip(self.parts, self.dof, position, velocity):
            self.data.qpos[part[0]] = q
            self.data.qvel[d] = v
        self.bristle = {}
        self.slow = [0.0] * len(self.facts["motors"])
        self.load = [0.0] * len(self.facts["motors"])
        self.past = [[] for _ in self.facts["motors"]]

    def position(self):
        return [sum(self.data.qpos[a] for a in part) for part in self.parts]

    def velocity(self):
        return [sum(self.data.qvel[a] for a in part) for part in self.parts]

    def shown(self):
        """Readings of the encoders, without noise."""
        q = self.position()
        for kind, port, e in self.effects:
            if kind == "sensor_bias":
                q[port] += e["bias_SI"]
            elif kind == "sensor_scale":
                q[port] *= 1 + e["scale_error"]
        return q

    def drive(self, command):
        """The motors' forces in the next physics step."""
        out = list(command)
        for kind, port, e in self.effects:
            if kind == "input_delay":
                steps = e["delay_s"] / STEP
                self.past[port].append(command[port])
                line = self.past[port]
                whole = int(steps)
                back = lambda n: line[-1 - n] if n < len(line) else 0.0
                out[port] = (1 - (steps - whole)) * back(whole) + (steps - whole) * back(whole + 1)
            elif kind == "dead_zone":
                out[port] = math.copysign(max(abs(out[port]) - e["width_SI"], 0.0), out[port])
            elif kind == "saturation":
                out[port] = min(max(out[port], -e["limit_SI"]), e["limit_SI"])
            elif kind == "actuator_gain":
                out[port] *= 1 + e["gain_error"]
            elif kind == "rate_limit":
                most = e["rate_SI_s"] * STEP
                change = min(max(out[port] - self.slow[port], -most), most)
                out[port] = self.slow[port] + 0.5 * change  # the step has the force of its middle
                self.slow[port] += change
            elif kind == "supply_sag":
                self.load[port] += (abs(out[port]) - self.load[port]) * -math.expm1(-STEP / e["recovery_s"])
                out[port] /= 1 + e["droop_per_SI"] * self.load[port]
        return out

    def applied(self, forces):
        """Forces that MuJoCo has not, on the joints: constant over a step, so those of its middle."""
        v = self.velocity()
        q = [a + 0.5 * STEP * b for a, b in zip(self.position(), v)]
        total = [0.0] * len(q)
        for kind, port, e in self.effects:
            if kind == "constant_offset":
                total[port] += e["force_SI"]
            elif kind == "quadratic_drag":
                total[port] -= e["drag_SI"] * abs(v[port]) * v[port]
            elif kind == "cubic_spring":
                total[port] -= e["stiffness_SI3"] * q[port] ** 3
            elif kind == "square_spring":
                total[port] -= e["stiffness_SI2"] * q[port] * abs(q[port])
            elif kind == "hard_stop":
                into = q[port] - e["position_SI"]
                if into > 0:
                    total[port] -= max(e["stiffness_SI"] * into + e["damping_SI"] * v[port], 0.0)
            elif kind == "position_friction":
                a = 2 * math.pi * q[port] / e["spatial_period_SI"]
                self.model.dof_frictionloss[self.load_dof[port]] = max(
                    e["friction_SI"] + e["cosine_SI"] * math.cos(a) + e["sine_SI"] * math.sin(a), 0.0)
            elif kind in ("cogging", "torque_ripple"):
                a = 2 * math.pi * q[port] / e["spatial_period_SI"]
                if kind == "cogging":
                    total[port] += e["cosine_SI"] * math.cos(a) + e["sine_SI"] * math.sin(a)
                else:
                    total[port] += forces[self.facts["motors"].index(port)] * (e["cosine"] * math.cos(a) + e["sine"] * math.sin(a))
            elif kind == "stribeck_friction":
                slow = math.exp(-(v[port] / e["stribeck_velocity_SI"]) ** 2)
                self.model.dof_frictionloss[self.load_dof[port]] = e["friction_SI"] + e["stiction_extra_SI"] * slow
            elif kind == "asymmetric_friction":
                self.model.dof_frictionloss[self.load_dof[port]] = e["forward_SI" if v[port] > 0 else "backward_SI"]
            elif kind == "load_friction":
                motor = self.facts["motors"].index(port)
                self.model.dof_frictionloss[self.load_dof[port]] = e["coefficient"] * abs(forces[motor])
            elif kind == "lugre_friction":
                total[port] += self.bristles(port, e, v[port])
        return total

    def bristles(self, port, e, v):
        """Force of the bristles, brought forward over the step in ten parts."""
        z, stiffness = self.bristle.get(port, 0.0), e["bristle_stiffness_SI"]
        level = e["friction_SI"] + e["stiction_extra_SI"] * math.exp(-(v / e["stribeck_velocity_SI"]) ** 2)
        for _ in range(10):
            z += 0.1 * STEP * (v - stiffness * abs(v) * z / level)
        self.bristle[port] = z
        return -stiffness * z

    def period(self, command):
        """Brings the plant forward over one control period."""
        for _ in range(PER_PERIOD):
            forces = self.drive(command)
            self.data.ctrl[:] = forces
            if self.effects:
                for d, f in zip(self.load_dof, self.applied(forces)):
                    self.data.qfrc_applied[d] = f
            mujoco.mj_step(self.model, self.data)
