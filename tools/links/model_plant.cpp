#include "tools/links/model_plant.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "effects/effect_info.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::uint32_t kFiner = 10;  // than the controller's own substeps

std::string where(const RobotFile& robot) { return robot.path + ":" + std::to_string(robot.sim.line) + ": [sim] "; }

// (0, 1) from the generator's bits: the standard library's distributions differ between libraries.
double next_uniform(void* context) {
  auto& generator = *static_cast<std::mt19937_64*>(context);
  return (static_cast<double>(generator() >> 11) + 0.5) * 0x1p-53;
}

double centre(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

tiller_prior_t fixed_at(double value) {
  const double inf = std::numeric_limits<double>::infinity();
  return {tiller_prior_fixed, 0, value, 0, -inf, inf};
}

Words param_names(const EffectInfo& info) {
  Words names;
  for (int i = 0; i < info.param_count; ++i) names.emplace_back(info.params[i].name);
  return names;
}

/// Of [sim], where the port of an input's or a body's effect may be left out.
std::optional<std::uint32_t> find_sim_port(const RobotFile& robot, const EffectInfo& info, const std::string& port) {
  if (port.empty() && (info.port == PortKind::input || info.port == PortKind::body)) return 0;
  return find_port(info, *robot.config.model, port);
}

/// What the plant has beside the model: the effects of [sim], and of the robot file's own the servos that [sim] says
/// nothing of, at the centre of their priors, because without them a command would be a force.
std::vector<SimEffect> effects_of(const RobotFile& robot) {
  std::vector<SimEffect> effects = robot.sim.effects;
  std::uint32_t row = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const tiller_effect_t& own = robot.config.effects[e];
    const EffectInfo& info = effect_info(own.kind);
    SimEffect servo{info.name, port_name(info.port, *robot.config.model, own.port), {}};
    for (const std::string& name : param_names(info)) servo.parameters[name] = centre(robot.config.priors[row++]);
    const bool given = std::any_of(effects.begin(), effects.end(), [&](const SimEffect& s) {
      return s.kind == servo.kind && (s.port == servo.port || s.port.empty());
    });
    if (hook_of(own.kind) == Hook::servo && !given) effects.push_back(servo);
  }
  return effects;
}

}  // namespace

bool ModelPlant::set_parameters(const RobotFile& robot, std::string& error) {
  for (const auto& [name, value] : robot.sim.parameters) {
    const int i = index_of(robot.names.params, name);
    if (i >= 0 && i < static_cast<int>(robot.config.model->param_count)) continue;
    error = where(robot) + "parameters." + name + ": the model has no such parameter; it has " +
            join(Words(robot.names.params.begin(), robot.names.params.begin() + robot.config.model->param_count));
    return false;
  }
  std::mt19937_64 draws(0x6d6f'6465'6c00'0000ull + robot.sim.seed);
  for (std::uint32_t i = 0; i < robot.config.model->param_count; ++i) {
    std::mt19937_64 own(draws());  // one stream each: fixing one parameter leaves the others' draws as they were
    const tiller_prior_t& prior = robot.config.priors[i];
    const auto given = robot.sim.parameters.find(robot.names.params[i]);
    double value = centre(prior);
    if (robot.sim.draw) value = draw_from_prior(prior, next_uniform, &own);
    if (given != robot.sim.parameters.end()) value = given->second;
    params_.push_back(value);
    config_.priors[i] = fixed_at(value);
  }
  return true;
}

bool ModelPlant::set_effects(const RobotFile& robot, std::string& error) {
  config_.effect_count = 0;
  std::uint32_t row = robot.config.model->param_count;
  for (const SimEffect& effect : effects_of(robot)) {
    const int kind = find_effect(effect.kind.c_str());
    if (kind < 0) {
      error = where(robot) + "there is no effect '" + effect.kind + "'; `tiller effects` lists them";
      return false;
    }
    const EffectInfo& info = effect_info(static_cast<std::uint32_t>(kind));
    const auto port = find_sim_port(robot, info, effect.port);
    if (!port) {
      error = where(robot) + effect.kind + ": the model has no port '" + effect.port +
              "'; write the name of one of its " + port_kind_name(info.port) + "s";
      return false;
    }
    if (config_.effect_count == TILLER_MAX_EFFECTS) {
      error = where(robot) + "more than " + std::to_string(TILLER_MAX_EFFECTS) + " effects";
      return false;
    }
    config_.effects[config_.effect_count++] = {static_cast<std::uint32_t>(kind), *port};
    for (const std::string& name : param_names(info)) {
      const auto value = effect.parameters.find(name);
      if (value == effect.parameters.end() || row == TILLER_MAX_PARAMS) {
        error = where(robot) + effect.kind + ": " +
                (row == TILLER_MAX_PARAMS ? "too many parameters" : "needs a number " + name);
        return false;
      }
      params_.push_back(value->second);
      config_.priors[row++] = fixed_at(value->second);
    }
  }
  config_.param_count = row;
  return true;
}

bool ModelPlant::set_sensors(const RobotFile& robot, std::string& error) {
  if (robot.sim.measurement_latency_s > 0 || robot.sim.command_latency_s > 0 || robot.sim.process_noise_sd > 0) {
    error = where(robot) +
            "the plant \"model\" has no latency and no process noise; a delayed input is "
            "[[sim.effects]] kind = \"input_delay\"";
    return false;
  }
  for (std::size_t k = 0; k < robot.names.measurements.size(); ++k) {
    const auto sd = robot.sim.sensor_sd.find(robot.names.measurements[k]);
    const auto step = robot.sim.sensor_step.find(robot.names.measurements[k]);
    if (sd != robot.sim.sensor_sd.end()) sensor_sd_[k] = sd->second;
    if (step != robot.sim.sensor_step.end()) sensor_step_[k] = step->second;
  }
  for (const auto& [name, value] : robot.sim.state) {
    const int i = index_of(robot.names.states, name);
    if (i < 0) {
      error = where(robot) + "state." + name + ": the model has no such state; it has " + join(robot.names.states);
      return false;
    }
    state_[i] = value;
  }
  return true;
}

std::unique_ptr<ModelPlant> ModelPlant::make(const RobotFile& robot, std::string& error) {
  auto plant = std::make_unique<ModelPlant>();
  plant->config_ = robot.config;
  std::copy(robot.config.initial_state, robot.config.initial_state + robot.config.model->state_count, plant->state_);
  if (!plant->set_parameters(robot, error) || !plant->set_effects(robot, error) || !plant->set_sensors(robot, error))
    return nullptr;
  plant->config_.integrator = tiller_integrator_rk4;
  plant->config_.substeps = std::min<std::uint32_t>(64, kFiner * robot.config.substeps);
  const tiller_status_t status = make_step_setup(plant->config_, plant->setup_);
  if (status != tiller_status_ok) {
    error = where(robot) + tiller_status_text(status);
    return nullptr;
  }
  plant->path_.begin(plant->config_, plant->state_);
  plant->table_ = &select_rollout(*robot.config.model);
  plant->history_.assign((plant->setup_.delay_steps + 1) * robot.config.model->input_count, 0.0);
  plant->generator_.seed(robot.sim.noise_seed ? robot.sim.noise_seed : robot.sim.seed);
  plant->true_params_.assign(robot.names.params.size(), std::numeric_limits<double>::quiet_NaN());
  std::copy(plant->params_.begin(), plant->params_.begin() + robot.config.model->param_count,
            plant->true_params_.begin());
  // an effect that the robot file names is true where the plant has the same at the same port, else zero
  std::uint32_t row = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const tiller_effect_t& asked = robot.config.effects[e];
    const int count = effect_info(asked.kind).param_count;
    std::uint32_t own = robot.config.model->param_count;
    for (int k = 0; k < count; ++k) plant->true_params_[row + static_cast<std::uint32_t>(k)] = 0.0;
    for (std::uint32_t h = 0; h < plant->config_.effect_count; ++h) {
      const tiller_effect_t& hidden = plant->config_.effects[h];
      if (hidden.kind == asked.kind && hidden.port == asked.port)
        std::copy_n(plant->params_.begin() + own, count, plant->true_params_.begin() + row);
      own += static_cast<std::uint32_t>(effect_info(hidden.kind).param_count);
    }
    row += static_cast<std::uint32_t>(count);
  }
  return plant;
}

