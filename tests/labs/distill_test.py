"""tiller distill: made-up beliefs, the model in motion, fits, and a short course, against what they must be."""
import json
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jax")

import tiller
from tiller import _core
from tiller._command import run as run_tiller
from tiller.labs.__main__ import main
from tiller.labs.distill import episode, network
from tiller.labs.distill.belief import BeliefCourse, prior_moments
from tiller.labs.distill.course import default_reads
from tiller.labs.distill.episode import Driver, Samples, Task
from tiller.labs.distill.teacher import held_out_params, policy_text, with_policy, with_teacher

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
PENDULUM = (ROBOTS / "pendulum.toml").read_text(encoding="utf-8")


def robot_of(text, name="pendulum.toml"):
    return _core.Robot.from_text(text, str(ROBOTS / name))


def edited(*changes):
    text = PENDULUM
    for was, now in changes:
        assert was in text, was
        text = text.replace(was, now)
    return text


# near upright under ilqr: taught in a second
HOLD = edited(("[start]\n", "[start]\nstate = { angle_rad = 3.0 }\n"), ("horizon = 75", "horizon = 30"),
              ("particles = 8", "particles = 1"), ("knots = 10\n", ""),
              ("sd = { angle_rad = 0.01, rate_rad_s = 0.01 }", "sd = { angle_rad = 0.1, rate_rad_s = 0.3 }"))


def test_prior_moments_are_those_of_the_prior():
    robot = _core.Robot.from_toml(str(ROBOTS / "pendulum.toml"))
    moments = prior_moments(robot)
    for i, prior in enumerate(robot.priors.values()):
        if prior["kind"] == "uniform":
            width = prior["high"] - prior["low"]  # 512 draws: four standard errors
            assert moments.mean[i] == pytest.approx((prior["low"] + prior["high"]) / 2, abs=0.06 * width)
            assert moments.sd[i] == pytest.approx(width / math.sqrt(12), rel=0.12)
        if prior["kind"] == "fixed":
            assert (moments.mean[i], moments.sd[i]) == (prior["value"], 0)


@pytest.mark.parametrize("time_s", [0.0, 0.05, 1.0, 20.0])
def test_belief_is_calibrated(time_s):
    """Told belief and truth go together as those of a calibrated posterior: the truth is off by the told deviation."""
    line = next(line for line in PENDULUM.splitlines() if line.startswith("mass_kg"))
    robot = robot_of(edited((line, "mass_kg = { normal = [1.0, 0.1], low = 0.1, high = 2 }")))
    prior = prior_moments(robot)
    off, sds = [], []
    for i in range(1500):
        belief = BeliefCourse(robot, prior, np.random.default_rng([5, i]))
        now = belief.at(time_s)
        off.append((belief.truth[0] - now.mean[0]) / now.sd[0])
        sds.append(now.sd[0])
    assert np.mean(np.square(off)) == pytest.approx(1, abs=0.15)  # prior moments by 512 draws: 6 % of the deviation
    assert min(sds) < (0.05 if time_s else 0.11)


def test_hypotheses_have_the_moments_that_are_told():
    robot = _core.Robot.from_toml(str(ROBOTS / "pendulum.toml"))
    belief = BeliefCourse(robot, prior_moments(robot), np.random.default_rng(1))
    now = belief.at(5.0)
    rows = belief.hypotheses(now, 512)
    free = now.sd > 0
    assert np.allclose(rows[:, ~free], now.mean[~free])
    assert np.all(np.abs(rows.mean(0) - now.mean)[free] < 4 * now.sd[free] / math.sqrt(512))
    assert np.allclose(rows.std(0)[free], now.sd[free], rtol=0.15)


def test_motion_is_a_pendulums():
    """Semi-implicit steps of a tenth of a millisecond, written out."""
    mass, length, damping, torque = 0.4, 0.5, 0.05, np.array([0.7])
    motion = _core.Motion(_core.Robot.from_toml(str(ROBOTS / "pendulum.toml")), np.array([mass, length, damping]))
    motion.move(np.array([2.0, -0.5]) - motion.state)
    angle, rate = motion.state
    for _ in range(25):
        motion.step(torque)
        for _ in range(200):
            rate += 1e-4 * (torque[0] - damping * rate - mass * 9.81 * length * math.sin(angle)) / (mass * length**2)
            angle += 1e-4 * rate
    assert motion.state == pytest.approx([angle, rate], abs=5e-3)


