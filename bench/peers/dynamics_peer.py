"""dynamics_peer.py FOLDER OUT.csv: PETS' and PILCO's learners on the data of bench/learned/dynamics_rows.py.

Two learners without physics, as the papers have them:
  pets   five probabilistic networks of mbrl-lib (Gaussian MLPs, three layers of 200, SiLU, bootstrapped, early stop on
         a tenth of the data), rollouts by TS-infinity: a particle keeps its network
  gp     an exact Gaussian process of GPyTorch for each state, squared exponential with ARD, on at most 800 points

and both again on the difference to a linear model fitted by least squares (`+linear`), which stands for the physics
that a robot file would have given.

States: the encoders, smoothed by Savitzky-Golay (cubic, eleven points), and their derivative. One step is 50 ms, a
usual period of these learners. Figures: the RMS error of rollouts of one second from the scoring runs' true states,
every quarter of a second, in sensor deviations, as dynamics_rows.py counts it, over that of tiller's model
without anything learnt (`before_sigma` in the file); and the share of readings at the end of the second within the
central 90 % of the particles, sensor noise added.
"""

import csv
import json
import math
import sys
import time
from pathlib import Path

import gpytorch
import numpy as np
import torch
from mbrl.models import GaussianMLP
from scipy.signal import savgol_filter

STEP_S, HORIZON_S, EVERY_S = 0.05, 1.0, 0.25
MEMBERS, PARTICLES, MOST_POINTS = 5, 40, 800


def numbers(rows):
    return np.array([[math.nan if v is None else v for v in row] for row in rows])


class World:
    """One exported case: features are angles' sine and cosine, everything else as it is."""

    def __init__(self, path):
        case = json.loads(path.read_text(encoding="utf-8"))
        self.states = case["states"]
        self.period = case["work"][0]["time_s"][1] - case["work"][0]["time_s"][0]
        self.stride = max(1, round(STEP_S / self.period))
        self.sensor_sd, self.before = case["sensor_sd"], case["before_sigma"]
        self.seen = [self.states.index(name) for name in case["measured"]]
        self.angles = [i for i, name in enumerate(self.states) if name.endswith("angle_rad")]
        self.work = [(self.smoothed(numbers(run["measured"])), numbers(run["input"])) for run in case["work"]]
        self.score = [(numbers(run["truth"]), numbers(run["input"]), numbers(run["measured"])) for run in case["score"]]

    def smoothed(self, measured):
        place = savgol_filter(measured, 11, 3, axis=1)
        speed = savgol_filter(measured, 11, 3, deriv=1, delta=self.period, axis=1)
        return np.concatenate([place, speed])[:len(self.states)]

    def features(self, state, inputs):
        rest = [i for i in range(state.shape[1]) if i not in self.angles]
        turned = state[:, self.angles]
        return torch.cat([torch.sin(turned), torch.cos(turned), state[:, rest], inputs], 1)

    def held(self, inputs, k):
        """The inputs in force over the step that begins at row k: their mean."""
        return inputs[:, k:k + self.stride].mean(axis=1)

    def pairs(self):
        x, u, d = [], [], []
        for states, inputs in self.work:
            for k in range(0, states.shape[1] - self.stride):
                x.append(states[:, k])
                u.append(self.held(inputs, k))
                d.append(states[:, k + self.stride] - states[:, k])
        as_tensor = lambda rows: torch.tensor(np.array(rows), dtype=torch.float32)  # noqa: E731
        return as_tensor(x), as_tensor(u), as_tensor(d)


class Linear:
    """What the learner stands on: nothing, or least squares."""

    def __init__(self, world, wanted):
        self.world, self.weights = world, None
        if wanted:
            x, u, d = world.pairs()
            self.weights = torch.linalg.lstsq(self.columns(x, u), d).solution

    def columns(self, x, u):
        return torch.cat([self.world.features(x, u), torch.ones(len(x), 1)], 1)

    def step(self, x, u):
        return 0.0 if self.weights is None else self.columns(x, u) @ self.weights


class Pets:
    def __init__(self, world, base):
        self.world, self.base = world, base
        x, u, d = world.pairs()
        f, y = world.features(x, u), d - base.step(x, u)
        self.mean, self.sd = f.mean(0), f.std(0) + 1e-6
        self.out_mean, self.out_sd = y.mean(0), y.std(0) + 1e-9
        f, y = (f - self.mean) / self.sd, (y - self.out_mean) / self.out_sd
        self.model = GaussianMLP(f.shape[1], y.shape[1], "cpu", num_layers=3, ensemble_size=MEMBERS, hid_size=200,
                                 activation_fn_cfg={"_target_": "torch.nn.SiLU"})
        self.train(f, y)

    def train(self, f, y, most_epochs=60, patience=8, batch=256):
        order = torch.randperm(len(f))
        held, kept = order[:len(f) // 10], order[len(f) // 10:]
        rows = torch.stack([kept[torch.randint(len(kept), (len(kept),))] for _ in range(MEMBERS)])
        optimiser = torch.optim.Adam(self.model.parameters(), lr=1e-3, weight_decay=3e-5)
        best, since, state = math.inf, 0, None
        for _ in range(most_epochs):
            rows = rows[:, torch.randperm(rows.shape[1])]
            for first in range(0, rows.shape[1], batch):
                pick = rows[:, first:first + batch]
                optimiser.zero_grad()
                loss, _ = self.model.loss(f[pick], y[pick])
                loss.backward()
                optimiser.step()
            with torch.no_grad():
                mean, _ = self.model.forward(f[held].expand(MEMBERS, -1, -1), use_propagation=False)
                score = float(((mean - y[held]) ** 2).mean())
            if score < 0.99 * best:
                best, since, state = score, 0, {k: v.clone() for k, v in self.model.state_dict().items()}
            else:
                since += 1
                if since >= patience:
                    break
        self.model.load_state_dict(state)

    def step(self, x, u):
        with torch.no_grad():
            f = (self.world.features(x, u) - self.mean) / self.sd
            mean, log_variance = self.model.forward(f.expand(MEMBERS, -1, -1), use_propagation=False)
            who = torch.arange(len(x)) % MEMBERS
            at = torch.arange(len(x))
            y = mean[who, at] + torch.exp(0.5 * log_variance[who, at]) * torch.randn(len(x), x.shape[1])
            return x + self.base.step(x, u) + y * self.out_sd + self.out_mean


class ExactGp(gpytorch.models.ExactGP):
    def __init__(self, f, y, likelihood):
        super().__init__(f, y, likelihood)
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel(ard_num_dims=f.shape[1]))

    def forward(self, f):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(f), self.covar_module(f))


