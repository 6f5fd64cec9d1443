"""An arm of a URDF with one hidden effect, moved by MuJoCo, for bench/drivers/robots_gap.py.

    mujoco_arm_worlds.py < cases.jsonl

A case is one line: {"id", "folder", "urdf", "kind", "joint", "seed"}; kind null hides nothing. `folder` gets log_1.csv ..
log_4.csv and sealed/case.json; a line {"id", "r", "error"} answers. The engine is MuJoCo's, with its own friction
constraint, damping, armature and springs; an amplifier's gain and lag act between command and qfrc_applied, once in every
physics step. A joint-space PD controller with MuJoCo's own gravity compensation follows sums of sines.

r: 1 s rollouts without the effect from the true states under the same commands, RMS deviation in sensor deviations.
A strength is drawn, and grows by half until r reaches LEAST_R.
"""

import json
import math
import pathlib
import sys

import mujoco
import numpy as np
from mujoco_robot import identifier, load

STEP, PERIOD, SECONDS, LOGS = 1e-3, 0.01, 10.0, 4
PER_PERIOD = round(PERIOD / STEP)
NOISE_RAD = 5e-4        # as `tiller import` writes it into [measurement]
ARMATURE_KGM2 = 0.1     # rotors behind their gears, known; the import is told the same
LEAST_R = 3.0
# where the arm moves about, and how far, rad
REST = [0.2, -1.1, 1.2, -0.6, 0.9, 0.3]
REACH = [1.0, 0.5, 0.7, 1.0, 1.0, 1.2]
# kind: where it sits, its parameter, its least and most strength; "effort" times the joint's largest torque
KINDS = {
    "viscous_friction": ("joint", "damping_SI", "effort", 0.005, 0.05),
    "coulomb_friction": ("joint", "friction_SI", "effort", 0.005, 0.05),
    "linear_spring": ("joint", "stiffness_SI", "effort", 0.005, 0.05),
    "joint_inertia": ("joint", "inertia_SI", "", 0.05, 0.5),
    "actuator_gain": ("input", "gain_error", "signed", 0.05, 0.25),
    "actuator_lag": ("input", "time_constant_s", "", 0.02, 0.08),
}


class Arm:
    def __init__(self, urdf, effect=None):
        self.model = m = load(urdf)
        self.joints = [identifier(m.joint(k).name) for k in range(m.njnt)]
        self.effect = effect
        m.opt.timestep, m.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
        m.opt.gravity[:] = 0.0, 0.0, -9.81
        m.opt.iterations, m.opt.tolerance = 50, 1e-12
        m.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        m.dof_armature[:], m.dof_damping[:], m.dof_frictionloss[:] = ARMATURE_KGM2, 0.0, 0.0
        m.dof_solref[:] = [2.5e-3, 1.0]
        m.dof_solimp[:, :3] = [0.95, 0.999, 1e-4]
        self.data, self.drive = mujoco.MjData(m), mujoco.MjData(m)
        if effect is not None:
            kind, j, value = effect
            if kind == "viscous_friction":
                m.dof_damping[j] = value
            elif kind == "coulomb_friction":
                m.dof_frictionloss[j] = value
            elif kind == "joint_inertia":
                m.dof_armature[j] += value
            elif kind == "linear_spring":
                m.jnt_stiffness[j] = value

    def reset(self, q, v, force=None):
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q, v
        self.force = np.zeros(self.model.nv) if force is None else np.array(force)

    def period(self, command):
        for _ in range(PER_PERIOD):
            force = np.array(command)
            if self.effect is not None:
                kind, j, value = self.effect
                if kind == "actuator_gain":
                    force[j] *= 1 + value
                elif kind == "actuator_lag":
                    force[j] = self.force[j] - (force[j] - self.force[j]) * math.expm1(-STEP / value)
            self.force = force
            self.data.qfrc_applied[:] = force
            mujoco.mj_step(self.model, self.data)


