"""tiller tune: numbers in a robot file, ranges, the search, the log, and the command on a badly tuned pendulum."""
import math
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("jax")
cma = pytest.importorskip("cma")

import tiller
from tiller._command import run as run_tiller
from tiller.labs.tune.search import generations
from tiller.labs.tune.search_key import check_search, default_search, number_at, parse_search, with_numbers
from tiller.labs.tune.trial_log import Trial, TrialLog

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
CART = (ROBOTS / "cart_pole.toml").read_text(encoding="utf-8")


# ---- numbers in the text

@pytest.mark.parametrize("path, was, now", [
    ("planner.horizon", "horizon = 50", "horizon = 7"),
    ("planner.noise_sd.force_N", "noise_sd = { force_N = 8 }", "noise_sd = { force_N = 7 }"),
    ("planner.noise_sd", "noise_sd = { force_N = 8 }", "noise_sd = { force_N = 7 }"),
    ("parameters.pole_mass_kg.uniform.1", "uniform = [0.05, 0.15]", "uniform = [0.05, 7]"),
    ("effects.0.damping_SI.uniform.0", "uniform = [0.1, 0.3]", "uniform = [7, 0.3]"),
    ("cost.terminal_weight.angle_rad", "angle_rad = 100.0", "angle_rad = 7")])
def test_one_number_changes_and_nothing_else(path, was, now):
    assert was in CART
    text = with_numbers(CART, {path: "7"})
    assert text == CART.replace(was, now, 1)
    assert number_at(text, path) == 7.0


def test_letters_of_many_bytes_and_comments_stay():
    text = '[planner] # Grüße\nnoise_sd = { "ä€" = 1, force_N = 8 } # é\n'
    assert with_numbers(text, {"planner.noise_sd.force_N": "2.5"}) == text.replace("8", "2.5")


def test_a_key_that_is_not_there_is_added_to_its_section():
    text = with_numbers(CART, {"planner.temperature": "0.25"})
    assert number_at(text, "planner.temperature") == 0.25
    assert len(text.splitlines()) == len(CART.splitlines()) + 1
    tiller.Robot.from_text(text, "cart.toml")
    with pytest.raises(KeyError, match="did you mean planner"):
        with_numbers(CART, {"planer.horizon": "3"})


# ---- ranges

def test_ranges_of_both_scales():
    key = parse_search("planner.noise_sd.force_N=log:0.5:8")
    assert key.value(0) == 0.5 and key.text(0.5) == "2"
    assert math.isclose(key.coordinate(key.value(0.3)), 0.3)
    key = parse_search("planner.rollouts=100:300")
    check_search(CART, key)
    assert key.whole
    for i in range(101):
        assert key.value(i / 100) % key.multiple == 0 and 100 <= key.value(i / 100) <= 300


@pytest.mark.parametrize("argument, says", [
    ("planner.horizon", "is no KEY=LOW:HIGH"), ("planner.horizon=20", "is no KEY=LOW:HIGH"),
    ("planner.horizon=a:b", "is no KEY=LOW:HIGH"), ("planner.horizon=80:20", "write the smaller number first"),
    ("planner.noise_sd=log:0:3", "a logarithm wants a low end above 0"),
    ("planner.horizn=20:80", "did you mean planner.horizon?"), ("planer.horizon=20:80", "did you mean planner?"),
    ("limits.force_N.high=5:30", "yours to set"), ("planner.horizon=20:1e9", "narrow the range"),
    ("planner.kind=0:3", "no number in the file"), ("planner.noise_sd.force=1:2", "did you mean force_N?"),
    ("cost.state_weight=1:2", "name one: cost.state_weight.angle_rad|name one: .*cost.state_weight.angle_rad"),
    ("parameters.pole_mas_kg=1:2", "did you mean pole_mass_kg?"),
    ("parameters.pole_mass_kg.uniform=0.1:0.2", "holds several values"),
    ("effects.3.damping_SI=1:2", "the file has no '3' in effects")])
def test_what_is_wrong_is_told_with_a_remedy(argument, says):
    with pytest.raises(tiller.Error, match=says.replace("?", r"\?")) as told:
        check_search(CART, parse_search(argument))
    assert "--search " + argument[:6] in str(told.value)


