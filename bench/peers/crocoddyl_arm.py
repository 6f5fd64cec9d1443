"""crocoddyl_arm.py URDF: iterations of crocoddyl's solvers on the problem of bench_arm_iterations, one JSON line each.

The arm is that of the URDF, its forward dynamics and their derivatives are pinocchio's in C++; Python only calls.
"""

import json
import statistics
import sys
import time

import crocoddyl
import numpy as np
import pinocchio as pin

START = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.5])
TARGET = np.array([0.5, 0.0, 0.3, -1.5, 0.3, 1.8, 0.0])
PLACE, SPEED, TORQUE, PLACE_END, SPEED_END = 10.0, 0.1, 1e-4, 100.0, 1.0
HORIZON, PERIOD_S, ITERATIONS, ROUNDS, OPTIMAL = 30, 0.01, 10, 40, 100

model = pin.buildModelFromUrdf(sys.argv[1])
if model.nq != 7:
    sys.exit(f"{model.nq} coordinates; an arm of 7 joints is needed")
state = crocoddyl.StateMultibody(model)
actuation = crocoddyl.ActuationModelFull(state)
target = np.concatenate([TARGET, np.zeros(7)])


def action(place, speed, torque, period_s):
    costs = crocoddyl.CostModelSum(state)
    weights = np.concatenate([np.full(7, place), np.full(7, speed)])
    costs.addCost("state", crocoddyl.CostModelResidual(state, crocoddyl.ActivationModelWeightedQuad(weights),
                                                       crocoddyl.ResidualModelState(state, target)), 1.0)
    if torque > 0.0:
        costs.addCost("torque", crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelControl(state)), torque)
    return crocoddyl.IntegratedActionModelEuler(
        crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs), period_s)


start = np.concatenate([START, np.zeros(7)])
problem = crocoddyl.ShootingProblem(start, [action(PLACE, SPEED, TORQUE, PERIOD_S)] * HORIZON,
                                    action(PLACE_END, SPEED_END, 0.0, 0.0))
problem.nthreads = 1
data, zero = problem.runningModels[0].differential.createData(), np.zeros(7)
problem.runningModels[0].differential.calc(data, start, zero)
if np.max(np.abs(data.xout - pin.aba(model, model.createData(), START, zero, zero))) > 1e-9:
    sys.exit("crocoddyl's dynamics are not pinocchio's: their versions do not fit together")
inputs = [np.zeros(7)] * HORIZON
path = list(problem.rollout(inputs))
for name in ("SolverDDP", "SolverFDDP"):
    solver = getattr(crocoddyl, name)(problem)
    solver.th_stop = 1e-16
    solver.solve(path, inputs, OPTIMAL, True)
    cost, first = solver.cost, solver.us[0].tolist()
    each = []
    for _ in range(ROUNDS):
        before = time.perf_counter()
        solver.solve(path, inputs, ITERATIONS, True)
        each.append((time.perf_counter() - before) / (solver.iter + (0 if solver.iter == ITERATIONS else 1)))
    print(json.dumps({"solver": name, "iteration_us": statistics.median(each) * 1e6, "iterations": solver.iter, "cost": cost,
                      "first_Nm": first}))