class Gp:
    def __init__(self, world, base):
        self.world, self.base = world, base
        x, u, d = world.pairs()
        pick = torch.randperm(len(x))[:MOST_POINTS]
        x, u, d = x[pick], u[pick], d[pick]
        f, y = world.features(x, u), d - base.step(x, u)
        self.mean, self.sd = f.mean(0), f.std(0) + 1e-6
        self.out_sd = y.std(0) + 1e-9
        f, y = (f - self.mean) / self.sd, y / self.out_sd
        self.models = [self.fit(f, y[:, i]) for i in range(y.shape[1])]

    @staticmethod
    def fit(f, y, steps=80):
        likelihood = gpytorch.likelihoods.GaussianLikelihood()
        model = ExactGp(f, y, likelihood)
        model.train()
        likelihood.train()
        optimiser = torch.optim.Adam(model.parameters(), lr=0.1)
        objective = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
        for _ in range(steps):
            optimiser.zero_grad()
            loss = -objective(model(f), y)
            loss.backward()
            optimiser.step()
        model.eval()
        likelihood.eval()
        return model, likelihood

    def step(self, x, u):
        with torch.no_grad(), gpytorch.settings.fast_pred_var():
            f = (self.world.features(x, u) - self.mean) / self.sd
            rows = []
            for i, (model, likelihood) in enumerate(self.models):
                at = likelihood(model(f))
                rows.append((at.mean + at.stddev * torch.randn(len(x))) * self.out_sd[i])
            return x + self.base.step(x, u) + torch.stack(rows, 1)


def starts(world):
    horizon, every = round(HORIZON_S / world.period), round(EVERY_S / world.period)
    return [(g, k) for g, (truth, _, _) in enumerate(world.score)
            for k in range(0, truth.shape[1] - horizon - world.stride, every)]


def judge(world, learner):
    """All rollouts at once, PARTICLES each: (RMS error of the particles' mean in sigma, share within 90 %)."""
    where = starts(world)
    x = torch.tensor(np.array([world.score[g][0][:, k] for g, k in where]), dtype=torch.float32)
    x = x.repeat_interleave(PARTICLES, 0)
    squares, inside, ends = [], [], 0
    steps = round(HORIZON_S / (world.stride * world.period))
    for step in range(steps):
        at = [(g, k + step * world.stride) for g, k in where]
        u = torch.tensor(np.array([world.held(world.score[g][1], k) for g, k in at]), dtype=torch.float32)
        x = torch.nan_to_num(learner.step(x, u.repeat_interleave(PARTICLES, 0)), nan=1e6).clamp(-1e6, 1e6)
        lanes = x.reshape(len(where), PARTICLES, -1).numpy()
        for channel, i in enumerate(world.seen):
            read = np.array([world.score[g][2][channel, k + world.stride] for g, k in at])
            off = lanes[:, :, i] - read[:, None]
            squares.append((off.mean(1) / world.sensor_sd) ** 2)
            if step == steps - 1:
                off = np.sort(off + world.sensor_sd * np.random.randn(*off.shape), 1)
                inside.append((off[:, 2] <= 0) & (off[:, -3] >= 0))
    return float(np.sqrt(np.nanmean(squares))), float(np.mean(inside))


def main(folder, out):
    torch.set_num_threads(1)
    known = set()
    if Path(out).exists():
        with open(out, encoding="utf-8") as file:
            known = {(row[0], row[1]) for row in csv.reader(file)}
    for path in sorted(Path(folder).glob("*.json")):
        world = World(path)
        for name, kind, linear in (("pets", Pets, False), ("pets+linear", Pets, True), ("gp", Gp, False),
                                   ("gp+linear", Gp, True)):
            if (path.stem, name) in known:
                continue
            torch.manual_seed(1)
            np.random.seed(1)
            begin = time.process_time()
            learner = kind(world, Linear(world, linear))
            seconds = time.process_time() - begin
            rms, covered = judge(world, learner)
            row = [path.stem, name, f"{world.before:.6g}", f"{rms:.6g}", f"{rms / world.before:.4g}", f"{covered:.3f}",
                   f"{seconds:.1f}"]
            with open(out, "a", encoding="utf-8", newline="") as file:  # a run that was cut goes on behind it
                csv.writer(file).writerow(row)
            print(*row, flush=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
