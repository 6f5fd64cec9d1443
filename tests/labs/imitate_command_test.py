"""`tiller imitate` from robot file and logs to a robot file that is read again, and everything that may be wrong."""
import json
import math
import pathlib
import subprocess
import sys

import pytest

for needed in ("jax", "equinox", "optax", "tomlkit"):
    pytest.importorskip(needed)

import tiller  # noqa: E402

ROBOT = pathlib.Path(tiller.__file__).parent / "robots/pendulum.toml"


def write_log(path, rows, push, header="time_s,angle_rad,torque_Nm"):
    """A pendulum that is pushed, by a stepper of its own at 1 ms."""
    angle, rate, lines = 0.0, 0.0, [header]
    for k in range(rows):
        torque = push * math.sin(0.1 * k)
        lines.append(f"{0.02 * k},{angle},{torque}")
        for _ in range(20):
            rate += 0.001 * (torque - 0.05 * rate - 0.5 * 9.81 * 0.5 * math.sin(angle)) / (0.5 * 0.25)
            angle += 0.001 * rate
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "robot.toml").write_bytes(ROBOT.read_bytes())
    write_log(tmp_path / "demo.csv", 120, 1.0)
    return tmp_path


def imitate(folder, *arguments):
    ended = subprocess.run([sys.executable, "-m", "tiller.labs", "imitate", "robot.toml", *arguments], cwd=folder,
                           capture_output=True, text=True, timeout=600)
    return ended.returncode, ended.stdout + ended.stderr


def test_learns_weights_and_a_target_and_writes_a_file_that_is_read(folder):
    code, said = imitate(folder, "demo.csv", "--horizon", "whole", "--target", "angle_rad", "-o", "learnt.toml",
                         "--page", "out/shown.html")
    assert code in (0, 2), said  # 2: a Python without what draws pages
    for line in ("cost.state_weight.angle_rad", "kept: cost.input_weight.torque_Nm = 0.01", "cost.target.angle_rad",
                 "demo.csv: differs from an optimum"):  # a sine is no optimum, which is told
        assert line in said, said
    tiller.Robot.from_toml(folder / "learnt.toml")
    assert (folder / "learnt.toml").read_bytes() != ROBOT.read_bytes()
    result = json.loads((folder / "out/shown.json").read_text(encoding="utf-8"))
    assert {"weights", "targets", "demonstrations", "alike", "nats", "warnings"} <= set(result)


def test_writes_a_policy_that_tiller_reads(folder):
    write_log(folder / "against.csv", 120, -0.5)  # the other way from the same rest: no function of the state does both
    code, said = imitate(folder, "demo.csv", "against.csv", "--method", "wasserstein", "--iterations", "3", "-o",
                         "acts.toml")
    assert code == 0, said
    assert "not fit for the robot" in said
    assert '"sin angle_rad"' in (folder / "acts_policy.json").read_text(encoding="utf-8")
    assert 'fallback = "cem"' in (folder / "acts.toml").read_text(encoding="utf-8")
    tiller.Robot.from_toml(folder / "acts.toml")


@pytest.mark.parametrize(("rows", "push", "header", "says"), [
    (30, 1.0, "time_s,angle_rad,torque_Nm", "demonstrate longer"), (120, 0.0, "time_s,angle_rad,torque_Nm", "other.csv"),
    (120, 1.0, "time_s,angle_rad,something", "torque_Nm"), (120, 1.0, "time_s,cart_m,force_N", "angle_rad")])
def test_tells_what_a_log_lacks(folder, rows, push, header, says):
    write_log(folder / "other.csv", rows, push, header)
    code, said = imitate(folder, "other.csv")
    assert code == 1 and says in said, said


@pytest.mark.parametrize(("arguments", "says"), [
    (("--keep", "cost.state_weight.angle_rat", "--horizon", "whole"), "did you mean cost.state_weight.angle_rad"),
    (("--target", "angle_rat", "--horizon", "whole"), "did you mean angle_rad"), (("--horizon", "soon"), "whole"),
    (("-o", "robot.toml"), "the robot file itself")])
def test_names_what_is_wrong(folder, arguments, says):
    code, said = imitate(folder, "demo.csv", *arguments)
    assert code == 1 and says in said, said
