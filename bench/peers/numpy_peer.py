"""Squared one-step residuals of 1,024 cart-poles at recorded transitions, in numpy.

The measured state is shared by all particles, so its sine and cosine are scalars in every variant. `plain`: the
formulas as they stand in episodes.py. `in place`: written for speed, no temporaries, and what depends on the parameters
alone computed once, outside of the timing (which tiller's kernel does not do).
"""

import math

import numpy as np

import episodes
from rounds import cpu_per_call, take_part

N, STEPS, PERIOD, GRAVITY = 1024, 64, episodes.PERIOD, episodes.GRAVITY
TASK = episodes.TASKS["cart-pole"]


def recorded():
    """Parameters (2, N), and (state, change, force) of some transitions."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.1, 1.0, (2, N)), list(zip(rng.normal(0, 1, (STEPS, 4)), rng.normal(0, 0.1, (STEPS, 4)),
                                                   rng.uniform(-12, 12, STEPS)))


class Plain:
    def __init__(self, kind):
        params, steps = recorded()
        self.params = params.astype(kind)
        self.steps = [(x.astype(kind), d.astype(kind), kind(u)) for x, d, u in steps]  # doubles would make doubles
        self.squared = np.zeros((4, N), kind)

    def add(self, step):
        x, change, force = step
        a_cart, a_pole = TASK.accelerations(x, force, self.params)
        dv, dw = PERIOD * a_cart, PERIOD * a_pole
        self.squared[0] += (change[0] - PERIOD * (x[2] + dv)) ** 2
        self.squared[1] += (change[1] - PERIOD * (x[3] + dw)) ** 2
        self.squared[2] += (change[2] - dv) ** 2
        self.squared[3] += (change[3] - dw) ** 2


class InPlace:
    def __init__(self, kind):
        (pole, half), steps = recorded()
        as_kind = lambda values: np.ascontiguousarray(values, dtype=kind)
        inertia = 4.0 / 3.0 * pole * half * half
        self.kind = kind
        self.moment, self.inertia, self.whole = as_kind(pole * half), as_kind(inertia), as_kind(1.0 + pole)
        self.whole_inertia = as_kind((1.0 + pole) * inertia)
        self.coupling, self.push, self.turn, self.inverse, self.gain, self.t = (np.empty(N, kind) for _ in range(6))
        self.squared = np.zeros((4, N), kind)
        self.steps = [tuple(map(kind, (math.cos(x[1]), math.sin(x[1]) * x[3] ** 2, u, GRAVITY * math.sin(x[1]),
                                       d[0] - PERIOD * x[2], d[1] - PERIOD * x[3], d[2], d[3]))) for x, d, u in steps]

    def add(self, step):
        cosine, swirl, force, pull, *change = step
        np.multiply(self.moment, cosine, out=self.coupling)
        np.multiply(self.moment, swirl, out=self.push)
        self.push += force
        np.multiply(self.moment, pull, out=self.turn)
        np.multiply(self.coupling, self.coupling, out=self.inverse)
        np.subtract(self.whole_inertia, self.inverse, out=self.inverse)
        np.divide(self.kind(PERIOD), self.inverse, out=self.inverse)
        self.add_rows(0, self.inertia, self.push, self.turn, change[0], change[2])
        self.add_rows(1, self.whole, self.turn, self.push, change[1], change[3])

    def add_rows(self, row, mass, own, other, position, rate):
        """A joint's position and rate: rate gains period (mass own - coupling other) / determinant."""
        np.multiply(mass, own, out=self.gain)
        np.multiply(self.coupling, other, out=self.t)
        self.gain -= self.t
        self.gain *= self.inverse
        np.subtract(rate, self.gain, out=self.t)
        self.t *= self.t
        self.squared[2 + row] += self.t
        self.gain *= self.kind(PERIOD)
        np.subtract(position, self.gain, out=self.t)
        self.t *= self.t
        self.squared[row] += self.t


def error(cloud):
    """Largest relative error of the sums, against double."""
    params, steps = recorded()
    for step in cloud.steps:
        cloud.add(step)
    want = sum(np.square(d[:, None] - TASK.change(x[:, None] * np.ones(N), u, params)) for x, d, u in steps)
    return float(np.max(np.abs(cloud.squared / want - 1)))


def contenders(name, cloud):
    def ring():
        for step in cloud.steps:
            cloud.add(step)

    facts = {"error": error(cloud), "numpy": np.__version__}
    return {f"{name}, one transition": (lambda: cpu_per_call(lambda: cloud.add(cloud.steps[0])) / N, facts),
            f"{name}, 64 transitions": (lambda: cpu_per_call(ring) / (N * STEPS), facts)}


every = {}
for kind in (np.float64, np.float32):
    every.update(contenders(f"numpy {kind.__name__} plain", Plain(kind)))
    every.update(contenders(f"numpy {kind.__name__} in place", InPlace(kind)))
take_part(every)