class Controller:
    """Follows sums of sines by what the arm without effect would need at the wanted place, and a PD law."""

    def __init__(self, urdf, dice):
        self.nominal = Arm(urdf)
        joints = len(self.nominal.joints)
        self.tones = [[(dice.uniform(0.1, 0.35) * (2.2 if n > 1 else 1), dice.uniform(0, 2 * math.pi),
                        dice.uniform(0.4, 1.0) / (1 + 0.5 * n)) for n in range(4)] for _ in range(joints)]

    def wanted(self, t):
        """Positions and speeds; the first second leads in from rest."""
        at = lambda s: np.array([REST[j] + min(max(s, 0.0), 1.0) * REACH[j] *
                                 sum(a * math.sin(2 * math.pi * hz * s + phase) for hz, phase, a in tones) /
                                 sum(a for *_, a in tones) for j, tones in enumerate(self.tones)])
        return at(t), (at(t + 1e-4) - at(t - 1e-4)) / 2e-4

    def command(self, t, shown, rate):
        m, d = self.nominal.model, self.nominal.data
        q, v = self.wanted(t)
        d.qpos[:], d.qvel[:] = q, v
        mujoco.mj_forward(m, d)
        inertia = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, inertia)
        w = 2 * math.pi * 0.8
        return d.qfrc_bias + inertia @ (w * w * (q - shown) + 1.6 * w * (v - rate))


def record(arm, controller, dice):
    """Rows (time, shown, command) and the true states and drive forces of a run."""
    arm.reset(REST, np.zeros(len(REST)), controller.command(0.0, np.array(REST), np.zeros(len(REST))))
    rows, truth, last, rate = [], [], None, np.zeros(len(REST))
    for k in range(round(SECONDS / PERIOD) + 1):
        shown = arm.data.qpos + NOISE_RAD * dice.standard_normal(len(REST))
        if last is not None:  # a filtered difference, as a drive's firmware takes it
            rate = 0.6 * rate + 0.4 * (shown - last) / PERIOD
        last = shown
        command = controller.command(k * PERIOD, shown, rate)
        rows.append((k * PERIOD, shown, command))
        truth.append((arm.data.qpos.copy(), arm.data.qvel.copy(), arm.force.copy()))
        arm.period(command)
        if not np.all(np.abs(arm.data.qpos) < 6.0):
            raise ValueError("the arm runs away")
    return rows, truth


def rollout_r(bare, rows, truth):
    points, squares, count = round(1 / PERIOD), 0.0, 0
    for start in range(0, len(rows) - points, points):
        bare.reset(*truth[start])
        for k in range(start, start + points):
            bare.period(rows[k][2])
            squares += float(np.sum((bare.data.qpos - truth[k + 1][0]) ** 2))
            count += len(REST)
    r = math.sqrt(squares / count) / NOISE_RAD
    return r if math.isfinite(r) else 1e9


def strength(arm, kind, j, dice):
    _, _, scale, low, high = KINDS[kind]
    value = math.exp(dice.uniform(math.log(low), math.log(high)))
    if scale == "effort":
        value *= float(arm.efforts[j])
    return value * (dice.choice([-1.0, 1.0]) if scale == "signed" else 1.0)


def make_case(case):
    dice = np.random.default_rng([case["seed"], *case["id"].encode()])
    bare, kind, j = Arm(case["urdf"]), case["kind"], case["joint"]
    bare.efforts = case["efforts"]
    controllers = [Controller(case["urdf"], dice) for _ in range(LOGS)]
    value, r, runs = 0.0, 0.0, []
    if kind is None:
        runs = [record(bare, c, dice) for c in controllers]
    else:
        value = strength(bare, kind, j, dice)
        while True:
            arm = Arm(case["urdf"], (kind, j, value))
            first = record(arm, controllers[0], dice)
            r = rollout_r(bare, *first)
            if r >= LEAST_R:
                break
            value *= 1.5
        runs = [first] + [record(arm, c, dice) for c in controllers[1:]]
    folder = pathlib.Path(case["folder"])
    (folder / "sealed").mkdir(parents=True, exist_ok=True)
    names = [f"{n}_rad" for n in bare.joints] + [f"{n}_Nm" for n in bare.joints]
    for k, (rows, _) in enumerate(runs):
        lines = [",".join(["time_s", *names])] + [",".join(f"{x:.9g}" for x in (t, *q, *u)) for t, q, u in rows]
        (folder / f"log_{k + 1}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    effects = []
    if kind is not None:
        where = bare.joints[j] + ("_Nm" if KINDS[kind][0] == "input" else "")
        effects = [{"kind": kind, "port": where, "parameters": {KINDS[kind][1]: value}}]
    (folder / "sealed/case.json").write_text(json.dumps({"r": r, "effects": effects}, indent=1), encoding="utf-8")
    return r


def main():
    mujoco.set_mju_user_warning(lambda text: None)  # a run that goes wrong is told in its answer
    for line in sys.stdin:
        case = json.loads(line)
        try:
            answer = {"id": case["id"], "r": make_case(case), "error": ""}
        except (ValueError, mujoco.FatalError, ArithmeticError) as error:
            answer = {"id": case["id"], "r": None, "error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
