#include <algorithm>
#include <cmath>

#include "harness/gap_worlds/gap_kinds.hpp"
#include "sim/mechanisms/mechanism.hpp"

namespace tiller::bench {
namespace {

bool stands_on_ground(const WorldPlant& plant, std::size_t joint) { return joint == plant.motors[0].state; }

/// Whether the effect may be hidden at the joint that has this index.
bool joint_fits(HidingPlace place, const WorldPlant& plant, std::size_t joint) {
  bool driven = false;
  for (const WorldPlant::Motor& motor : plant.motors) driven = driven || motor.state == joint;
  switch (place) {
    case HidingPlace::joint:
    case HidingPlace::sensor: return true;
    case HidingPlace::motor_joint: return driven;
    case HidingPlace::ground_joint: return driven && stands_on_ground(plant, joint);
    case HidingPlace::spring_joint:
    case HidingPlace::spring_sensor: return plant.rest[joint] == 0;
    // nothing depends on where a rail's zero is
    case HidingPlace::gravity_sensor: return !(plant.drifts && joint == 0);
    default: return false;
  }
}

/// Names and indices of the ports at which the effect may be hidden.
std::vector<std::pair<std::string, std::size_t>> ports(const HiddenKind& kind, const WorldPlant& plant,
                                                       const sim::MechanismInfo& info) {
  std::vector<std::pair<std::string, std::size_t>> found;
  if (kind.place == HidingPlace::body) return {{"body", 0}};
  if (kind.place == HidingPlace::input || kind.place == HidingPlace::ground_input) {
    for (std::size_t i = 0; i < info.commands.size(); ++i) {
      if (kind.place == HidingPlace::input || i == 0) found.emplace_back(info.commands[i].name, i);
    }
    return found;
  }
  const bool sensor = kind.place == HidingPlace::sensor || kind.place == HidingPlace::gravity_sensor ||
                      kind.place == HidingPlace::spring_sensor;
  for (std::size_t j = 0; j < info.joints.size(); ++j) {
    if (joint_fits(kind.place, plant, j)) found.emplace_back(sensor ? info.states[j].name : info.joints[j], j);
  }
  return found;
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
    if (info == nullptr || kind.in_catalogue != in_catalogue) continue;
    if (!ports(kind, *find_world_plant(plant), *info).empty()) names.push_back(kind.name);
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
  const std::vector<double> plain = calibrate(setup), amplitude = fit_amplitude(setup, plain, "log_1");
  const Typical typical = typical_motion(setup, plain);
  for (const std::string& text : wanted.kinds) {
    const auto at = text.find('@');
    const std::string name = text.substr(0, at);
    const HiddenKind* kind = find_hidden_kind(name);
    if (kind == nullptr) {
      error = "no effect '" + name + "' is hidden in worlds";
      return false;
    }
    Draws draws(wanted.seed, "effect." + name);
    auto places = ports(*kind, *setup.plant, info);
    if (at != std::string::npos) {
      const auto other = [&](const auto& place) { return place.first != text.substr(at + 1); };
      places.erase(std::remove_if(places.begin(), places.end(), other), places.end());
    }
    if (places.empty()) {
      error = "'" + text + "' cannot be hidden in a " + wanted.plant;
      return false;
    }
    const std::pair<std::string, std::size_t> place = places[draws.index(places.size())];
    const double r = draws.log_between(wanted.least_r, wanted.most_r);
    const auto make = [&](double strength) {
      return sim::HiddenEffect{name, place.first,
                               kind->make(strength, place.second, typical, Draws(wanted.seed, "shape." + name))};
    };
    sim::HiddenEffect effect;
    if (!find_strength(setup, amplitude, r, make, effect, error)) return false;
    world.effects.push_back(effect);
  }
  return true;
}

}  // namespace tiller::bench
