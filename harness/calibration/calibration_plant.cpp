#include "harness/calibration/calibration_plant.hpp"

#include <algorithm>
#include <cmath>
#include <random>

namespace tiller::bench {
namespace {

constexpr double kGravity = 9.81;
constexpr double kStep_s = 0.0005;

void derivative(const PlantPhysics& p, const double* x, double input, double* dx) {
  const int n = p.joints();
  for (int i = 0; i < n; ++i) dx[i] = x[n + i];
  accelerations(p, x, input, dx + n);
}

void runge_kutta(const PlantPhysics& p, double* x, double input, double h) {
  const int n = p.states();
  double k[4][kPlantStates], at[kPlantStates];
  const double reach[] = {0.0, 0.5, 0.5, 1.0};
  for (int s = 0; s < 4; ++s) {
    for (int i = 0; i < n; ++i) at[i] = x[i] + (s > 0 ? reach[s] * h * k[s - 1][i] : 0.0);
    derivative(p, at, input, k[s]);
  }
  for (int i = 0; i < n; ++i) x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
}

/// A step with dry friction at the driven joint, the first of either mechanism. It acts against the motion; where the
/// joint comes to rest within the step, the rest of it begins from there: it sticks where friction is the stronger,
/// else it goes on the other way. (Stopping it for the whole step instead would delay every reversal by half a step, a
/// thousandth of a pendulum's period.)
void step(const PlantPhysics& p, double* x, double input, double h) {
  if (!(p.coulomb > 0.0)) return runge_kutta(p, x, input, h);
  const int rate = p.joints(), n = p.states();
  for (double left = h; left > 1e-9 * h;) {
    double pulled[kPlantStates];
    accelerations(p, x, input, pulled);
    const double direction = x[rate] != 0.0 ? x[rate] : pulled[0];
    const double friction = direction > 0.0 ? -p.coulomb : direction < 0.0 ? p.coulomb : 0.0;
    double next[kPlantStates];
    std::copy(x, x + n, next);
    runge_kutta(p, next, input + friction, left);
    if (x[rate] == 0.0 && next[rate] * direction <= 0.0) {
      // friction holds it: the others move on
      const double held = x[0];
      std::copy(next, next + n, x);
      x[0] = held;
      x[rate] = 0.0;
      return;
    }
    if (x[rate] == 0.0 || next[rate] * direction >= 0.0) {
      std::copy(next, next + n, x);
      return;
    }
    const double until = left * x[rate] / (x[rate] - next[rate]);
    runge_kutta(p, x, input + friction, until);
    x[rate] = 0.0;
    left -= until;
  }
}

class Input {
 public:
  Input(const PlantRun& run, std::mt19937_64& random) : run_(run), random_(random) {}
  double next(int tick, const double* x) {
    if (run_.excitation == Excitation::none || tick < run_.rest_ticks) return 0.0;
    if (run_.excitation == Excitation::task) return task(tick, x);
    constexpr int kHold = 8;
    if (tick % kHold == 0) level_ = std::uniform_real_distribution<double>(-1.0, 1.0)(random_);
    if (run_.physics.mechanism == Mechanism::pendulum) return std::clamp(3.0 * level_, -1.5, 1.5);
    return std::clamp(12.0 * level_ - 3.0 * x[0] - 3.0 * x[2], -12.0, 12.0);
  }

 private:
  double task(int tick, const double* x) const {
    if (run_.physics.mechanism == Mechanism::cart_pole) {
      const double wanted = 0.3 * std::sin(2.0 * run_.period_s * tick);
      return std::clamp(40.0 * (wanted - x[0]) - 8.0 * x[2], -12.0, 12.0);
    }
    // energy towards that of standing upright, then a spring about it (Astrom and Furuta, Automatica 36, 2000)
    const double mass = run_.physics.param[0], length = run_.physics.param[1], torque = mass * kGravity * length;
    const double off = std::remainder(x[0] - 3.14159265358979323846, 6.283185307179586);
    if (std::fabs(off) < 0.4) return std::clamp(-2.5 * torque * off - 0.5 * torque * x[1], -1.5, 1.5);
    const double lacking = torque * (1.0 + std::cos(x[0])) - 0.5 * mass * length * length * x[1] * x[1];
    return std::clamp(std::copysign(1.0, x[1]) * 2.0 * lacking, -1.0, 1.0);
  }

