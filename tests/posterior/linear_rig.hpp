#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <vector>

#include "posterior/posterior.hpp"
#include "tiller/config.hpp"

namespace rig {

/// A mass on a rail with unknown gain and damping, in discrete time:
///   position' = position + dt velocity,  velocity' = velocity + dt (gain u - damping velocity)
/// Linear, so the Kalman filter is exact and the posterior can be had on a grid. The rollout table is written here
/// in plain loops: it shares nothing with the library's kernels.
inline void linearise(const tiller_model_t&, const tiller::LineariseJob& job) {
  const double dt = job.period_s;
  auto at = [](const tiller::Lanes<double>& rows, std::uint32_t row, std::uint32_t lane) {
    return rows.splat() ? rows.data[row] : rows.data[row * rows.stride + lane];
  };
  for (std::uint32_t l = 0; l < job.lanes; ++l) {
    const double position = at(job.state, 0, l), velocity = at(job.state, 1, l);
    const double gain = at(job.params, 0, l), damping = at(job.params, 1, l), u = at(job.control, 0, l);
    job.next_state[l] = position + dt * velocity;
    job.next_state[job.lanes + l] = velocity + dt * (gain * u - damping * velocity);
    if (job.b) {
      job.b[l] = 0.0;
      job.b[job.lanes + l] = dt * gain;
    }
    if (!job.a) continue;
    job.a[0 * job.lanes + l] = 1.0;
    job.a[1 * job.lanes + l] = dt;
    job.a[2 * job.lanes + l] = 0.0;
    job.a[3 * job.lanes + l] = 1.0 - dt * damping;
  }
}

inline const tiller::RolloutTable& table() {
  static const tiller::RolloutTable t = [] {
    tiller::RolloutTable made;
    made.linearise = &linearise;
    return made;
  }();
  return t;
}

inline const tiller_model_t& model() {
  static const char* const states[] = {"position_m", "velocity_m_s"};
  static const char* const inputs[] = {"force_N"};
  static const char* const params[] = {"gain_per_kg", "damping_per_s"};
  static const tiller_model_t m = [] {
    tiller_model_t made{};
    made.size = sizeof made;
    made.version = TILLER_MODEL_VERSION;
    made.name = "linear";
    made.state_count = 2;
    made.input_count = 1;
    made.param_count = 2;
    made.state_names = states;
    made.input_names = inputs;
    made.param_names = params;
    return made;
  }();
  return m;
}

inline tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0, -INFINITY, INFINITY}; }
inline tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0, 0, low, high}; }
inline tiller_prior_t normal(double mean, double sd) { return {tiller_prior_normal, 0, mean, sd, -INFINITY, INFINITY}; }
inline tiller_prior_t log_normal(double median, double sd) {
  return {tiller_prior_log_normal, 0, median, sd, 0.0, INFINITY};
}

/// Position measured, velocity not; gain uniform on [0.5, 1.5], damping known.
inline tiller::Config config() {
  tiller::Config c{};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = &model();
  c.seed = 1;
  c.period_s = 0.05;
  c.substeps = 1;
  c.param_count = 2;
  c.priors[0] = uniform(0.5, 1.5);
  c.priors[1] = fixed(0.3);
  c.measurement_count = 1;
  c.measured_state[0] = 0;
  c.measurement_sd[0] = 0.01;
  c.process_sd[0] = 0.002;
  c.process_sd[1] = 0.05;
  c.initial_state_sd[0] = 0.1;
  c.initial_state_sd[1] = 0.1;
  c.posterior.enabled = 1;
  c.posterior.particles = 256;
  c.posterior.window = 64;
  c.posterior.moves_per_tick = 32;
  c.posterior.ess_fraction = 0.5;
  c.posterior.noise_scale_shape = 5.0;
  return c;
}

/// Taken in: ok or a limited band's status, neither refused nor a fault.
inline bool works(tiller_status_t status) { return status == tiller_status_ok || status >= 200; }

