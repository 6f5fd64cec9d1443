#include "tools/identify/identify_fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "effects/effect_info.hpp"
#include "tiller/config.hpp"
#include "tools/base/text.hpp"
#include "tools/identify/identify_noise.hpp"

namespace tiller::tools {
namespace {

bool is_learnt(const tiller_prior_t& prior) { return prior.kind != tiller_prior_fixed; }

double centre(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

tiller_prior_t fixed_at(double value) { return {tiller_prior_fixed, 0, value, 0, -INFINITY, INFINITY}; }

constexpr std::uint32_t kOneByOne = 8;  // effects; of more, all of a kind join at once: a fit each would take hours

using Stage = std::vector<bool>;  // (effects of the robot file) which of them a candidate has

// The effects of each candidate, in the robot file's order: one more at a time, or of many one kind more at a time.
std::vector<Stage> stages_of(const tiller_config_t& config) {
  std::vector<Stage> stages;
  Stage stage(config.effect_count);
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    if (stage[e]) continue;
    for (std::uint32_t other = e; other < config.effect_count; ++other)
      if (other == e || (config.effect_count > kOneByOne && config.effects[other].kind == config.effects[e].kind))
        stage[other] = true;
    stages.push_back(stage);
  }
  return stages;
}

// "viscous_friction (joint)", or of several "viscous_friction (6 of them)", by kind in the order of the first of each.
std::string effects_name(const tiller_config_t& config) {
  std::string text;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    const auto same = [&](const tiller_effect_t& other) { return other.kind == config.effects[e].kind; };
    const tiller_effect_t* const end = config.effects + config.effect_count;
    const auto count = std::count_if(config.effects, end, same);
    const bool many = config.effect_count > kOneByOne && count > 1;
    if (many && std::find_if(config.effects, end, same) != config.effects + e) continue;
    text += std::string(" + ") + info.name + " (" +
            (many ? std::to_string(count) + " of them" : port_name(info.port, *config.model, config.effects[e].port)) +
            ")";
  }
  return text;
}

// The robot's model with some of its effects.
Candidate with_effects(const RobotFile& robot, const Stage& stage) {
  Candidate candidate;
  candidate.config = robot.config;
  candidate.config.effect_count = 0;
  std::uint32_t count = robot.config.model->param_count, from = count;
  candidate.params.assign(robot.names.params.begin(), robot.names.params.begin() + count);
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const auto params = static_cast<std::uint32_t>(effect_info(robot.config.effects[e].kind).param_count);
    if (stage[e]) {
      candidate.config.effects[candidate.config.effect_count++] = robot.config.effects[e];
      for (std::uint32_t i = 0; i < params; ++i, ++count) {
        candidate.config.priors[count] = robot.config.priors[from + i];
        candidate.params.push_back(robot.names.params[from + i]);
      }
    }
    from += params;
  }
  candidate.config.param_count = count;
  // a joint prior is of all parameters or of none
  if (candidate.config.effect_count < robot.config.effect_count) candidate.config.prior_mixture = nullptr;
  candidate.name = robot.config.model->name + effects_name(candidate.config);
  return candidate;
}

// The block that a posterior lives in.
struct Block {
  std::unique_ptr<void, decltype(&std::free)> memory{nullptr, &std::free};
  Posterior* posterior = nullptr;
};

Block make_posterior(const tiller_config_t& config, const StepSetup& setup) {
  const RolloutTable& table = select_rollout(*config.model);
  Arena measure;
  Posterior::lay_out(measure, config, setup, table, nullptr);
  Block block;
  block.memory.reset(std::aligned_alloc(TILLER_ALIGNMENT, measure.used()));
  Arena place(block.memory.get(), measure.used());
  block.posterior = Posterior::lay_out(place, config, setup, table, nullptr);
  block.posterior->reset();
  return block;
}

void summarise(const Posterior& posterior, const Candidate& candidate, bool prior, Fit& result) {
  const std::uint32_t np = candidate.config.param_count;
  double mean[TILLER_MAX_PARAMS] = {}, sd[TILLER_MAX_PARAMS] = {};
  posterior.moments(mean, sd, nullptr, nullptr);
  result.params.resize(np);
  for (std::uint32_t i = 0; i < np; ++i) {
    ParamSummary& p = result.params[i];
    p.name = candidate.params[i];
    p.fixed = !is_learnt(candidate.config.priors[i]);
    const double low = posterior.quantile(i, 0.05), high = posterior.quantile(i, 0.95);
    if (prior) {
      p.prior_mean = mean[i], p.prior_sd = sd[i], p.prior_low = low, p.prior_high = high;
    } else {
      p.mean = mean[i], p.sd = sd[i], p.low = low, p.high = high;
      p.median = posterior.quantile(i, 0.5);
    }
  }
}

