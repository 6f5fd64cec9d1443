"""Optima of the problems of `./dev bench minima`, by many local searches from random inputs.

    minima_reference.py bench/planning/minima_problems.toml [--starts 512] [--only NAME] [--check] > minima_optima.toml

Models, integrator and cost are written out here from docs/reference and the equations in the literature; nothing is
shared with tiller but the problems' numbers. All starts of a problem descend side by side by L-BFGS with projection
onto the inputs' limits, slopes by the adjoint recursion. Where there are two states, one more begins at the
result of dynamic programming on a grid. In each of five more rounds a quarter as many begin around the 16 cheapest ends
so far. The cheapest of all, and the cheapest that costs more by over 1 %, are then polished by scipy's L-BFGS-B.

--check compares the slopes with central differences and ends.
"""

import argparse
import sys
import time
import tomllib

import numpy as np
from scipy.optimize import minimize

GRAVITY = 9.81
WITHIN = 0.01  # a start has reached the optimum where it costs at most this share more
MEMORY, EVALUATIONS, LOOK = 12, 800, 50
ROUNDS = (1.0, 0.5, 0.2, 0.1, 0.05)  # how far from the cheapest ends more begin, as a share of the inputs' range


# ---- models: accelerations (nv, B), and a function that gives their slopes by states and by inputs ---


def solve_pair(m11, m12, m22, r1, r2):
    inverse = 1.0 / (m11 * m22 - m12 * m12)
    return (m22 * r1 - m12 * r2) * inverse, (m11 * r2 - m12 * r1) * inverse


def pendulum(x, u, p):
    mass, length, damping = p
    inertia = mass * length**2
    a = (u[0] - damping * x[1] - mass * GRAVITY * length * np.sin(x[0])) / inertia
    return [a], lambda: ([[-GRAVITY / length * np.cos(x[0]), -damping / inertia]], [[1.0 / inertia]])


def cart_pole(x, u, p):
    cart, pole, half = p
    whole, moment, inertia = cart + pole, pole * half, pole * half**2 * 4.0 / 3.0
    s, c, w = np.sin(x[1]), np.cos(x[1]), x[3]
    m12 = moment * c
    ax, aw = solve_pair(whole, m12, inertia, u[0] + moment * s * w**2, moment * GRAVITY * s)

    def slopes():  # M da = dr - dM a
        dm = -moment * s
        by_angle = solve_pair(whole, m12, inertia, moment * c * w**2 - dm * aw, moment * GRAVITY * c - dm * ax)
        by_rate = solve_pair(whole, m12, inertia, 2.0 * moment * s * w, 0.0)
        by_input = solve_pair(whole, m12, inertia, 1.0, 0.0)
        return [[0.0, by_angle[i], 0.0, by_rate[i]] for i in range(2)], [[by_input[i]] for i in range(2)]

    return [ax, aw], slopes


def two_rods(x, push1, push2, p):
    m1, m2, l1, _, c1, c2, i1, i2 = p
    h = l1 * m2 * c2
    j1, j2 = i1 + m1 * c1**2 + m2 * l1**2, i2 + m2 * c2**2
    upper, lower = (m1 * c1 + m2 * l1) * GRAVITY, m2 * c2 * GRAVITY
    q1, q2, w1, w2 = x
    s, c = h * np.sin(q2), h * np.cos(q2)
    m11, m12 = j1 + j2 + 2.0 * c, j2 + c
    pull2 = -lower * np.sin(q1 + q2)
    r1 = push1 - upper * np.sin(q1) + pull2 + s * w2 * (2.0 * w1 + w2)
    r2 = push2 + pull2 - s * w1**2
    a1, a2 = solve_pair(m11, m12, j2, r1, r2)

    def slopes():
        slope2, slope1 = -lower * np.cos(q1 + q2), -upper * np.cos(q1)
        columns = [solve_pair(m11, m12, j2, slope1 + slope2, slope2),
                   solve_pair(m11, m12, j2, slope2 + c * w2 * (2.0 * w1 + w2) + 2.0 * s * a1 + s * a2,
                              slope2 - c * w1**2 + s * a1),
                   solve_pair(m11, m12, j2, 2.0 * s * w2, -2.0 * s * w1),
                   solve_pair(m11, m12, j2, 2.0 * s * (w1 + w2), 0.0)]
        pushes = [solve_pair(m11, m12, j2, 1.0, 0.0), solve_pair(m11, m12, j2, 0.0, 1.0)]
        return [[column[i] for column in columns] for i in range(2)], [[b[i] for b in pushes] for i in range(2)]

    return [a1, a2], slopes


