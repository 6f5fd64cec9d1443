"""do-mpc on the plants of `./dev bench pushed`: model predictive control with moving horizon estimation.

The first line is a JSON object with the robot file's sections ("robot"), the plant, a force that matters ("force") and
the settings; the answer tells that it has begun. Each line after it is a list of the readings and of the input that was
applied since the readings before; the answer has the next input, and what is estimated.

Both problems have RK4 steps of a period. The estimator has the state, the parameters that have a prior, and a force at
the input that walks at random. The controller has the robot file's cost, but its input's weight counts from the input
that holds the target against gravity and the estimated force.
"""

import json
import os
import sys
import time

import casadi
import do_mpc
import numpy as np

GRAVITY_M_S2 = 9.81
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0, "ipopt.max_iter": 60, "ipopt.tol": 1e-6}
FORCE = "beyond"


def pendulum(x, u, p):
    angle, rate, force = x
    turn = u + force - p["damping_Nms"] * rate - GRAVITY_M_S2 * p["mass_kg"] * p["length_m"] * casadi.sin(angle)
    return [rate, turn / (p["mass_kg"] * p["length_m"] ** 2), 0]


def cart_pole(x, u, p):
    _, angle, speed, rate, force = x
    mass = p["pole_mass_kg"]
    moment, inertia = mass * p["half_length_m"], 4 / 3 * mass * p["half_length_m"] ** 2
    push = u + force - p["cart.damping_SI"] * speed + moment * casadi.sin(angle) * rate**2
    turn, coupling = moment * GRAVITY_M_S2 * casadi.sin(angle), moment * casadi.cos(angle)
    whole = p["cart_mass_kg"] + mass
    scale = 1 / (whole * inertia - coupling**2)
    return [speed, rate, (inertia * push - coupling * turn) * scale, (whole * turn - coupling * push) * scale, 0]


def pendulum_steady(target, force, p):
    return GRAVITY_M_S2 * p["mass_kg"] * p["length_m"] * casadi.sin(target[0]) - force


def cart_pole_steady(target, force, p):
    return -force


# equations, what is held against, states in their order, the names of the readings
PLANTS = {
    "pendulum": (pendulum, pendulum_steady, ["angle_rad", "rate_rad_s"], ["angle_rad"]),
    "cart-pole": (cart_pole, cart_pole_steady, ["position_m", "angle_rad", "velocity_m_s", "rate_rad_s"],
                  ["position_m", "angle_rad"]),
}


def rk4(f, x, period_s):
    move = lambda a, b, h: [i + h * j for i, j in zip(a, b)]
    k1 = f(x)
    k2 = f(move(x, k1, period_s / 2))
    k3 = f(move(x, k2, period_s / 2))
    k4 = f(move(x, k3, period_s))
    return [i + period_s / 6 * (a + 2 * b + 2 * c + d) for i, a, b, c, d in zip(x, k1, k2, k3, k4)]