// (count x np)
std::vector<double> take_samples(const Posterior& posterior, std::uint32_t np, std::uint32_t count) {
  std::vector<float> rows(std::size_t{np} * count);
  posterior.draw(count, 0, rows.data(), nullptr, nullptr, nullptr);
  std::vector<double> samples(rows.size());
  for (std::uint32_t s = 0; s < count; ++s)
    for (std::uint32_t i = 0; i < np; ++i)
      samples[std::size_t{s} * np + i] = static_cast<double>(rows[std::size_t{i} * count + s]);
  return samples;
}

bool is_taken(tiller_status_t status) { return status == tiller_status_ok || status >= tiller_status_command_limited; }

std::size_t steps_of(const std::vector<Stretch>& stretches) {
  std::size_t all = 0;
  for (const Stretch& stretch : stretches) all += stretch.steps.size();
  return all;
}

void update_posterior(Posterior& posterior, const tiller_config_t& config, const std::vector<Stretch>& stretches,
                      const FitOptions& options, Fit& result) {
  const std::size_t all = steps_of(stretches);
  std::size_t done = 0;
  result.history.begin(posterior, config, all);
  ResidualPattern pattern;
  pattern.begin(config);
  for (const Stretch& stretch : stretches) {
    result.history.begin_stretch();
    pattern.begin_stretch(stretch.start);
    if (posterior.start(stretch.start) != tiller_status_ok) ++result.refused;
    for (const Transition& step : stretch.steps) {
      if (!is_taken(posterior.update(step))) ++result.refused;
      ++result.transitions;
      result.history.add(posterior, step.period_s);
      if (posterior.adequacy() != nullptr) pattern.add(*posterior.adequacy(), step);
      if (options.progress && ++done % 64 == 0) options.progress(static_cast<double>(done) / static_cast<double>(all));
    }
  }
  if (posterior.adequacy() != nullptr) result.trends = pattern.trends();
}

/// One pass over the data with process noise `process_scale` times the configured one.
bool fit_with(const Candidate& candidate, double process_scale, const std::vector<Stretch>& stretches,
              const FitOptions& options, Fit& result, std::string& error) {
  Config config = candidate.config;
  for (double& sd : config.process_sd) sd *= process_scale;
  config.posterior.enabled = candidate.learns() ? 1 : 0;
  config.posterior.particles = options.particles;
  config.posterior.window = options.window;
  config.posterior.moves_per_tick = options.moves;
  config.posterior.adequacy = 1;
  config.posterior.relearn = 0;  // one robot, one answer: an alarm is told, the data before it stay
  StepSetup setup;
  if (!can_be_fitted(config, error)) return false;
  if (make_step_setup(config, setup) != tiller_status_ok) {
    error = candidate.name + ": an effect's port is not the model's";
    return false;
  }
  const Block block = make_posterior(config, setup);
  result = {};
  result.process_scale = process_scale;
  result.particles = block.posterior->size();
  result.sample_count = std::min(result.particles, 512u);
  summarise(*block.posterior, candidate, true, result);
  result.prior_samples = take_samples(*block.posterior, config.param_count, result.sample_count);
  update_posterior(*block.posterior, config, stretches, options, result);
  summarise(*block.posterior, candidate, false, result);
  result.samples = take_samples(*block.posterior, config.param_count, result.sample_count);
  result.covariance.resize(std::size_t{config.param_count} * config.param_count);
  block.posterior->covariance(result.covariance.data());
  result.effective_samples = block.posterior->effective_samples();
  result.noise_scale = block.posterior->noise_scale();
  result.exponent = block.posterior->exponent();
  result.gated = block.posterior->gated();
  result.tested = block.posterior->adequacy() != nullptr;
  if (result.refused * 2 < result.transitions) return true;
  error = candidate.name + ": the posterior refused " + std::to_string(result.refused) + " of " +
          std::to_string(result.transitions) + " transitions; check period_s and the priors";
  return false;
}