def test_defaults_come_from_the_file():
    keys = default_search(tiller.Robot.from_text(CART, "cart.toml"), CART)
    assert [key.path for key in keys] == ["planner.horizon", "planner.noise_sd.force_N", "cost.input_weight.force_N",
                                          "cost.input_rate_weight.force_N"]
    for key in keys:
        assert key.coordinate(number_at(CART, key.path)) == pytest.approx(0.5 if key.log else 1 / 3, abs=0.02)


# ---- the search

def best_of(dimension, seed, evaluations, function):
    search, best, done = generations([0.2] * dimension, seed), -math.inf, 0
    points = next(search)
    while done < evaluations:
        assert all(0 <= v <= 1 for point in points for v in point)
        returns = [function(point) for point in points]
        best, done = max(best, *returns), done + len(points)
        points = search.send(returns)
    return best


def turned(x):
    return -100 * (x[0] + x[1] - 1.2) ** 2 - (x[0] - x[1]) ** 2


def chained(x):
    d = len(x)
    off = [v - 0.6 for v in x]
    return -sum(100 ** (i / (d - 1)) *
                ((off[i] + off[(i + 1) % d]) / math.sqrt(2) + 0.3 * off[i]) ** 2 for i in range(d))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_converges_on_turned_ellipsoids(seed):
    assert best_of(1, seed, 160, lambda x: -(x[0] - 0.6) ** 2) > -1e-6
    assert best_of(2, seed, 500, turned) > -1e-6
    assert best_of(4, seed, 1600, chained) > -1e-6


def test_refused_trials_rank_last_and_bounds_hold():
    """The best lies at (.9, 1), beside what is refused and on the face."""
    assert best_of(2, 5, 300, lambda x: -math.inf if x[0] > 0.9 else x[0] + x[1]) > 1.85


def test_same_seed_same_bits():
    assert best_of(3, 7, 60, chained) == best_of(3, 7, 60, chained) != best_of(3, 8, 60, chained)


# ---- the log

KEYS = [parse_search("planner.horizon=10:40")]


def trial(a):
    return Trial([f"{a}"], [-a / 3, -a * 1e-17, -math.inf], 1)


def test_log_goes_on_behind_the_last_whole_row(tmp_path):
    path = tmp_path / "log.csv"
    log = TrialLog(path, "settings", KEYS, 3, False)
    log.add(trial(11))
    log.add(Trial(["12"], refused="cart.toml:3: horizon = 12: too short, or so\nsecond line"))
    log.add(trial(13))
    whole = path.read_bytes()
    path.write_bytes(whole + b"4,14,-0.2")  # cut off by a loss of power
    log = TrialLog(path, "settings", KEYS, 3, True)
    assert path.read_bytes() == whole
    assert len(log.trials) == 3 and log.trials[2] == trial(13), "to the last bit"
    assert log.trials[1].mean == -math.inf and log.trials[1].refused
    log.add(trial(14))
    assert len(TrialLog(path, "settings", KEYS, 3, True).trials) == 4


def test_log_neither_overwrites_nor_mixes(tmp_path):
    path = tmp_path / "log.csv"
    TrialLog(path, "settings", KEYS, 3, False).add(trial(11))
    with pytest.raises(tiller.Error, match="--resume"):
        TrialLog(path, "settings", KEYS, 3, False)
    for settings, seeds in (("settings of another file", 3), ("settings", 4)):
        with pytest.raises(tiller.Error, match="other settings"):
            TrialLog(path, settings, KEYS, seeds, True)
    with pytest.raises(tiller.Error, match="/dev/zero"):
        TrialLog(Path("/dev/zero"), "settings", KEYS, 3, True)


# ---- the command, on a pendulum whose planner looks too short a way ahead and hardly tries anything

@pytest.fixture
def folder(tmp_path):
    text = (ROBOTS / "pendulum.toml").read_text(encoding="utf-8")
    for was, now in (("horizon = 75\nknots = 10\nrollouts = 256\nparticles = 8\niterations = 3",
                      "horizon = 5\nknots = 5\nrollouts = 32\nparticles = 2\niterations = 2"),
                     ("noise_sd = { torque_Nm = 1.0 }", "noise_sd = { torque_Nm = 0.05 }")):
        assert was in text
        text = text.replace(was, now)
    (tmp_path / "bad.toml").write_text(text, encoding="utf-8")
    return tmp_path


USUAL = ["bad.toml", "--search", "planner.horizon=5:50", "--search", "planner.noise_sd=log:0.05:3", "--seconds", "3",
         "--train", "2", "--test", "4", "--quiet"]


