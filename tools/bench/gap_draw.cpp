#include <algorithm>
#include <cmath>

#include "gap_kinds.hpp"
#include "sim/check.hpp"
#include "sim/effects/effects.hpp"
#include "sim/mechanism.hpp"

namespace tiller::bench {
namespace {

std::vector<std::string> ports(const HiddenKind& kind, const Setup& setup, const sim::MechanismInfo& info) {
  std::vector<std::string> names;
  if (kind.place == HidingPlace::joint) return info.joints;
  if (kind.place == HidingPlace::motor_joint) {
    for (const WorldPlant::Motor& motor : setup.plant->motors) names.push_back(info.joints[motor.state]);
  } else if (kind.place == HidingPlace::input) {
    for (const sim::Channel& c : info.commands) names.push_back(c.name);
  } else if (kind.place == HidingPlace::sensor) {
    for (const std::size_t i : info.measured) names.push_back(info.states[i].name);
  } else {
    names.push_back("");
  }
  return names;
}

std::size_t port_index(const HiddenKind& kind, const Setup& setup, const sim::MechanismInfo& info,
                       const std::string& port) {
  const auto names = kind.place == HidingPlace::motor_joint ? info.joints : ports(kind, setup, info);
  return static_cast<std::size_t>(std::find(names.begin(), names.end(), port) - names.begin());
}

/// r of one effect on the first run; negative where the plant refuses it.
double try_effect(Setup setup, const std::vector<double>& amplitude, const sim::HiddenEffect& effect,
                  std::string& error) {
  setup.world.effects = setup.options.effects = {effect};
  setup.world.process_sd = 0;
  // a search over strengths need not plan: the planner's motion is as rich as the sines'
  if (setup.world.excitation == Excitation::planner) setup.world.excitation = Excitation::open_loop;
  Series series;
  if (!record(setup, amplitude, "log_1", 8.0, series, error)) return -1;
  RolloutError squares;
  add_rollout_error(setup, series, squares);
  return rms_r(squares, setup.sensor_sd);
}

/// Seeks the strength that gives r, false position in logarithms; the strongest where r is out of reach.
bool find_strength(const Setup& setup, const std::vector<double>& amplitude, double wanted_r,
                   const std::function<sim::HiddenEffect(double)>& make, sim::HiddenEffect& found, std::string& error) {
  double high = 1, high_r = try_effect(setup, amplitude, make(high), error);
  if (high_r < 0) return false;
  found = make(high);
  if (high_r <= wanted_r) return true;
  double low = 0, low_r = 0;
  for (int round = 0; round < 6; ++round) {
    double strength = high * wanted_r / high_r;
    if (low > 0) {
      const double part = std::log(wanted_r / low_r) / std::log(high_r / low_r);
      strength = low * std::pow(high / low, std::clamp(part, 0.1, 0.9));
    }
    const double r = try_effect(setup, amplitude, make(strength), error);
    if (r < 0) return false;
    found = make(strength);
    if (std::fabs(std::log(std::max(r, 1e-9) / wanted_r)) < 0.1) return true;
    if (r > wanted_r) {
      high = strength;
      high_r = r;
    } else if (r > 1e-6) {
      low = strength;
      low_r = r;
    } else {
      low = strength;
      low_r = 1e-6;
    }
  }
  return true;
}

}  // namespace

std::vector<std::string> hidden_kinds(const std::string& plant, bool in_catalogue) {
  std::vector<std::string> names;
  const sim::MechanismInfo* info = sim::find_mechanism(plant);
  for (const HiddenKind& kind : hidden_kind_table()) {
    if (info == nullptr || kind.in_catalogue != in_catalogue || sim::find_effect(kind.name) == nullptr) continue;
    // a tilt turns gravity, which a free axis may feel too; a pendulum's load is one only where something hangs
    names.push_back(kind.name);
  }
  return names;
}

bool draw_case(const CaseWanted& wanted, WorldCase& world, std::string& error) {
  world = WorldCase{wanted.plant,      {},         wanted.noise_sd, wanted.excitation, wanted.encoder_step,
                    wanted.process_sd, wanted.seed};
  Setup setup;
  if (!make_setup(world, setup, error)) return false;
  if (wanted.kinds.empty()) return true;
  const sim::MechanismInfo& info = *sim::find_mechanism(wanted.plant);
  const std::vector<double> amplitude = calibrate(setup);
  const Typical typical = typical_motion(setup, amplitude);
  for (const std::string& text : wanted.kinds) {
    const auto at = text.find('@');
    const std::string name = text.substr(0, at);
    const HiddenKind* kind = find_hidden_kind(name);
    if (kind == nullptr) {
      error = "no effect '" + name + "' is hidden in worlds";
      return false;
    }
    Draws draws(wanted.seed, "effect." + name);
    const auto names = ports(*kind, setup, info);
    std::string port = names[draws.index(names.size())];
    if (at != std::string::npos) port = text.substr(at + 1);
    const std::size_t index = port_index(*kind, setup, info, port);
    const double r = draws.log_between(wanted.least_r, wanted.most_r);
    const auto make = [&](double strength) {
      return sim::HiddenEffect{name, port, kind->make(strength, index, typical, Draws(wanted.seed, "shape." + name))};
    };
    sim::HiddenEffect effect;
    if (!find_strength(setup, amplitude, r, make, effect, error)) return false;
    world.effects.push_back(effect);
  }
  return true;
}

}  // namespace tiller::bench
