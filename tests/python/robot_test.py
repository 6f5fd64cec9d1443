"""Robots: files, text, descriptions, headers; errors with their remedies."""
import pathlib
import shutil

import numpy as np
import pytest

import tiller
from tiller import _errors

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_every_robot_that_comes_along_can_be_read():
    assert len(tiller.robot_names()) >= 12
    for name in ("pendulum", "cart_pole"):
        robot = tiller.Robot.from_toml(name)
        assert robot.prior_centre.shape == (len(robot.params),) and robot.initial_state.shape == (len(robot.states),)
        assert (robot.input_low < robot.input_high).all() and robot.period_s > 0 and name in robot.path


def test_every_status_has_a_remedy_and_no_other_has():
    names = {status.name for status in tiller.Status}
    assert names == set(_errors.REMEDIES) and all(_errors.REMEDIES.values())


def test_a_wrong_file_lists_every_problem():
    text = (ROOT / "robots/pendulum.toml").read_text().replace("horizon = 75", "horizon = -3").replace(
        "period_s = 0.02", "period_s = 'fast'")
    with pytest.raises(tiller.RobotFileError) as caught:
        tiller.Robot.from_text(text, "wrong.toml")
    assert len(caught.value.problems) == 2
    assert any("wrong.toml" in p and "horizon" in p and "-3" in p for p in caught.value.problems)
    assert isinstance(caught.value, ValueError) and caught.value.remedy


@pytest.mark.parametrize("path, error", [("nowhere", ValueError), (3, TypeError), ("missing.toml", ValueError)])
def test_a_path_that_is_none(path, error):
    with pytest.raises(error) as caught:
        tiller.Robot.from_toml(path)
    assert isinstance(caught.value, tiller.Error) and str(path) in str(caught.value)


def test_views_of_a_robot_cannot_be_written():
    robot = tiller.Robot.from_toml("pendulum")
    for view in (robot.initial_state, robot.target, robot.input_low, robot.prior_centre):
        with pytest.raises(ValueError):
            view[0] = 1.0
    target = robot.target
    del robot
    assert target.tolist() == [np.pi, 0.0]


def test_stage_cost_is_the_quadratic_form():
    robot = tiller.Robot.from_toml("pendulum")
    assert robot.stage_cost([np.pi - 0.5, 2.0], [1.0]) == pytest.approx(4 * 0.25 + 0.05 * 4 + 0.01)


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_a_model_header_and_a_description(tmp_path, monkeypatch):
    monkeypatch.setenv("TILLER_CACHE", str(tmp_path / "models"))
    folder = ROOT / "examples/own_model"
    robot = tiller.Robot.from_model_header(folder / "ball_and_beam.hpp", "BallAndBeam", folder / "robot.toml")
    assert robot.model == "ball_and_beam" and robot.states[0] == "position_m"
    way = tiller.rollout(robot, robot.initial_state, np.zeros((10, 1)))
    assert way.shape == (11, 4) and np.isfinite(way).all()
    with pytest.raises(tiller.ArgumentError, match="header"):
        tiller.Robot.from_model_header("none.hpp", "X", {})
