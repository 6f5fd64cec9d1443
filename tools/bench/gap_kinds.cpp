#include "gap_kinds.hpp"

#include <algorithm>
#include <cmath>

#include "sim/mechanism.hpp"

namespace tiller::bench {
namespace {

constexpr double kPi = 3.14159265358979323846;

using Parameters = std::map<std::string, double>;
using Port = std::size_t;

double sign(Draws& d) { return d.uniform() < 0.5 ? -1.0 : 1.0; }

double rms(const std::vector<double>& values, double about = 0) {
  double sum = 0;
  for (const double v : values) sum += (v - about) * (v - about);
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// Of teeth or magnets: a whole number a turn, or a part of the travel.
[[maybe_unused]] double pitch(Draws& d, Port p, const Typical& t) {
  if (t.turns[p]) return 2 * kPi / std::round(d.log_between(6, 24));
  return t.position[p] * d.between(0.15, 0.6);
}

Parameters viscous(double s, Port p, const Typical& t, Draws) {
  return {{"damping_SI", 0.8 * s * t.force[p] / t.velocity[p]}};
}
Parameters coulomb(double s, Port p, const Typical& t, Draws) { return {{"friction_SI", 0.5 * s * t.force[p]}}; }
Parameters offset(double s, Port p, const Typical& t, Draws d) {
  return {{"force_SI", sign(d) * 0.5 * s * t.force[p]}};
}
Parameters lag(double s, Port, const Typical&, Draws) { return {{"time_constant_s", 0.1 * s}}; }
Parameters delay(double s, Port, const Typical&, Draws) { return {{"delay_s", 0.1 * s}}; }

}  // namespace

const std::vector<HiddenKind>& hidden_kind_table() {
  static const std::vector<HiddenKind> all = {
      {"viscous_friction", HidingPlace::joint, true, viscous}, {"coulomb_friction", HidingPlace::joint, true, coulomb},
      {"constant_offset", HidingPlace::joint, true, offset},   {"actuator_lag", HidingPlace::input, true, lag},
      {"input_delay", HidingPlace::input, true, delay},
  };
  return all;
}

const HiddenKind* find_hidden_kind(const std::string& name) {
  for (const HiddenKind& kind : hidden_kind_table()) {
    if (kind.name == name) return &kind;
  }
  return nullptr;
}

Typical typical_motion(const Setup& setup, const std::vector<double>& amplitude) {
  Setup plain = setup;
  plain.options.effects.clear();
  plain.world.effects.clear();
  if (plain.world.excitation == Excitation::planner) plain.world.excitation = Excitation::open_loop;
  Series s;
  std::string error;
  Typical t;
  if (!record(plain, amplitude, "log_1", 8.0, s, error)) return t;
  const sim::MechanismInfo& info = *sim::find_mechanism(setup.world.plant);
  const std::size_t joints = setup.plant->excursion.size();
  sim::PlantOptions options = plain.options;
  const auto plant = sim::Plant::make(options, error);
  std::map<std::string, double> all;
  for (const sim::ParameterInfo& p : info.parameters) all[p.name] = plant->parameter(p.name);
  const auto mechanism = info.build(all);
  for (std::size_t j = 0; j < joints; ++j) {
    std::vector<double> change;
    const std::vector<double>& rate = s.truth[joints + j];
    for (std::size_t k = 1; k < rate.size(); ++k) change.push_back((rate[k] - rate[k - 1]) / kWorldPeriod);
    t.inertia.push_back(mechanism->joint(j).least_inertia());
    t.force.push_back(t.inertia[j] * rms(change));
    t.velocity.push_back(rms(rate));
    t.position.push_back(rms(s.truth[j], setup.plant->rest[j]));
    t.turns.push_back(info.states[j].unit == "rad");
  }
  for (std::size_t i = 0; i < s.input.size(); ++i) {
    t.input.push_back(rms(s.input[i]));
    double peak = 0;
    for (const double u : s.input[i]) peak = std::max(peak, std::fabs(u));
    t.input_peak.push_back(peak);
    // where a motor pushes, its command says better what a force there is than the inertia that it could least meet
    const std::size_t joint = setup.plant->motors[i].state;
    t.force[joint] = std::max(t.force[joint], t.input[i]);
  }
  for (const auto& [name, value] : setup.options.parameters) {
    if (name.find("mass_kg") != std::string::npos) t.mass = t.mass == 0 ? value : std::min(t.mass, value);
  }
  return t;
}

}  // namespace tiller::bench