def acrobot(x, u, p):
    a, slopes = two_rods(x, 0.0, u[0], p)

    def elbow_alone():
        by_state, by_push = slopes()
        return by_state, [[row[1]] for row in by_push]

    return a, elbow_alone


def two_link_arm(x, u, p):
    return two_rods(x, u[0], u[1], p)


def planar_quadrotor(x, u, p):
    mass, arm, inertia, drag = p
    s, c, thrust = np.sin(x[2]), np.cos(x[2]), (u[0] + u[1]) / mass
    loss, turn = -drag / mass, arm / inertia
    a = [-thrust * s + loss * x[3], thrust * c - GRAVITY + loss * x[4], turn * (u[1] - u[0])]
    return a, lambda: ([[0.0, 0.0, -thrust * c, loss, 0.0, 0.0], [0.0, 0.0, -thrust * s, 0.0, loss, 0.0], [0.0] * 6],
                       [[-s / mass] * 2, [c / mass] * 2, [-turn, turn]])


def linear_axis(x, u, p):
    return [u[0] / p[0]], lambda: ([[0.0, 0.0]], [[1.0 / p[0]]])


def skid_steer(x, u, p):
    radius, axle, ahead_of_origin = p
    s, c = np.sin(x[2]), np.cos(x[2])
    turn, ahead = radius * (u[1] - u[0]) / axle, radius * (u[0] + u[1]) / 2.0
    aside = -ahead_of_origin * turn
    vx, vy = ahead * c - aside * s, ahead * s + aside * c

    def slopes():
        by_turn, by_ahead = [ahead_of_origin * s, -ahead_of_origin * c, 1.0], [c, s, 0.0]
        by_input = [[by_ahead[i] * radius / 2.0 - by_turn[i] * radius / axle,
                     by_ahead[i] * radius / 2.0 + by_turn[i] * radius / axle] for i in range(3)]
        return [[0.0, 0.0, -vy], [0.0, 0.0, vx], [0.0, 0.0, 0.0]], by_input

    return [vx, vy, turn], slopes


# accelerations, states that are angles, whether the slopes are those of velocities (else of the states themselves)
MODELS = {"pendulum": (pendulum, [0], True), "cart_pole": (cart_pole, [1], True), "acrobot": (acrobot, [0, 1], True),
          "two_link_arm": (two_link_arm, [0, 1], True), "planar_quadrotor": (planar_quadrotor, [2], True),
          "linear_axis": (linear_axis, [], True), "skid_steer": (skid_steer, [2], False)}


# ---- a problem: cost and slope of B sequences at once ----------------------------------------------


