"""./dev bench posterior reads the tables that programs print, hides no short row, and says what it does not know."""

import argparse
import contextlib
import io
import os
import stat
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, os.environ["TILLER_BENCH"])
sys.path.insert(0, os.environ["TILLER_BENCH"] + "/../peers")

import posterior  # noqa: E402
import robot  # noqa: E402

# As bench_table.hpp prints: "  %-58s %10.4g %-8s %-16s %s".
TABLE = [
    "measuring, 15 interleaved repetitions each ...",
    "",
    "cart-pole, sigma 0.03, 1000 runs",
    "  %-58s %10.4g %-8s %-16s %s" % ("mean log density online (exact 9.00, paper 4.66)", 8.94, "nats", "goal >= 9", "short"),
    "  %-58s %10.4g %-8s %-16s %s" % ("  loss: median", -0.012, "nats", "goal <= 0.05", "met"),
    "  %-58s %10.4g %-8s %-16s %s" % ("  no goal", 3.0, "us", "", ""),
    "  %-58s %10.4g %-8s %-16s %s" % ("x" * 80, float("nan"), "", "goal <= 3", "short"),
    "  %-58s %10.4g %-8s %-16s %s" % ("tiny", 1.5e-07, "s", "goal <= 1e-06", "met"),
    "",
    "3 rows met, 2 short",
]


def quietly(function, *arguments, **more):
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return function(*arguments, **more)


class Robot(unittest.TestCase):
    """./dev bench robot: what fails, or prints no number, is never met, and does not lose the other sections."""

    def verdicts(self, rows):
        return [(r["row"], r["met"]) for r in rows]

    def test_fuzzers(self):
        said = "dev: fuzz_can: 20000000 executions, no finding\ndev: fuzz_csv: 9000000 executions, no finding\n"
        both = [("executions: can", True), ("executions: csv", False)]
        self.assertEqual(self.verdicts(quietly(robot.fuzz_rows, 0, said)), [*both, ("fuzzers with a finding", True)])
        rows = quietly(robot.fuzz_rows, 1, said + "dev: findings in: log mcap; the inputs are in build/fuzz/findings\n")
        self.assertEqual(self.verdicts(rows), [*both, ("fuzzers with a finding", False)])
        self.assertEqual(rows[-1]["figure"], 2)
        for code, text in ((1, said), (1, ""), (0, "")):
            with self.assertRaises(robot.NotMeasured):
                quietly(robot.fuzz_rows, code, text)

    def test_targets(self):
        said = ("dev: testing build/cortex-m7\ndev: testing build/reproducible-aarch64\n"
                "    # instructions_per_tick_most 6790485\n  # flash_bytes 402100\n  # ram_bytes 143308\n"
                "  the same bits over 10000 ticks in 3 builds\n")
        rows = quietly(robot.target_rows, 0, said, presets=2, builds=3)
        self.assertTrue(all(r["met"] for r in rows), rows)
        rows = quietly(robot.target_rows, 0, "", presets=2, builds=3)
        self.assertFalse(any(r["met"] for r in rows), "what was not printed is short")
        with self.assertRaises(robot.NotMeasured):
            quietly(robot.target_rows, 1, said, presets=2, builds=3)

    def test_a_section_that_fails_does_not_lose_the_others(self):
        args = argparse.Namespace(failed=[])
        def broken(_):
            raise robot.NotMeasured("no compiler")
        robot.SECTIONS["broken"] = ("broken", broken)
        try:
            self.assertEqual(quietly(robot.run_section, args, "broken"), [])
        finally:
            del robot.SECTIONS["broken"]
        self.assertEqual(args.failed, ["broken"])

    def test_tests_that_do_not_exist_are_short(self):
        build = Path(tempfile.mkdtemp())
        (build / "CTestTestfile.cmake").write_text("add_test(good true)\nadd_test(bad false)\n")
        args = argparse.Namespace(build=build, quick=False, tests_built=True)
        for pattern, figure, met in (("^none$", 0, False), ("^good$", 100, True), ("good|bad", 50, False)):
            (row,) = quietly(robot.tests, args, "heap", "heading", "what", pattern)
            self.assertEqual((row["figure"], row["met"]), (figure, met), pattern)

    def test_every_section_is_told_in_the_help(self):
        for name in robot.SECTIONS:
            self.assertIn(f"    {name} ", robot.__doc__)


