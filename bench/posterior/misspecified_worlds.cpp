#include "bench/posterior/misspecified_worlds.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <map>
#include <memory>
#include <mutex>

#include "sim/effects/effects.hpp"
#include "sim/mechanisms/mechanism.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {
namespace {

constexpr double kOdeStep = 1e-4;  // its integrator is of first order
constexpr double kOutlierScale = 30.0;
constexpr std::uint32_t kReadingStream = 131, kLossStream = 132, kOutlierStream = 133;

/// One period of the true motion.
class World {
 public:
  virtual ~World() = default;
  virtual void step(const double* params, const double* state, const double* input, double* next) = 0;
};

/// The model with an effect of its own library that the estimator does not know of.
class ModelWorld final : public World {
 public:
  ModelWorld(const AccuracyTask& task, const Hidden& hidden) : config_(task.config) {
    const auto add = [&](std::uint32_t kind, double value) {
      if (value == 0.0) return;
      config_.effects[config_.effect_count++] = {kind, 0};
      config_.priors[config_.param_count++] = {tiller_prior_fixed, 0, value, 0.0, -INFINITY, INFINITY};
    };
    add(tiller_effect_viscous_friction, hidden.viscous);
    add(tiller_effect_coulomb_friction, hidden.coulomb);
    if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
  }
  void step(const double* params, const double* state, const double* input, double* next) override {
    double lanes[TILLER_MAX_PARAMS * kLanePadding], out[TILLER_MAX_STATES * kLanePadding];
    for (std::uint32_t i = 0; i < config_.param_count; ++i)
      std::fill_n(lanes + i * kLanePadding, kLanePadding,
                  i < config_.model->param_count ? params[i] : config_.priors[i].a);
    step_lanes(config_, setup_, kLanePadding, state, lanes, input, out);
    for (std::uint32_t r = 0; r < config_.model->state_count; ++r) next[r] = out[r * kLanePadding];
  }

 private:
  tiller::Config config_;
  StepSetup setup_;
};

/// Bodies and joints. Rebuilt whenever a parameter changes; placed at the state of every period's beginning.
class OdeWorld final : public World {
 public:
  OdeWorld(const AccuracyTask& task, const Hidden& hidden)
      : model_(*task.config.model),
        period_s_(task.config.period_s),
        info_(*sim::find_mechanism(model_.name)),
        hidden_(hidden) {}
  void step(const double* params, const double* state, const double* input, double* next) override {
    // ODE steps all worlds through one threading object without locks: one at a time
    static std::mutex one_at_a_time;
    const std::lock_guard<std::mutex> lock(one_at_a_time);
    build(params);
    mechanism_->place({state, state + model_.state_count});
    for (int k = 0; k < std::lround(period_s_ / kOdeStep); ++k) {
      mechanism_->drive(input);
      for (const auto& effect : effects_) effect->push(mechanism_->joint(info_.actuated), {});
      mechanism_->step(kOdeStep);
    }
    mechanism_->read_state(next);
  }

 private:
  void build(const double* params) {
    std::map<std::string, double> values;
    for (const sim::ParameterInfo& p : info_.parameters) values[p.name] = p.default_value;
    for (std::uint32_t i = 0; i < model_.param_count; ++i) values[model_.param_names[i]] = params[i];
    if (mechanism_ && values == built_) return;
    built_ = values;
    mechanism_ = info_.build(values);
    effects_.clear();
    if (hidden_.viscous > 0.0)
      effects_.push_back(sim::find_effect("viscous_friction")->make({{"damping_SI", hidden_.viscous}}));
    if (hidden_.coulomb > 0.0) mechanism_->joint(info_.actuated).set_dry_friction(hidden_.coulomb);
  }

  const tiller_model_t& model_;
  double period_s_;
  const sim::MechanismInfo& info_;
  Hidden hidden_;
  std::map<std::string, double> built_;
  std::unique_ptr<sim::Mechanism> mechanism_;
  std::vector<std::unique_ptr<sim::Effect>> effects_;
};

std::unique_ptr<World> make_world(const AccuracyTask& task, const Hidden& hidden, Source source) {
  if (source == Source::model) return std::make_unique<ModelWorld>(task, hidden);
  return std::make_unique<OdeWorld>(task, hidden);
}

/// Frictions as forces: what stands in `hidden` times the inertia at the actuated joint.
Hidden as_forces(const AccuracyTask& task, Hidden hidden, const std::vector<double>& truth) {
  const bool cart = task.name == "cart-pole";
  const double inertia = cart ? truth[0] + truth[1] : truth[0] * truth[1] * truth[1];
  hidden.viscous *= inertia;
  hidden.coulomb *= inertia;
  return hidden;
}

/// The drifting parameter over its first value, at a share of the run.
double drift(const Hidden& hidden, std::uint32_t tick, std::uint32_t ticks) {
  if (hidden.jump_tick > 0) return tick < hidden.jump_tick ? 1.0 : hidden.ramp;
  return 1.0 + (hidden.ramp - 1.0) * tick / ticks;
}

}  // namespace