class Problem:
    def __init__(self, data):
        self.name, self.single = data["name"], data.get("single", False)
        self.rates, self.angles, self.second_order = MODELS[data["model"]]
        self.params, self.h, self.steps = data["params"], data["period_s"], data["horizon"]
        column = {k: np.array(data[k], dtype=float)[:, None] for k in
                  ("start", "target", "state_weight", "terminal_weight", "input_weight", "input_low", "input_high")}
        self.start, self.target = column["start"], column["target"]
        self.q, self.qf, self.r = column["state_weight"], column["terminal_weight"], column["input_weight"]
        self.low, self.high = column["input_low"], column["input_high"]
        self.obstacles, self.bounds = data.get("obstacles", []), data.get("bounds", [])
        self.nx, self.nu = len(self.start), len(self.r)
        self.size = self.steps * self.nu

    def step(self, x, u):
        rates, half = np.array(self.rates(x, u, self.params)[0]), self.nx // 2
        if not self.second_order:
            return x + self.h * rates
        v = x[half:] + self.h * rates
        return np.concatenate([x[:half] + self.h * v, v])

    def slopes(self, x, u):
        """Of the rates at all points (n) by state (nv, nx, n) and by input (nv, nu, n)."""
        by_state, by_input = self.rates(x, u, self.params)[1]()
        whole = lambda rows: np.array([[np.broadcast_to(e, x.shape[1]) for e in row] for row in rows])
        return whole(by_state), whole(by_input)

    def step_back(self, slope, by_state, by_input):
        """Slopes of the cost by the states and inputs before a step, from those by the states after it."""
        half = self.nx // 2
        if self.second_order:
            felt = slope[half:] + self.h * slope[:half]
            kept = np.concatenate([slope[:half], felt])
        else:
            felt = kept = slope
        return (kept + self.h * np.einsum("vxb,vb->xb", by_state, felt),
                self.h * np.einsum("vub,vb->ub", by_input, felt))

    def state_cost(self, x, weight):
        d = x - self.target
        for i in self.angles:
            d[i] -= 2.0 * np.pi * np.rint(d[i] / (2.0 * np.pi))
        cost, slope = np.sum(weight * d * d, 0), 2.0 * weight * d
        for i, low, high, w in self.bounds:
            over, under = np.maximum(x[i] - high, 0.0), np.maximum(low - x[i], 0.0)
            cost = cost + w * (over**2 + under**2)
            slope[i] += 2.0 * w * (over - under)
        for i, j, px, py, radius, w in self.obstacles:
            dx, dy = x[i] - px, x[j] - py
            distance = np.hypot(dx, dy)
            depth = np.maximum(radius - distance, 0.0)
            cost = cost + w * depth**2
            share = -2.0 * w * depth / np.maximum(distance, 1e-12)
            slope[i] += share * dx
            slope[j] += share * dy
        return cost, slope

    def evaluate(self, z):
        """Costs (B) and slopes (B, size) of inputs scaled to [-1, 1], z (B, size)."""
        count, scale = len(z), 0.5 * (self.high - self.low)
        u = np.ascontiguousarray(z.T).reshape(self.steps, self.nu, count) * scale + 0.5 * (self.high + self.low)
        x = np.empty((self.nx, self.steps + 1, count))
        x[:, 0] = self.start
        for k in range(self.steps):
            x[:, k + 1] = self.step(x[:, k], u[k])
        before, inputs = x[:, :-1].reshape(self.nx, -1), u.transpose(1, 0, 2).reshape(self.nu, -1)
        cost, slope = self.state_cost(before, self.q)
        last, back = self.state_cost(x[:, -1].copy(), self.qf)
        total = np.sum((cost + np.sum(self.r * inputs**2, 0)).reshape(self.steps, count), 0) + last
        by_state, by_input = self.slopes(before, inputs)
        slope, by_state, by_input = (a.reshape(*a.shape[:-1], self.steps, count) for a in (slope, by_state, by_input))
        out = np.empty_like(u)
        for k in reversed(range(self.steps)):
            back, by_u = self.step_back(back, by_state[..., k, :], by_input[..., k, :])
            back = back + slope[:, k]
            out[k] = (by_u + 2.0 * self.r * u[k]) * scale
        return total, out.reshape(self.size, count).T.copy()

    def inputs(self, z):
        """(steps * nu) in the inputs' units, to nine digits as the table has them."""
        u = z.reshape(self.steps, self.nu).T * 0.5 * (self.high - self.low) + 0.5 * (self.high + self.low)
        return [float(f"{v:.9g}") for v in u.T.reshape(-1)]

    def cost_of(self, inputs):
        u = np.reshape(inputs, (self.steps, self.nu)).T
        z = (u - 0.5 * (self.high + self.low)) / (0.5 * (self.high - self.low))
        return float(self.evaluate(z.T.reshape(1, -1))[0][0])


