"""The package around the extension: types, import time's parts, environments, functions, the command, no strays."""
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import tiller

ROOT = pathlib.Path(__file__).resolve().parents[2]
LOGS = sorted((ROOT / "data/dfki_simple_pendulum").glob("*_measured.csv"))


def test_import_brings_nothing_along():
    said = subprocess.run([sys.executable, "-c", "import sys, tiller; print([m for m in ('numpy', 'gymnasium', 'jax',"
                           "'pandas', 'matplotlib', 'subprocess') if m in sys.modules])"], check=True,
                          capture_output=True, text=True).stdout
    assert said.strip() == "[]"


def test_every_public_name_is_there_and_explained():
    for name in tiller.__all__:
        assert (getattr(tiller, name).__doc__ or "").strip(), name
    for kind in (tiller.Robot, tiller.Controller, tiller.Plant, tiller.Posterior):
        for name in dir(kind):
            assert name.startswith("_") or getattr(kind, name) is not None


def test_types_of_package_and_examples():
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml", "--cache-dir",
                           "/dev/null"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_stubs_name_what_the_extension_has():
    pytest.importorskip("mypy")
    import enum
    import re
    text = (ROOT / "python/tiller/_core.pyi").read_text()
    classes = re.split(r"^(?:@final\n)?class (\w+).*:$", text, flags=re.MULTILINE)
    for name, body in zip(classes[1::2], classes[2::2]):
        body = body.split("\n@overload")[0]
        kind = getattr(tiller._core, name)
        if issubclass(kind, enum.Enum):
            told = dict(re.findall(r"^    ([A-Za-z_]+) = (\d+)$", body, re.MULTILINE))
            assert {k: str(int(v)) for k, v in kind.__members__.items()} == told
        else:
            told = set(re.findall(r"    def (\w+)\(", body)) - {"__init__"}
            assert told == {n for n in dir(kind) if not n.startswith("_")}, name


def test_every_environment_passes_the_checker_of_gymnasium(recwarn):
    gymnasium = pytest.importorskip("gymnasium")
    import tiller.envs
    from gymnasium.utils.env_checker import check_env
    names = tiller.envs.environment_names()
    assert {"tiller/CartPole-v0", "tiller/Pendulum-v0", "tiller/SkidSteer-v0"} <= set(names)
    for identifier in names:
        env = gymnasium.make(identifier, seconds=0.5)
        check_env(env.unwrapped, skip_render_check=True)
        first = env.reset(seed=5)[0]
        assert np.array_equal(first, env.reset(seed=5)[0])
        total, over = 0.0, False
        while not over:
            _, reward, ended, over, info = env.step(env.action_space.sample() * 0)
            total += reward
            assert not ended, identifier
        period = env.unwrapped.robot.period_s
        assert total < 0 and info["time_s"] == pytest.approx(0.5, abs=1.05 * period), identifier
        assert set(info["measured"]) <= set(env.unwrapped.robot.measurements)


def test_environments_refuse_wrong_arguments():
    pytest.importorskip("gymnasium")
    import tiller.envs
    env = tiller.envs.PlantEnv("pendulum")
    for call, args, options, word in ((tiller.envs.PlantEnv, ("pendulum",), {"observe": "everything"}, "observe"),
                                      (tiller.envs.PlantEnv, (3,), {}, "path"),
                                      (tiller.envs.PlantEnv, ("pendulum", float("nan")), {}, "seconds"),
                                      (tiller.envs.PlantEnv, ("pendulum",), {"second": 3}, "second"),
                                      (tiller.envs.environment_names, (1,), {}, "environment_names"),
                                      (env.step, (), {}, "action"), (env.step, ("up",), {}, "could not convert"),
                                      (env.step, (np.zeros(2),), {}, "torque_Nm"),
                                      (env.step, ([float("nan")],), {}, "nan"), (env.reset, (1,), {}, "reset")):
        with pytest.raises(tiller.Error, match=word) as caught:
            call(*args, **options)
        assert caught.value.remedy


def test_identify_finds_the_damping_of_a_measured_pendulum(tmp_path):
    result = tiller.identify(ROOT / "robots/dfki_pendulum.toml", LOGS[:1], out=tmp_path / "fit", particles=64, moves=8,
                             window=16, horizon=1)
    assert result.json == json.loads((tmp_path / "fit/identify.json").read_text())
    assert result.posterior_file is not None and len(result.rows()) > 3
    assert all(p["fixed"] or p["interval_90"][0] <= p["mean"] <= p["interval_90"][1] for p in
               result.parameters().values())


def test_gap_names_effects_in_its_table_and_draws_what_they_change(tmp_path):
    result = tiller.gap(ROOT / "robots/dfki_pendulum_bare.toml", LOGS[:2], out=tmp_path / "gap", max_effects=1)
    rows = result.rows()
    assert rows[0]["effects"] == "none" and "friction (joint)" in " ".join(row["effects"] for row in rows[1:])
    assert len(rows) == len(result.ranking) and all(row["gain_nats"] >= 0 for row in rows)
    pytest.importorskip("matplotlib")
    figure = result.figure()
    assert [axis.get_ylabel() for axis in figure.axes] == ["angle_rad", "rate_rad_s"]
    assert all(len(axis.lines) in (2, 3) and len(axis.lines[0].get_xdata()) > 50 for axis in figure.axes)


def test_excite_gives_a_sequence_within_the_limits():
    robot = tiller.Robot.from_toml("pendulum")
    result = tiller.excite(robot, candidates="input_delay:delay_s=0.02,actuator_lag:time_constant_s=0.02", seconds=2,
                           tries=48, keep="angle_rad=2", quiet=True)
    assert result.inputs.shape == (len(result.time_s), 1) and result.names == ["torque_Nm"]
    assert (np.diff(result.time_s) > 0).all() and np.abs(result.inputs).max() <= robot.input_high[0] + 1e-9


def test_functions_refuse_what_is_not_there():
    with pytest.raises(tiller.ArgumentError, match="logs.*no.csv"):
        tiller.gap("pendulum", "no.csv")
    with pytest.raises(tiller.ArgumentTypeError, match="logs"):
        tiller.identify("pendulum", 3)
    with pytest.raises(tiller.CommandError) as caught:
        tiller.identify(ROOT / "robots/dfki_pendulum.toml", LOGS[:1], method="nonsense")
    assert caught.value.exit_code == 1 and "nonsense" in caught.value.output and caught.value.remedy


def test_the_command():
    done = subprocess.run([sys.executable, "-m", "tiller", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and tiller.instruction_set() in done.stdout
    wrong = subprocess.run([sys.executable, "-m", "tiller", "chekc"], capture_output=True, text=True)
    assert wrong.returncode == 1 and "check" in wrong.stderr


def test_lockstep_wants_a_step():
    plant = tiller.Plant(tiller.Robot.from_toml("pendulum"))
    with pytest.raises(tiller.ArgumentError, match="plant.step"):
        for _ in tiller.lockstep(plant, 1.0):
            pass
    with pytest.raises(tiller.ArgumentError, match="seconds"):
        next(tiller.lockstep(plant, -1.0))


def test_without_jax_the_package_stays_whole_and_says_what_is_missing():
    script = ("import sys; sys.modules['jax'] = None\nimport tiller\nassert 'tiller.jax' not in sys.modules\n"
              "try:\n import tiller.jax\nexcept ImportError as e:\n assert isinstance(e, tiller.Error); print(e)")
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert said.count("\n") == 1 and 'pip install "tiller[jax]"' in said
