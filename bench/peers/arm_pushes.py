"""arm_pushes.py URDF FRAME ARMATURE   how soon pushes on an arm can be told at all, by the lemma of Neyman and Pearson.

Reads JSON lines {"payload_kg": .., "push_Nm": [..], "at": [[joint angles] of each push], "sensor_rad": ..,
"period_s": .., "process_sd": [rad/s per root of a second], "alarms_an_hour": ..}; push i is at joint i. Answers with
lines {"known": [..], "walking": [..]}: the mean number of periods, from a push's start to the first reading that tells
it, below which no test of that rate of false alarms can come. `known`: encoders alone are noisy; inertia, load, motors
and the state at the start are known, and so is the push but for when it comes, at which joint and which way. `walking`:
rates walk besides, with process_sd, and a Kalman filter knows that.
"""

import json
import statistics
import sys

import numpy as np
import pinocchio as pin

MOST = 60  # periods
NORMAL = statistics.NormalDist()


def arm(urdf, frame, armature, payload_kg):
    whole = pin.buildModelFromUrdf(urdf)
    model = pin.buildReducedModel(whole, [whole.getJointId(n) for n in whole.names if "finger" in n], pin.neutral(whole))
    at = model.frames[model.getFrameId(frame)]
    radius_m = (payload_kg / (7850.0 * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)  # a ball of steel, as the plant's
    if payload_kg > 0.0:
        model.appendBodyToJoint(at.parentJoint, pin.Inertia.FromSphere(payload_kg, radius_m), at.placement)
    model.armature[:] = armature
    return model


def signals(acceleration, period_s):
    """What a push adds to the angles, by period and joint."""
    return 0.5 * (np.arange(1, MOST + 1)[:, None] * period_s) ** 2 * acceleration


def innovations(signal, period_s, sensor_rad, process_sd):
    """What of it is left over the predictions of a steady filter, in their deviations."""
    move, gain = np.array([[1.0, period_s], [0.0, 1.0]]), np.zeros(2)
    walk = process_sd**2 * np.array([[period_s**3 / 3.0, period_s**2 / 2.0], [period_s**2 / 2.0, period_s]])
    spread = np.diag([sensor_rad**2, 1.0])
    for _ in range(2000):
        spread = move @ spread @ move.T + walk
        size = spread[0, 0] + sensor_rad**2
        gain = spread[:, 0] / size
        spread = spread - np.outer(gain, gain) * size
    state, left = np.zeros(2), []
    for value in signal:
        state = move @ state
        left.append(value - state[0])
        state = state + gain * left[-1]
    return np.array(left) / np.sqrt(size)


def least_periods(deviations, share):
    """Of n readings a test that is wrong with probability n * share each tells the push with at most this probability."""
    distance = np.sqrt(np.cumsum(np.sum(deviations**2, axis=1)))
    told = [NORMAL.cdf(d + NORMAL.inv_cdf(n * share)) for n, d in enumerate(distance, 1)]
    return 1.0 + float(np.sum(1.0 - np.maximum.accumulate(told)))


def main():
    for line in sys.stdin:
        asked = json.loads(line)
        model = arm(sys.argv[1], sys.argv[2], float(sys.argv[3]), asked["payload_kg"])
        data, period_s, sensor = model.createData(), asked["period_s"], asked["sensor_rad"]
        share = asked["alarms_an_hour"] * period_s / 3600.0 / (2 * len(asked["push_Nm"]))  # each joint, each way
        answer = {"known": [], "walking": []}
        for joint, (push, at) in enumerate(zip(asked["push_Nm"], asked["at"])):
            mass = pin.crba(model, data, np.array(at))
            mass = np.triu(mass) + np.triu(mass, 1).T
            signal = signals(np.linalg.solve(mass, push * np.eye(len(at))[joint]), period_s)
            answer["known"].append(least_periods(signal / sensor, share))
            walking = [innovations(s, period_s, sensor, sd) for s, sd in zip(signal.T, asked["process_sd"])]
            answer["walking"].append(least_periods(np.array(walking).T, share))
        print(json.dumps(answer))


main()
