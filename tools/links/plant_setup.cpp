#include "tools/links/plant_setup.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "effects/effect_info.hpp"
#include "sim/mechanisms/tree.hpp"
#include "tools/import/described_plant.hpp"

namespace tiller::tools {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// (0, 1) from the generator's bits: the standard library's distributions differ between libraries.
double next_uniform(void* context) {
  auto& generator = *static_cast<std::mt19937_64*>(context);
  return (static_cast<double>(generator() >> 11) + 0.5) * 0x1p-53;
}

std::string where(const RobotFile& robot) { return robot.path + ":" + std::to_string(robot.sim.line) + ": [sim] "; }

bool knows_parameter(const sim::MechanismInfo& info, const std::string& name) {
  return std::any_of(info.parameters.begin(), info.parameters.end(),
                     [&](const sim::ParameterInfo& p) { return p.name == name; });
}

/// The robot file's effect as the plant's: kinds and parameters have the same names there.
sim::HiddenEffect hidden_effect(const RobotFile& robot, const tiller_effect_t& effect, const double* values) {
  const EffectInfo& info = effect_info(effect.kind);
  sim::HiddenEffect hidden;
  hidden.kind = info.name;
  if (info.port != PortKind::body) hidden.port = port_name(info.port, *robot.config.model, effect.port);
  for (int i = 0; i < info.param_count; ++i) hidden.parameters[info.params[i].name] = values ? values[i] : 0.0;
  return hidden;
}

/// An effect at "all" ports as one at each.
void part_at_ports(const tiller_model_t& model, std::vector<sim::HiddenEffect>& effects) {
  std::vector<sim::HiddenEffect> parted;
  for (const sim::HiddenEffect& e : effects) {
    const int kind = e.port == "all" ? find_effect(e.kind.c_str()) : -1;
    if (kind < 0) {
      parted.push_back(e);
      continue;
    }
    const EffectInfo& info = effect_info(static_cast<std::uint32_t>(kind));
    for_ports(info, TILLER_EVERY_PORT, model, [&](std::uint32_t port) {
      parted.push_back({e.kind, port_name(info.port, model, port), e.parameters});
    });
  }
  effects = std::move(parted);
}

/// Every parameter is drawn in order, fixed ones too, so that fixing one leaves the others' draws as they were.
std::vector<double> draw_all(const RobotFile& robot) {
  std::mt19937_64 generator(0x7469'6c6c'6572'0000ull + robot.sim.seed);
  std::vector<double> values;
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    std::mt19937_64 own(generator());
    values.push_back(draw_from_prior(robot.config.priors[i], next_uniform, &own));
  }
  return values;
}

void apply_draw(const RobotFile& robot, const sim::MechanismInfo& info, sim::PlantOptions& options) {
  const std::vector<double> values = draw_all(robot);
  for (std::uint32_t i = 0; i < robot.config.model->param_count; ++i) {
    if (knows_parameter(info, robot.names.params[i])) options.parameters.emplace(robot.names.params[i], values[i]);
  }
  std::size_t row = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const tiller_effect_t& effect = robot.config.effects[e];
    options.effects.push_back(hidden_effect(robot, effect, &values[row]));
    row += static_cast<std::size_t>(effect_info(effect.kind).param_count);
  }
}

sim::PlantOptions plant_options(const RobotFile& robot, const sim::MechanismInfo& info,
                                std::shared_ptr<const sim::MechanismInfo> described) {
  const SimSection& s = robot.sim;
  sim::PlantOptions options;
  options.kind = s.plant;
  options.made = std::move(described);
  options.parameters = s.parameters;
  if (s.draw) apply_draw(robot, info, options);
  const std::size_t drawn = options.effects.size();
  for (const SimEffect& effect : s.effects) {
    // what [sim] gives goes before what was drawn
    const auto same = std::find_if(
        options.effects.begin(), options.effects.begin() + static_cast<std::ptrdiff_t>(drawn),
        [&](const sim::HiddenEffect& e) { return e.kind == effect.kind && (e.port == effect.port || e.port.empty()); });
    if (same != options.effects.begin() + static_cast<std::ptrdiff_t>(drawn))
      same->parameters = effect.parameters;
    else
      options.effects.push_back({effect.kind, effect.port, effect.parameters});
  }
  part_at_ports(*robot.config.model, options.effects);
  for (std::size_t i = 0; i < robot.names.states.size(); ++i) {
    for (const sim::Channel& state : info.states) {
      if (state.name == robot.names.states[i]) options.initial_state[state.name] = robot.config.initial_state[i];
    }
  }
  for (const auto& [name, value] : s.state) options.initial_state[name] = value;
  options.encoder_noise_sd = s.sensor_sd;
  options.encoder_step = s.sensor_step;
  options.process_noise_sd = s.process_noise_sd;
  options.measurement_latency_s = s.measurement_latency_s;
  options.command_latency_s = s.command_latency_s;
  options.watchdog_timeout_s = s.watchdog_s;
  options.step_s = s.step_s;
  options.rates = s.rates;
  options.seed = s.noise_seed ? s.noise_seed : s.seed;
  return options;
}

