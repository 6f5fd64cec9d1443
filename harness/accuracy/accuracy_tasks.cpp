#include "harness/accuracy/accuracy_tasks.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "harness/accuracy/measured_task.hpp"
#include "posterior/prior.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

const tiller_model_t& rod_acrobot_model();

namespace {

constexpr double kInf = INFINITY;
constexpr std::uint32_t kShortStream = 104;

tiller_prior_t fixed(double value) { return {tiller_prior_fixed, 0, value, 0.0, -kInf, kInf}; }
tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, 0.0, 0.0, low, high}; }

StepSetup setup_of(const tiller_config_t& c) {
  StepSetup setup;
  if (make_step_setup(c, setup) != tiller_status_ok) std::abort();
  return setup;
}

AccuracyTask cart_pole() {
  AccuracyTask t = measured_task("cart-pole", *tiller_find_model("cart_pole"), {},
                                 {fixed(1.0), uniform(0.1, 1.0), uniform(0.1, 1.0)}, {0.022, 0.074, 0.122, 0.367});
  t.config.initial_state[1] = 3.141592653589793;
  t.excitation = {12.0, 20.0, 8, {4.0, 0.0, 2.0, 0.0}};
  t.paper_log_density = 4.66;
  t.goal_log_density = 9.0;
  return t;
}

AccuracyTask pendulum() {
  AccuracyTask t = measured_task("pendulum", *tiller_find_model("pendulum"), {},
                                 {uniform(0.1, 1.0), uniform(0.1, 1.0), fixed(0.02)}, {0.071, 0.48});
  t.config.initial_state[0] = 2.5;  // swings far by itself: the longest ones are moved by gravity alone
  t.excitation = {1.0, 2.0, 8, {0.0, 0.05}};
  t.paper_log_density = 4.08;
  t.goal_log_density = 10.6;
  return t;
}

AccuracyTask acrobot(const char* name, std::initializer_list<tiller_prior_t> priors,
                     std::initializer_list<double> step_rms, const Excitation& excitation) {
  AccuracyTask t = measured_task(name, rod_acrobot_model(), {}, priors, step_rms);
  t.excitation = excitation;
  return t;
}

Episode play(const AccuracyTask& task, const double* noise_sd, std::uint32_t ticks, std::uint64_t seed,
             const CommandSource& command) {
  Episode e;
  e.ticks = ticks;
  e.nx = task.states();
  e.nu = task.inputs();
  e.state.resize((ticks + 1) * e.nx);
  e.input.resize(ticks * e.nu);
  Rng noise(seed, kNoiseStream, 0);
  e.truth = draw_truth(task, seed);
  std::copy_n(task.config.initial_state, e.nx, e.state.begin());
  const StepSetup setup = setup_of(task.config);
  std::vector<double> params(task.config.param_count * kLanePadding), next(e.nx * kLanePadding);
  for (std::uint32_t i = 0; i < task.config.param_count; ++i)
    std::fill_n(&params[i * kLanePadding], kLanePadding, e.truth[i]);
  for (std::uint32_t k = 0; k < ticks; ++k) {
    const double* x = &e.state[k * e.nx];
    command(k, x, &e.input[k * e.nu]);
    step_lanes(task.config, setup, kLanePadding, x, params.data(), &e.input[k * e.nu], next.data());
    for (std::uint32_t r = 0; r < e.nx; ++r)
      e.state[(k + 1) * e.nx + r] = next[r * kLanePadding] + noise_sd[r] * noise.normal();
  }
  return e;
}

/// The task's own excitation.
CommandSource excitation(const AccuracyTask& task, std::uint64_t seed) {
  return [commands = Commands(task, seed)](std::uint32_t tick, const double* x, double* u) mutable {
    commands.next(tick, x, u);
  };
}

/// A prior of a random kind within [low, high].
tiller_prior_t random_prior(double low, double high, Rng& rng) {
  const double range = high - low, centre = low + range * (0.3 + 0.4 * rng.uniform());
  switch (rng.below(4)) {
    case 0: return uniform(low, high);
    // normal and log-normal stay positive and off the edge of what the task's plant can take
    case 1: return {tiller_prior_normal, 0, centre, 0.2 * range, 0.5 * low, kInf};
    case 2: return {tiller_prior_log_normal, 0, centre, 0.3, 0.5 * low, kInf};
    default: return {tiller_prior_normal, 0, low, 0.5 * range, low, high};
  }
}

}  // namespace

void set_period(AccuracyTask& task, double period_s) {
  task.config.period_s = period_s;
  for (std::uint32_t i = 0; i < task.states(); ++i)
    task.config.process_sd[i] = kNominalSigma * task.step_rms[i] / std::sqrt(period_s);
}

AccuracyTask measured_task(const char* name, const tiller_model_t& model,
                           std::initializer_list<tiller_effect_t> effects, std::initializer_list<tiller_prior_t> priors,
                           std::initializer_list<double> step_rms) {
  AccuracyTask t;
  t.name = name;
  tiller::Config& c = t.config;
  c = {};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = &model;
  c.param_count = static_cast<std::uint32_t>(priors.size());
  c.effect_count = static_cast<std::uint32_t>(effects.size());
  std::copy(effects.begin(), effects.end(), c.effects);
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.period_s = 0.02;
  c.substeps = 1;
  std::copy(priors.begin(), priors.end(), c.priors);
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    if (c.priors[i].kind != tiller_prior_fixed) t.inferred.push_back(i);
  std::copy(step_rms.begin(), step_rms.end(), t.step_rms);
  c.measurement_count = model.state_count;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    // readings are exact here; a filter needs some variance of its own, far below the noise of any row
    c.measurement_sd[i] = 1e-3 * kSigmas[0] * t.step_rms[i];
    c.initial_state_sd[i] = c.measurement_sd[i];
  }
  set_period(t, c.period_s);
  c.posterior.enabled = 1;
  c.posterior.ess_fraction = 0.5;
  c.posterior.delay_hypotheses = 1;
  c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = 1.0;
  c.posterior.noise_scale_shape = 0.5;  // three decimal powers of the variance within its 90 % interval
  return t;
}

