"""FATROP and ALPAQA from CasADi's wheel on the cart-pole of the comparisons, N = 50 from hanging: cold, CPU time of a
call from Python (some tens of microseconds of a millisecond). FATROP takes the program stage by stage (multiple
shooting), ALPAQA's PANOC the inputs alone (single shooting); dynamics and derivatives run in CasADi's virtual machine:
to compile the unrolled program takes minutes."""

import sys

import casadi as ca
import numpy as np

from rounds import cpu_per_call, take_part

N, DT, START = 50, 0.02, [0.0, np.pi, 0.0, 0.0]
Q, R, QF = [0.1, 1.0, 0.01, 0.01], 0.001, [100.0, 100.0, 10.0, 10.0]
OPTIMA = {"free": (72.2651, np.inf), "box": (122.0087, 20.0)}
MOST = {"fatrop": 300, "alpaqa": 512}


def step(x, u):
    """bench/problems/cart_pole_problem.hpp."""
    mass, h = 1.1, 0.1 * 0.5
    inertia = 4.0 / 3.0 * 0.1 * 0.25
    s, c, w = ca.sin(x[1]), ca.cos(x[1]), x[3]
    push, turn = u + h * s * w * w, h * 9.81 * s
    inverse = 1.0 / (mass * inertia - h * h * c * c)
    v = x[2] + DT * (inertia * push - h * c * turn) * inverse
    w = w + DT * (mass * turn - h * c * push) * inverse
    return ca.vertcat(x[0] + DT * v, x[1] + DT * w, v, w)


def stage(x, u):
    return 0.5 * (R * u * u + sum(q * x[i] ** 2 for i, q in enumerate(Q)))


def end(x):
    return 0.5 * sum(q * x[i] ** 2 for i, q in enumerate(QF))


def plant():
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    return ca.Function("plant", [x, u], [step(x, u), stage(x, u)])


PLANT = plant()


def cost_of(inputs, limit):
    """Of the inputs, cut to their limit, on the plant."""
    x, total = ca.DM(START), 0.0
    for u in inputs:
        x, c = PLANT(x, min(max(float(u), -limit), limit))
        total += float(c)
    return total + float(end(x))


class Fatrop:
    def __init__(self, limit, most):
        xs, us = [ca.SX.sym(f"x{k}", 4) for k in range(N + 1)], [ca.SX.sym(f"u{k}") for k in range(N)]
        rows, equal, cost, z = [], [], 0, []
        for k in range(N):
            z += [xs[k], us[k]]
            rows.append(xs[k + 1] - step(xs[k], us[k]))
            equal += [True] * 4
            if k == 0:
                rows.append(xs[0] - ca.DM(START))
                equal += [True] * 4
            cost += stage(xs[k], us[k])
        z.append(xs[N])
        program = {"x": ca.vertcat(*z), "f": cost + end(xs[N]), "g": ca.vertcat(*rows)}
        self.solver = ca.nlpsol("fatrop", "fatrop", program, {
            "structure_detection": "auto", "equality": equal, "print_time": False, "error_on_fail": False,
            "fatrop": {"print_level": 0, "max_iter": most}})
        bound = np.full(N, limit) if np.isfinite(limit) else np.full(N, np.inf)
        upper = np.concatenate([np.concatenate([np.full(4, np.inf), [b]]) for b in bound] + [np.full(4, np.inf)])
        first = np.concatenate([np.concatenate([START, [0.0]])] * N + [START])
        self.arguments = {"x0": first, "lbx": -upper, "ubx": upper, "lbg": 0, "ubg": 0}

    def solve(self):
        result = self.solver(**self.arguments)
        return np.array(result["x"]).ravel()[4::5][:N]


class Alpaqa:
    def __init__(self, limit, most):
        u = ca.SX.sym("u", N)
        x, cost = ca.SX(START), 0
        for k in range(N):
            cost += stage(x, u[k])
            x = step(x, u[k])
        self.solver = ca.nlpsol("alpaqa", "alpaqa", {"x": u, "f": cost + end(x)}, {
            "print_time": False, "error_on_fail": False,
            "alpaqa": {"panoc.max_iter": most, "alm.max_iter": 1, "alm.tolerance": 1e-6, "alm.initial_tolerance": 1e-6,
                       "lbfgs.memory": 20}})
        bound = np.full(N, limit) if np.isfinite(limit) else np.full(N, np.inf)
        self.arguments = {"x0": np.zeros(N), "lbx": -bound, "ubx": bound}

    def solve(self):
        return np.array(self.solver(**self.arguments)["x"]).ravel()


def contender(kind, name, task):
    """With the fewest iterations that reach the optimum."""
    optimum, limit = OPTIMA[task]
    most, figure = 1, np.inf
    low, high = 0, None
    while high is None or high - low > 1:  # doubling, then between
        most = 2 * max(low, 1) if high is None else (low + high) // 2
        if most > MOST[name.lower()]:
            break
        figure = cost_of(kind(limit, most).solve(), limit)
        if abs(figure - optimum) <= 1e-3 * optimum:
            high = most
        else:
            low = most
    if high is None:
        return None, {"figure": figure, "optimum": optimum, "iterations": low}
    solver = kind(limit, high)
    figure = cost_of(solver.solve(), limit)

    def measure():
        return cpu_per_call(lambda: solver.solver(**solver.arguments))

    return measure, {"figure": figure, "optimum": optimum, "iterations": high}


def main():
    contenders = {}
    for name, kind in (("FATROP", Fatrop), ("ALPAQA", Alpaqa)):
        for task in OPTIMA:
            try:
                measure, facts = contender(kind, name, task)
            except RuntimeError as trouble:
                print(trouble, file=sys.stderr)
                continue
            measure = measure or (lambda: float("inf"))
            contenders[f"{name} {task}"] = (measure, facts)
            if name == "FATROP":
                contenders[f"{name} {task}/iteration"] = (lambda m=measure, n=facts["iterations"]: m() / n, facts)
    take_part(contenders)


main()
