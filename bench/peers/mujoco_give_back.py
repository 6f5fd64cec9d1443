"""A MuJoCo arm that is tuned otherwise than its MJCF says, for bench/drivers/give_back.py.

    mujoco_give_back.py record MJCF SEED FOLDER     log_1.csv .. log_4.csv, sealed/truth.json and sealed/states.npz
    mujoco_give_back.py judge FOLDER MJCF..         a line of JSON for each MJCF

The tuned arm has dry friction at one joint, more damping at a second and a weaker drive at a third, drawn by the seed. A
joint-space PD controller with the MJCF's own gravity compensation follows sums of sines; positions have 0.5 mrad of noise.

Judged: rollouts in MuJoCo of 1 s from the tuned arm's true states under its commands, RMS over joints in sensor deviations.
"""

import json
import math
import pathlib
import sys

import mujoco
import numpy as np

STEP, PERIOD, SECONDS, LOGS, HELD_OUT = 1e-3, 0.01, 10.0, 4, 1
PER_PERIOD, NOISE_RAD, REACH_RAD = round(PERIOD / STEP), 5e-4, 0.7


def load(mjcf):
    m = mujoco.MjModel.from_xml_path(str(mjcf))
    m.opt.timestep, m.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return m


def tune(m, dice):
    """Changes of three joints, by what was hidden."""
    most = m.actuator_ctrlrange[:, 1]
    dry, damped, weak = dice.permutation(m.nv - 1)[:3]  # the last joint hardly moves anything
    friction, damping, gain = dice.uniform(0.01, 0.03) * most[dry], dice.uniform(0.01, 0.04) * most[damped], dice.uniform(0.85, 0.95)
    m.dof_frictionloss[dry] += friction
    m.dof_damping[damped] += damping
    m.actuator_gainprm[weak, 0] *= gain
    # friction that hardly gives way: MuJoCo's own defaults let it creep
    m.dof_solref[:], m.dof_solimp[:, :3] = [2.5 * STEP, 1.0], [0.95, 0.999, 1e-4]
    return {"coulomb_friction": [m.joint(int(dry)).name, friction], "viscous_friction": [m.joint(int(damped)).name, damping],
            "actuator_gain": [m.joint(int(weak)).name, gain - 1]}


def period(m, d, command):
    d.ctrl[:] = command
    for _ in range(PER_PERIOD):
        mujoco.mj_step(m, d)


def rest_of(m):
    """The middle of each joint's range, or 0 where that is inside of it."""
    low, high = m.jnt_range.T
    return np.where((low < -0.3) & (high > 0.3), 0.0, 0.5 * (low + high))


def record(mjcf, seed, folder):
    dice = np.random.default_rng(seed)
    nominal, m = load(mjcf), load(mjcf)
    truth, rest = tune(m, dice), rest_of(m)
    wanted_of, d = mujoco.MjData(nominal), mujoco.MjData(m)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sealed").mkdir(exist_ok=True)
    joints, kept = [m.joint(k).name for k in range(m.njnt)], []
    header = ["time_s", *(f"{j}_rad" for j in joints), *(f"{j}_Nm" for j in joints)]
    for log in range(1, LOGS + HELD_OUT + 1):
        tones = [[(dice.uniform(0.1, 0.8), dice.uniform(0, 2 * math.pi), dice.uniform(0.4, 1)) for _ in range(4)] for _ in joints]
        place = lambda t: rest + REACH_RAD * min(max(t, 0.0), 1.0) * np.array(
            [sum(a * math.sin(2 * math.pi * hz * t + phase) for hz, phase, a in of) / 2.8 for of in tones])
        mujoco.mj_resetData(m, d)
        d.qpos[:] = rest
        rows, states, last, rate = [], [], None, np.zeros(m.nv)
        for k in range(round(SECONDS / PERIOD) + 1):
            t = k * PERIOD
            shown = d.qpos + NOISE_RAD * dice.standard_normal(m.nq)
            rate = rate if last is None else 0.6 * rate + 0.4 * (shown - last) / PERIOD  # as a drive's firmware takes it
            last = shown
            wanted_of.qpos[:], wanted_of.qvel[:] = place(t), (place(t + 1e-4) - place(t - 1e-4)) / 2e-4
            mujoco.mj_forward(nominal, wanted_of)
            inertia, w = np.zeros((m.nv, m.nv)), 2 * math.pi * 1.5
            mujoco.mj_fullM(nominal, wanted_of, inertia)
            command = wanted_of.qfrc_bias + inertia @ (w * w * (wanted_of.qpos - shown) + 1.6 * w * (wanted_of.qvel - rate))
            command = np.clip(command, *m.actuator_ctrlrange.T)
            rows.append([t, *shown, *command])
            states.append([*d.qpos, *d.qvel, *command])
            period(m, d, command)
        if log <= LOGS:
            text = "\n".join([",".join(header), *(",".join(f"{v:.9g}" for v in row) for row in rows)])
            (folder / f"log_{log}.csv").write_text(text + "\n", encoding="utf-8")
        else:
            kept.append(states)
    np.savez(folder / "sealed/states.npz", kept=np.array(kept))
    (folder / "sealed/truth.json").write_text(json.dumps(truth), encoding="utf-8")


def judge(folder, mjcf):
    m = load(mjcf)
    d, n, points = mujoco.MjData(m), m.nv, round(1 / PERIOD)
    m.dof_solref[:], m.dof_solimp[:, :3] = [2.5 * STEP, 1.0], [0.95, 0.999, 1e-4]
    squares = []
    for states in np.load(folder / "sealed/states.npz")["kept"]:
        for start in range(0, len(states) - points, points):
            mujoco.mj_resetData(m, d)
            d.qpos[:], d.qvel[:] = states[start][:n], states[start][n:2 * n]
            for k in range(start, start + points):
                period(m, d, states[k][2 * n:])
                squares.append((d.qpos - states[k + 1][:n]) ** 2)
    return {"file": str(mjcf), "rms_rad": float(np.sqrt(np.mean(squares))), "sigma": float(np.sqrt(np.mean(squares)) / NOISE_RAD)}


if __name__ == "__main__":
    if sys.argv[1] == "record":
        record(sys.argv[2], int(sys.argv[3]), pathlib.Path(sys.argv[4]))
    else:
        for name in sys.argv[3:]:
            print(json.dumps(judge(pathlib.Path(sys.argv[2]), name)), flush=True)