def check_slopes(problem, rng):
    z = rng.uniform(-0.9, 0.9, (1, problem.size))
    _, slope = problem.evaluate(z)
    step, eye = 1e-6, np.eye(problem.size)
    numeric = (problem.evaluate(z + step * eye)[0] - problem.evaluate(z - step * eye)[0]) / (2.0 * step)
    return np.max(np.abs(numeric - slope[0])) / np.max(np.abs(slope))


# ---- descent, all starts side by side --------------------------------------------------------------


def draw_sequences(problem, count, rng):
    """In turn: smooth, knots with straight lines between; in pieces at the limits; rough."""
    starts = np.empty((count, problem.steps, problem.nu))
    at = np.linspace(0.0, 1.0, problem.steps)
    for b in range(count):
        for i in range(problem.nu):
            knots = rng.integers(2, 9)
            values = rng.uniform(-1.0, 1.0, knots) * rng.choice([0.1, 0.4, 1.0])
            if b % 3 == 0:
                starts[b, :, i] = np.interp(at, np.linspace(0.0, 1.0, knots), values)
            elif b % 3 == 1:
                starts[b, :, i] = np.sign(values)[np.minimum((at * knots).astype(int), knots - 1)]
            else:
                starts[b, :, i] = rng.uniform(-1.0, 1.0, problem.steps)
    return starts.reshape(count, -1)


def draw_policies(problem, count, rng):
    """Inputs of random feedback on the states and their sines."""
    gain = rng.standard_normal((problem.nu, 2 * problem.nx + 1, count)) * rng.choice([0.3, 1.0, 3.0], count)
    x, out = np.repeat(problem.start, count, 1), np.empty((count, problem.steps, problem.nu))
    for k in range(problem.steps):
        d = np.nan_to_num(x - problem.target)  # Euler's rule takes wild motions beyond all numbers
        z = np.clip(np.einsum("ufb,fb->ub", gain, np.concatenate([d, np.sin(d), np.ones((1, count))])), -1.0, 1.0)
        out[:, k] = z.T
        x = problem.step(x, 0.5 * (problem.high - problem.low) * z + 0.5 * (problem.high + problem.low))
    return out.reshape(count, -1)


def draw_starts(problem, count, rng):
    policies = count // 4
    return np.concatenate([draw_sequences(problem, count - policies, rng), draw_policies(problem, policies, rng)])


def shift(problem, z, rng):
    """Every sequence up to four steps earlier or later."""
    steps = np.clip(np.arange(problem.steps) + rng.integers(-4, 5, (len(z), 1)), 0, problem.steps - 1)
    return z.reshape(len(z), problem.steps, problem.nu)[np.arange(len(z))[:, None], steps].reshape(z.shape)


def draw_program(problem, points=201, levels=21):
    """One start, of dynamic programming on a grid of two states and one input: linear between the points."""
    wraps = 0 in problem.angles
    spread = np.pi if wraps else 2.0 * abs(problem.target[0, 0] - problem.start[0, 0])
    fastest = 15.0 if wraps else 3.0
    middle = problem.target[0, 0]
    first, second = np.linspace(-spread, spread, points), np.linspace(-fastest, fastest, points)
    grid = np.array(np.meshgrid(middle + first, second, indexing="ij")).reshape(2, -1)
    levels = np.linspace(problem.low[0, 0], problem.high[0, 0], levels)

    def look_up(value, x):
        a = x[0] - middle
        a = (a + spread) % (2.0 * spread) if wraps else np.clip(a + spread, 0.0, 2.0 * spread)
        a, b = a / (first[1] - first[0]), (np.clip(x[1], -fastest, fastest) + fastest) / (second[1] - second[0])
        i, j = np.minimum(a.astype(int), points - 2), np.minimum(b.astype(int), points - 2)
        a, b = a - i, b - j
        return ((1 - a) * ((1 - b) * value[i, j] + b * value[i, j + 1])
                + a * ((1 - b) * value[i + 1, j] + b * value[i + 1, j + 1]))

    def costs(value, x):
        """Of every level at the points x (2, n): (levels, n)."""
        return np.array([problem.r[0, 0] * u**2 + look_up(value, problem.step(x, np.full((1, x.shape[1]), u)))
                         for u in levels])

    values = [problem.state_cost(grid, problem.qf)[0].reshape(points, points)]
    stage = problem.state_cost(grid, problem.q)[0].reshape(points, points)
    for _ in range(problem.steps - 1):
        values.append(stage + costs(values[-1], grid).min(0).reshape(points, points))
    x, inputs = problem.start.copy(), []
    for value in reversed(values):
        u = levels[np.argmin(costs(value, x)[:, 0])]
        x = problem.step(x, np.full((1, 1), u))
        inputs.append(u)
    return (np.array(inputs)[None] - 0.5 * (problem.high + problem.low)) / (0.5 * (problem.high - problem.low))