def test_episode_repeats_and_differs_by_its_number():
    robot = with_teacher(robot_of(HOLD), "ilqr")
    task = Task.of(robot, prior_moments(robot), default_reads(robot), 0.5, 1)
    a, b, other = (episode.run(task, number, Driver(robot), None, pushed=True) for number in (0, 0, 1))
    assert np.array_equal(a.samples.read, b.samples.read) and np.array_equal(a.samples.share, b.samples.share)
    assert len(a.samples.read) <= 25 * 3 and len(a.samples.read[0]) == 7  # sine, cosine, rate, two means, two sds
    assert np.abs(a.samples.share).max() <= 1
    assert len(a.samples.to_go) == len(a.samples.read)
    assert not np.array_equal(a.samples.read[0], other.samples.read[0])


def test_samples_nearby_have_the_teachers_feedback():
    """What is recorded beside a tick is the command plus the gain times the way off."""
    robot = with_teacher(robot_of(HOLD), "ilqr")
    belief = BeliefCourse(robot, prior_moments(robot), np.random.default_rng(1))
    motion, now = _core.Motion(robot, belief.truth), belief.at(1.0)
    motion.move(np.array([math.pi - 0.02, 0.0]) - motion.state)  # within the limits
    command, gain = Driver(robot).ask(motion, belief, now, np.zeros(1), 0)
    assert gain.shape == (1, 2)
    motion.move(np.array([1e-3, 0.0]))
    moved, _ = Driver(robot).ask(motion, belief, now, np.zeros(1), 0)
    assert abs(moved[0] - command[0] - gain[0, 0] * 1e-3) < 0.3 * abs(gain[0, 0] * 1e-3)