void ModelPlant::advance(const double* command) {
  const std::uint32_t nx = config_.model->state_count, nu = config_.model->input_count;
  constexpr std::uint32_t lanes = kLanePadding;
  double next[TILLER_MAX_STATES * lanes], effects[(TILLER_MAX_EFFECT_STATES + 1) * lanes];
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = lanes;
  job.horizon = 1;
  job.state.data = state_;
  job.params.data = params_.data();
  job.effect_state.data = effect_state_;
  job.controls.data = command;
  job.history = history_.data();
  job.final_state = next;
  job.final_effect_state = effects;
  table_->rollout_f64(*config_.model, job);
  for (std::uint32_t i = 0; i < nx; ++i) state_[i] = next[i * lanes];
  path_.push(state_);
  for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i) effect_state_[i] = effects[i * lanes];
  std::rotate(history_.begin(), history_.end() - nu, history_.end());
  std::copy(command, command + nu, history_.begin());
  elapsed_s_ += config_.period_s;
  time_us_ = std::llround(1e6 * elapsed_s_);
}

double ModelPlant::normal() {
  const double radius = std::sqrt(-2 * std::log(next_uniform(&generator_)));
  return radius * std::cos(2 * kPi * next_uniform(&generator_));
}

void ModelPlant::measure(double* out) {
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k) {
    out[k] = path_.reading(config_, params_.data(), k) + sensor_sd_[k] * normal();
    if (sensor_step_[k] > 0) out[k] = sensor_step_[k] * std::nearbyint(out[k] / sensor_step_[k]);
  }
}

namespace {

class ModelLink : public Link {
 public:
  ModelLink(const RobotFile& robot, ModelPlant& plant) : plant_(plant), nx_(robot.config.model->state_count) {}
  Sensed wait(const volatile std::sig_atomic_t&) override {
    if (begun_) plant_.advance(command_);
    begun_ = true;
    Sensed sensed;
    sensed.now_us = kEpochUs + plant_.time_us();
    sensed.fresh = true;
    sensed.measurement.stamp_us = sensed.now_us;
    sensed.measurement.sequence = sequence_++;
    plant_.measure(sensed.measurement.value);
    return sensed;
  }
  tiller_status_t send(const tiller_command_t& command) override {
    std::copy(std::begin(command.value), std::end(command.value), command_);
    return tiller_status_ok;
  }
  bool truth(double* state) const override {
    std::copy(plant_.state(), plant_.state() + nx_, state);
    return true;
  }

 private:
  static constexpr std::int64_t kEpochUs = 1000000;  // no stamp is zero or negative
  ModelPlant& plant_;
  std::uint32_t nx_;
  bool begun_ = false;
  std::uint32_t sequence_ = 0;
  double command_[TILLER_MAX_INPUTS] = {};
};

}  // namespace

std::unique_ptr<Link> make_model_link(const RobotFile& robot, ModelPlant& plant) {
  return std::make_unique<ModelLink>(robot, plant);
}

}  // namespace tiller::tools
