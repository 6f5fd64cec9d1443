"""Mixtures of normals: fitted to weighted points by expectation maximisation, drawn from within bounds."""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp
from scipy.stats import chi2

Array = npt.NDArray[np.float64]

MOST_COMPONENTS, STARTS, STEPS = 4, 4, 200
STRONG_EVIDENCE = 6.0  # of the Bayesian information criterion, for every component more
LEAST_SHARE = 1e-3  # a component's deviation over the whole's, in any direction


@dataclass(frozen=True)
class Mixture:
    weight: Array  # (k)
    mean: Array  # (k, d)
    covariance: Array  # (k, d, d)
    low: Array | float = -np.inf
    high: Array | float = np.inf

    def cut(self, low: Array, high: Array) -> Mixture:
        return replace(self, low=low, high=high)

    def over_its_cut(self, rng: np.random.Generator) -> Mixture:
        """With weights over the share that lies within the bounds: log_density() is then the law of draw()."""
        v = self._draw_uncut(rng, 4096)
        inside = ((v >= self.low) & (v <= self.high)).all(axis=1).mean()
        return replace(self, weight=self.weight / max(inside, 1 / 4096))

    def beside(self, other: Mixture) -> Mixture:
        """The sum of both densities, within the same bounds."""
        return replace(self, **{key: np.concatenate([getattr(self, key), getattr(other, key)])
                                for key in ("weight", "mean", "covariance")})

    def widened(self, factor: float) -> Mixture:
        """With deviations `factor` times as large."""
        return replace(self, covariance=factor**2 * self.covariance)

    def _draw_uncut(self, rng: np.random.Generator, count: int) -> Array:
        which = rng.choice(len(self.weight), count, p=self.weight / self.weight.sum())
        z = rng.normal(size=(count, self.mean.shape[1]))
        return self.mean[which] + np.einsum("nij,nj->ni", np.linalg.cholesky(self.covariance)[which], z)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Within the bounds: by rejection, and what is left after a hundred tries is clipped to them."""
        v = self._draw_uncut(rng, count)
        for _ in range(100):
            bad = ((v < self.low) | (v > self.high)).any(axis=1)
            if not bad.any():
                return v
            v[bad] = self._draw_uncut(rng, int(bad.sum()))
        return np.clip(v, self.low, self.high)

    def _squares(self, v: Array) -> Array:
        """Squared Mahalanobis distances (n, k)."""
        roots = np.linalg.cholesky(self.covariance)
        z = np.stack([np.linalg.solve(root, (v - mean).T) for root, mean in zip(roots, self.mean)])
        return (z**2).sum(axis=1).T

    def log_parts(self, v: Array) -> Array:
        """log of weight times density, (n, k)."""
        log_det = np.linalg.slogdet(self.covariance)[1]
        d = self.mean.shape[1]
        with np.errstate(divide="ignore"):
            return np.log(self.weight) - 0.5 * (self._squares(v) + log_det + d * np.log(2 * np.pi))

    def log_density(self, v: Array) -> Array:
        """The cut's constant is left out; -infinity outside of the bounds."""
        inside = ((v >= self.low) & (v <= self.high)).all(axis=1)
        return np.where(inside, logsumexp(self.log_parts(v), axis=1), -np.inf)

    def covers(self, v: Array) -> npt.NDArray[np.bool_]:
        """Within the ellipsoid that holds 99.9 % of one of the normals."""
        return (self._squares(v) < chi2.ppf(0.999, self.mean.shape[1])).any(axis=1)


def _moments(v: Array, share: Array, floor: Array) -> tuple[Array, Array, Array]:
    """Weights (k), means and covariances of points that belong to components by `share` (n, k)."""
    weight = share.sum(axis=0)
    mean = share.T @ v / weight[:, None]
    off = v[:, None] - mean
    return weight, mean, np.einsum("nk,nki,nkj->kij", share, off, off) / weight[:, None, None] + floor