  const PlantRun& run_;
  std::mt19937_64& random_;
  double level_ = 0.0;
};

double changing_param(const PlantRun& run, int tick) {
  const double last = run.physics.param[run.change_param] * run.change_factor,
               first = run.physics.param[run.change_param];
  if (run.change_tick > 0) return tick >= run.change_tick ? last : first;
  return first + (last - first) * tick / run.ticks;
}

void read(const PlantRun& run, int tick, std::mt19937_64& random, PlantTick& t) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  for (int i = 0; i < run.physics.states(); ++i) {
    double y = t.state[i] + run.sensor_sd[i] * normal(random);
    if (run.encoder_step[i] > 0.0) y = run.encoder_step[i] * std::round(y / run.encoder_step[i]);
    const double sd = std::max(run.sensor_sd[i], run.encoder_step[i] / std::sqrt(12.0));
    t.outlier[i] = tick > 0 && uniform(random) < run.outlier_share;
    if (t.outlier[i]) y += run.outlier_size * sd * (uniform(random) < 0.5 ? -1.0 : 1.0);
    t.reading[i] = uniform(random) < run.nan_share && tick > 0 ? NAN : y;
  }
  const bool in_gap = tick >= run.gap_begin && tick < run.gap_begin + run.gap_ticks;
  t.measured = tick == 0 || !(in_gap || uniform(random) < run.missing_share);
}

}  // namespace

void accelerations(const PlantPhysics& p, const double* x, double input, double* a) {
  if (p.mechanism == Mechanism::pendulum) {
    const double mass = p.param[0], length = p.param[1], damping = p.param[2];
    a[0] = (input - damping * x[1]) / (mass * length * length) - kGravity / length * std::sin(x[0]);
    return;
  }
  // A uniform rod of half length l on a cart, the angle from upright; Newton and Euler about the rod's centre of mass,
  // which moves with x + l sin(angle), l cos(angle). With f the horizontal force of the hinge on the rod:
  //   m (x'' + l (a'' cos - a'^2 sin)) = f,   M x'' = u - c x' - f,   m l^2 / 3 a'' = hinge's moment about the centre
  const double cart = p.param[0], rod = p.param[1], l = p.param[2], damping = p.param[3];
  const double s = std::sin(x[1]), c = std::cos(x[1]), rate = x[3], total = cart + rod;
  const double drive = (input - damping * x[2] + rod * l * rate * rate * s) / total;
  a[1] = (kGravity * s - c * drive) / (l * (4.0 / 3.0 - rod * c * c / total));
  a[0] = drive - rod * l * a[1] * c / total;
}

PlantRecord record_plant(const PlantRun& run, std::uint64_t seed) {
  std::mt19937_64 random(seed * 2654435761u + 17u);
  std::normal_distribution<double> normal;
  PlantPhysics physics = run.physics;
  const int n = physics.states(), joints = physics.joints();
  PlantRecord record;
  record.states = n;
  record.period_s = run.period_s;
  record.tick.resize(static_cast<std::size_t>(run.ticks) + 1);
  double x[kPlantStates] = {};
  for (int i = 0; i < n; ++i) x[i] = run.start[i] + run.start_sd[i] * normal(random);
  std::copy(x, x + n, record.tick[0].state);
  read(run, 0, random, record.tick[0]);

  Input inputs(run, random);
  const int steps = static_cast<int>(std::lround(run.period_s / kStep_s));
  const double h = run.period_s / steps;
  std::vector<double> command(record.tick.size());
  for (int k = 1; k <= run.ticks; ++k) {
    PlantTick& t = record.tick[static_cast<std::size_t>(k)];
    command[static_cast<std::size_t>(k)] = t.input = inputs.next(k - 1, x);
    if (run.change_param >= 0) physics.param[run.change_param] = changing_param(run, k);
    for (int s = 0; s < steps; ++s) {
      // the command in force `delay` periods ago, zero before the first
      const double ago = k - 1 + (s + 0.5) / steps - run.delay_periods;
      const double acting = ago < 0.0 ? 0.0 : command[static_cast<std::size_t>(ago) + 1];
      step(physics, x, acting, h);
      for (int j = 0; j < joints && !(run.quiet_rest && k <= run.rest_ticks); ++j)
        if (run.physics.process_sd[j] > 0.0) x[joints + j] += run.physics.process_sd[j] * std::sqrt(h) * normal(random);
    }
    std::copy(x, x + n, t.state);
    read(run, k, random, t);
  }
  std::copy(physics.param, physics.param + kPlantParams, record.param);
  return record;
}

}  // namespace tiller::bench
