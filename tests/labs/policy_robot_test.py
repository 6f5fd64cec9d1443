"""`tiller policy --on-robot`: trials by `tiller run` over LCM, against `tiller sim` as the robot. Run by
in_network_namespace.sh."""
import json
import os
import pathlib
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("jax", exc_type=ImportError)

from tiller.labs.policies.on_robot import TrialFailed, read_trial
from tiller.labs.policies.search import realised_cost

ROOT = pathlib.Path(__file__).resolve().parents[2]
HEADER = "time_s,angle_rad,torque_Nm,mean.angle_rad,mean.rate_rad_s,state,status\n"


def robot_file(folder):
    text = (ROOT / "robots/pendulum.toml").read_text(encoding="utf-8")
    file = folder / "robot.toml"
    file.write_text(text + '\n[transport]\nkind = "lcm"\n', encoding="utf-8")
    return file


def task_of(file):
    from tiller import _core
    from tiller.labs.policies.task import make_task
    return make_task(_core.Robot.from_toml(str(file)), 0.1, 1.0)


# The robot: before each trial it stands at its start again.
RESET = """
import os, pathlib, signal, subprocess, sys
pid = pathlib.Path("plant.pid")
if pid.exists():
    os.kill(int(pid.read_text()), signal.SIGTERM)
plant = subprocess.Popen([sys.executable, "-m", "tiller", "sim", sys.argv[1], "--serve", "lcm", "--lockstep"],
                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
pid.write_text(str(plant.pid))
"""


@pytest.fixture
def reset(tmp_path):
    (tmp_path / "reset.py").write_text(RESET, encoding="utf-8")
    yield f"{sys.executable} reset.py served.toml"
    pid = tmp_path / "plant.pid"
    if pid.exists():
        os.kill(int(pid.read_text()), signal.SIGTERM)


def test_a_policy_is_searched_on_a_robot_over_lcm(tmp_path, reset):
    file = robot_file(tmp_path)
    text = file.read_text(encoding="utf-8")
    (tmp_path / "served.toml").write_text(text.replace("period_s = 0.02", "period_s = 0.1"), encoding="utf-8")
    ended = subprocess.run([sys.executable, "-m", "tiller.labs", "policy", str(file), "--on-robot", "--arm",
                            "--lockstep", "--reset", reset, "--trials", "1", "--seconds", "2", "--evaluations", "3",
                            "--restarts", "0", "--bumps", "5", "-o", "policy.json"],
                           cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0, ended.stderr
    assert "a policy by chance" in ended.stderr and "trial 2: cost" in ended.stderr
    assert json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))["format"] == "tiller policy"
    assert not (tmp_path / "robot_trial.toml").exists()
    logs = sorted((tmp_path / "policy_trials").glob("trial_*.csv"))
    trials = [read_trial(log, task_of(file)) for log in logs]
    assert len(trials) == 2 and all(len(t.command) == 10 for t in trials)  # a log has a row more than is asked for
    assert np.abs(trials[0].command).max() > 0.05 and np.abs(trials[0].command).max() <= 1.5
    assert not np.array_equal(trials[0].command, trials[1].command)


def rows(states):
    return "".join(f"{0.1 * k},0,{k},{0.5 * k},{-k},{state},ok\n" for k, state in enumerate(states))


def test_a_trial_is_what_the_log_has_while_the_robot_moved(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text(HEADER + rows(["STANDBY"] * 3 + ["ACTIVE"] * 4 + ["SAFE"] * 5), encoding="utf-8")
    task = task_of(robot_file(tmp_path))
    trial = read_trial(log, task)
    assert trial.measured.tolist() == [[1.5, -3], [2, -4], [2.5, -5], [3, -6]]
    assert trial.command.tolist() == [[3], [4], [5]]
    whole = realised_cost(task, trial._replace(truth=np.tile(task.start_mean, (11, 1)), command=np.zeros((10, 1))))
    cut = realised_cost(task, trial._replace(truth=np.tile(task.start_mean, (4, 1)), command=np.zeros((3, 1))))
    assert cut == pytest.approx(0.3 * whole + 7)  # each of the seven missing periods costs one


@pytest.mark.parametrize("text", ["", HEADER, HEADER + rows(["STANDBY"] * 4), HEADER + rows(["ACTIVE"]),
                                  "time_s,state\n0,ACTIVE\n1,ACTIVE\n2,ACTIVE\n",
                                  HEADER + "0,0,nan,0,0,ACTIVE,ok\n" * 3])
def test_a_log_that_teaches_nothing_is_named(tmp_path, text):
    log = tmp_path / "log.csv"
    log.write_text(text, encoding="utf-8")
    with pytest.raises(TrialFailed, match="log.csv"):
        read_trial(log, task_of(robot_file(tmp_path)))


@pytest.mark.parametrize("words,told", [(["--arm"], "--on-robot"), (["--on-robot", "--method", "guided"], "guided")])
def test_what_does_not_go_together_is_refused(tmp_path, words, told):
    ended = subprocess.run([sys.executable, "-m", "tiller.labs", "policy", str(robot_file(tmp_path)), *words],
                           cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 1 and told in ended.stderr, ended.stderr
