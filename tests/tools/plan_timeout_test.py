"""plan_timeout_test.py TILLER ROBOT TYPES: [sim] plan_timeout_s of a served plant, against a sender that repeats its
plan.

Run in a network namespace of its own.
"""
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import lcm

TILLER, ROBOT, TYPES = sys.argv[1:4]
sys.path.insert(0, TYPES)
from tiller_lcm import command_t, measurement_t  # noqa: E402

ACTIVE, SECONDS, PERIOD_S = 2, 2.0, 0.02


def serve(timeout_s, thinks):
    """The plant's own account of two seconds of commands that answer every measurement; `thinks`: with new plans."""
    with tempfile.TemporaryDirectory() as folder:
        robot = pathlib.Path(folder) / "robot.toml"
        text = pathlib.Path(ROBOT).read_text()
        assert "[sim]\n" in text
        robot.write_text(text.replace("[sim]\n", f"[sim]\nplan_timeout_s = {timeout_s}\n"))
        bus = lcm.LCM()

        def answer(_, data):
            measurement = measurement_t.decode(data)
            command = command_t()
            command.stamp_us, command.sequence = measurement.stamp_us, measurement.sequence
            command.state, command.count = ACTIVE, 1
            command.plan_sequence = measurement.sequence if thinks else 5
            bus.publish("TILLER_COMMAND", command.encode())

        bus.subscribe("TILLER_MEASUREMENT", answer)
        plant = subprocess.Popen([TILLER, "sim", str(robot), "--serve", "lcm", "--lockstep", "--seconds", str(SECONDS),
                                  "--answer-timeout", "20"], stdout=subprocess.PIPE, text=True)
        while plant.poll() is None:
            bus.handle_timeout(50)
        told = plant.stdout.read()
        plant.stdout.close()
    assert plant.returncode == 0, told
    facts = re.search(r"(\d+) commands, .* (\d+) without a new plan, .* (\d+) watchdog trips", told)
    return tuple(map(int, facts.groups()))


class PlanTimeout(unittest.TestCase):
    def test_the_motor_stops_when_the_timeout_and_the_watchdog_are_over(self):
        for timeout_s in (0.3, 1.0):
            commands, hung, trips = serve(timeout_s, thinks=False)
            self.assertAlmostEqual(hung, (SECONDS - timeout_s) / PERIOD_S, delta=2)
            self.assertAlmostEqual(commands, timeout_s / PERIOD_S, delta=2)
            self.assertEqual(trips, 1)

    def test_zero_and_new_plans_let_it_run(self):
        for timeout_s, thinks in ((0, False), (0.3, True)):
            commands, hung, trips = serve(timeout_s, thinks)
            self.assertGreaterEqual(commands, SECONDS / PERIOD_S - 2)
            self.assertEqual((hung, trips), (0, 0))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
