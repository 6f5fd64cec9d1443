"""PIQP, ProxQP, Clarabel and DAQP on the hover QP: sparse form (DAQP: states eliminated), updated right-hand side, CPU
time of update and solve through their Python bindings (a call costs about a microsecond; of DAQP the solver's own time
is told as well). Each with the loosest tolerance that gives the first inputs to
1e-4; ProxQP starts warm, the interior point methods cannot."""

import sys

import clarabel
import daqp
import numpy as np
import piqp
import scipy.sparse as sp
from proxsuite import proxqp

import hover_problem as hover
from rounds import cpu_per_call, take_part

EQUALITIES, VARIABLES = 12 * hover.N, 16 * hover.N


class Problem:
    """Of the hover QP: 1/2 z'Hz, dynamics z = right, |z| <= bound."""

    def __init__(self, p):
        triangle, rows, self.bound = hover.sparse(p)
        self.triangle = triangle
        self.hessian = (triangle + sp.triu(triangle, 1).T).tocsc()
        self.dynamics = rows[:EQUALITIES].tocsc()
        self.rights = []
        for x in p["states"]:
            right = np.zeros(EQUALITIES)
            right[:12] = p["a"] @ x
            self.rights.append(right)
        self.first_inputs = p["u0"]


class Piqp:
    name = "PIQP hover"

    def __init__(self, q, tolerance):
        self.solver = piqp.SparseSolver()
        self.solver.settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        self.solver.settings.eps_abs = self.solver.settings.eps_rel = tolerance
        self.solver.setup(q.hessian, np.zeros(VARIABLES), q.dynamics, q.rights[0], None, None, None, -q.bound, q.bound)

    def solve(self, right):
        self.solver.update(b=right)
        return self.solver.solve() == piqp.PIQP_SOLVED

    def first_input(self):
        return self.solver.result.x[:4]


class ProxQp:
    name = "ProxQP hover"

    def __init__(self, q, tolerance):
        self.solver = proxqp.sparse.QP(VARIABLES, EQUALITIES, VARIABLES)
        self.solver.settings.eps_abs, self.solver.settings.eps_rel = tolerance, 0.0
        self.solver.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self.solver.init(q.hessian, np.zeros(VARIABLES), q.dynamics, q.rights[0], sp.eye(VARIABLES, format="csc"), -q.bound,
                         q.bound)

    def solve(self, right):
        self.solver.update(b=right)
        self.solver.solve()
        return self.solver.results.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED

    def first_input(self):
        return self.solver.results.x[:4]


class Clarabel:
    name = "Clarabel hover"

    def __init__(self, q, tolerance):
        settings = clarabel.DefaultSettings()
        settings.verbose = settings.presolve_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        box = sp.eye(VARIABLES, format="csc")
        rows = sp.vstack([q.dynamics, box, -box], format="csc")
        self.sides = np.concatenate([q.bound, q.bound])
        cones = [clarabel.ZeroConeT(EQUALITIES), clarabel.NonnegativeConeT(2 * VARIABLES)]
        right = np.concatenate([q.rights[0], self.sides])
        self.solver = clarabel.DefaultSolver(q.triangle, np.zeros(VARIABLES), rows, right, cones, settings)

    def solve(self, right):
        self.solver.update(b=np.concatenate([right, self.sides]))
        self.solution = self.solver.solve()
        return self.solution.status == clarabel.SolverStatus.Solved

    def first_input(self):
        return np.array(self.solution.x[:4])


class Daqp:
    name = "DAQP hover"

    def __init__(self, q, tolerance):
        count = 4 * hover.N
        states = q.dynamics[:, count:].toarray()  # of z = (u, x): states x + inputs u = right
        lead = np.linalg.inv(states)
        self.from_start, from_inputs = lead, -lead @ q.dynamics[:, :count].toarray()
        hessian = q.hessian.toarray()
        self.weight = from_inputs.T @ hessian[count:, count:]
        self.bound = q.bound
        self.model = daqp.Model()
        self.model.settings = {"primal_tol": tolerance, "dual_tol": 1e-12}
        whole = hessian[:count, :count] + self.weight @ from_inputs
        self.model.setup(whole, np.zeros(count), from_inputs, q.bound.copy(), -q.bound, np.zeros(len(q.bound), np.int32))
        self.own_s = 0.0

    def solve(self, right):
        free = self.from_start @ right
        upper, lower = self.bound.copy(), -self.bound
        upper[4 * hover.N :] -= free
        lower[4 * hover.N :] -= free
        self.model.update(f=self.weight @ free, bupper=upper, blower=lower)
        self.inputs, _, flag, info = self.model.solve()
        self.own_s += info["solve_time"]
        return flag > 0

    def first_input(self):
        return self.inputs[:4]


def contender(kind, q):
    """With the first tolerance that suffices."""
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        solver = kind(q, tolerance)
        worst, unsolved = 0.0, 0
        for right, u0 in zip(q.rights, q.first_inputs):
            unsolved += not solver.solve(right)
            worst = max(worst, float(np.abs(solver.first_input() - u0).max()))
        if worst <= 1e-4 and not unsolved:
            break

    def solve_all():
        for right in q.rights:
            solver.solve(right)

    facts = {"error": worst, "unsolved": unsolved, "of": len(q.rights), "tolerance": tolerance}
    if hasattr(solver, "own_s"):
        solver.own_s = 0.0
        for _ in range(100):
            solve_all()
        facts["own_us"] = solver.own_s * 1e4 / len(q.rights)
    return lambda: cpu_per_call(solve_all) / len(q.rights), facts


def main():
    q = Problem(hover.read(sys.argv[1]))
    take_part({kind.name: contender(kind, q) for kind in (Piqp, ProxQp, Clarabel, Daqp)})


main()
