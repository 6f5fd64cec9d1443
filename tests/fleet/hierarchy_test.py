"""The fleet's distribution: against integrals on a grid, against known answers, and with what logs cannot say."""

import os
import sys
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_PYTHON_PACKAGE"])

import numpy as np  # noqa: E402

from tiller_tools.fleet import chance, hierarchy, identify_fleet, odd  # noqa: E402
from tiller_tools.fleet.jobs import Job  # noqa: E402
from tiller_tools.fleet.summaries import (Coordinate, Evidence, disagreement, divide_prior,  # noqa: E402
                                          evidence_of, together)

LOG = Coordinate("mass_kg", "kg", True, np.log(0.5), 0.4, True)
FLAT = Coordinate("offset_Nm", "N m", False, 0.0, 0.5, False)


def evidence(mean, covariance):
    lam = np.linalg.inv(np.atleast_2d(covariance))
    return Evidence(lam, lam @ np.atleast_1d(mean))


def one_parameter(robots, seed, spread=0.1):
    rng = np.random.default_rng(seed)
    sd = rng.uniform(0.03, 0.2, robots)
    return rng.normal(0.3, np.hypot(spread, sd)), sd


class Hierarchy(unittest.TestCase):
    def test_one_parameter_is_that_of_a_grid(self):
        """Centre and spread of twelve robots by sums over a grid: no code of the sampler, no conjugacy."""
        y, s = one_parameter(12, 3)
        coordinate = Coordinate("a", "", False, 0.0, 0.5, True)
        fleet = hierarchy.fleet_of([evidence(m, d**2) for m, d in zip(y, s)], [coordinate])
        draws = hierarchy.sample(fleet, seed=1, chains=8, burn=100, draws=700)
        mu, tau = np.meshgrid(np.linspace(-0.6, 1.2, 401), np.linspace(1e-3, 1.0, 600), indexing="ij")
        log = -0.5 * (mu / 0.5) ** 2 - 1.5 * np.log1p((tau / 0.5) ** 2 / 2)  # normal, half-t with 2 degrees
        for m, d in zip(y, s):
            log -= 0.5 * np.log(tau**2 + d**2) + 0.5 * (m - mu) ** 2 / (tau**2 + d**2)
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        for grid, drawn in ((mu, draws.flat("mean")[:, 0]), (tau, np.sqrt(draws.flat("covariance")[:, 0, 0]))):
            order = np.argsort(grid, axis=None)
            share = np.cumsum(weight.ravel()[order])
            exact = grid.ravel()[order][np.searchsorted(share, [0.05, 0.5, 0.95])]
            width = exact[2] - exact[0]
            # 5,600 correlated draws: an effective thousand leaves 0.02 of the width at the median, 0.05 at the edges
            np.testing.assert_allclose(np.quantile(drawn, [0.05, 0.5, 0.95]), exact, atol=0.06 * width)

    def test_same_seed_same_bits(self):
        y, s = one_parameter(8, 1)
        fleet = hierarchy.fleet_of([evidence(m, d**2) for m, d in zip(y, s)], [FLAT])
        one, two = (hierarchy.sample(fleet, 5, chains=2, burn=5, draws=20) for _ in range(2))
        np.testing.assert_array_equal(one.theta, two.theta)

    def test_a_robot_without_information_is_any_of_the_fleet(self):
        y, s = one_parameter(40, 2)
        parts = [evidence(m, d**2) for m, d in zip(y, s)] + [Evidence(np.zeros((1, 1)), np.zeros(1))]
        draws = hierarchy.sample(hierarchy.fleet_of(parts, [FLAT]), 1)
        blank = draws.flat("theta")[:, -1, 0]
        self.assertAlmostEqual(blank.mean(), draws.flat("mean").mean(), delta=0.03)
        self.assertAlmostEqual(blank.std(), np.sqrt(draws.flat("covariance").mean()), delta=0.03)
        self.assertEqual(odd.ranks(hierarchy.fleet_of(parts, [FLAT]))[-1], 0)