/// A posterior in a block of its own.
class Instance {
 public:
  explicit Instance(const tiller_config_t& config, const tiller_hooks_t* hooks = nullptr,
                    const tiller::RolloutTable& rollouts = table(), const tiller::StepSetup* setup = nullptr)
      : config_(config) {
    tiller::StepSetup plain;
    plain.period_s = config.period_s;
    if (setup) plain = *setup;
    tiller::Arena measure;
    tiller::Posterior::lay_out(measure, config_, plain, rollouts, hooks);
    size_ = measure.used();
    memory_ = std::aligned_alloc(64, size_);
    tiller::Arena arena(memory_, size_);
    posterior_ = tiller::Posterior::lay_out(arena, config_, plain, rollouts, hooks);
    fits_ = arena.fits() && arena.used() == size_;
  }
  ~Instance() { std::free(memory_); }
  Instance(const Instance&) = delete;
  Instance& operator=(const Instance&) = delete;
  tiller::Posterior* operator->() { return posterior_; }
  tiller::Posterior& operator*() { return *posterior_; }
  bool fits() const { return fits_; }
  std::size_t size() const { return size_; }
  const void* memory() const { return memory_; }

 private:
  tiller::Config config_;
  std::size_t size_ = 0;
  void* memory_ = nullptr;
  tiller::Posterior* posterior_ = nullptr;
  bool fits_ = false;
};

struct Log {
  double first = 0.0;  // measured at the start
  std::vector<tiller::Transition> transitions;
};

/// Simulates the system with process and measurement noise scaled by `noise` (a standard deviation), forces drawn
/// again every five steps.
inline Log simulate(const tiller_config_t& c, double gain, double damping, int steps, unsigned seed, double noise = 1.0,
                    double force = 1.0) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> n;
  double position = c.initial_state[0] + noise * c.initial_state_sd[0] * n(random);
  double velocity = c.initial_state[1] + noise * c.initial_state_sd[1] * n(random);
  Log log;
  log.first = position + noise * c.measurement_sd[0] * n(random);
  double u = 0.0;
  const double root_dt = std::sqrt(c.period_s);
  for (int k = 0; k < steps; ++k) {
    if (k % 5 == 0) u = force * n(random);
    const double next = position + c.period_s * velocity + noise * root_dt * c.process_sd[0] * n(random);
    velocity += c.period_s * (gain * u - damping * velocity) + noise * root_dt * c.process_sd[1] * n(random);
    position = next;
    tiller::Transition t;
    t.period_s = c.period_s;
    t.input[0] = u;
    t.measured[0] = position + noise * c.measurement_sd[0] * n(random);
    log.transitions.push_back(t);
  }
  return log;
}

/// The textbook Kalman filter for one parameter pair, written out for two states.
struct Kalman {
  double x[2], p[2][2];
  std::vector<double> squares, logs;  // innovation^2 / variance, log variance, of every measurement but the first

  Kalman(const tiller_config_t& c, double first) : x{c.initial_state[0], c.initial_state[1]}, p{} {
    p[0][0] = c.initial_state_sd[0] * c.initial_state_sd[0];
    p[1][1] = c.initial_state_sd[1] * c.initial_state_sd[1];
    correct(c, first);
    squares.clear();
    logs.clear();
  }
  void step(const tiller_config_t& c, double gain, double damping, const tiller::Transition& t) {
    const double dt = t.period_s, f = 1.0 - dt * damping;
    x[0] += dt * x[1];
    x[1] = f * x[1] + dt * gain * t.input[0];
    const double p00 = p[0][0] + 2 * dt * p[0][1] + dt * dt * p[1][1], p01 = f * (p[0][1] + dt * p[1][1]);
    p[0][0] = p00 + c.process_sd[0] * c.process_sd[0] * dt;
    p[0][1] = p[1][0] = p01;
    p[1][1] = f * f * p[1][1] + c.process_sd[1] * c.process_sd[1] * dt;
    correct(c, t.measured[0]);
  }
  void correct(const tiller_config_t& c, double measured) {
    if (std::isnan(measured)) return;
    const double s = p[0][0] + c.measurement_sd[0] * c.measurement_sd[0], e = measured - x[0];
    const double k0 = p[0][0] / s, k1 = p[1][0] / s;
    x[0] += k0 * e;
    x[1] += k1 * e;
    p[1][1] -= k1 * p[0][1];
    p[0][1] -= k0 * p[0][1];
    p[1][0] = p[0][1];
    p[0][0] -= k0 * p[0][0];
    squares.push_back(e * e / s);
    logs.push_back(std::log(s));
  }
  /// log of the integral over sigma^2 ~ InvGamma(a0, a0) of the product of the innovations' densities, by the
  /// trapezoidal rule over log sigma^2 (the library has it in closed form).
  double log_evidence(double a0) const {
    double sse = 0.0, sum_logs = 0.0;
    for (double v : squares) sse += v;
    for (double v : logs) sum_logs += v;
    const double n = static_cast<double>(squares.size());
    auto log_integrand = [&](double v) {  // v = log sigma^2; the Jacobian turns -(a0 + 1) into -a0
      return -a0 * v - a0 * std::exp(-v) - 0.5 * n * v - 0.5 * sse * std::exp(-v);
    };
    const double mode = std::log((a0 + 0.5 * sse) / (a0 + 0.5 * n)), width = 1.0 / std::sqrt(a0 + 0.5 * n);
    const int points = 60;
    double sum = 0.0;
    for (int i = -points; i <= points; ++i)
      sum += std::exp(log_integrand(mode + 10.0 * width * i / points) - log_integrand(mode));
    return log_integrand(mode) + std::log(sum * width) - 0.5 * sum_logs;
  }
};