def start(folder, arguments, **more):
    return subprocess.Popen([sys.executable, "-m", "tiller.labs", "tune", *arguments], cwd=folder, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **more)


def run(folder, *arguments):
    process = start(folder, arguments)
    out = process.communicate()[0]
    return process.returncode, out


def rows(folder):
    return [line.split(",") for line in (folder / "bad_tuned.csv").read_text().splitlines()[2:]]


def test_improves_a_badly_tuned_pendulum_and_goes_on_after_a_cut(folder):
    code, out = run(folder, *USUAL, "--trials", "12")
    assert code == 0, out
    assert "trained on seeds 1..2" in out and "others: seeds 3..6" in out and "better on 4 of 4" in out
    log, tuned = (folder / "bad_tuned.csv").read_bytes(), (folder / "bad_tuned.toml").read_bytes()
    assert len(rows(folder)) == 12
    _, ran = run_tiller(["run", str(folder / "bad.toml"), "--sim", "--seconds", "3", "--episodes", "2", "--seed", "1"])
    cost = float(ran.split("episode 1: cost ")[1].split()[0])
    assert cost == pytest.approx(-float(rows(folder)[0][6]), rel=1e-3), "four digits are printed"
    lines = log.splitlines(keepends=True)
    (folder / "bad_tuned.csv").write_bytes(b"".join(lines[:7]) + b"6,2")
    code, out = run(folder, *USUAL, "--trials", "12", "--resume")
    assert code == 0, out
    assert (folder / "bad_tuned.csv").read_bytes() == log and (folder / "bad_tuned.toml").read_bytes() == tuned


def test_the_cost_of_the_file_as_it_was_judges(folder):
    """A weight that is made small would else win."""
    code, out = run(folder, "bad.toml", "--search", "cost.state_weight.angle_rad=log:0.002:0.008", "--seconds", "3",
                    "--train", "2", "--test", "2", "--trials", "4", "--quiet")
    assert code == 0, out
    own = float(rows(folder)[0][2])
    assert own < -20, "it hangs: 4 pi^2 is 39.5"
    assert all(float(row[2]) < 0.5 * own for row in rows(folder)[1:])


def test_ctrl_c_keeps_the_trials_and_says_how_to_go_on(folder):
    process = start(folder, [*USUAL, "--trials", "1000"])
    for _ in range(600):
        if (folder / "bad_tuned.csv").exists() and rows(folder):
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    out = process.communicate()[0]
    assert process.returncode == 130 and "--resume goes on" in out, out
    assert rows(folder) and not (folder / "bad_tuned.toml").exists()


def test_a_full_disk_is_told_and_the_log_can_be_gone_on_with(folder):
    process = start(folder, [*USUAL, "--trials", "5"],  # the two first lines and a row
                    preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (420, resource.RLIM_INFINITY)))
    out = process.communicate()[0]
    assert process.returncode == 1 and "bad_tuned.csv: cannot be written" in out and "free space" in out, out
    assert (folder / "bad_tuned.csv").read_text().endswith("\n"), "no part of a row is left"
    assert 1 <= len(rows(folder)) < 5
    code, out = run(folder, *USUAL, "--trials", "5", "--resume")
    assert code == 0 and len(rows(folder)) == 5, out


@pytest.mark.parametrize("arguments, says", [
    (["bad.toml", "--search", "safety.hold_gain=1:2"], "yours to set"),
    (["bad.toml", "--search", "planner.horizon=5:50", "--search", "planner.horizon=6:9"], "twice"),
    (["none.toml"], "none.toml"), ([*USUAL, "--log", "there.csv"], "go on with --resume"),
    ([*USUAL, "--log", "there.csv", "--resume"], "made with other settings"),
    ([*USUAL, "-o", "file/tuned.toml"], "-o file/tuned.toml"), ([*USUAL, "-o", "bad.toml"], "is the robot file itself"),
    ([*USUAL, "--trials", "1"], "--trials")])
def test_wrong_input_ends_with_one_and_a_remedy(folder, arguments, says, monkeypatch, capsys):
    from tiller.labs.__main__ import main

    (folder / "there.csv").write_text("something\n")
    (folder / "file").write_text("no folder\n")
    monkeypatch.chdir(folder)
    assert main(["tune", *arguments]) == 1
    assert says in capsys.readouterr().err
    assert (folder / "there.csv").read_text() == "something\n"