std::vector<double> draw_truth(const AccuracyTask& task, std::uint64_t seed) {
  Rng rng(seed, kTruthStream, 0);
  std::vector<double> truth;
  for (std::uint32_t i = 0; i < task.config.param_count; ++i) {
    const tiller_prior_t& p = task.config.priors[i];
    truth.push_back(p.kind == tiller_prior_fixed ? p.a : from_coordinate(p, prior_quantile(p, rng.uniform())));
  }
  return truth;
}

void Commands::next(std::uint32_t tick, const double* state, double* u) {
  const Excitation& e = task_.excitation;
  for (std::uint32_t i = 0; i < task_.inputs(); ++i) {
    if (tick % e.hold == 0) push_[i] = e.amplitude * (2.0 * rng_.uniform() - 1.0);
    double back = 0.0;
    for (std::uint32_t s = 0; s < task_.states(); ++s) back += e.feedback[s] * state[s];
    u[i] = std::clamp(push_[i] - back, -e.limit, e.limit);
  }
}

void step_lanes(const tiller_config_t& config, const StepSetup& setup, std::uint32_t lanes, const double* state,
                const double* params, const double* input, double* next) {
  RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = lanes;
  job.horizon = 1;
  job.state = {state, 0};
  job.params = {params, lanes};
  job.controls = {input, 0};
  job.final_state = next;
  select_rollout(*config.model).rollout_f64(*config.model, job);
}

Transition Episode::transition(std::uint32_t k, double period_s) const {
  Transition t;
  t.period_s = period_s;
  std::copy_n(&input[k * nu], nu, t.input);
  std::copy_n(&state[(k + 1) * nx], nx, t.measured);
  return t;
}

std::vector<AccuracyTask> accuracy_tasks() {
  std::vector<AccuracyTask> tasks = {cart_pole(), pendulum()};
  // rods of .1 m spin fast under little torque: the shortest decide how much may be applied
  const Excitation gentle = {1.0, 2.0, 8, {0.0, 0.0, 0.0, 0.05}};
  tasks.push_back(acrobot("acrobot masses", {uniform(0.5, 2.0), uniform(0.5, 2.0), fixed(1.0), fixed(1.0)},
                          {0.022, 0.067, 0.208, 0.657}, {6.0, 10.0, 8, {0.0, 0.0, 0.0, 0.5}}));
  tasks.back().paper_log_density = 2.85;
  tasks.back().goal_log_density = 6.4;
  tasks.push_back(acrobot("acrobot lengths", {fixed(1.0), fixed(1.0), uniform(0.1, 1.5), uniform(0.1, 1.5)},
                          {0.0375, 0.0766, 0.502, 1.03}, gentle));
  tasks.back().paper_log_density = 2.25;
  tasks.back().goal_log_density = 3.2;
  tasks.push_back(acrobot("acrobot all four",
                          {uniform(0.5, 2.0), uniform(0.5, 2.0), uniform(0.1, 1.5), uniform(0.1, 1.5)},
                          {0.0324, 0.0772, 0.439, 1.10}, gentle));
  return tasks;
}

Episode make_episode(const AccuracyTask& task, double sigma, std::uint32_t ticks, std::uint64_t seed,
                     const CommandSource& command) {
  double sd[TILLER_MAX_STATES];
  for (std::uint32_t r = 0; r < task.states(); ++r) sd[r] = sigma * task.step_rms[r];
  return play(task, sd, ticks, seed, command);
}

Episode make_episode(const AccuracyTask& task, double sigma, std::uint32_t ticks, std::uint64_t seed) {
  return make_episode(task, sigma, ticks, seed, excitation(task, seed));
}

ShortRun make_short_run(const std::vector<AccuracyTask>& tasks, std::uint64_t seed) {
  Rng rng(seed, kShortStream, 0);
  ShortRun run;
  run.task = tasks[rng.below(static_cast<std::uint32_t>(tasks.size()))];
  run.sigma = 0.003 * std::pow(0.5 / 0.003, rng.uniform());
  const std::uint32_t ticks = 20 + rng.below(81);
  for (const std::uint32_t i : run.task.inferred) {
    tiller_prior_t& p = run.task.config.priors[i];
    p = random_prior(p.low, p.high, rng);
  }
  run.episode = make_episode(run.task, run.sigma, ticks, seed);
  return run;
}

std::vector<double> measure_step_rms(const AccuracyTask& task, std::uint32_t draws,
                                     const std::function<CommandSource(std::uint64_t seed)>& commands) {
  const double no_noise[TILLER_MAX_STATES] = {};
  std::vector<double> sum(task.states());
  for (std::uint64_t seed = 900001; seed <= 900000 + draws; ++seed) {
    const Episode e = play(task, no_noise, kEpisodeTicks, seed, commands(seed));
    for (std::uint32_t k = 0; k < e.ticks; ++k)
      for (std::uint32_t r = 0; r < e.nx; ++r)
        sum[r] += std::pow(e.state[(k + 1) * e.nx + r] - e.state[k * e.nx + r], 2) / (e.ticks * draws);
  }
  for (double& s : sum) s = std::sqrt(s);
  return sum;
}

std::vector<double> measure_step_rms(const AccuracyTask& task, std::uint32_t draws) {
  return measure_step_rms(task, draws, [&](std::uint64_t seed) { return excitation(task, seed); });
}

}  // namespace tiller::bench