/// A marginal on a grid.
struct GridMarginal {
  std::vector<double> value, weight;
  double mean = 0.0, sd = 0.0;

  void finish() {
    double sum = 0.0;
    for (double w : weight) sum += w;
    for (double& w : weight) w /= sum;
    for (std::size_t i = 0; i < value.size(); ++i) mean += weight[i] * value[i];
    for (std::size_t i = 0; i < value.size(); ++i) sd += weight[i] * (value[i] - mean) * (value[i] - mean);
    sd = std::sqrt(sd);
  }
  double quantile(double q) const {
    double below = 0.0, last = 0.0;
    for (std::size_t i = 0; i < value.size(); ++i) {
      const double at = below + 0.5 * weight[i];
      if (i > 0 && at >= q) return value[i - 1] + (q - last) / (at - last) * (value[i] - value[i - 1]);
      below += weight[i];
      last = at;
    }
    return value.back();
  }
};

/// The exact posterior of gain and damping under uniform priors (or a fixed damping), one Kalman filter for each
/// point of a grid that is laid over prior (first pass), then over eight deviations around the first result.
struct GridPosterior {
  GridMarginal gain, damping;

  GridPosterior(const tiller_config_t& c, const Log& log, int points = 201) {
    const bool both = c.priors[1].kind == tiller_prior_uniform;
    double low[2] = {c.priors[0].low, both ? c.priors[1].low : c.priors[1].a};
    double high[2] = {c.priors[0].high, both ? c.priors[1].high : c.priors[1].a};
    const int second = both ? points : 1;
    for (int pass = 0; pass < 3; ++pass) {
      lay(c, log, low, high, points, second);
      const GridMarginal* marginals[2] = {&gain, &damping};
      for (int j = 0; j < (both ? 2 : 1); ++j) {
        // a peak between two points of a coarse grid has no width there: keep a few points around it at least
        const double cell = (high[j] - low[j]) / points, reach = 8.0 * marginals[j]->sd + 2.0 * cell;
        low[j] = std::fmax(low[j], marginals[j]->mean - reach);
        high[j] = std::fmin(high[j], marginals[j]->mean + reach);
      }
    }
  }

 private:
  void lay(const tiller_config_t& c, const Log& log, const double* low, const double* high, int first, int second) {
    std::vector<double> logs;
    double top = -INFINITY;
    gain = damping = GridMarginal{};
    for (int i = 0; i < first; ++i) gain.value.push_back(low[0] + (high[0] - low[0]) * (i + 0.5) / first);
    for (int j = 0; j < second; ++j) damping.value.push_back(low[1] + (high[1] - low[1]) * (j + 0.5) / second);
    for (double g : gain.value) {
      for (double d : damping.value) {
        Kalman filter(c, log.first);
        for (const auto& t : log.transitions) filter.step(c, g, d, t);
        logs.push_back(filter.log_evidence(c.posterior.noise_scale_shape));
        top = std::fmax(top, logs.back());
      }
    }
    gain.weight.assign(gain.value.size(), 0.0);
    damping.weight.assign(damping.value.size(), 0.0);
    for (int i = 0; i < first; ++i) {
      for (int j = 0; j < second; ++j) {
        const double w = std::exp(logs[static_cast<std::size_t>(i * second + j)] - top);
        gain.weight[static_cast<std::size_t>(i)] += w;
        damping.weight[static_cast<std::size_t>(j)] += w;
      }
    }
    gain.finish();
    damping.finish();
  }
};

inline void run(tiller::Posterior& p, const Log& log) {
  (void)p.start(&log.first);
  for (const auto& t : log.transitions) (void)p.update(t);
}

}  // namespace rig
