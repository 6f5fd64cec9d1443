"""OSQP on the hover QP: sparse form, updated bounds, warm start; update and solve of the C++ object, CPU time."""

import sys

import numpy as np
import osqp

import hover_problem as hover
from rounds import cpu_per_call, take_part


def build(p, tolerance):
    hessian, rows, bound = hover.sparse(p)
    solver = osqp.OSQP()
    start = np.concatenate([np.zeros(12 * hover.N), bound])
    solver.setup(hessian, np.zeros(hover.N * 16), rows, -start, start, eps_abs=tolerance, eps_rel=tolerance,
                 max_iter=4000, verbose=False, polishing=False)
    return solver, bound


def bounds(p, bound):
    """Lower and upper sides for every state."""
    sides = []
    for x in p["states"]:
        equal = np.zeros(12 * hover.N)
        equal[:12] = p["a"] @ x
        sides.append((np.concatenate([equal, -bound]), np.concatenate([equal, bound])))
    return sides


def solve_all(p, solver, sides):
    worst, unsolved = 0.0, 0
    for (low, high), u0 in zip(sides, p["u0"]):
        solver.update(l=low, u=high)
        r = solver.solve(raise_error=False)
        worst = max(worst, float(np.abs(r.x[:4] - u0).max()))
        unsolved += r.info.status != "solved"
    return worst, unsolved


def only_solve(core, sides):
    for low, high in sides:
        core.update_data_vec(q=None, l=low, u=high)
        core.solve()


def main():
    p = hover.read(sys.argv[1])
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        solver, bound = build(p, tolerance)
        sides = bounds(p, bound)
        worst, unsolved = solve_all(p, solver, sides)
        if worst <= 1e-4 and not unsolved:
            break
    facts = {"error": worst, "unsolved": unsolved, "of": len(p["states"]), "tolerance": tolerance}
    measure = lambda: cpu_per_call(lambda: only_solve(solver._solver, sides)) / len(sides)
    take_part({"OSQP hover": (measure, facts)})


main()
