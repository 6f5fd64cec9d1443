"""A simulated fleet with known answers: `tiller fleet make`.

Damped pendulums of one series. Mass and damping of each robot are drawn from a known population; a few robots are odd:
each of them hides something else. The equations are integrated here by the Runge-Kutta rule, so that nothing of the
fitted model's code takes part in the answer. `truth.json` keeps the answers; `tiller fleet identify` never reads it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from .files import replace_file

PERIOD_S = 0.02
SUBSTEPS = 4
LENGTH_M = 0.5
GRAVITY_M_S2 = 9.81
ANGLE_SD_RAD = 0.005
PROCESS_SD = 0.1  # rad/s per root of a second
START_SD = 0.01

# The population, in the coordinates of the robot file's priors: the logarithms.
NAMES = ["mass_kg", "damping_Nms"]
MEDIAN = np.array([0.5, 0.03])
SPREAD = np.array([0.06, 0.20])
CORRELATION = 0.4

# kind -> what its robot has beside the population, and in words.
ODD = {
    "payload": "carries a forgotten load: 1.45 times the mass",
    "dry_friction": "has 0.3 N m of Coulomb friction",
    "weak_drive": "makes 0.7 of the torque that it is told",
    "spring": "is held by a cable: 0.5 N m/rad towards hanging down",
    "worn_bearing": "has four times the damping",
}

ROBOT = f"""# A fleet's pendulum: mass and damping differ from robot to robot, the length is the drawing's.

[robot]
name = "fleet_pendulum"

[model]
name = "pendulum"
period_s = {PERIOD_S}
substeps = {SUBSTEPS}

[parameters]
mass_kg = {{ log_normal = [0.5, 0.4] }}
length_m = {LENGTH_M}
damping_Nms = {{ log_normal = [0.03, 1.0] }}

[measurement]
angle_rad = {{ sd = {ANGLE_SD_RAD} }}

[noise]
process_sd = {{ rate_rad_s = {PROCESS_SD} }}

[start]
sd = {{ angle_rad = {START_SD}, rate_rad_s = {START_SD} }}

[limits]
torque_Nm = {{ low = -3, high = 3, safe = 0 }}

[log]
time = "time_s"
columns = {{ angle_rad = "angle_rad", torque_Nm = "torque_Nm" }}
input = "hold"
"""


def population_covariance() -> np.ndarray:
    """(2 x 2) of the coordinates over the robots."""
    shape = np.array([[1.0, CORRELATION], [CORRELATION, 1.0]])
    return shape * np.outer(SPREAD, SPREAD)


def odd_robots(robots: int, odd: int, rng: np.random.Generator) -> dict[int, str]:
    """Index -> kind of the odd ones; kinds repeat where more than five are asked for."""
    kinds = list(ODD)
    chosen = sorted(int(i) for i in rng.choice(robots, size=odd, replace=False))
    return {index: kinds[i % len(kinds)] for i, index in enumerate(chosen)}


class Plants:
    """All pendulums side by side: every array is (robots)."""

    def __init__(self, params: np.ndarray, odd: dict[int, str]):
        robots = len(params)
        self.mass, self.damping = params[:, 0].copy(), params[:, 1].copy()
        self.gain, self.coulomb, self.spring = np.ones(robots), np.zeros(robots), np.zeros(robots)
        for index, kind in odd.items():
            self.mass[index] *= 1.45 if kind == "payload" else 1
            self.damping[index] *= 4 if kind == "worn_bearing" else 1
            self.gain[index] = 0.7 if kind == "weak_drive" else 1
            self.coulomb[index] = 0.3 if kind == "dry_friction" else 0
            self.spring[index] = 0.5 if kind == "spring" else 0

    def acceleration(self, angle, rate, torque):
        force = (self.gain * torque - self.damping * rate - self.coulomb * np.tanh(rate / 0.02)
                 - self.spring * angle - self.mass * GRAVITY_M_S2 * LENGTH_M * np.sin(angle))
        return force / (self.mass * LENGTH_M**2)

    def step(self, angle, rate, torque, h):
        """One Runge-Kutta step of h seconds."""
        a1 = self.acceleration(angle, rate, torque)
        v2 = rate + 0.5 * h * a1
        a2 = self.acceleration(angle + 0.5 * h * rate, v2, torque)
        v3 = rate + 0.5 * h * a2
        a3 = self.acceleration(angle + 0.5 * h * v2, v3, torque)
        v4 = rate + h * a3
        a4 = self.acceleration(angle + h * v3, v4, torque)
        return angle + h / 6 * (rate + 2 * v2 + 2 * v3 + v4), rate + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def torques(robots: int, rows: int, rng: np.random.Generator) -> np.ndarray:
    """(robots x rows): levels within 1.5 N m, each held for 0.1 to 0.5 s."""
    out = np.empty((robots, rows))
    for r in range(robots):
        at = 0
        while at < rows:
            hold = int(rng.integers(5, 26))
            out[r, at:at + hold] = rng.uniform(-1.5, 1.5)
            at += hold
    return np.round(out, 4)


def simulate(plants: Plants, torque: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Measured angles (robots x rows); the torque of a row acts until the next."""
    robots, rows = torque.shape
    angle, rate = START_SD * rng.standard_normal((2, robots))
    measured = np.empty((robots, rows))
    h = PERIOD_S / SUBSTEPS
    for k in range(rows):
        measured[:, k] = angle + ANGLE_SD_RAD * rng.standard_normal(robots)
        for _ in range(SUBSTEPS):
            angle, rate = plants.step(angle, rate, torque[:, k], h)
            rate = rate + PROCESS_SD * np.sqrt(h) * rng.standard_normal(robots)
    return measured


def log_text(angle: np.ndarray, torque: np.ndarray) -> str:
    lines = [f"{k * PERIOD_S:.2f},{a:.5f},{u:.4f}" for k, (a, u) in enumerate(zip(angle, torque))]
    return "time_s,angle_rad,torque_Nm\n" + "\n".join(lines) + "\n"


def make(folder: str | Path, robots: int, odd: int, length_s: float, seed: int) -> None:
    """Writes robot.toml, a log for each robot and truth.json into `folder`. Same arguments, same bytes."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.Generator(np.random.PCG64(seed))
    root = np.linalg.cholesky(population_covariance())
    coordinates = np.log(MEDIAN) + rng.standard_normal((robots, 2)) @ root.T
    strange = odd_robots(robots, odd, rng)
    rows = int(round(length_s / PERIOD_S)) + 1
    torque = torques(robots, rows, rng)
    angle = simulate(Plants(np.exp(coordinates), strange), torque, rng)
    names = [f"robot_{i:0{len(str(robots))}d}" for i in range(1, robots + 1)]
    for i, name in enumerate(names):
        replace_file(folder / f"{name}.csv", log_text(angle[i], torque[i]).encode())
    truth = {"seed": seed, "parameters": NAMES, "coordinates": ["log", "log"],
             "population": {"mean": np.log(MEDIAN).tolist(), "covariance": population_covariance().tolist()},
             "robots": {name: np.exp(coordinates[i]).tolist() for i, name in enumerate(names)},
             "odd": {names[i]: {"kind": kind, "text": ODD[kind]} for i, kind in sorted(strange.items())}}
    replace_file(folder / "truth.json", (json.dumps(truth, indent=1) + "\n").encode())
    replace_file(folder / "robot.toml", ROBOT.encode())
