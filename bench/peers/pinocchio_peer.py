"""pinocchio_peer.py values URDF JOINTS SEED COUNT: random states, and what pinocchio makes of them, one JSON line each.

JOINTS are the model's own names, by commas, in its order. A line has the row (q, v, force) and the accelerations and the
inverse inertia in that order of joints, and the slopes of the accelerations by position and by speed. `judge` is the
inverse of the same inertia matrix by elimination in 80 bits, which no recursion over bodies is part of, and
`judge_slopes` are the slopes that follow from it and those of the inverse dynamics.
"""

import json
import re
import sys

import numpy as np
import pinocchio as pin


def eliminated(matrix):
    """The inverse, by Gauss and Jordan with pivots, in long double."""
    n = len(matrix)
    rows = np.hstack([matrix.astype(np.longdouble), np.eye(n, dtype=np.longdouble)])
    for i in range(n):
        pivot = i + int(np.argmax(np.abs(rows[i:, i])))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] /= rows[i, i]
        for j in range(n):
            if j != i:
                rows[j] -= rows[j, i] * rows[i]
    return rows[:, n:]


urdf, joints, seed, count = sys.argv[2], sys.argv[3].split(","), int(sys.argv[4]), int(sys.argv[5])
model = pin.buildModelFromUrdf(urdf)
if model.nv != len(joints):
    sys.exit(f"{model.nv} velocities in pinocchio, {len(joints)} joints here")
place = {re.sub(r"[^A-Za-z0-9]", "_", name): k for k, name in enumerate(model.names)}
data, rng = model.createData(), np.random.default_rng(seed)
for _ in range(count):
    q, v, force = (rng.uniform(-a, a, len(joints)) for a in (3.0, 3.0, 20.0))
    full_q, full_v, full_force, order = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv), []
    for k, name in enumerate(joints):
        joint = model.joints[place[name]]
        if joint.nq == 2:  # a continuous one is a point of the circle
            full_q[joint.idx_q:joint.idx_q + 2] = np.cos(q[k]), np.sin(q[k])
        else:
            full_q[joint.idx_q] = q[k]
        full_v[joint.idx_v], full_force[joint.idx_v] = v[k], force[k]
        order.append(joint.idx_v)
    acceleration = pin.aba(model, data, full_q, full_v, full_force)
    inverse = np.triu(pin.computeMinverse(model, data, full_q))
    inverse = inverse + np.triu(inverse, 1).T
    inertia = np.triu(pin.crba(model, data, full_q))
    judge = eliminated(inertia + np.triu(inertia, 1).T)
    pin.computeABADerivatives(model, data, full_q, full_v, full_force)
    slopes = [data.ddq_dq[np.ix_(order, order)].tolist(), data.ddq_dv[np.ix_(order, order)].tolist()]
    pin.computeRNEADerivatives(model, data, full_q, full_v, acceleration)
    judged = [(-judge @ d)[np.ix_(order, order)].astype(float).tolist() for d in (data.dtau_dq, data.dtau_dv)]
    print(json.dumps({"row": [*q, *v, *force],
                      "slopes": slopes, "judge_slopes": judged,
                      "acceleration": acceleration[order].tolist(),
                      "inverse": inverse[np.ix_(order, order)].tolist(), "judge": judge[np.ix_(order, order)].astype(float).tolist()}))
