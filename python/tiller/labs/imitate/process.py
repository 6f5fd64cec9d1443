"""Processes of few states and actions: occupancies, and the policy that is nearest to a demonstrator's."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from .problem import Numbers


@dataclass(frozen=True)
class FiniteProcess:
    start: Numbers     # (states)
    next: Numbers      # (actions, states, states): row s, column s'
    discount: float = 0.9

    @property
    def states(self) -> int:
        return len(self.start)

    @property
    def actions(self) -> int:
        return len(self.next)

    def flow(self) -> Numbers:
        """(states, states * actions): an occupancy o of this process has flow o = (1 - discount) start."""
        leaves = np.repeat(np.eye(self.states), self.actions, 1)
        arrives = np.transpose(self.next, (2, 1, 0)).reshape(self.states, -1)
        return np.asarray(leaves - self.discount * arrives)

    def occupancy(self, policy: Numbers) -> Numbers:
        """(states * actions) of a policy (states, actions), discounted, sums to one."""
        chain = np.einsum("sa,ast->st", policy, self.next)
        visits = (1 - self.discount) * np.linalg.solve(np.eye(self.states) - self.discount * chain.T, self.start)
        return np.asarray((visits[:, None] * policy).ravel())

    def best_occupancy(self, cost: Numbers) -> Numbers:
        """Of the policy of least cost (states * actions), by policy iteration."""
        costs, choice = cost.reshape(self.states, self.actions), np.zeros(self.states, int)
        every = np.arange(self.states)
        for _ in range(1000):
            chain = self.next[choice, every]
            value = np.linalg.solve(np.eye(self.states) - self.discount * chain, costs[every, choice])
            q = costs + self.discount * np.einsum("ast,t->sa", self.next, value)
            better = q.min(1) < q[every, choice] - 1e-12
            if not better.any():
                break
            choice = np.where(better, q.argmin(1), choice)
        return self.occupancy(np.eye(self.actions)[choice])

    def least_total_variation(self, demonstrated: Numbers) -> tuple[float, Numbers]:
        """The least total variation from a demonstrated occupancy over all policies, and the occupancy that has it:
        the game's value where the reward may be any function. One linear program, no planner."""
        size = self.states * self.actions
        rows = np.zeros((self.states + size, 3 * size))
        rows[:self.states, :size] = self.flow()
        rows[self.states:] = np.hstack([np.eye(size), -np.eye(size), np.eye(size)])
        done = linprog(np.concatenate([np.zeros(size), np.full(2 * size, 0.5)]), A_eq=rows,
                       b_eq=np.concatenate([(1 - self.discount) * self.start, demonstrated]), method="highs")
        return float(done.fun), done.x[:size]
