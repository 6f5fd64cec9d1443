"""arm_judge.py URDF FRAME poses SEED COUNT   poses of a frame within reach, a JSON line each: position, rpy, rotation
arm_judge.py URDF FRAME judge LOG GOALS     how far the frame was from each goal at its end, by MuJoCo's kinematics

LOG is a CSV of `tiller run`, GOALS the lines that `poses` printed with "end_s" added. Readings of the encoders over the
last ten ticks before a goal ends are averaged.
"""

import csv
import json
import sys

import mujoco
import numpy as np

from mujoco_robot import load

START = {"panda_joint4": -1.5708, "panda_joint6": 1.8675}
SPAN_RAD = 0.6  # of each joint about the start


def pose(model, data, body, joints, position):
    for name, value in zip(joints, position):
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    return data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()


def main():
    model = load(sys.argv[1])
    data = mujoco.MjData(model)
    body = model.body(sys.argv[2]).id
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    if sys.argv[3] == "poses":
        rng = np.random.default_rng(int(sys.argv[4]))
        for _ in range(int(sys.argv[5])):
            at = [np.clip(START.get(name, 0.0) + rng.uniform(-SPAN_RAD, SPAN_RAD), *(0.95 * model.joint(name).range))
                  for name in joints]
            p, r = pose(model, data, body, joints, at)
            rpy = [np.arctan2(r[2, 1], r[2, 2]), np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0])), np.arctan2(r[1, 0], r[0, 0])]
            print(json.dumps({"position": p.tolist(), "rpy": [float(v) for v in rpy], "rotation": r.tolist()}))
        return
    rows = list(csv.DictReader(open(sys.argv[4], encoding="utf-8")))
    time = np.array([float(row["time_s"]) for row in rows])
    read = np.array([[float(row[f"{name}_rad"] or "nan") for name in joints] for row in rows])
    for line in open(sys.argv[5], encoding="utf-8"):
        goal = json.loads(line)
        last = np.flatnonzero(time < goal["end_s"] - 1e-6)[-10:]
        p, r = pose(model, data, body, joints, np.nanmean(read[last], axis=0))
        apart = np.linalg.norm(r - np.array(goal["rotation"])) / np.sqrt(8.0)
        print(json.dumps({"m": float(np.linalg.norm(p - goal["position"])), "rad": float(2 * np.arcsin(min(1.0, apart)))}))


main()