class Driver(unittest.TestCase):
    def parse_error(self, *arguments):
        with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
            posterior.parse(list(arguments))
        return said.getvalue()

    def test_every_row_with_a_goal_is_read(self):
        rows = posterior.rows_of("accuracy", TABLE)
        self.assertEqual([r["met"] for r in rows], [False, True, False, True])
        self.assertEqual(rows[0]["heading"], "cart-pole, sigma 0.03, 1000 runs")
        self.assertEqual(rows[0]["figure"], 8.94)
        self.assertEqual(rows[0]["goal"], ">= 9")
        self.assertEqual(rows[1]["row"], "loss: median")
        self.assertEqual(rows[3]["figure"], 1.5e-07)

    def test_summary_shows_short_rows(self):
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            posterior.summary(posterior.rows_of("accuracy", TABLE))
        self.assertIn("2 rows met, 2 short", printed.getvalue())
        self.assertEqual(printed.getvalue().count(" short\n"), 3, "two rows and the count")

    def test_arguments(self):
        self.assertEqual(posterior.parse([]).sections, posterior.SECTIONS)
        self.assertEqual(posterior.parse(["--quick"]).sections, list(posterior.QUICK))
        args = posterior.parse(["accuracy", "--runs", "100"])
        self.assertEqual((args.sections, args.rest), (["accuracy"], ["--runs", "100"]))
        args = posterior.parse(["--", "accuracy", "--runs", "100"])
        self.assertEqual((args.sections, args.rest), (["accuracy"], ["--runs", "100"]))
        args = posterior.parse(["--build", "elsewhere", "methods", "--only", "accuracy"])
        self.assertEqual((args.sections, args.rest), (["methods"], ["--only", "accuracy"]))
        self.assertEqual(str(args.build), "elsewhere")
        args = posterior.parse(["--peers", "numpy,sbi"])
        self.assertEqual((args.sections, args.wanted), (["peers"], ["numpy", "sbi"]))
        self.assertEqual(posterior.parse(["peers", "--rounds", "3"]).rounds, 3)
        self.assertIn("no section 'acuracy'", self.parse_error("acuracy"))
        self.assertIn("no peer 'pyro'", self.parse_error("--peers", "pyro"))
        self.assertIn("name its section", self.parse_error("--runs", "100"))

    def program(self, text):
        build = Path(tempfile.mkdtemp())
        path = build / "bench/bench_residual"
        path.parent.mkdir(parents=True)
        path.write_text("#!/bin/sh\n" + text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return build

    def run_quietly(self, section, build, arguments=()):
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            return *posterior.run_program(section, build, list(arguments)), printed.getvalue()

    def test_programs(self):
        table = "printf '%-60s %10s %-8s %-16s %s\\n' \"  rate $1\" 2100 M/s 'goal >= 2000' met\n"
        rows, good, _ = self.run_quietly("residual", self.program(table), ["now"])
        self.assertTrue(good)
        self.assertEqual((rows[0]["row"], rows[0]["figure"], rows[0]["met"]), ("rate now", 2100.0, True))
        rows, good, printed = self.run_quietly("residual", self.program(table + "exit 3\n"))
        self.assertFalse(good, "a program that fails is an error")
        self.assertIn("failed with 3", printed)
        rows, good, printed = self.run_quietly("methods", self.program(table))
        self.assertEqual((rows, good), ([], True))
        self.assertIn("this build has no bench_methods", printed)


class Tasks(unittest.TestCase):
    """The numpy twin of the accuracy benchmark's tasks, from the equations of motion."""

    def test_energy_is_kept(self):
        import numpy as np

        import episodes as ep

        # at 1e-5 s and without input or damping, semi-implicit Euler keeps the energy to first order in the step
        def pendulum(x, p):
            return 0.5 * p[0] * p[1] ** 2 * x[1] ** 2 - p[0] * 9.81 * p[1] * np.cos(x[0])

        def cart_pole(x, p):
            m, l = p
            return (0.5 * (1 + m) * x[2] ** 2 + m * l * x[2] * x[3] * np.cos(x[1]) + 2 / 3 * m * l * l * x[3] ** 2 +
                    m * 9.81 * l * np.cos(x[1]))

        def acrobot(x, p):
            m1, m2 = p
            v2 = 1 / 3 * (x[2] + x[3]) ** 2 + x[2] ** 2 + x[2] * (x[2] + x[3]) * np.cos(x[1])
            return (m1 / 6 * x[2] ** 2 + 0.5 * m2 * v2 - 9.81 * (0.5 * m1 + m2) * np.cos(x[0]) -
                    9.81 * 0.5 * m2 * np.cos(x[0] + x[1]))

        begin = {"pendulum": [1.0, 2.0], "cart-pole": [0.1, 2.0, 0.3, 1.0], "acrobot masses": [0.5, -0.8, 1.0, 2.0]}
        step = 1e-5
        for name, energy in (("pendulum", pendulum), ("cart-pole", cart_pole), ("acrobot masses", acrobot)):
            task, p, x = ep.TASKS[name], np.array([0.6, 0.8]), np.array(begin[name])
            half, first = len(x) // 2, energy(np.array(begin[name]), p)
            for _ in range(20000):
                damping = 0.02 * x[1] if name == "pendulum" else 0.0
                rate = np.array(task.accelerations(x, damping, p))
                x[half:] += step * rate
                x[:half] += step * x[half:]
            self.assertLess(abs(energy(x, p) - first), 2e-3 * abs(first), name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
