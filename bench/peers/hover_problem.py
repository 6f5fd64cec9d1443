"""The hover QP of the comparisons: a 27 cm quadrotor of 35 g, linearised at hover, as every QP solver gets it.

12 states (position, rotation vector, velocity, rates), 4 inputs (motor commands as shares of 0.147 N, deviations from
hover), 20 ms, zero-order hold, N = 10, |u| <= 0.5, |x| <= 5. Cost 1/2 sum (x'Qx + u'Ru) + 1/2 x_N' Qf x_N, Qf from
TinyMPC's own terminal cost, which cannot be chosen there: the infinite-horizon cost of (Q + rho, R + rho), less rho.
The states to solve for are those of closed loops from random starts, in their order, so that every solver may start
from its last solution.
"""

import sys

import numpy as np

N, DT, RHO, U_MAX, X_MAX = 10, 0.02, 5.0, 0.5, 5.0
Q = np.diag([100.0] * 3 + [4.0, 4.0, 40.0] + [4.0] * 3 + [2.0, 2.0, 4.0])
R = 4.0 * np.eye(4)


def matrices():
    mass, arm, thrust, yaw = 0.035, 0.046 / np.sqrt(2.0), 0.147, 0.006
    inertia = np.array([1.66e-5, 1.66e-5, 2.93e-5])
    a, b = np.zeros((12, 12)), np.zeros((12, 4))
    a[0:3, 6:9] = a[3:6, 9:12] = np.eye(3)
    a[6, 4], a[7, 3] = 9.81, -9.81
    b[8] = thrust / mass
    b[9] = thrust * arm / inertia[0] * np.array([-1, -1, 1, 1])
    b[10] = thrust * arm / inertia[1] * np.array([-1, 1, 1, -1])
    b[11] = thrust * yaw / inertia[2] * np.array([-1, 1, -1, 1])
    block = np.zeros((16, 16))
    block[:12, :12], block[:12, 12:] = a * DT, b * DT
    hold, term = np.eye(16), np.eye(16)
    for k in range(1, 12):  # the series of the exponential; the block is nilpotent but for rounding
        term = term @ block / k
        hold = hold + term
    return hold[:12, :12], hold[:12, 12:]


def riccati(a, b, q, r):
    p = q.copy()
    for _ in range(5000):
        k = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        p = q + a.T @ p @ (a - b @ k)
    return p


def terminal(a, b):
    return riccati(a, b, Q + RHO * np.eye(12), R + RHO * np.eye(4)) - RHO * np.eye(12)


def starts(count=10):
    rng = np.random.default_rng(1)
    scale = np.array([0.5] * 3 + [0.1] * 3 + [0.5] * 3 + [0.5] * 3)
    return rng.uniform(-1.0, 1.0, (count, 12)) * scale


def sparse(p):
    """Hessian, rows, bounds and the selector of the first inputs: z = (u_0 .. u_{N-1}, x_1 .. x_N)."""
    import scipy.sparse as sp

    hessian = sp.block_diag([sp.kron(sp.eye(N), p["r"])] + [p["q"]] * (N - 1) + [p["qf"]], format="csc")
    shift = sp.kron(sp.eye(N), sp.eye(12)) - sp.kron(sp.diags([1.0], [-1], shape=(N, N)), p["a"])
    dynamics = sp.hstack([-sp.kron(sp.eye(N), p["b"]), shift])
    rows = sp.vstack([dynamics, sp.eye(N * 16)], format="csc")
    bound = np.concatenate([np.full(N * 4, U_MAX), np.full(N * 12, X_MAX)])
    return sp.triu(hessian, format="csc"), rows, bound


def reference(p, loops=10, steps=10):
    """The states in their order, and the first inputs of solutions at 1e-10 with the active set polished (OSQP); how
    many have an input and a state at a bound."""
    import osqp

    hessian, rows, bound = sparse(p)
    equal = np.zeros(12 * N)
    states, first, input_bounds, state_bounds = [], [], 0, 0
    for x in starts(loops):
        for _ in range(steps):
            equal[:12] = p["a"] @ x
            solver = osqp.OSQP()
            solver.setup(hessian, np.zeros(N * 16), rows, np.concatenate([equal, -bound]),
                         np.concatenate([equal, bound]), eps_abs=1e-10, eps_rel=1e-10, max_iter=200000, verbose=False,
                         polishing=True)
            r = solver.solve()
            assert r.info.status == "solved", r.info.status
            states.append(x)
            first.append(r.x[:4])
            input_bounds += bool(np.abs(r.x[: 4 * N]).max() > U_MAX - 1e-6)
            state_bounds += bool(np.abs(r.x[4 * N :]).max() > X_MAX - 1e-6)
            x = p["a"] @ x + p["b"] @ r.x[:4]
    return np.array(states), np.array(first), input_bounds, state_bounds


def write(path):
    """Plain numbers: sizes, then the arrays row by row."""
    a, b = matrices()
    p = {"a": a, "b": b, "q": Q, "r": R, "qf": terminal(a, b)}
    p["states"], p["u0"], with_input, with_state = reference(p)
    with open(path, "w", encoding="ascii") as out:
        out.write(f"{N} {U_MAX} {X_MAX} {len(p['states'])} {with_input} {with_state}\n")
        for key in ("a", "b", "q", "r", "qf", "states", "u0"):
            out.write(" ".join(f"{v:.17g}" for v in p[key].ravel()) + "\n")


def read(path):
    lines = open(path, encoding="ascii").read().splitlines()
    shapes = {"a": (12, 12), "b": (12, 4), "q": (12, 12), "r": (4, 4), "qf": (12, 12), "states": (-1, 12), "u0": (-1, 4)}
    return {key: np.array(line.split(), float).reshape(shape) for (key, shape), line in zip(shapes.items(), lines[1:])}


if __name__ == "__main__":
    write(sys.argv[1])
