"""The fleet's own distribution: robots are draws from a Gaussian population whose mean and covariance are unknown.

    theta_i ~ N(mu, T)            parameters of robot i, in coordinates
    logs_i | theta_i              likelihood exp(eta_i' theta - theta' lam_i theta / 2)  (summaries.py)
    mu ~ N(prior of the robot file), flat where that is uniform
    T  ~ half-t on each standard deviation, any correlation (Huang and Wand 2013)

Solved by Gibbs sampling: (mu, theta) jointly given T, then T, then the scales of its prior. docs/theory/fleet.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .summaries import Coordinate, Evidence

NU = 2.0  # of the half-t on the standard deviations; 2 makes every correlation equally likely


@dataclass
class Fleet:
    """The robots' evidence as arrays, and the prior of the population."""

    lam: np.ndarray  # (n x d x d)
    eta: np.ndarray  # (n x d)
    mean_precision: np.ndarray  # (d) of mu's prior
    mean_centre: np.ndarray  # (d)
    scale: np.ndarray  # (d) of the half-t

    @property
    def size(self) -> int:
        return len(self.eta)

    def part(self, keep: np.ndarray) -> Fleet:
        return Fleet(self.lam[keep], self.eta[keep], self.mean_precision, self.mean_centre, self.scale)


@dataclass
class Draws:
    """Of the posterior: (chains x draws ...)."""

    mean: np.ndarray  # (c x s x d)
    covariance: np.ndarray  # (c x s x d x d)
    theta: np.ndarray  # (c x s x n x d)

    def flat(self, name: str) -> np.ndarray:
        values = getattr(self, name)
        return values.reshape(-1, *values.shape[2:])


def fleet_of(evidence: list[Evidence], coordinates: list[Coordinate]) -> Fleet:
    sd = np.array([c.prior_sd for c in coordinates])
    gaussian = np.array([c.gaussian for c in coordinates])
    return Fleet(np.array([e.lam for e in evidence]), np.array([e.eta for e in evidence]),
                 np.where(gaussian, 1 / sd**2, 0.0), np.array([c.prior_mean for c in coordinates]), sd)