class Memory:
    """The last pairs of every start, newest first at (place - 1)."""

    def __init__(self, count, size):
        self.s, self.y = np.zeros((count, MEMORY, size)), np.zeros((count, MEMORY, size))
        self.rho, self.place, self.scale = np.zeros((count, MEMORY)), np.zeros(count, int), np.ones(count)

    def take(self, rows, s, y):
        product, square = np.sum(s * y, 1), np.sum(y * y, 1)
        good = product > 1e-10 * np.sqrt(square * np.sum(s * s, 1))
        rows, s, y, product, square = rows[good], s[good], y[good], product[good], square[good]
        at = self.place[rows] % MEMORY
        self.s[rows, at], self.y[rows, at], self.rho[rows, at] = s, y, 1.0 / product
        self.scale[rows] = product / square
        self.place[rows] += 1

    def forget(self, rows):
        self.rho[rows] = 0.0

    def keep(self, rows):
        for name in ("s", "y", "rho", "place", "scale"):
            setattr(self, name, getattr(self, name)[rows])

    def direction(self, slope, free):
        """Two loops over the pairs (Nocedal and Wright, algorithm 7.4), among the inputs that are free."""
        rows, d, taken = np.arange(len(slope)), slope * free, []
        for age in range(1, MEMORY + 1):
            at = (self.place - age) % MEMORY
            s, y, rho = self.s[rows, at] * free, self.y[rows, at] * free, self.rho[rows, at]
            a = rho * np.sum(s * d, 1)
            d = d - a[:, None] * y
            taken.append((s, y, rho, a))
        d = d * self.scale[:, None]
        for s, y, rho, a in reversed(taken):
            d = d + (a - rho * np.sum(y * d, 1))[:, None] * s
        return -d * free


def descend(problem, z):
    """Costs and inputs that the starts end in."""
    end_cost, end_z, names = np.full(len(z), np.inf), z.copy(), np.arange(len(z))
    cost, slope = problem.evaluate(z)
    memory = Memory(*z.shape)
    length = 0.1 / np.maximum(np.max(np.abs(slope), 1), 1e-12)  # the first steps change an input by a tenth at most
    way, before = -slope, cost.copy()
    for evaluation in range(1, EVALUATIONS + 1):
        trial = np.clip(z + length[:, None] * way, -1.0, 1.0)
        trial_cost, trial_slope = problem.evaluate(trial)
        with np.errstate(invalid="ignore"):
            good = trial_cost <= cost + 1e-4 * np.sum(slope * (trial - z), 1)
        rows = np.flatnonzero(good)
        memory.take(rows, trial[rows] - z[rows], trial_slope[rows] - slope[rows])
        z[rows], cost[rows], slope[rows] = trial[rows], trial_cost[rows], trial_slope[rows]
        stuck = ~good & (length < 1e-6)
        memory.forget(stuck)
        length = np.where(good, 1.0, 0.3 * length)
        anew = np.flatnonzero(good | stuck)
        free = ~(((z <= -1.0) & (slope > 0.0)) | ((z >= 1.0) & (slope < 0.0)))
        d = memory.direction(slope, free)
        uphill = np.sum(d * slope, 1) >= 0.0
        restart = stuck | uphill
        steepest = -slope * free
        d[restart] = steepest[restart]
        way[anew] = d[anew]
        again = np.flatnonzero(restart & (good | stuck))
        length[again] = 0.01 / np.maximum(np.max(np.abs(way[again]), 1), 1e-12)
        if evaluation % LOOK == 0 or evaluation == EVALUATIONS:
            end_cost[names], end_z[names] = np.where(np.isfinite(cost), cost, np.inf), z
            goes_on = before - cost > 1e-5 * np.abs(cost)
            if not goes_on.any():
                break
            before = cost[goes_on]
            z, cost, slope, way, length, names = (a[goes_on] for a in (z, cost, slope, way, length, names))
            memory.keep(goes_on)
    return end_cost, end_z


