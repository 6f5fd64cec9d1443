"""How ./dev bench gap mujoco judges answers, and that its cases are what its rates are said to be of."""

import argparse
import os
import sys
import unittest

sys.path.insert(0, os.environ["TILLER_BENCH"])

import _gap_mujoco as mujoco  # noqa: E402

CATALOGUE = {"tilt": {"aliases": ["sensor_bias"]}}


def answer(verdict, *sets):
    ranking = [{"effects": [dict(zip(("kind", "port"), e.split("@"))) for e in s], "parameters": []} for s in sets]
    return {"verdict": verdict, "ranking": ranking, "ambiguity": list(range(len(sets))), "catalogue": CATALOGUE}


def outcome(truth, verdict, *sets):
    return mujoco.judge(truth, answer(verdict, *sets))[0]


class Judge(unittest.TestCase):
    def test_exact(self):
        self.assertEqual(outcome(["tilt@body"], "named", ["tilt@body"]), "exact")
        self.assertEqual(outcome(["tilt@body"], "named", ["sensor_bias@angle_rad"], ["tilt@body"]), "exact")
        self.assertEqual(outcome(["asymmetric_friction@joint"], "named", ["asymmetric_friction@joint"],
                                 ["constant_offset@joint", "coulomb_friction@joint"]), "exact")

    def test_less_than_exact(self):
        self.assertEqual(outcome(["tilt@body"], "partly_explained", ["tilt@body"]), "in_set")
        self.assertEqual(outcome(["cogging@joint"], "ambiguous", ["tilt@body"], ["cogging@joint"]), "in_set")
        self.assertEqual(outcome(["a@x", "b@y"], "named", ["a@x"]), "part")

    def test_wrong(self):
        self.assertEqual(outcome(["cogging@joint"], "named", ["tilt@body"]), "wrong")
        self.assertEqual(outcome(["viscous_friction@cart"], "named", ["viscous_friction@pole"]), "wrong")
        self.assertEqual(outcome([], "named", ["tilt@body"]), "wrong")
        self.assertEqual(outcome(["tilt@body"], "named", ["a@x", "tilt@body"]), "wrong")

    def test_no_name(self):
        self.assertEqual(outcome(["tilt@body"], "no_gap"), "none")
        self.assertEqual(outcome(["tilt@body"], "unnamed"), "unnamed")
        self.assertEqual(outcome(["tilt@body"], "unfit"), "unfit")


class Cases(unittest.TestCase):
    def cases(self, **changes):
        return list(mujoco.cases_of(argparse.Namespace(**{"tune": False, "seeds": 1, "kinds": [], **changes})))

    def test_every_kind_in_every_plant_that_can_show_it(self):
        cases = self.cases()
        self.assertEqual(len({c["id"] for c in cases}), len(cases))
        hidden = {(c["plant"], *c["kinds"]) for c in cases if c["kinds"]}
        self.assertEqual(len(hidden), 4 * len(mujoco.KINDS) - 4)
        self.assertNotIn(("linear_axis", "tilt"), hidden)
        self.assertEqual(sum(not c["kinds"] for c in cases), 4 * len(mujoco.NOISES) * mujoco.NULLS_A_SEED)

    def test_tuning_and_scoring_seeds_never_meet(self):
        self.assertEqual({c["seed"] for c in self.cases(seeds=2)}, {31, 32})
        self.assertEqual({c["seed"] for c in self.cases(seeds=2, tune=True)}, {100001, 100002})


if __name__ == "__main__":
    unittest.main()
