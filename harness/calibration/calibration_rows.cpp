#include "harness/calibration/calibration_rows.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

#include "tiller/config.hpp"

namespace tiller::bench {
namespace {

ReferencePrior uniform(double low, double high) { return {ReferencePrior::Kind::uniform, 0.0, 0.0, low, high}; }
ReferencePrior log_normal(double median, double sd) {
  return {ReferencePrior::Kind::log_normal, median, sd, 0.0, INFINITY};
}

/// Mechanism, priors, nominal noise and start that the rows begin with.
CalibrationRow plain(Engine engine, Mechanism mechanism) {
  CalibrationRow row;
  row.name = "plain";
  row.engine = engine;
  ReferenceProblem& q = row.problem;
  PlantPhysics& p = q.physics;
  p.mechanism = mechanism;
  const bool full = engine == Engine::transition;
  if (mechanism == Mechanism::pendulum) {
    const double param[] = {0.5, 0.5, 0.05, 0.0};
    std::copy(param, param + kPlantParams, p.param);
    q.inferred = {0, 1, 2};
    q.prior = {uniform(0.25, 0.75), uniform(0.3, 0.7), uniform(0.0, 0.1)};
    // of a full state: noise of process .03, of sensors .01 of what a step changes
    p.process_sd[0] = full ? 0.05 : 0.02;
    q.sensor_sd[0] = full ? 4e-4 : 0.002;
    q.sensor_sd[1] = 2e-3;
  } else {
    const double param[] = {1.0, 0.1, 0.5, 0.2};
    std::copy(param, param + kPlantParams, p.param);
    q.inferred = {1, 2, 3};
    q.prior = {uniform(0.05, 0.15), uniform(0.25, 0.75), uniform(0.1, 0.3)};
    p.process_sd[0] = full ? 0.03 : 0.01;
    p.process_sd[1] = full ? 0.06 : 0.02;
    q.sensor_sd[0] = full ? 2e-4 : 0.0005;
    q.sensor_sd[1] = full ? 4e-4 : 0.002;
    q.sensor_sd[2] = 1e-3;
    q.sensor_sd[3] = 2e-3;
    q.start[1] = 3.14159265358979;
  }
  for (int i = 0; i < p.states(); ++i) {
    q.measured[i] = full || i < p.joints();
    q.start_sd[i] = 0.01;
  }
  q.noise_unknown = true;
  q.noise_shape = 5.0;
  row.run.physics = p;
  std::copy(q.start, q.start + kPlantStates, row.run.start);
  std::copy(q.start_sd, q.start_sd + kPlantStates, row.run.start_sd);
  std::copy(q.sensor_sd, q.sensor_sd + kPlantStates, row.run.sensor_sd);
  return row;
}

class Rows {
 public:
  Rows(Engine engine, Mechanism mechanism, std::vector<CalibrationRow>& to)
      : engine_(engine), mechanism_(mechanism), to_(to) {}

  template <class Change>
  void add(const char* name, CalibrationGoal goal, const Change& change) {
    CalibrationRow row = plain(engine_, mechanism_);
    row.name = name;
    row.goal = goal;
    change(row);
    to_.push_back(row);
  }
  bool filter() const { return engine_ == Engine::filter; }
  bool pendulum() const { return mechanism_ == Mechanism::pendulum; }