def polish(problem, z):
    def one(flat):
        cost, slope = problem.evaluate(flat[None])
        return cost[0], slope[0]

    r = minimize(one, z, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * problem.size,
                 options={"maxiter": 600, "maxfun": 800, "maxcor": 30, "ftol": 1e-14, "gtol": 1e-9})
    return r.fun, r.x


def solve(problem, count):
    """Best cost and inputs; how many random starts reach it, and their median; the next cost."""
    rng = np.random.default_rng(1)
    drawn, drawn_z = descend(problem, draw_starts(problem, count, rng))
    cost, z = drawn, drawn_z
    if problem.nx == 2:
        program_cost, program_z = descend(problem, draw_program(problem))
        cost, z = np.concatenate([cost, program_cost]), np.concatenate([z, program_z])
    for share in ROUNDS:
        near = z[np.argsort(cost)[:16]].repeat(max(1, count // 64), 0)
        near = shift(problem, near, rng) + share * draw_sequences(problem, len(near), rng)
        near = np.clip(near, -1.0, 1.0)
        near_cost, near_z = descend(problem, near)
        cost, z = np.concatenate([cost, near_cost]), np.concatenate([z, near_z])
    order = np.argsort(cost)
    inputs = min((problem.inputs(polish(problem, z[i])[1]) for i in order[:2]), key=problem.cost_of)
    best = problem.cost_of(inputs)
    others = [i for i in order if cost[i] > (1.0 + WITHIN) * best]
    following = min((polish(problem, z[i])[0] for i in others[:1]), default=0.0)
    reached = int(np.sum(drawn <= (1.0 + WITHIN) * best))
    return best, inputs, reached, float(np.median(drawn)), following if following > (1.0 + WITHIN) * best else 0.0


def main():
    np.seterr(over="ignore", invalid="ignore")  # of searches that begin with such a motion; they end at infinity
    parser = argparse.ArgumentParser()
    parser.add_argument("problems")
    parser.add_argument("--starts", type=int, default=128)
    parser.add_argument("--only")
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args()
    with open(args.problems, "rb") as file:
        problems = [Problem(data) for data in tomllib.load(file)["problem"]]
    problems = [p for p in problems if args.only in (None, p.name)]
    if args.check:
        for p in problems:
            print(f"{p.name}: slopes off by {check_slopes(p, np.random.default_rng(2)):.1e}")
        return
    print(f"""\
# The cheapest inputs that minima_reference.py finds, and how many of its starts end within 1 % of their cost. median:
# of the starts' ends; next: the cheapest end that costs over 1 % more, polished (0: it goes on to the optimum). Made by
#   python bench/peers/minima_reference.py bench/planning/minima_problems.toml --starts {args.starts}""")
    for p in problems:
        begin = time.process_time()
        best, inputs, reached, median, following = solve(p, args.starts)
        print(f'\n[[optimum]]\nname = "{p.name}"\ncost = {best:.12g}\nreached = {reached}\nstarts = {args.starts}\n'
              f"median = {median:.6g}\nnext = {following:.6g}\ninputs = [")
        for k in range(0, len(inputs), 8):
            print("  " + ", ".join(map(repr, inputs[k : k + 8])) + ",")
        print("]", flush=True)
        print(f"{p.name}: {best:.6g}, {reached} of {args.starts}, median {median:.6g}, next {following:.6g}, "
              f"{time.process_time() - begin:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