class Summaries(unittest.TestCase):
    def test_the_prior_is_divided_out(self):
        """Likelihood times prior, then without it: the likelihood again."""
        lam = np.array([[40.0, 5.0], [5.0, 9.0]])
        eta = lam @ np.array([-0.6, 0.2])
        covariance = np.linalg.inv(lam + np.diag([1 / 0.4**2, 0]))
        mean = covariance @ (eta + np.array([np.log(0.5) / 0.4**2, 0]))
        back = divide_prior(mean, covariance, [LOG, FLAT])
        np.testing.assert_allclose(back.lam, lam, rtol=1e-9)
        np.testing.assert_allclose(back.eta, eta, rtol=1e-9)

    def test_what_logs_do_not_say_is_no_information(self):
        """A posterior a little wider than its prior by chance must not become a negative precision."""
        back = divide_prior(np.array([np.log(0.5)]), np.array([[0.41**2]]), [LOG])
        np.testing.assert_array_equal(back.lam, [[0.0]])

    def test_draws_become_their_gaussian(self):
        draws = np.exp(np.random.default_rng(1).normal(-0.7, 0.02, (20000, 1)))
        found = evidence_of(draws, [LOG])
        # 0.05 = 0.02 / 0.4, the prior's part
        self.assertAlmostEqual(found.lam[0, 0] * 0.02**2, 1 - 0.05**2, delta=0.03)
        self.assertAlmostEqual(found.eta[0] / found.lam[0, 0], -0.7, delta=0.002)

    def test_logs_that_disagree(self):
        near, far = evidence(0.1, 0.01), evidence(0.6, 0.01)
        statistic, degrees = disagreement([near, far])
        self.assertEqual(degrees, 1)
        self.assertAlmostEqual(statistic, 0.5**2 / 0.02, places=9)
        self.assertAlmostEqual(disagreement([near, near])[0], 0, places=9)
        np.testing.assert_allclose(together([near, far]).eta / together([near, far]).lam[0], [0.35])


class Odd(unittest.TestCase):
    def test_tails_are_those_of_tables(self):
        for degrees, x in ((1, 3.841), (2, 5.991), (3, 7.815), (4, 9.488), (7, 14.067)):
            self.assertAlmostEqual(float(chance.chi_square_tail(x, degrees)), 0.05, places=4)
        self.assertAlmostEqual(chance.normal_tail(1.959964), 0.05, places=6)

    def fleet(self, seed, robots=60, strange=()):
        y, s = one_parameter(robots, seed)
        for i in strange:
            y[i] += 1.5
        return hierarchy.fleet_of([evidence(m, d**2) for m, d in zip(y, s)], [FLAT])

    def test_odd_ones_do_not_hide_each_other(self):
        found = odd.suspects(self.fleet(1, strange=(3, 7, 11)), 0.05 / 60)
        self.assertEqual(list(np.flatnonzero(found)), [3, 7, 11])

    def test_false_alarms_are_as_rare_as_promised(self):
        """One fleet in twenty may have a name: more than five of twenty-five would come once in 800 times."""
        named = 0
        for seed in range(25):
            fleet = self.fleet(seed, robots=15)
            _, tails, _ = odd.judge(fleet, [], 0.05 / 15, 1, chains=2, burn=30, draws=60)
            named += (tails < 0.05 / 15).any()
        self.assertLessEqual(named, 5)

    def test_who_is_no_outlier_after_all_goes_back(self):
        """What a plug-in population calls odd, and a population that is not known exactly does not."""
        fleet = self.fleet(1, robots=15)
        draws, tails, out = odd.judge(fleet, [], 0.2, 1, chains=2, burn=30, draws=60)
        self.assertFalse((out & (tails >= 0.2)).any())
        self.assertEqual(draws.theta.shape[2], (~out).sum())

    def test_a_number_apart_is_an_outlier(self):
        values = np.concatenate([np.random.default_rng(2).normal(0, 1, 200), [9.0, np.nan]])
        tails = odd.outliers(values)
        self.assertEqual(list(np.flatnonzero(tails < 0.05 / 200)), [200])

    def test_residuals_that_go_with_something_are_named(self):
        rng = np.random.default_rng(3)

        def job_and_result(name, spring=0.0):
            z = rng.standard_normal(3)
            samples = np.exp(rng.normal(-0.7, 0.02, (64, 1))).tolist()
            trend = {"name": "angle_rad", "value": z[0] + spring, "change": z[1], "inputs": {"torque_Nm": z[2]}}
            prior = {"mean": 0.5, "sd": 0.2, "stated": {"kind": "log_normal", "a": 0.5, "b": 0.4}}
            parameter = {"name": "mass_kg", "unit": "kg", "fixed": False, "prior": prior, "mean": 0.5, "sd": 0.01,
                         "interval_90": [0.48, 0.52]}
            result = {"tiller": "0", "robot": "r", "parameters": [parameter], "samples": samples, "noise_scale": 1.0,
                      "residual_trends": [trend]}
            return Job(name, name, Path(name), ()), {"result": result}

        fitted = [job_and_result(f"r{i:02d}") for i in range(40)] + [job_and_result("spring", spring=-9.0)]
        tails, quantities = identify_fleet.Robots(fitted).strange_residuals()
        self.assertEqual(list(np.flatnonzero(tails < 0.05 / 41 / 3)), [40])
        self.assertEqual(quantities[40], "angle_rad")
        for _, kept in fitted:  # results of versions that say nothing of it
            del kept["result"]["residual_trends"]
        self.assertEqual(identify_fleet.Robots(fitted).strange_residuals()[0].min(), 1.0)


if __name__ == "__main__":
    unittest.main()
