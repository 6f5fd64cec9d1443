"""Forces without an equation: fits whose answer is known, and `tiller learn` from logs of a hidden spring."""
import json
import math
import subprocess
import sys

import numpy as np
import pytest

for needed in ("jax", "optax", "tomlkit"):
    pytest.importorskip(needed)

import tiller  # noqa: E402
from tiller._command import run as run_tiller  # noqa: E402
from tiller.labs.forces import ensemble, process  # noqa: E402
from tiller.labs.forces.data import Logs, Samples  # noqa: E402
from tiller.labs.forces.network import evaluate  # noqa: E402

NOISE = 0.05
ROBOT = """[robot]
name = "hidden"
[model]
name = "pendulum"
period_s = 0.01
[parameters]
mass_kg = { normal = [0.5, 0.025] }
length_m = 0.5
damping_Nms = 0.02
[measurement]
angle_rad = { sd = 3e-4 }
[limits]
torque_Nm = { low = -5.0, high = 5.0 }
[noise]
process_sd = { rate_rad_s = 0.01 }  # of the file
"""


def line(samples, useless=0):
    """y = sin 2x on [-2, 2] with noise, in units that leave it as it is."""
    rng = np.random.default_rng(1)
    x = np.linspace(-2, 2, samples)[:, None]
    y = np.sin(2 * x) + NOISE * rng.normal(size=x.shape)
    x = np.hstack([x, rng.normal(size=(samples, useless))])
    return Samples(x, y, np.ones_like(y), np.arange(samples) // 10, np.zeros(1 + useless), np.ones(1 + useless),
                   np.ones(1))


def said(kind, hidden, members, weights, x):
    network = {"kind": kind, "hidden": hidden, "members": members, "outputs": ["force"], "weights": weights}
    return evaluate(network, np.atleast_2d(x))[:, 0]


def test_an_ensemble_agrees_where_data_are_and_not_beyond():
    weights = ensemble.fit(line(300), 5, [16, 16], 1200, 256, 1)
    x = np.linspace(-1.8, 1.8, 21)
    inside, beyond = (said("tanh", [16, 16], 5, weights, at) for at in (x, np.where(x < 0, x - 3, x + 3)))
    rms = np.sqrt(np.mean((inside.mean(0) - np.sin(2 * x)) ** 2))
    assert rms < NOISE  # it is averaged over three hundred samples
    assert beyond.std(0).mean() > 3 * inside.std(0).mean()


