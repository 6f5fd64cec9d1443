"""tiller policy end to end: each method writes a policy that the runtime follows, the same seed the same one, and what
is wrong is told."""
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jax")

from tiller import _core
from tiller.labs.__main__ import main
from tiller.labs.policies.feedback import command, document, make_feedback
from tiller.labs.policies.moments import Normal
from tiller.labs.policies.plant import PlantTrials, measured_deviation
from tiller.labs.policies.physics import Model
from tiller.labs.policies.task import make_task
from tiller.labs.robot_text import with_words

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
PENDULUM = str(ROBOTS / "pendulum.toml")
SHORT = ["--seconds", "1", "--quiet", "--trials", "1", "--bumps", "4", "--evaluations", "5"]


def under(policy, text=None, name="pendulum.toml"):
    """The robot whose planner is this policy file."""
    text = text or (ROBOTS / name).read_text(encoding="utf-8")
    return _core.Robot.from_text(with_words(text, {"planner": {"kind": "policy", "fallback": "policy"},
                                                   "policy": {"file": str(policy)}}), str(ROBOTS / name))


def answers(robot, x):
    alone, facts = _core.PlannerAlone(robot), _core.training_facts(robot)
    params = np.tile(robot.prior_centre, (alone.hypotheses, 1))
    return alone.plan(np.asarray(x, float), np.zeros(0), params.ravel(), robot.prior_centre,
                      np.zeros(len(robot.params)), facts["safe_command"], 0)[0]


@pytest.mark.parametrize("kind", ["rbf", "linear"])
def test_the_runtime_answers_as_the_laboratory(tmp_path, kind):
    robot = _core.Robot.from_toml(PENDULUM)
    task = make_task(robot, 0.1, 1.0)
    policy = make_feedback(task, kind, 6, Normal(np.zeros(3), np.eye(3)), 0.5, [3])
    path = tmp_path / "p.json"
    path.write_text(json.dumps(document(task, policy.network(), "sine")), encoding="utf-8")
    runtime = under(path)
    for x in ([0.3, -1.0], [2.0, 4.0], [-3.0, 0.1]):
        # its weights are in single precision, and the bumps' are hundreds that nearly cancel
        assert answers(runtime, x) == pytest.approx(np.asarray(command(task, policy)(np.array(x))), abs=1e-3)


@pytest.mark.parametrize("method", [[], ["--method", "reps", "--kind", "linear"]])
def test_a_search_writes_a_policy_and_its_page_and_again_the_same(tmp_path, method):
    files = [tmp_path / "p.json", tmp_path / "again.json"]
    page = tmp_path / "p.html"
    assert main(["policy", PENDULUM, *SHORT, *method, "-o", str(files[0]), "--page", str(page)]) in (0, 2)
    written = json.loads(files[0].read_text())
    assert written["format"] == "tiller policy" and "sin angle_rad" in written["network"]["inputs"]
    search = json.loads((tmp_path / "p_search.json").read_text())
    assert len(search["trials"]) == 2 and search["units"]["rate_rad_s"] == "rad/s"
    assert np.shape(search["trials"][1]["forecast_mean"]) == (2, 11)
    if not method:
        assert main(["policy", PENDULUM, *SHORT, "-o", str(files[1])]) == 0
        assert files[0].read_text() == files[1].read_text()
    robot = under(files[0])
    assert np.all(np.abs(answers(robot, [1.0, 0.0])) <= 1.5)


@pytest.mark.parametrize("words", [["guided", "--conditions", "1"], ["simopt", "--updates", "3"]])
def test_a_search_by_cost_writes_a_network_that_the_runtime_follows(tmp_path, words):
    out = tmp_path / "g.json"
    assert main(["policy", PENDULUM, "--method", *words, "--iterations", "1", "--seconds", "1", "--quiet", "-o",
                 str(out)]) == 0
    written = json.loads(out.read_text())
    assert written["network"]["kind"] == "tanh" and written["squash"] == "cut"
    assert np.all(np.abs(answers(under(out), [1.0, 0.0])) <= 1.5)


def test_what_is_missing_is_told(tmp_path, capsys):
    text = Path(PENDULUM).read_text(encoding="utf-8")
    bare = tmp_path / "bare.toml"
    bare.write_text(text[:text.index("[sim]")], encoding="utf-8")
    assert main(["policy", str(bare), "-o", str(tmp_path / "p.json")]) == 1
    assert "has no [sim] section" in capsys.readouterr().err
    arm = str(ROBOTS / "two_link_arm.toml")
    assert main(["policy", arm, "--method", "guided", "-o", str(tmp_path / "p.json")]) == 1
    assert "costs of states alone" in capsys.readouterr().err
    assert main(["policy", PENDULUM, "--method", "reps", "--match", "a.csv", "-o", str(tmp_path / "p.json")]) == 1
    assert "--match: is of pilco" in capsys.readouterr().err
    assert main(["policy", PENDULUM, "--prior", "network", "-o", str(tmp_path / "p.json")]) == 1
    assert "adaptive_ilqr" in capsys.readouterr().err
    idle = tmp_path / "idle.toml"
    idle.write_text(text.replace("state_weight = { angle_rad = 4.0, rate_rad_s = 0.05 }", ""), encoding="utf-8")
    assert main(["policy", str(idle), "-o", str(tmp_path / "p.json")]) == 1
    assert "state_weight: the start costs nothing" in capsys.readouterr().err
    assert main(["policy", PENDULUM, "--method", "magic"]) == 1
    assert main(["policy", PENDULUM, "-o", str(tmp_path)]) == 1
    assert "name a file that can be written" in capsys.readouterr().err