def marginal(fleet: Fleet, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """With theta integrated out, what robot i says of mu: precision v (... n x d x d) and w (... n x d).

    `covariance` is (... x d x d), of as many populations as wanted.
    """
    shrink = np.linalg.inv(np.eye(fleet.eta.shape[1]) + fleet.lam @ covariance[..., None, :, :])  # (I + lam T)^-1
    v = shrink @ fleet.lam
    return 0.5 * (v + np.swapaxes(v, -1, -2)), (shrink @ fleet.eta[..., None])[..., 0]


def posterior_mean_of_mu(fleet: Fleet, v: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (... x d) and covariance (... x d x d) of mu given T."""
    covariance = np.linalg.inv(v.sum(axis=-3) + np.diag(fleet.mean_precision))
    mean = covariance @ (w.sum(axis=-2) + fleet.mean_precision * fleet.mean_centre)[..., None]
    return mean[..., 0], 0.5 * (covariance + np.swapaxes(covariance, -1, -2))


def robots_given(fleet: Fleet, mu: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (... n x d) and covariance (... n x d x d) of each robot's parameters given the population."""
    inverse = np.linalg.inv(covariance)
    spread = np.linalg.inv(fleet.lam + inverse[..., None, :, :])
    pull = fleet.eta + (inverse @ mu[..., None])[..., 0][..., None, :]
    return (spread @ pull[..., None])[..., 0], 0.5 * (spread + np.swapaxes(spread, -1, -2))


def expectation_maximisation(fleet: Fleet, rounds: int = 200, start: np.ndarray | None = None):
    """mu and T near the most likely ones; the prior of T counts as one robot a tenth as wide as its scale."""
    covariance = np.diag((0.3 * fleet.scale) ** 2) if start is None else start
    floor = np.diag((0.1 * fleet.scale) ** 2)
    for _ in range(rounds):
        mu, _ = posterior_mean_of_mu(fleet, *marginal(fleet, covariance))
        mean, spread = robots_given(fleet, mu, covariance)
        apart = mean - mu
        new = (apart.T @ apart + spread.sum(axis=0) + floor) / (fleet.size + 1)
        done = np.max(np.abs(new - covariance) / np.sqrt(np.outer(np.diag(new), np.diag(new)))) < 1e-6
        covariance = new
        if done:
            break
    return mu, covariance


def _normal(rng: np.random.Generator, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """One draw for each mean (... x d)."""
    return mean + (np.linalg.cholesky(covariance) @ rng.standard_normal(mean.shape)[..., None])[..., 0]


def _wishart_inverse(rng: np.random.Generator, degrees: float, scale: np.ndarray) -> np.ndarray:
    """A draw from the inverse Wishart of each scale (c x d x d): Bartlett's triangle of a Wishart, inverted."""
    chains, d = scale.shape[:2]
    root = np.linalg.cholesky(np.linalg.inv(scale))
    triangle = np.tril(rng.standard_normal((chains, d, d)), -1)
    at = np.arange(d)
    triangle[:, at, at] = np.sqrt(rng.chisquare(degrees - at, (chains, d)))
    inverse = np.linalg.inv(root @ triangle)
    return np.swapaxes(inverse, 1, 2) @ inverse


def _scale_of(fleet: Fleet, extra: np.ndarray, theta: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """(c x d x d) scale of T's inverse Wishart given all else."""
    apart = theta - mu[:, None, :]
    return 2 * NU * np.eye(fleet.eta.shape[1]) / extra[:, None, :] + np.swapaxes(apart, 1, 2) @ apart


def sample(fleet: Fleet, seed: int, chains: int = 4, burn: int = 100, draws: int = 400) -> Draws:
    """Gibbs sampling, chains side by side, from starts around the most likely covariance. Same seed, same bits.

    A sweep costs some (chains x robots) inversions of d x d: 1,000 robots of two parameters take about 10 ms.
    """
    (n, d), rng = fleet.eta.shape, np.random.Generator(np.random.PCG64(seed))
    _, likely = expectation_maximisation(fleet)
    covariance = likely * (0.5 * 4.0 ** (np.arange(chains) / max(1, chains - 1)))[:, None, None]
    extra = np.ones((chains, d))
    out = Draws(np.empty((chains, draws, d)), np.empty((chains, draws, d, d)),
                np.empty((chains, draws, n, d), dtype=np.float32))
    for step in range(-burn, draws):
        mu = _normal(rng, *posterior_mean_of_mu(fleet, *marginal(fleet, covariance)))
        theta = _normal(rng, *robots_given(fleet, mu, covariance))
        covariance = _wishart_inverse(rng, NU + d - 1 + n, _scale_of(fleet, extra, theta, mu))
        rate = NU * np.diagonal(np.linalg.inv(covariance), axis1=1, axis2=2) + 1 / fleet.scale**2
        extra = rate / rng.gamma(0.5 * (NU + d), 1.0, (chains, d))
        if step >= 0:
            out.mean[:, step], out.covariance[:, step], out.theta[:, step] = mu, covariance, theta
    return out


def split_r_hat(values: np.ndarray) -> float:
    """Gelman and others' split R-hat of (chains x draws): near 1 where the chains agree with themselves."""
    half = values.shape[1] // 2
    parts = np.concatenate([values[:, :half], values[:, half:2 * half]])
    within, between = parts.var(axis=1, ddof=1).mean(), parts.mean(axis=1).var(ddof=1)
    return float(np.sqrt((within * (half - 1) / half + between) / within)) if within > 0 else 1.0


def worst_r_hat(draws: Draws) -> float:
    d = draws.mean.shape[2]
    sd = np.sqrt(np.diagonal(draws.covariance, axis1=2, axis2=3))
    return max(split_r_hat(chains[:, :, k]) for chains in (draws.mean, np.log(sd)) for k in range(d))