 private:
  Engine engine_;
  Mechanism mechanism_;
  std::vector<CalibrationRow>& to_;
};

constexpr CalibrationGoal kPlain = {0.86, 0.94};
constexpr CalibrationGoal kNoise = {0.85, 0.95, 1.15};
constexpr CalibrationGoal kAtLeast = {0.85, 1.0};

void scale_noise(CalibrationRow& row, double sensor, double process) {
  for (double& sd : row.run.sensor_sd) sd *= sensor;
  for (double& sd : row.run.physics.process_sd) sd *= process;
  // the reference knows
  for (double& sd : row.problem.sensor_sd) sd *= sensor;
  for (double& sd : row.problem.physics.process_sd) sd *= process;
  row.problem.noise_unknown = false;
  row.configure = [sensor, process](tiller::Config& c) {
    for (double& sd : c.measurement_sd) sd /= sensor;
    for (double& sd : c.process_sd) sd /= process;
  };
}

void well_specified(Rows& rows) {
  rows.add("plain", kPlain, [](CalibrationRow&) {});
  rows.add("plain, 2,000 ticks", kPlain, [](CalibrationRow& r) { r.run.ticks = 2000; });
  rows.add("plain, 10,000 ticks", kPlain, [](CalibrationRow& r) {
    r.run.ticks = 10000;
    r.references = 30;
  });
  rows.add("log-normal friction", kPlain,
           [&](CalibrationRow& r) { r.problem.prior[2] = log_normal(rows.pendulum() ? 0.03 : 0.15, 1.0); });
  rows.add("log-normal friction, sigma 2", kAtLeast,
           [&](CalibrationRow& r) { r.problem.prior[2] = log_normal(rows.pendulum() ? 0.03 : 0.15, 2.0); });
  rows.add("NaN in a tenth of the values", kPlain, [](CalibrationRow& r) { r.run.nan_share = 0.1; });
  rows.add("1 % outliers", kPlain, [](CalibrationRow& r) { r.run.outlier_share = 0.01; });
  rows.add("30 % missing ticks", kPlain, [](CalibrationRow& r) { r.run.missing_share = 0.3; });
  rows.add("one gap of 4 ticks", kPlain, [](CalibrationRow& r) {
    r.run.gap_begin = 200;
    r.run.gap_ticks = 4;
  });
  rows.add("one gap of 10 ticks", kPlain, [](CalibrationRow& r) {
    r.run.gap_begin = 200;
    r.run.gap_ticks = 10;
  });
  rows.add("a task's excitation", kPlain, [](CalibrationRow& r) { r.run.excitation = Excitation::task; });
  if (!rows.filter()) return;
  rows.add("coarse encoder", kPlain, [](CalibrationRow& r) {
    // 2,048 and 1,024 counts a turn; half a millimetre on the rail
    for (int i = 0; i < r.run.physics.joints(); ++i) {
      const bool metre = r.run.physics.mechanism == Mechanism::cart_pole && i == 0;
      r.run.encoder_step[i] = metre ? 0.0005 : 6.283185307179586 / 1024.0;
      r.run.sensor_sd[i] = 0.0;
      r.problem.sensor_sd[i] = r.run.encoder_step[i] / std::sqrt(12.0);
    }
  });
}

void misstated_noise(Rows& rows) {
  constexpr struct {
    const char* name;
    double sensor, process;
  } kCases[] = {{"all noise x3", 3, 3},     {"all noise x1/3", 1.0 / 3, 1.0 / 3},
                {"process noise x3", 1, 3}, {"process noise x1/3", 1, 1.0 / 3},
                {"sensor noise x3", 3, 1},  {"sensor noise x1/3", 1.0 / 3, 1}};
  for (const auto& c : kCases)
    rows.add(c.name, kNoise, [&](CalibrationRow& r) { scale_noise(r, c.sensor, c.process); });
}

void hard_shapes(Rows& rows) {
  rows.add("bounds active, correlated", kAtLeast, [&](CalibrationRow& r) {
    // friction near zero, short runs with little motion: much of the posterior lies on the bound
    r.problem.prior[2] = uniform(0.0, rows.pendulum() ? 0.02 : 0.1);
    r.run.ticks = 100;
    r.goal.offset = 0.15;
  });
  if (rows.pendulum())
    rows.add("ridge: free swing", kAtLeast, [](CalibrationRow& r) {
      // without a torque mass and damping act as a ratio alone
      r.run.excitation = Excitation::none;
      r.run.start[0] = r.problem.start[0] = 1.0;
      r.goal.offset = 0.15;
    });
}

void rests(Rows& rows) {
  for (const int ticks : {10000, 100000})
    for (const bool quiet : {false, true}) {
      char name[80];
      std::snprintf(name, sizeof name, "%d ticks at rest %s process noise, then 400 in motion", ticks,
                    quiet ? "without" : "with");
      rows.add(name, kAtLeast, [&](CalibrationRow& r) {
        r.run.rest_ticks = ticks;
        r.run.quiet_rest = quiet;
        r.run.ticks = ticks + 400;
        for (double& sd : r.run.start_sd) sd = 0.0;
        r.references = 0;
        if (ticks > 10000) r.most_runs = 30;
      });
    }
}

void lacking_physics(Rows& rows) {
  for (const double sd : {1e-3, 1e-4, 1e-5}) {
    char name[64];
    std::snprintf(name, sizeof name, "hidden Coulomb, discrepancy, position sd %g", sd);
    rows.add(name, kAtLeast, [&](CalibrationRow& r) {
      r.run.physics.coulomb = rows.pendulum() ? 0.08 : 0.8;
      for (int i = 0; i < r.run.physics.joints(); ++i) r.run.sensor_sd[i] = r.problem.sensor_sd[i] = sd;
      // what the discrepancy takes up cannot be told from viscous friction
      r.problem.inferred.pop_back();
      r.problem.prior.pop_back();
      r.references = 0;
      r.configure = [](tiller::Config& c) { c.posterior.disturbance = 1; };
    });
  }
  if (!rows.filter())
    for (const double delay : {0.5, 1.3}) {
      char name[64];
      std::snprintf(name, sizeof name, "delay of %.1f periods, hypotheses 0..2", delay);
      rows.add(name, kAtLeast, [&](CalibrationRow& r) {
        r.run.delay_periods = delay;
        r.references = 0;
        r.configure = [](tiller::Config& c) { c.posterior.delay_hypotheses = 3; };
      });
    }
  const auto changing = [&](const char* name, double factor, int tick) {
    rows.add(name, kAtLeast, [&](CalibrationRow& r) {
      r.run.change_param = r.problem.inferred[0];
      r.run.change_factor = factor;
      r.run.change_tick = tick;
      r.run.ticks = 1000;
      r.references = 0;
      // the changed value stays within the prior
      ReferencePrior& prior = r.problem.prior[0];
      if (factor > 1.0)
        prior.high *= factor;
      else
        prior.low *= factor;
      if (tick == 0)
        r.configure = [](tiller::Config& c) {
          c.posterior.forgetting_count = 1;
          c.posterior.forgetting[0] = 0.98;
          if (c.posterior.kind == tiller_posterior_filter) return;
          c.posterior.forgetting_count = 3;
          c.posterior.forgetting[0] = 1.0;
          c.posterior.forgetting[1] = 0.98;
          c.posterior.forgetting[2] = 0.94;
        };
      else if (r.engine == Engine::transition)
        r.configure = [](tiller::Config& c) {
          c.posterior.forgetting_count = 3;
          c.posterior.forgetting[0] = 1.0;
          c.posterior.forgetting[1] = 0.98;
          c.posterior.forgetting[2] = 0.94;
        };
    });
  };
  changing("drift +30 % over the run", 1.3, 0);
  changing("drift -30 % over the run", 0.7, 0);
  changing("mass x1.5 in mid-run", 1.5, 500);
}

tiller_prior_t to_prior(const ReferencePrior& p) {
  switch (p.kind) {
    case ReferencePrior::Kind::uniform: return {tiller_prior_uniform, 0, 0.0, 0.0, p.low, p.high};
    case ReferencePrior::Kind::normal: return {tiller_prior_normal, 0, p.a, p.b, p.low, p.high};
    default: return {tiller_prior_log_normal, 0, p.a, p.b, p.low, p.high};
  }
}

}  // namespace

std::vector<CalibrationRow> calibration_rows() {
  std::vector<CalibrationRow> all;
  for (const Engine engine : {Engine::filter, Engine::transition})
    for (const Mechanism mechanism : {Mechanism::pendulum, Mechanism::cart_pole}) {
      Rows rows(engine, mechanism, all);
      well_specified(rows);
      misstated_noise(rows);
      hard_shapes(rows);
      rests(rows);
      lacking_physics(rows);
    }
  return all;
}

tiller::Config calibration_config(const CalibrationRow& row) {
  const ReferenceProblem& q = row.problem;
  const PlantPhysics& p = q.physics;
  const bool pendulum = p.mechanism == Mechanism::pendulum;
  tiller::Config c;
  if (tiller_config_default(&c, tiller_find_model(pendulum ? "pendulum" : "cart_pole")) != tiller_status_ok)
    std::abort();
  if (!pendulum) {
    c.effect_count = 1;
    c.effects[0] = {tiller_effect_viscous_friction, 0};
    c.param_count = 4;
  }
  for (int i = 0; i < p.params(); ++i) c.priors[i] = {tiller_prior_fixed, 0, p.param[i], 0.0, -INFINITY, INFINITY};
  for (int j = 0; j < q.dimensions(); ++j)
    c.priors[q.inferred[static_cast<std::size_t>(j)]] = to_prior(q.prior[static_cast<std::size_t>(j)]);
  c.measurement_count = 0;
  for (int i = 0; i < p.states(); ++i) {
    c.initial_state[i] = q.start[i];
    c.initial_state_sd[i] = q.start_sd[i];
    c.process_sd[i] = i < p.joints() ? 0.0 : p.process_sd[i - p.joints()];
    if (!q.measured[i]) continue;
    c.measurement_sd[c.measurement_count] = q.sensor_sd[i];
    c.measured_state[c.measurement_count++] = static_cast<std::uint8_t>(i);
  }
  c.safety.input_high[0] = pendulum ? 1.5 : 12.0;
  c.safety.input_low[0] = -c.safety.input_high[0];
  c.posterior.kind = row.engine == Engine::filter ? tiller_posterior_filter : tiller_posterior_transition;
  c.posterior.noise_scale_shape = q.noise_shape;
  c.posterior.disturbance = 0;
  if (row.engine == Engine::transition) {
    c.posterior.particles = 1024;
    c.posterior.moves_per_tick = 128;
  }
  if (row.configure) row.configure(c);
  return c;
}

PlantRun draw_run(const CalibrationRow& row, std::uint64_t seed) {
  std::mt19937_64 random(seed * 7919u + 3u);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit;
  PlantRun run = row.run;
  for (int j = 0; j < row.dimensions(); ++j) {
    const ReferencePrior& prior = row.problem.prior[static_cast<std::size_t>(j)];
    const int at = row.problem.inferred[static_cast<std::size_t>(j)];
    double value = 0.0, first = 0.0;
    do {
      value = prior.kind == ReferencePrior::Kind::uniform
                  ? prior.low + unit(random) * (prior.high - prior.low)
                  : prior.from_coordinate(prior.mean() + prior.b * normal(random));
      // of a parameter that changes the value at the run's end is drawn; the prior holds its beginning too
      first = at == run.change_param ? value / run.change_factor : value;
    } while (!(std::min(first, value) >= prior.low && std::max(first, value) <= prior.high));
    run.physics.param[at] = first;
  }
  return run;
}

}  // namespace tiller::bench