std::vector<AccuracyTask> plant_tasks() {
  std::vector<AccuracyTask> wanted;
  for (AccuracyTask& t : accuracy_tasks()) {
    if (t.name != "cart-pole" && t.name != "pendulum") continue;
    t.config.integrator = tiller_integrator_rk4;
    wanted.push_back(t);
  }
  return wanted;
}

Readings read_plant(const AccuracyTask& task, const Hidden& hidden, Source source, double sigma, std::uint32_t ticks,
                    std::uint64_t seed) {
  Readings out;
  Episode& e = out.episode;
  e.ticks = ticks;
  e.nx = task.states();
  e.nu = task.inputs();
  e.truth = draw_truth(task, seed);
  // with drift the prior holds at the end of the run
  const std::uint32_t moving = task.inferred[0];
  const double first = e.truth[moving] / drift(hidden, ticks, ticks);
  e.input.resize(ticks * e.nu);
  out.state.resize((ticks + 1) * e.nx);
  std::copy_n(task.config.initial_state, e.nx, out.state.begin());
  Rng noise(seed, kNoiseStream, 0), outlier(seed, kOutlierStream, 0);
  Commands commands(task, seed);
  const auto world = make_world(task, as_forces(task, hidden, e.truth), source);
  std::vector<double> params = e.truth, sent(e.nu);
  for (std::uint32_t k = 0; k < ticks; ++k) {
    commands.next(k, &out.state[k * e.nx], &e.input[k * e.nu]);
    for (std::uint32_t i = 0; i < e.nu; ++i)
      sent[i] = k < hidden.delay ? 0.0 : hidden.gain * e.input[(k - hidden.delay) * e.nu + i];
    params[moving] = first * drift(hidden, k, ticks);
    double* next = &out.state[(k + 1) * e.nx];
    world->step(params.data(), &out.state[k * e.nx], sent.data(), next);
    const double scale = sigma * (outlier.uniform() < hidden.outliers ? kOutlierScale : 1.0);
    for (std::uint32_t r = 0; r < e.nx; ++r) next[r] += scale * task.step_rms[r] * noise.normal();
  }
  e.state = out.state;
  Rng reading(seed, kReadingStream, 0), loss(seed, kLossStream, 0);
  for (std::uint32_t k = 0; k <= ticks; ++k) {
    const bool lost = k > 0 && loss.uniform() < hidden.missing;
    for (std::uint32_t r = 0; r < e.nx; ++r) {
      double& value = e.state[k * e.nx + r];
      value = lost ? NAN : value + hidden.reading * task.step_rms[r] * reading.normal();
    }
  }
  return out;
}

double rollout_error_ratio(const AccuracyTask& task, const Hidden& hidden, Source source, double sigma,
                           std::uint32_t periods, std::uint64_t seed) {
  const auto squared_error = [&](const Hidden& what) {
    const Readings r = read_plant(task, what, source, sigma, 200, seed);
    const auto nominal = make_world(task, Hidden{}, Source::model);
    std::vector<double> sum(task.states()), x(task.states()), next(task.states());
    for (std::uint32_t k = 0; k + periods <= r.episode.ticks; k += periods) {
      std::copy_n(&r.state[k * r.episode.nx], r.episode.nx, x.begin());
      for (std::uint32_t i = 0; i < periods; ++i) {
        nominal->step(r.episode.truth.data(), x.data(), &r.episode.input[(k + i) * r.episode.nu], next.data());
        x = next;
        for (std::uint32_t s = 0; s < r.episode.nx; ++s)
          sum[s] += std::pow(x[s] - r.state[(k + i + 1) * r.episode.nx + s], 2);
      }
    }
    return sum;
  };
  const std::vector<double> with = squared_error(hidden), without = squared_error(Hidden{});
  double largest = 0.0;
  for (std::size_t s = 0; s < with.size(); ++s) largest = std::max(largest, std::sqrt(with[s] / without[s]));
  return largest;
}

}  // namespace tiller::bench
