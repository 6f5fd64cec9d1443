"""pytorch_mppi on the cart-pole of the comparisons: K = 1536, N = 50, single precision, one thread, fresh noise."""

import math

import torch
from pytorch_mppi import MPPI

from rounds import cpu_per_call, take_part

Q = torch.tensor([0.1, 1.0, 0.01, 0.01])
QF = torch.tensor([100.0, 100.0, 10.0, 10.0])


def dynamics(x, u):
    a, v, w = x[:, 1], x[:, 2], x[:, 3]
    force = u[:, 0].clamp(-20.0, 20.0)
    s, c, h, j = torch.sin(a), torch.cos(a), 0.05, 0.1 * 0.25 * 4 / 3
    push, turn = force + h * s * w * w, h * 9.81 * s
    det = 1.1 * j - h * h * c * c
    v = v + 0.02 * (j * push - h * c * turn) / det
    w = w + 0.02 * (1.1 * turn - h * c * push) / det
    return torch.stack([x[:, 0] + 0.02 * v, a + 0.02 * w, v, w], dim=1)


def wrapped(x):
    return torch.stack([x[..., 0], torch.remainder(x[..., 1] + math.pi, 2 * math.pi) - math.pi, x[..., 2], x[..., 3]], -1)


def running_cost(x, u):
    return 0.5 * ((wrapped(x) ** 2 * Q).sum(-1) + 0.001 * u[:, 0] ** 2)


def terminal_cost(states, actions):
    return 0.5 * (wrapped(states[..., -1, :]) ** 2 * QF).sum(-1)


def controller(temperature):
    torch.manual_seed(1)
    return MPPI(dynamics, running_cost, 4, torch.tensor([[64.0]]), num_samples=1536, horizon=50,
                lambda_=temperature, terminal_state_cost=terminal_cost, u_min=torch.tensor([-20.0]),
                u_max=torch.tensor([20.0]))


def closed_loop(temperature, steps=400):
    mppi, x, cost = controller(temperature), torch.tensor([[0.0, math.pi, 0.0, 0.0]]), 0.0
    for _ in range(steps):
        u = mppi.command(x[0]).reshape(1, 1)
        cost += float(running_cost(x, u)[0])
        x = dynamics(x, u)
    return cost


def main():
    torch.set_num_threads(1)
    with torch.no_grad():
        costs = {t: closed_loop(t, 200) for t in (0.1, 1.0, 10.0)}
        best = min(costs, key=costs.get)
        mppi, x = controller(best), torch.tensor([0.0, 3.0, 0.1, 0.5])
        take_part({"pytorch_mppi": (lambda: cpu_per_call(lambda: mppi.command(x)),
                                    {"cost_200_steps": costs[best], "temperature": best})})


main()