// Of many steps some 4,000, in runs of 400 evenly over the stretches: enough for the share of process noise.
std::vector<Stretch> pilot_of(const std::vector<Stretch>& stretches) {
  constexpr std::size_t kPilotSteps = 4000, kRun = 400;
  const std::size_t all = steps_of(stretches);
  if (all <= 2 * kPilotSteps) return stretches;
  const std::size_t every = all / kPilotSteps * kRun;  // steps from the begin of one run to that of the next
  std::vector<Stretch> pilot;
  std::size_t next = 0, done = 0;
  for (const Stretch& stretch : stretches) {
    for (; next < done + stretch.steps.size(); next += every) {
      const std::size_t first = next - done, last = std::min(first + kRun, stretch.steps.size());
      if (last - first < kRun / 4) continue;
      Stretch run;
      run.path = stretch.path;
      std::copy_n(first == 0 ? stretch.start : stretch.steps[first - 1].measured, TILLER_MAX_MEASUREMENTS, run.start);
      run.steps.assign(stretch.steps.begin() + static_cast<std::ptrdiff_t>(first),
                       stretch.steps.begin() + static_cast<std::ptrdiff_t>(last));
      pilot.push_back(std::move(run));
    }
    done += stretch.steps.size();
  }
  return pilot;
}

}  // namespace

std::vector<double> means_of(const Fit& fit) {
  std::vector<double> means;
  for (const ParamSummary& p : fit.params) means.push_back(p.mean);
  return means;
}

bool can_be_fitted(const tiller_config_t& config, std::string& error) {
  const char* field = nullptr;
  const tiller_status_t status = tiller_config_check(&config, &field);
  if (status == tiller_status_ok) return true;
  error = std::string("the configuration cannot be fitted: ") + tiller_status_text(status) + " (" +
          (field ? field : "?") + ")";
  return false;
}

bool Candidate::learns() const {
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (is_learnt(config.priors[i])) return true;
  return false;
}

std::vector<Candidate> make_candidates(const RobotFile& robot) {
  std::vector<Candidate> candidates;
  Candidate nominal = with_effects(robot, Stage(robot.config.effect_count));
  if (nominal.learns()) candidates.push_back(nominal);
  nominal.name = "nominal";
  nominal.config.prior_mixture = nullptr;
  for (std::uint32_t i = 0; i < nominal.config.param_count; ++i)
    nominal.config.priors[i] = fixed_at(centre(nominal.config.priors[i]));
  candidates.insert(candidates.begin(), nominal);
  for (const Stage& stage : stages_of(robot.config)) candidates.push_back(with_effects(robot, stage));
  return candidates;
}

Config fitted_config(const Candidate& candidate, const Fit& fit) {
  Config config = candidate.config;
  for (double& sd : config.process_sd) sd *= fit.process_scale;
  return config;
}

bool fit(const Candidate& candidate, const std::vector<Stretch>& stretches, const FitOptions& options, Fit& result,
         std::string& error) {
  constexpr int kRounds = 3;        // the second corrects what the first's parameters made of the noise
  constexpr double kSettled = 1.2;  // a factor that moves no interval by more than the width of a line
  if (candidate.config.posterior.kind != tiller_posterior_filter)
    return fit_with(candidate, 1.0, stretches, options, result, error);
  const std::vector<Stretch> pilot = pilot_of(stretches);
  const std::size_t few = steps_of(pilot), all = steps_of(stretches);
  const bool piloted = few < all;
  double process_scale = 1;
  std::size_t done = 0;
  const std::size_t expected = few * (kRounds - 1) + all;  // steps, for the progress: rarely fewer
  FitOptions shown = options;
  const auto show_from = [&](std::size_t now) {
    if (options.progress)
      shown.progress = [&options, &done, now, expected](double share) {
        options.progress(std::min(
            1.0, (static_cast<double>(done) + share * static_cast<double>(now)) / static_cast<double>(expected)));
      };
  };
  show_from(few);
  for (int round = 0;; ++round) {
    if (!fit_with(candidate, process_scale, pilot, shown, result, error)) return false;
    done += few;
    if (round + 1 == kRounds) break;
    const double next = estimate_process_scale(candidate.config, means_of(result), result.noise_scale, pilot);
    const bool settled = std::fabs(std::log(next / process_scale)) < std::log(kSettled);
    if (settled && !piloted) return true;
    if (piloted || !settled) process_scale = next;
    if (settled) break;
  }
  if (!piloted) return true;
  show_from(all);
  return fit_with(candidate, process_scale, stretches, shown, result, error);
}

}  // namespace tiller::tools
