"""tiller infer, from the guide's own simulator and logs to a posterior that tiller reads; and what a
simulator does wrong."""
import json
import math
import pathlib
import re
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip("jax")
pytest.importorskip("equinox")
pytest.importorskip("optax")

from tiller.labs import InferenceError  # noqa: E402
from tiller.labs.problem import read_problem  # noqa: E402
from tiller.labs.simulator import Pool  # noqa: E402

GUIDE = pathlib.Path(__file__).resolve().parents[2] / "docs/guide/simulator.md"
FRICTION = 0.42


def guide(language):
    text = re.search(rf"```{language}\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL).group(1)
    return text.replace('"python3"', json.dumps(sys.executable))


def write_log(path, seed):
    """The guide's puck by a stepper of its own at 0.1 ms, pushed to and fro, with the sensor's noise."""
    rng, x, v, rows = np.random.default_rng(seed), 0.0, 0.0, ["time_s,position_m,force_N"]
    for k in range(200):
        force_N = (1 if k // 25 % 2 == 0 else -1) * 8.0 if k % 25 < 6 else 0.0
        rows.append(f"{0.02 * k:.2f},{x + 0.001 * rng.normal():.6f},{force_N}")
        for _ in range(200):
            free, grip = v + 1e-4 * force_N / 0.5, 1e-4 * FRICTION * 9.81
            v = 0.0 if abs(free) <= grip else free - math.copysign(grip, free)
            x += 1e-4 * v
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.fixture
def puck(tmp_path):
    (tmp_path / "puck.py").write_text(guide("python"), encoding="utf-8")
    (tmp_path / "puck.toml").write_text(guide("toml"), encoding="utf-8")
    for seed in (1, 2):
        write_log(tmp_path / f"run{seed}.csv", seed)
    return tmp_path


def labs(folder, *arguments):
    return subprocess.run([sys.executable, "-m", "tiller.labs", "infer", *arguments], cwd=folder, capture_output=True,
                          text=True, timeout=600)


@pytest.mark.parametrize("options", [("--simulations", "600", "--rounds", "3"),
                                     ("--method", "abc_regression", "--simulations", "600", "--accept", "0.1")])
def test_learns_the_guides_friction(puck, options):
    ended = labs(puck, "puck.toml", "run1.csv", "run2.csv", "-o", "out", "--processes", "2", *options)
    assert ended.returncode in (0, 2), ended.stderr  # 2: no matplotlib for the page
    found = json.loads((puck / "out/infer.json").read_text())
    friction = found["parameters"][0]
    assert friction["interval_90"][0] < FRICTION < friction["interval_90"][1]
    assert friction["sd"] < 0.05 and found["simulations"] == 640 and found["held_out"] > 0
    assert "calibration: 90 % intervals hold" in ended.stdout
    # as a robot's prior, in a simulator file of the same names
    stored = json.loads((puck / "out/posterior.json").read_text())
    assert stored["parameters"] == [{"name": "friction", "coordinate": "value"}] and stored["model"] == "puck"


def test_tiller_takes_the_posterior(tmp_path):
    robot = (GUIDE.parents[2] / "robots/pendulum.toml").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(robot, encoding="utf-8")
    (tmp_path / "box.toml").write_text(
        f'[simulator]\nrobot = "robot.toml"\ncommand = [{json.dumps(sys.executable)}, "-m", "tiller", "sim", '
        '"robot.toml", "--serve", "lines"]\n', encoding="utf-8")
    tiller = [sys.executable, "-m", "tiller"]
    subprocess.run([*tiller, "run", "robot.toml", "--sim", "--seconds", "2", "--log", "run.csv"], cwd=tmp_path,
                   check=True, capture_output=True)
    ended = labs(tmp_path, "box.toml", "run.csv", "-o", "out", "--simulations", "300", "--rounds", "2")
    assert ended.returncode in (0, 2), ended.stderr
    run = subprocess.run([*tiller, "run", "robot.toml", "--sim", "--seconds", "0.2", "--posterior",
                          "out/posterior.json"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_takes_a_command_with_a_robot_or_data_that_were_written(tmp_path):
    robot = (GUIDE.parents[2] / "robots/pendulum.toml").read_text(encoding="utf-8")
    (tmp_path / "robot.toml").write_text(robot, encoding="utf-8")
    box, tiller = f"{sys.executable} -m tiller sim robot.toml --serve lines", [sys.executable, "-m", "tiller"]
    subprocess.run([*tiller, "run", "robot.toml", "--sim", "--seconds", "1", "--log", "run.csv"], cwd=tmp_path,
                   check=True, capture_output=True)
    few = ("--method", "abc", "--simulations", "100", "--accept", "0.1")
    named = labs(tmp_path, "--command", box, "--robot", "robot.toml", *few, "--", "run.csv")
    assert named.returncode == 0, named.stderr
    subprocess.run([*tiller, "data", "infer", "--command", box, "--robot", "robot.toml", "-o", "data.json", "run.csv"],
                   cwd=tmp_path, check=True)
    written = labs(tmp_path, "--data", "data.json", *few, "-o", "out", "--no-page")
    assert written.returncode == 0, written.stderr
    assert written.stdout.splitlines()[2:6] == named.stdout.splitlines()[2:6]
    assert not (tmp_path / "out/infer.html").exists()
    assert labs(tmp_path, "--data", "data.json", "run.csv").returncode == 1


def test_tells_what_is_wrong_with_a_file(puck):
    (puck / "puck.toml").write_text(guide("toml").replace("uniform", "unifrom"), encoding="utf-8")
    ended = labs(puck, "puck.toml", "run1.csv")
    assert ended.returncode == 1 and "puck.toml:" in ended.stderr and "Traceback" not in ended.stderr


# ---- simulators that go wrong ---------------------------------------------------------------------------

def pool(tmp_path, body, **told):
    """A simulator of one parameter and one measurement, whose answers `body` makes of `ask`."""
    (tmp_path / "box.py").write_text("import json, os, sys, time\nsys.stdin.readline()\n"
                                     "print(json.dumps({'tiller_simulator': 1}), flush=True)\n"
                                     f"for line in sys.stdin:\n    ask = json.loads(line)\n    {body}\n",
                                     encoding="utf-8")
    return Pool({"command": [sys.executable, "box.py"], "folder": str(tmp_path), "timeout_s": 5.0, "start_s": 60.0,
                 "processes": 2, "restarts": 3, "parameters": [{"name": "a"}], "inputs": [], "measurements": ["y"],
                 "period_s": 0.1, "lengths": [2], "inputs_by_piece": [[[], []]]} | told)


ANSWER = "print(json.dumps({'id': ask['id'], 'measured': [[ask['parameters'][0]]] * 2}), flush=True)"


def ask(made, count=6):
    try:
        return made(np.arange(float(count))[:, None], np.zeros((count, 1, 1)), np.arange(count))
    finally:
        made.close()


def test_answers_in_order(tmp_path):
    y, failures = ask(pool(tmp_path, ANSWER))
    assert y[:, 0, 0].tolist() == [0, 1, 2, 3, 4, 5] and failures == [""] * 6


@pytest.mark.parametrize("body, text", [
    ("print(json.dumps({'id': ask['id'], 'error': 'the mesh is torn'}), flush=True)", "the mesh is torn"),
    ("print(json.dumps({'id': ask['id'], 'measured': [[1.0], [float('nan')]]}), flush=True)", "finite from period 2"),
])
def test_a_draw_fails_alone(tmp_path, body, text):
    y, failures = ask(pool(tmp_path, f"if ask['parameters'][0] == 3: {body}; continue\n    {ANSWER}"))
    assert np.isnan(y[3]).all() and np.isfinite(np.delete(y, 3, axis=0)).all() and text in failures[3]


@pytest.mark.parametrize("body, text", [("os._exit(3)", "ended with exit code 3"),
                                        ("time.sleep(60)", "did not answer")])
def test_a_process_that_dies_or_sleeps_is_started_anew(tmp_path, body, text):
    y, failures = ask(pool(tmp_path, f"if ask['parameters'][0] == 3: {body}\n    {ANSWER}", timeout_s=2.0))
    assert text in failures[3] and np.isfinite(np.delete(y, 3, axis=0)).all()


@pytest.mark.parametrize("body, text", [
    ("os._exit(3)", "after 3 restarts"), ("print('hm', flush=True)", "no JSON object"),
    ("print('{\"id\": 9}', flush=True)", "answer requests in the order"),
    ("print(json.dumps({'id': ask['id'], 'measured': [[1]]}), flush=True)", "2 rows")])
def test_what_is_no_answer_ends_the_run(tmp_path, body, text):
    with pytest.raises(InferenceError, match=text):
        ask(pool(tmp_path, body), 8)


def test_a_command_that_cannot_be_started_is_told(tmp_path):
    with pytest.raises(InferenceError, match="cannot start /nowhere/box in .*check folder"):
        ask(pool(tmp_path, ANSWER, command=["/nowhere/box"]))
    (tmp_path / "box.sh").write_text("", encoding="utf-8")
    with pytest.raises(InferenceError, match="chmod"):
        ask(pool(tmp_path, ANSWER, command=[str(tmp_path / "box.sh")]))
    with pytest.raises(InferenceError, match="ended with exit code 1 before it had greeted"):
        ask(pool(tmp_path, ANSWER, command=["false"]))
    with pytest.raises(InferenceError, match="did not answer within 0.2 s before it had greeted"):
        ask(pool(tmp_path, ANSWER, command=["sleep", "60"], start_s=0.2))


def test_takes_lines_longer_than_a_pipe(tmp_path):
    rows = 20000  # 400 kB there and back
    made = pool(tmp_path, "print(json.dumps({'id': ask['id'], 'measured': ask['inputs']}), flush=True)", inputs=["u"],
                lengths=[rows], inputs_by_piece=[[[0.123456789012 + k] for k in range(rows)]], timeout_s=60.0)
    y, failures = ask(made, 2)
    assert failures == ["", ""] and y[1, -1, 0] == rows - 1 + 0.123456789012


def test_children_of_a_simulator_end_with_it_and_nobody_waits(tmp_path):
    made = pool(tmp_path, "import subprocess; p = subprocess.Popen(['sleep', '600']); "
                          "open('child', 'w').write(str(p.pid)); time.sleep(600)", timeout_s=600.0, processes=1)
    threading.Timer(3.0, made.close).start()
    begun = time.monotonic()
    with pytest.raises(BaseException):
        ask(made, 2)
        raise InferenceError("what was cancelled gave answers")
    assert time.monotonic() - begun < 60
    child = pathlib.Path("/proc") / (tmp_path / "child").read_text() / "stat"
    assert not child.exists() or child.read_text().split()[2] == "Z"


def test_reads_a_problem(tmp_path):
    (tmp_path / "problem.json").write_text(json.dumps({
        "simulator": "box", "seed": 7, "inputs": ["u"], "measurements": ["y"], "noise_sd": [0.1],
        "parameters": [{"name": "a", "kind": "log_normal", "numbers": [2.0, 0.5, 0.0, None], "unit": "kg"},
                       {"name": "b", "kind": "fixed", "numbers": [3.0, 0.0, None, None], "unit": ""}],
        "prior_mixture": [{"weight": 1.0, "mean": [0.5], "covariance": [[0.04]]}],
        "pieces": [{"start": [0.0], "inputs": [[1.0], [2.0]], "measured": [[0.1], [0.2]]},
                   {"start": [5.0], "inputs": [[3.0]], "measured": [[5.1]]}]}), encoding="utf-8")
    problem = read_problem(tmp_path / "problem.json", lambda told: told["lengths"])
    assert problem.simulate == [2, 1] and problem.first.tolist() == [0, 2]
    assert problem.changes(problem.measured)[:, 0] == pytest.approx([0.1, 0.1, 0.1])
    assert problem.to_params(np.array([[0.0]])).tolist() == [[1.0, 3.0]]
    v = problem.draw(np.random.default_rng(1), 4000)
    assert v.mean() == pytest.approx(0.5, abs=0.02) and v.std() == pytest.approx(0.2, abs=0.01)