def test_ctrl_c_after_a_trial_writes_its_policy(tmp_path):
    out = tmp_path / "p.json"
    words = [sys.executable, "-m", "tiller.labs", "policy", PENDULUM, "--trials", "900", "--seconds", "0.5", "--bumps",
             "4", "--evaluations", "5", "-o", str(out)]
    child = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    for line in child.stderr:
        if line.startswith("trial 3"):
            child.send_signal(signal.SIGINT)
            break
    end = time.monotonic() + 300
    assert "interrupted" in child.stderr.read() and time.monotonic() < end
    assert child.wait() == 130 and json.loads(out.read_text())["format"] == "tiller policy"


def test_trials_are_of_one_plant_with_noise_and_starts_of_their_own():
    robot = _core.Robot.from_toml(PENDULUM)
    task = make_task(robot, 0.1, 1.0)
    sd = measured_deviation(robot, 0.1)
    assert sd == pytest.approx([0.002, np.sqrt(2) * 0.002 / 0.1])
    run = PlantTrials(robot, 0.1, task.horizon, sd, task.start_mean, task.start_covariance, 1)
    still = lambda x, k: np.zeros(1)
    first, second, again = run(still, 0), run(still, 1), run(still, 0)
    assert np.array_equal(first.measured, again.measured) and not np.array_equal(first.truth, second.truth)
    off = np.concatenate([run(still, i).measured - run(still, i).truth for i in range(40)])
    assert off.std(0) == pytest.approx(sd, rel=0.2)  # 440 draws: five standard errors
    # a pendulum that is let go follows the model, whose parameters are near the plant's
    pushed = run(lambda x, k: np.array([1.0]), 2)
    physics = Model(robot, 0.1).physics()
    after = np.array([physics(np.append(x, 1.0))[0] for x in pushed.truth[:-1]])
    assert np.abs(after - pushed.truth[1:]).max() < 0.2 * np.ptp(pushed.truth, 0).max()


def test_the_slopes_own_derivative_is_that_of_differences():
    import jax

    physics = Model(_core.Robot.from_toml(PENDULUM), 0.1).physics()
    z, by = np.array([1.0, -2.0, 0.5]), np.random.default_rng(1).standard_normal((2, 3))
    whole = lambda z: (physics(z)[1] * by).sum() + physics(z)[0].sum()
    found = np.asarray(jax.grad(whole)(z))
    for i in range(3):
        h = np.eye(3)[i] * 1e-5
        assert found[i] == pytest.approx((float(whole(z + h)) - float(whole(z - h))) / 2e-5, rel=1e-4, abs=1e-6)


def test_demonstrations_are_read_from_logs_and_matched(tmp_path, capsys):
    """Three pushes of a pendulum, by a stepper of its own; one of them tells no spread."""
    logs = []
    for i, push in enumerate((0.8, 0.9, 1.0)):
        angle, rate, lines = 0.0, 0.0, ["time_s,angle_rad,torque_Nm"]
        for k in range(80):
            torque = push * np.sin(0.1 * k)
            lines.append(f"{0.02 * k},{angle},{torque}")
            for _ in range(20):
                rate += 0.001 * (torque - 0.05 * rate - 0.5 * 9.81 * 0.5 * np.sin(angle)) / 0.125
                angle += 0.001 * rate
        logs.append(str(tmp_path / f"{i}.csv"))
        Path(logs[-1]).write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ["policy", PENDULUM, *(w for w in SHORT if w != "--quiet"), "-o", str(tmp_path / "p.json"), "--match"]
    assert main([*words, logs[0]]) == 1 and "two or more" in capsys.readouterr().err
    assert main([*words, *logs]) == 0
    said = capsys.readouterr().err
    assert "of one of them 10" in said and "expected divergence" in said  # ten periods of two states


def test_an_adaptive_lqr_is_compared_with_the_model_alone(tmp_path, capsys):
    """The servo's plant was fitted to measurements; its model was not."""
    out = tmp_path / "none.json"
    assert main(["policy", str(ROBOTS / "xl330.toml"), "--method", "adaptive_lqr", "--period", "0.02", "--seconds", "2",
                 "--trials", "1", "-o", str(out)]) == 0
    alone, learnt = map(float, re.findall(r"median of 1: (\S+) and (\S+)", capsys.readouterr().out)[0])
    assert 0 < learnt < alone and not out.exists()