def test_an_ensemble_is_the_same_to_the_last_bit():
    first, again = (ensemble.fit(line(100), 2, [16, 16], 200, 256, 1) for _ in range(2))
    assert (first == again).all()
    assert (first[:len(first) // 2] != first[len(first) // 2:]).any()


def test_draws_of_a_process_have_the_exact_posteriors_moments():
    """By plain algebra on all samples, without inducing points."""
    samples, at = line(200), np.array([-1.5, 0.0, 0.7, 3.0, 6.0])
    weights, shape, scales = process.fit(samples, 181, 30, 1, waves=256, fitted=200)
    length, signal, noise = scales.length[0], scales.signal[0], scales.noise[0]
    assert noise == pytest.approx(NOISE, abs=0.02)

    def kernel(a, b):
        return signal**2 * np.exp(-0.5 * ((a[:, None] - b) / length) ** 2)

    x, y = samples.x[:, 0], samples.y[:, 0]
    solved = np.linalg.solve(kernel(x, x) + noise**2 * np.eye(len(x)), np.column_stack([y, kernel(x, at)]))
    mean = kernel(at, x) @ solved[:, 0]
    sd = np.sqrt(np.diag(kernel(at, at) - kernel(at, x) @ solved[:, 1:]))
    drawn = said("gaussian", shape, 181, weights, at)
    assert drawn[0] == pytest.approx(mean, abs=0.02)
    # 180 draws: five standard errors of a mean and of a deviation; the waves' kernel is one of 256 features
    assert (abs(drawn[1:].mean(0) - mean) < 5 * sd / math.sqrt(180) + 0.01).all()
    # the 256 waves are one draw for all members: their kernel is off by 1/sqrt(256), in a deviation the half of it
    assert (abs(drawn[1:].std(0) - sd) < 5 * sd / math.sqrt(360) + sd / 8 + 0.01).all()


def test_the_length_of_an_input_that_tells_nothing_grows():
    scales = process.fit_scales(line(150, useless=1), 1, 150)
    assert scales.length[1] > 3 * scales.length[0]


def spring(angle, _rate):
    return -1.2 * angle * abs(angle)


def write_log(path, seed, force=spring, seconds=8.0, read=lambda q: q):
    """A point mass on a rod under a multisine torque held over each period, by a stepper of its own at 0.2 ms."""
    rng = np.random.default_rng(seed)
    phase, q, v, lines = 2 * math.pi * rng.random(4), 0.0, 0.0, ["time_s,angle_rad,torque_Nm"]
    for k in range(round(seconds / 0.01)):
        u = sum(s * math.sin(2 * math.pi * f * 0.01 * k + p)
                for s, f, p in zip((0.6, 0.5, 0.35, 0.3), (0.23, 0.61, 0.97, 1.7), phase))
        lines.append(f"{0.01 * k:.2f},{read(q) + 3e-4 * rng.normal():.9g},{u:.9g}")
        for _ in range(50):
            v += 2e-4 * (u - 0.5 * 9.81 * 0.5 * math.sin(q) - 0.02 * v + force(q, v)) / 0.125
            q += 2e-4 * v
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def learn(folder, *words):
    ended = subprocess.run([sys.executable, "-m", "tiller.labs", "learn", str(folder / "robot.toml"), *words],
                           capture_output=True, text=True, timeout=800)
    return ended.returncode, ended.stdout + ended.stderr


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("learn")
    (folder / "robot.toml").write_text(ROBOT, encoding="utf-8")
    logs = [write_log(folder / f"log_{i}.csv", 11 + i) for i in range(4)]
    code, text = learn(folder, *logs, "-o", str(folder / "out"), "--no-catalogue", "--members", "3", "--inducing", "24")
    return folder, code, text


def test_a_hidden_spring_is_learnt_and_the_file_runs(learnt):
    folder, code, text = learnt
    assert code == 0, text
    result = json.loads((folder / "out/learn.json").read_text(encoding="utf-8"))
    assert {one["name"] for one in result["candidates"]} == {"network", "gaussian_process"}
    for one in result["candidates"]:
        assert one["ratio"] < 0.35, text  # the nine local weights come to a fifth on these worlds
        assert one["spread_ratio"] > 1.5 and one["held_out"]["covered"] >= 0.85, text
    robot = tiller.Robot.from_toml(folder / "out/hidden_learnt.toml")
    assert "# of the file" in (folder / "out/hidden_learnt.toml").read_text(encoding="utf-8")
    assert robot.params[-1].endswith("member")
    run_tiller(["run", str(folder / "out/hidden_learnt.toml"), "--sim", "--seconds", "0.5"])


def test_forces_are_right_where_the_logs_were_and_rollouts_nearer(learnt):
    """On a log that nothing has seen, from its true start."""
    folder, _, _ = learnt
    plain, with_forces = (tiller.Robot.from_toml(folder / name) for name in ("robot.toml", "out/hidden_learnt.toml"))
    rows = [line.split(",") for line in open(write_log(folder / "fresh.csv", 99), encoding="utf-8")][1:101]
    u = np.array([[float(row[2])] for row in rows])
    measured = np.array([float(row[1]) for row in rows])
    params = np.array(with_forces.prior_centre)
    params[-1] = 0.5

    def error(robot, params):
        return np.sqrt(np.mean((tiller.rollout(robot, np.zeros(2), u, params)[:-1, 0] - measured) ** 2))

    assert error(with_forces, params) < 0.35 * error(plain, plain.prior_centre)


def test_what_is_learnt_of_nothing_is_refused(tmp_path):
    (tmp_path / "robot.toml").write_text(ROBOT, encoding="utf-8")
    logs = [write_log(tmp_path / f"log_{i}.csv", 5 + i, force=lambda q, v: 0.0) for i in range(3)]
    code, text = learn(tmp_path, *logs, "-o", str(tmp_path / "out"), "--no-catalogue", "--form", "gaussian")
    assert code == 2 and "refused" in text, text
    assert not (tmp_path / "out/hidden_learnt.toml").exists()


def test_an_encoder_off_its_centre_is_read_through(tmp_path):
    (tmp_path / "robot.toml").write_text(ROBOT, encoding="utf-8")
    paths = [write_log(tmp_path / f"log_{i}.csv", 21 + i, force=lambda q, v: 0.0, read=lambda q: q + 0.06 * math.sin(q))
             for i in range(3)]
    logs = Logs(tmp_path / "robot.toml", paths, 0.25, tmp_path)
    alone = logs.ground()
    found = logs.catalogue(alone, 1)
    assert "encoder_eccentricity" in found.document["origin"]
    assert found.before.rms_sigma < 0.2 * alone.before.rms_sigma


@pytest.mark.parametrize(("change", "says"), [("", "3.0 s"), ("still", "must move"), ("learnt", "already")])
def test_what_the_logs_or_the_file_lack_is_told(tmp_path, change, says):
    log = write_log(tmp_path / "log.csv", 9, seconds=3.0 if not change else 8.0)
    text = ROBOT
    if change == "still":
        lines = open(log, encoding="utf-8").read().splitlines()
        (tmp_path / "log.csv").write_text("\n".join([lines[0]] + [row.split(",")[0] + ",0,0" for row in lines[1:]]))
    if change == "learnt":
        network = {"format": "tiller network", "version": 1, "kind": "tanh", "members": 1, "hidden": [0, 0],
                   "inputs": ["sin angle_rad", "cos angle_rad", "rate_rad_s", "torque_Nm"], "outputs": ["joint_Nm"],
                   "weights": [0.0] * 5}
        (tmp_path / "net.json").write_text(json.dumps(network), encoding="utf-8")
        text += '[[effects]]\nkind = "network"\n[network]\nfile = "net.json"\n'
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    code, said = learn(tmp_path, log, "--no-catalogue")
    assert code == 3 and says in said, said