class Peer:
    def __init__(self, given):
        self.robot, settings = given["robot"], given["settings"]
        self.equations, self.steady, self.states, self.readings = PLANTS[given["plant"]]
        self.period_s = self.robot["model"]["period_s"]
        values = dict(self.robot["parameters"])
        for effect in self.robot.get("effects", []):
            values[f"{effect['port']}.damping_SI"] = effect["damping_SI"]
        self.priors = {n: v["uniform"] for n, v in values.items() if isinstance(v, dict)}
        self.known = {n: v for n, v in values.items() if not isinstance(v, dict)}
        (self.input_name, self.limits), = self.robot["limits"].items()
        self.start = np.array([self.robot["start"].get("state", {}).get(s, 0.0) for s in self.states] + [0.0])
        self.now_p = np.array([np.mean(v) for v in self.priors.values()])
        self.used = np.zeros(1)
        self.estimator = self.make_estimator(given["force"], settings)
        self.controller = self.make_controller()

    def model(self, noisy):
        """The period's step; the estimator's is noisy, and has the readings."""
        model = do_mpc.model.Model("discrete", "SX")
        x = [model.set_variable("_x", name) for name in [*self.states, FORCE]]
        u = model.set_variable("_u", "u")
        p = {**self.known, **{n: model.set_variable("_p", n.replace(".", "_")) for n in self.priors}}
        for name, value in zip([*self.states, FORCE], rk4(lambda at: self.equations(at, u, p), x, self.period_s)):
            model.set_rhs(name, value, process_noise=noisy)
        if noisy:
            for name in self.readings:
                model.set_meas(f"{name}_read", x[self.states.index(name)], meas_noise=True)
            model.set_meas("u_used", u, meas_noise=False)
        model.setup()
        return model

    def target(self, state):
        return self.robot["cost"]["target"].get(state, 0.0)

    def make_estimator(self, force, settings):
        model = self.model(True)
        mhe = do_mpc.estimator.MHE(model, [n.replace(".", "_") for n in self.priors])
        mhe.set_param(n_horizon=settings["window"], t_step=self.period_s, meas_from_data=True,
                      store_full_solution=False, nlpsol_opts=QUIET)
        root_s = self.period_s**0.5
        process = self.robot["noise"]["process_sd"]
        walk = [max(process.get(s, 0.0), 1e-3) * root_s for s in self.states] + [settings["drift"] * force * root_s]
        arrival = [self.robot["start"]["sd"].get(s, 0.1) for s in self.states] + [force]
        sensors = [self.robot["measurement"][name]["sd"] for name in self.readings]
        width = [(high - low) / 12**0.5 for low, high in self.priors.values()]
        weights = lambda sd: np.diag(1 / np.square(sd))
        mhe.set_default_objective(weights(arrival), weights(sensors), settings["memory"] * weights(width),
                                  weights(walk))
        for name, (low, high) in self.priors.items():
            mhe.bounds["lower", "_p_est", name.replace(".", "_")] = low
            mhe.bounds["upper", "_p_est", name.replace(".", "_")] = high
        mhe.setup()
        mhe.x0, mhe.u0, mhe.p_est0 = self.start, np.zeros(1), self.now_p
        mhe.set_initial_guess()
        return mhe

    def make_controller(self):
        model = self.model(False)
        mpc = do_mpc.controller.MPC(model)
        mpc.set_param(n_horizon=self.robot["planner"]["horizon"], n_robust=0, t_step=self.period_s,
                      store_full_solution=False, nlpsol_opts=QUIET)
        cost = self.robot["cost"]
        weigh = lambda weights: sum(w * (model.x[s] - self.target(s)) ** 2 for s, w in weights.items())
        weight = cost["input_weight"][self.input_name]
        p = {**self.known, **{n: model.p[n.replace(".", "_")] for n in self.priors}}
        steady = self.steady([self.target(s) for s in self.states], model.x[FORCE], p)
        mpc.set_objective(lterm=weigh(cost["state_weight"]) + weight * (model.u["u"] - steady) ** 2,
                          mterm=weigh(cost["terminal_weight"]))
        mpc.set_rterm(u=cost["input_rate_weight"][self.input_name])
        mpc.bounds["lower", "_u", "u"], mpc.bounds["upper", "_u", "u"] = self.limits["low"], self.limits["high"]
        template = mpc.get_p_template(1)

        def parameters(_):
            template["_p", 0] = self.now_p
            return template

        mpc.set_p_fun(parameters)
        mpc.setup()
        mpc.x0, mpc.u0 = self.start, np.zeros(1)
        mpc.set_initial_guess()
        return mpc

    def step(self, readings, used):
        began = time.process_time()
        x = self.estimator.make_step(np.array([*readings, used]).reshape(-1, 1))
        self.now_p = self.estimator.p_est0.cat.full().ravel()
        u = float(self.controller.make_step(x)[0, 0])
        return {"u": u, "state": x.ravel().tolist(), "parameters": self.now_p.tolist(),
                "seconds": time.process_time() - began}


def main():
    out = os.fdopen(os.dup(1), "w")  # what the solvers print goes elsewhere
    os.dup2(2, 1)
    peer = Peer(json.loads(sys.stdin.readline()))
    print(json.dumps({"begun": True}), file=out, flush=True)
    for line in sys.stdin:
        readings, used = json.loads(line)
        print(json.dumps(peer.step(readings, used)), file=out, flush=True)


if __name__ == "__main__":
    main()