def test_network_learns_and_the_runtime_answers_as_it_was_taught(tmp_path):
    robot, rng, samples = robot_of(HOLD), np.random.default_rng(3), Samples()
    for i in range(4000):
        angle, rate, mass = rng.uniform(0, 6.28), rng.uniform(-2, 2), rng.uniform(0.3, 0.7)
        samples.read.append(np.array([math.sin(angle), math.cos(angle), rate, mass, 0.05, rng.uniform(0, 0.1), 0.02]))
        samples.share.append(np.clip([1.5 * math.sin(angle) - 0.3 * rate * mass], -1, 1))
        samples.episode.append(i // 40)
        samples.to_go.append(1.0)
    student = network.Student(*network.names(robot, default_reads(robot)), [16, 16], 1)
    errors = student.fit(samples, 1)
    assert errors.held_out < 0.03 and errors.trained < 0.03
    document = student.document(default_reads(robot))
    assert document["input_low"][5] == 0, "a posterior may know better than the examples"
    assert document["input_high"][2] == pytest.approx(2.0, abs=0.01)
    assert len(document["network"]["weights"]) == 16 * 8 + 16 * 17 + 17
    planner = _core.PlannerAlone(with_policy(robot, document))
    mean, sd = prior_moments(robot)
    mean[0], worst = 0.5, 0.0
    mean[sd > 0], spread = [0.5, 0.05], np.where(sd > 0, [0.05, 0, 0.02], 0)
    for angle in np.linspace(0, 6, 25):
        answer, _ = planner.plan(np.array([angle, 0.5]), np.zeros(0), np.tile(mean, (planner.hypotheses, 1)), mean,
                                 spread, np.zeros(1), 0)
        wanted = np.clip(1.5 * math.sin(angle) - 0.15 * 0.5, -1, 1)
        worst = max(worst, abs(answer[0] - wanted * robot.input_high[0]) / robot.input_high[0])
    assert worst < 0.25


# Sixty episodes whose teacher leans to one side or the other, each under a belief of its own: by heart, the belief
# tells the side. It tells nothing of new ones. There the jitter leaves .77 of the error (.24 of .31); .9 is asked.
def test_few_beliefs_are_not_learnt_by_heart(monkeypatch):
    robot, rng = robot_of(HOLD), np.random.default_rng(4)

    def shown(lean):
        samples = Samples()
        for i in range(60):
            belief, side = rng.uniform([0.3, 0.02, 0, 0], [0.7, 0.08, 0.1, 0.02]), rng.choice([-1, 1])
            for angle in rng.uniform(0, 6.28, 60):
                samples.read.append(np.array([math.sin(angle), math.cos(angle), rng.uniform(-2, 2), *belief]))
                samples.share.append(np.array([0.5 * math.sin(angle) + lean * side]))
                samples.episode.append(i)
                samples.to_go.append(1.0)
        return samples

    taught, new, off = shown(0.4), shown(0.0), []
    for jitter in (1.0, 0.0):
        monkeypatch.setattr(network, "JITTERS", (jitter,))
        student = network.Student(*network.names(robot, default_reads(robot)), [16, 16], 1)
        student.fit(taught, 1)
        off.append(student.rms(new))
    assert off[0] < 0.9 * off[1]


def test_teachers():
    robot = _core.Robot.from_toml(str(ROBOTS / "cart_pole.toml"))
    facts = _core.training_facts(with_teacher(robot))
    assert (facts["rollouts"], facts["iterations"]) == (512, 4), "more samples agree better"
    assert _core.training_facts(with_teacher(robot, as_it_is=True))["rollouts"] == 128
    for wrong in ("oracle", "policy"):
        with pytest.raises(tiller.Error, match="ilqr|--teacher"):
            with_teacher(robot, wrong)


def test_a_sampling_teacher_answers_nearby():
    robot = _core.Robot.from_toml(str(ROBOTS / "cart_pole.toml"))
    for teacher, answers in ((with_teacher(robot), True), (with_teacher(robot, as_it_is=True), False)):
        belief = BeliefCourse(teacher, prior_moments(teacher), np.random.default_rng(1))
        motion = _core.Motion(teacher, belief.truth)
        _, gain = Driver(teacher).ask(motion, belief, belief.at(0.0), np.zeros(1), 0)
        assert (gain is not None) == answers


def test_held_out_draws_have_what_has_a_prior():
    arm = _core.Robot.from_toml(str(ROBOTS / "two_link_arm.toml"))
    a, b = held_out_params(arm, 1), held_out_params(arm, 2)
    for i, (name, prior) in enumerate(arm.priors.items()):
        assert np.isnan(a[i]) == (prior["kind"] == "fixed"), name
        assert np.isnan(a[i]) or a[i] != b[i]
    true = _core.Plant(arm, 1, a).true_params
    known = ~np.isnan(a) & ~np.isnan(true)
    assert known.any() and np.allclose(true[known], a[known])


def test_policy_robot_changes_the_planner_and_nothing_else():
    text = '# mine\n[planner]\nhorizon = 9 # far\nkind = "cem"\n\n[cost]\ninput_weight = 1\n'
    out = policy_text(text, "cem", 'a"b.json')
    assert out.startswith("# mine\n") and "horizon = 9 # far\nkind = \"policy\"\n" in out
    assert 'fallback = "cem"\n' in out and '[policy]\nfile = "a\\"b.json"\n' in out
    twice = policy_text(out, "mppi", "c.json")
    assert 'fallback = "mppi"' in twice and "b.json" not in twice


# ---- the command

@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "hold.toml").write_text(HOLD, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


SHORT = ["distill", "hold.toml", "-o", "p.json", "--teacher", "ilqr", "--hidden", "8", "--iterations", "1",
         "--episodes", "10", "--seconds", "1", "--test", "0", "--validation", "2", "--no-page"]


def test_writes_a_policy_and_a_robot_file_that_runs_and_exports(folder, capsys):
    assert main([*SHORT, "--test", "1", "--iterations", "2"]) == 0
    told = capsys.readouterr()
    assert "73 weights" in told.out and "round 1 of 2" in told.err  # 8 (1 + 7) + 1 (1 + 8)
    ratio = float(told.out.split("cost over the teacher's ")[1].split(";")[0])
    assert 0.5 < ratio < 1.5 and "SAFE in 0 of 1" in told.out
    robot = (folder / "hold_policy.toml").read_text()
    for line in ('kind = "policy"', 'fallback = "ilqr"', 'file = "p.json"'):
        assert line in robot
    run_tiller(["run", str(folder / "hold_policy.toml"), "--sim", "--seconds", "1"])
    _, exported = run_tiller(["export", str(folder / "hold_policy.toml")])
    assert "tiller_planner_policy" in exported and "[73]" in exported


def test_same_seed_same_bytes(folder):
    taught = []
    for more in (["--threads", "1"], ["--threads", "2"], ["--seed", "2"]):
        assert main([*SHORT, *more]) == 0
        taught.append((folder / "p.json").read_bytes())
    assert taught[0] == taught[1] != taught[2]


def test_ctrl_c_keeps_the_best_round(folder, monkeypatch):
    from tiller.labs.distill.course import Course

    rounds = Course._round

    def cut(self, k, par):
        if k == 1:
            raise KeyboardInterrupt
        return rounds(self, k, par)

    monkeypatch.setattr(Course, "_round", cut)
    assert main([*SHORT, "--iterations", "3"]) == 130
    assert json.loads((folder / "p.json").read_text())["format"] == "tiller policy"


@pytest.mark.parametrize("more, says", [
    (["--teacher", "oracle"], "oracle"), (["--reads", "state,future"], "future"), (["--hidden", "65"], "1..64"),
    (["-o", "hold.toml/p.json"], "hold.toml/p.json"), (["--episodes", "1"], "--episodes")])
def test_what_is_wrong_ends_with_one_and_a_remedy(folder, capsys, more, says):
    assert main([*SHORT, *more]) == 1
    assert says in capsys.readouterr().err
    assert not (folder / "p.json").exists()