def _maximise(v: Array, w: Array, share: Array, floor: Array, effective: float) -> tuple[float, Mixture] | None:
    """The mean log density; None where a component has fewer effective points than a normal has parameters."""
    before, least = -np.inf, 2 + v.shape[1] * (v.shape[1] + 3) / 2
    for _ in range(STEPS):
        weight, mean, covariance = _moments(v, share, floor)
        if share.shape[1] > 1 and (weight * effective < least).any():
            return None
        mixture = Mixture(weight, mean, covariance)
        parts = mixture.log_parts(v)
        log_density = logsumexp(parts, axis=1)
        now = float(w @ log_density)
        if abs(now - before) < 1e-8:
            break
        before, share = now, w[:, None] * np.exp(parts - log_density[:, None])
    return now, mixture


def fit_mixture(v: Array, w: Array, low: Array, high: Array) -> Mixture:
    """Of one to four normals, by the Bayesian information criterion, to points v (n, d) of weights w. Each is widened
    by what its count of points leaves unknown; a cut by bounds is allowed for (_allow_for_cut)."""
    w = w / w.sum()
    effective, d = 1 / float((w**2).sum()), v.shape[1]
    _, centre, whole = _moments(v, w[:, None], 1e-300 * np.eye(d))
    floor = LEAST_SHARE**2 * whole[0] + 1e-300 * np.eye(d)
    z = np.linalg.solve(np.linalg.cholesky(floor), (v - centre).T).T
    rng = np.random.default_rng(0)
    best, best_value = None, np.inf
    for k in range(1, MOST_COMPONENTS + 1):
        for _ in range(STARTS if k > 1 else 1):
            seeds = z[rng.choice(len(z), k, p=w)]
            nearest = ((z[:, None] - seeds) ** 2).sum(axis=2).argmin(axis=1)
            share = w[:, None] * np.eye(k)[nearest]
            found = _maximise(v, w, share, floor, effective) if (share.sum(axis=0) > 0).all() else None
            if found is None:
                continue
            value = (k - 1 + k * d * (d + 3) / 2) * np.log(effective) - 2 * effective * found[0]
            if best is None or value + STRONG_EVIDENCE * (k - len(best.weight)) < best_value:
                best, best_value = found[1], value
    assert best is not None
    points = effective * best.weight
    factor = np.minimum(4.0, (points + 1) / np.maximum(points - 1, 0.1))
    best = replace(best, weight=best.weight / best.weight.sum(), covariance=factor[:, None, None] * best.covariance)
    return _allow_for_cut(best.cut(low, high), centre[0], np.sqrt(np.diag(whole[0])))


def _allow_for_cut(mixture: Mixture, mean: Array, sd: Array) -> Mixture:
    """Moves and widens until the cut mixture has the points' means and deviations; else a parameter of which nothing is
    known would lose a fifth of its width with every file."""
    reach = 5 * np.sqrt(np.diagonal(mixture.covariance, axis1=1, axis2=2))
    if ((mixture.mean - reach > mixture.low) & (mixture.mean + reach < mixture.high)).all():
        return mixture
    for _ in range(60):
        v = mixture.draw(np.random.default_rng(1), 8192)
        off, ratio = mean - v.mean(axis=0), np.clip(sd / v.std(axis=0), 0.7, 1.4)
        if (np.abs(off) < 0.002 * sd).all() and (ratio < 1.002).all():
            break
        # the square: a cut normal's deviation follows its uncut one ever more slowly; a normal four ranges wide is flat
        own = np.sqrt(np.diagonal(mixture.covariance, axis1=1, axis2=2))
        factor = np.maximum(1.0, np.minimum(ratio**2, 4 * (mixture.high - mixture.low) / own))
        mixture = replace(mixture, mean=np.clip(mixture.mean + off, mixture.low, mixture.high),
                          covariance=factor[:, :, None] * mixture.covariance * factor[:, None, :])
    return mixture
