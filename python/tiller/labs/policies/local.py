"""Local linear models of few transitions, with what is known before them."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from .minimise import Numbers


class LinearStep(NamedTuple):
    """Outputs = slope z + offset + noise of covariance `noise`. Of a period: z = [x; u], outputs the next state."""
    slope: Numbers  # (outputs, inputs)
    offset: Numbers  # (outputs)
    noise: Numbers  # (outputs, outputs)


class Prior(NamedTuple):
    """Inputs and outputs together are normal with a normal-inverse-Wishart prior, worth `mean_strength` samples of the
    mean and `strength` samples of the covariance."""
    mean: Numbers
    covariance: Numbers  # expected
    mean_strength: float
    strength: float


class Data(NamedTuple):
    """Weighted first and second moments."""
    total: float
    mean: Numbers
    covariance: Numbers  # about the mean

    @staticmethod
    def of(samples: Numbers) -> Data:
        """Rows of `samples`."""
        mean = samples.mean(0)
        return Data(float(len(samples)), mean, (samples - mean).T @ (samples - mean) / len(samples))


def fit_step(data: Data, prior: Prior | None, outputs: int, ridge: float = 0.0) -> LinearStep:
    """The posterior's mean, conditioned on the inputs (Levine and Abbeel 2014, section 4; Murphy 2007, equations 200 to
    205):

        mu = (m mu_0 + N mean) / (m + N)
        Sigma = (n_0 Sigma_0 + N S + N m / (N + m) (mean - mu_0)(mean - mu_0)') / (N + n_0)

    `ridge` is added to the diagonal of the inputs' covariance. Without a prior: least squares."""
    mean, covariance = data.mean, data.covariance
    if prior is not None:
        n, m, away = data.total, prior.mean_strength, data.mean - prior.mean
        mean = (m * prior.mean + n * data.mean) / (m + n)
        covariance = (prior.strength * prior.covariance + n * data.covariance
                      + n * m / (n + m) * np.outer(away, away)) / (n + prior.strength)
    inputs = len(mean) - outputs
    given = covariance[:inputs, :inputs] + ridge * np.eye(inputs)
    slope = np.linalg.lstsq(given, covariance[:inputs, inputs:], rcond=None)[0].T
    noise = covariance[inputs:, inputs:] - slope @ covariance[:inputs, inputs:]
    offset = mean[inputs:] - slope @ mean[:inputs]
    return LinearStep(np.asarray(slope, float), offset, 0.5 * (noise + noise.T) + 1e-10 * np.eye(outputs))


def prior_of_model(at: Numbers, after: Numbers, slope: Numbers, spread: Numbers, measured: Numbers, process: Numbers,
                   strength: float, mean_strength: float = 1.0) -> Prior:
    """What a known model says of measured transitions about `at` = [x; u], which it takes to `after` with `slope`.

    spread    (nz, nz) covariance of what is measured of [x; u]
    measured  (nx) variance of the states' measurement, part of it: of what is measured only the rest goes on to the
              next state, so that a noisy state counts less than the model's slope says (errors in variables)
    process   (nx) variance of a period's own disturbance
    """
    nx = len(after)
    noise = np.concatenate([measured, np.zeros(len(at) - nx)])
    kept = np.maximum(0, 1 - noise / np.maximum(np.diag(spread), 1e-300))
    true = np.sqrt(kept)[:, None] * spread * np.sqrt(kept)
    across = slope @ true
    return Prior(np.concatenate([at, after]),
                 np.block([[spread, across.T], [across, across @ slope.T + np.diag(measured + process)]]),
                 mean_strength, strength)


class Mixture(NamedTuple):
    """Rows of earlier runs as a mixture of normals, each of them a rough local model."""
    share: Numbers  # (k)
    mean: Numbers  # (k, d)
    covariance: Numbers  # (k, d, d)


def _memberships(mixture: Mixture, samples: Numbers) -> Numbers:
    """(samples, components), rows sum to one."""
    logs = []
    for share, mean, covariance in zip(*mixture, strict=True):
        root = np.linalg.cholesky(covariance)
        z = np.linalg.solve(root, (samples - mean).T)
        logs.append(np.log(share) - np.log(np.diag(root)).sum() - 0.5 * (z**2).sum(0))
    table = np.array(logs).T
    return np.exp(table - logsumexp(table, 1, keepdims=True))


def fit_mixture(samples: Numbers, components: int, steps: int, seed: int) -> Mixture:
    """Expectation maximisation, each sample first to the nearest of random ones. At most `components`, fewer where data
    are few. Cost: O(steps N components d^2)."""
    count, d = samples.shape
    wanted = max(1, min(components, count // (2 * d)))
    floor = 1e-6 * samples.var(0) + 1e-10
    first = samples[np.random.default_rng([seed, 95]).choice(count, wanted, replace=False)]
    gap = ((samples[:, None] - first) ** 2 / (1e6 * floor)).sum(-1)
    weight = np.eye(wanted)[gap.argmin(1)]
    for _ in range(steps):
        weight = weight[:, weight.sum(0) > 1e-3]
        total = weight.sum(0)
        mean = (weight.T @ samples) / total[:, None]
        away = samples - mean[:, None]
        covariance = np.einsum("nk,kni,knj->kij", weight, away, away) / total[:, None, None] + np.diag(floor)
        mixture = Mixture(total / count, mean, covariance)
        weight = _memberships(mixture, samples)
    return mixture


def prior_of_mixture(mixture: Mixture, samples: Numbers, strength: float, mean_strength: float | None = None) -> Prior:
    """The mixture's moments under the memberships of a few samples of one period, worth `strength` of them (Levine and
    Abbeel 2014, appendix A.3)."""
    share = _memberships(mixture, samples).mean(0)
    mean = share @ mixture.mean
    away = mixture.mean - mean
    covariance = np.einsum("k,kij->ij", share, mixture.covariance + away[:, :, None] * away[:, None])
    return Prior(mean, covariance, strength if mean_strength is None else mean_strength, strength)