int channel_index(const std::vector<sim::Channel>& channels, const std::string& name) {
  for (std::size_t i = 0; i < channels.size(); ++i) {
    if (channels[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

Words channel_names(const std::vector<sim::Channel>& channels) {
  Words names;
  for (const sim::Channel& channel : channels) names.push_back(channel.name);
  return names;
}

bool connect(const RobotFile& robot, SimPlant& made, std::string& error) {
  const sim::Plant& plant = *made.plant;
  for (const std::string& name : robot.names.measurements) {
    const int channel = channel_index(plant.measurements(), name);
    if (channel < 0) {
      error = where(robot) + "the plant " + robot.sim.plant + " does not measure " + name +
              " of [measurement]; it measures " + join(channel_names(plant.measurements())) + "\n";
      return false;
    }
    made.measured_from.push_back(static_cast<std::size_t>(channel));
  }
  if (channel_names(plant.commands()) != robot.names.inputs) {
    error = where(robot) + "the plant " + robot.sim.plant + " takes " + join(channel_names(plant.commands())) +
            ", the model has " + join(robot.names.inputs) + "; name a plant with the model's inputs\n";
    return false;
  }
  for (const std::string& name : robot.names.states) made.state_from.push_back(channel_index(plant.states(), name));
  return true;
}

double true_effect(const sim::PlantOptions& options, const sim::HiddenEffect& asked, const std::string& parameter) {
  for (const sim::HiddenEffect& effect : options.effects) {
    if (effect.kind != asked.kind || (effect.port != asked.port && asked.port != "all")) continue;
    const auto value = effect.parameters.find(parameter);
    if (value != effect.parameters.end()) return value->second;
  }
  return kNaN;
}

void note_truth(const RobotFile& robot, SimPlant& made) {
  for (std::uint32_t i = 0; i < robot.config.model->param_count; ++i) {
    made.true_params.push_back(made.plant->parameter(robot.names.params[i]));
  }
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const tiller_effect_t& effect = robot.config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    const sim::HiddenEffect asked = hidden_effect(robot, effect, nullptr);
    for (int k = 0; k < info.param_count; ++k)
      made.true_params.push_back(true_effect(made.plant->options(), asked, info.params[k].name));
  }
}

}  // namespace

namespace {

/// In the place of every effect of [sim] of this kind that acts there.
void set_true_effect(RobotFile& robot, const tiller_effect_t& effect, const double* values) {
  const EffectInfo& info = effect_info(effect.kind);
  SimEffect truth;
  truth.kind = info.name;
  if (info.port != PortKind::body) truth.port = port_name(info.port, *robot.config.model, effect.port);
  for (int i = 0; i < info.param_count; ++i) truth.parameters[info.params[i].name] = values[i];
  auto& all = robot.sim.effects;
  const auto replaced = [&](const SimEffect& old) {
    return old.kind == truth.kind && (old.port == truth.port || old.port.empty());
  };
  all.erase(std::remove_if(all.begin(), all.end(), replaced), all.end());
  all.push_back(truth);
}

}  // namespace

void set_true_params(RobotFile& robot, const double* params) {
  robot.sim.draw = false;
  if (robot.sim.line == 0) robot.sim.plant = "model";
  for (std::uint32_t p = 0; p < robot.config.model->param_count; ++p)
    if (!std::isnan(params[p])) robot.sim.parameters[robot.names.params[p]] = params[p];
  const double* row = params + robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const int count = effect_info(robot.config.effects[e].kind).param_count;
    if (count > 0 && !std::isnan(row[0])) set_true_effect(robot, robot.config.effects[e], row);
    row += count;
  }
}

double draw_from_prior(const tiller_prior_t& prior, double (*uniform)(void*), void* context) {
  if (prior.kind == tiller_prior_fixed) return prior.a;
  if (prior.kind == tiller_prior_uniform) return prior.low + (prior.high - prior.low) * uniform(context);
  // Box-Muller, drawn again while outside the hard bounds; a range in the far tail ends at its nearest bound
  double value = prior.a;
  for (int attempt = 0; attempt < 1000; ++attempt) {
    const double radius = std::sqrt(-2 * std::log(uniform(context)));
    const double normal = radius * std::cos(2 * kPi * uniform(context));
    value = prior.kind == tiller_prior_normal ? prior.a + prior.b * normal : prior.a * std::exp(prior.b * normal);
    if (value >= prior.low && value <= prior.high) return value;
  }
  return std::clamp(value, prior.low, prior.high);
}

std::unique_ptr<SimPlant> make_sim_plant(const RobotFile& robot, std::string& error) {
  std::shared_ptr<const sim::MechanismInfo> described;
  if (robot.sim.plant == "urdf") {
    std::vector<std::string> problems;
    const auto tree = describe_plant({robot.sim.file, robot.sim.frame, robot.sim.hold, robot.sim.armature}, problems);
    if (!tree) {
      for (const std::string& problem : problems) error += where(robot) + problem + "\n";
      return nullptr;
    }
    described = std::make_shared<const sim::MechanismInfo>(sim::tree_info(tree));
  }
  const sim::MechanismInfo* info = described ? described.get() : sim::find_mechanism(robot.sim.plant);
  if (robot.sim.line == 0 && !info) {
    error = robot.path + ": has no [sim] section, and there is no plant '" + robot.sim.plant +
            "'; add [sim] with plant = one of those in `tiller sim --help`\n";
    return nullptr;
  }
  if (!info) {
    Words known;
    for (const sim::MechanismInfo& mechanism : sim::mechanisms()) known.push_back(mechanism.kind);
    known.insert(known.end(), {"urdf", "model"});
    error = where(robot) + "there is no plant '" + robot.sim.plant + "'; plants: " + join(known) + "\n";
    return nullptr;
  }
  auto made = std::make_unique<SimPlant>();
  std::string problem;
  made->plant = sim::Plant::make(plant_options(robot, *info, described), problem);
  if (!made->plant) {
    error = where(robot) + problem + "\n";
    return nullptr;
  }
  if (!connect(robot, *made, error)) return nullptr;
  note_truth(robot, *made);
  return made;
}

}  // namespace tiller::tools
