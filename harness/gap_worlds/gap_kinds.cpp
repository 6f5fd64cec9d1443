#include "harness/gap_worlds/gap_kinds.hpp"

#include <algorithm>
#include <cmath>

#include "sim/mechanisms/mechanism.hpp"

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
double spatial_period(Draws& d, Port p, const Typical& t) {
  if (t.turns[p]) return 2 * kPi / std::round(d.log_between(6, 24));
  return t.position[p] * d.between(0.15, 0.6);
}

/// Two numbers of a given size in a drawn direction.
std::pair<double, double> turned(Draws& d, double size) {
  const double phase = d.between(0, 2 * kPi);
  return {size * std::cos(phase), size * std::sin(phase)};
}

// friction
Parameters viscous(double s, Port p, const Typical& t, Draws) {
  return {{"damping_SI", 0.8 * s * t.force[p] / t.velocity[p]}};
}
Parameters coulomb(double s, Port p, const Typical& t, Draws) { return {{"friction_SI", 0.5 * s * t.force[p]}}; }
Parameters stribeck(double s, Port p, const Typical& t, Draws d) {
  const double friction = 0.35 * s * t.force[p];
  return {{"friction_SI", friction},
          {"stiction_extra_SI", d.between(0.5, 1.0) * friction},
          {"stribeck_velocity_SI", d.between(0.1, 0.3) * t.velocity[p]}};
}
Parameters asymmetric(double s, Port p, const Typical& t, Draws d) {
  const double large = 0.5 * s * t.force[p], small = large * d.between(0.2, 0.6);
  const bool forward = d.uniform() < 0.5;
  return {{"forward_SI", forward ? large : small}, {"backward_SI", forward ? small : large}};
}
Parameters position_friction(double s, Port p, const Typical& t, Draws d) {
  const double friction = 0.6 * s * t.force[p];
  const auto [cosine, sine] = turned(d, friction * d.between(0.8, 1.0));
  return {{"friction_SI", friction},
          {"cosine_SI", cosine},
          {"sine_SI", sine},
          {"spatial_period_SI", spatial_period(d, p, t)}};
}
Parameters load_friction(double s, Port, const Typical&, Draws) { return {{"coefficient", 0.6 * s}}; }
Parameters drag(double s, Port p, const Typical& t, Draws) {
  return {{"drag_SI", 0.6 * s * t.force[p] / std::pow(t.velocity[p], 2)}};
}
Parameters lugre(double s, Port p, const Typical& t, Draws d) {
  Parameters all = stribeck(s, p, t, d);
  // the bristles yield a tenth to a third of the motion before they slide, else nobody could see them
  Draws more(d);
  all["bristle_stiffness_SI"] = all["friction_SI"] / (t.position[p] * more.between(0.1, 0.3));
  return all;
}

// other forces at a joint
Parameters offset(double s, Port p, const Typical& t, Draws d) {
  return {{"force_SI", sign(d) * 0.5 * s * t.force[p]}};
}
Parameters linear(double s, Port p, const Typical& t, Draws) {
  return {{"stiffness_SI", 0.8 * s * t.force[p] / t.reach[p]}};
}
Parameters cubic(double s, Port p, const Typical& t, Draws) {
  return {{"stiffness_SI3", 0.5 * s * t.force[p] / std::pow(t.reach[p], 3)}};
}
Parameters cogging(double s, Port p, const Typical& t, Draws d) {
  const auto [cosine, sine] = turned(d, 0.5 * s * t.force[p]);
  return {{"cosine_SI", cosine}, {"sine_SI", sine}, {"spatial_period_SI", spatial_period(d, p, t)}};
}
Parameters ripple(double s, Port p, const Typical& t, Draws d) {
  const auto [cosine, sine] = turned(d, 0.6 * s);
  const auto [cosine2, sine2] = turned(d, 0.6 * s * d.between(0.3, 0.7));
  return {{"cosine", cosine},
          {"sine", sine},
          {"cosine2", cosine2},
          {"sine2", sine2},
          {"spatial_period_SI", spatial_period(d, p, t)}};
}
Parameters inertia(double s, Port p, const Typical& t, Draws) { return {{"inertia_SI", s * t.inertia[p]}}; }
Parameters tilt(double s, Port, const Typical&, Draws d) { return {{"angle_rad", sign(d) * 0.3 * s}}; }
Parameters payload(double s, Port, const Typical& t, Draws) { return {{"mass_kg", s * t.mass}}; }

// between command and motor
Parameters lag(double s, Port, const Typical&, Draws) { return {{"time_constant_s", 0.1 * s}}; }
Parameters delay(double s, Port, const Typical&, Draws) {
  // whole steps of the world: any other ends at the next one, and the sealed answer would not be what happens
  return {{"delay_s", kWorldStep * std::max(1.0, std::round(0.1 * s / kWorldStep))}};
}
Parameters dead_zone(double s, Port p, const Typical& t, Draws) { return {{"width_SI", 0.8 * s * t.input[p]}}; }
Parameters saturation(double s, Port p, const Typical& t, Draws) {
  return {{"limit_SI", (1 - 0.85 * s) * t.input_peak[p]}};
}
Parameters gain(double s, Port, const Typical&, Draws d) { return {{"gain_error", sign(d) * 0.5 * s}}; }
Parameters backlash(double s, Port p, const Typical& t, Draws d) {
  // a rotor that does not shrink with the play would be found for its inertia
  const double rotor = (0.01 + d.between(0.03, 0.12) * s) * t.inertia[p];
  return {{"gap_SI", 0.4 * s * t.position[p]}, {"rotor_inertia_SI", rotor}};
}
Parameters rate_limit(double s, Port p, const Typical& t, Draws) { return {{"rate_SI_s", 2 * t.input[p] / s}}; }

// sensors
Parameters bias(double s, Port p, const Typical& t, Draws d) {
  return {{"bias_SI", sign(d) * 0.4 * s * t.position[p]}};
}
Parameters scale(double s, Port, const Typical&, Draws d) { return {{"scale_error", sign(d) * 0.3 * s}}; }

Parameters square_spring(double s, Port p, const Typical& t, Draws) {
  return {{"stiffness_SI2", 0.6 * s * t.force[p] / std::pow(t.reach[p], 2)}};
}
// what no catalogue has
Parameters gap_spring(double s, Port p, const Typical& t, Draws d) {
  return {{"stiffness_SI", 2 * s * t.force[p] / t.reach[p]}, {"gap_SI", 2 * t.reach[p] * d.between(0.4, 0.9)}};
}
Parameters hard_stop(double s, Port p, const Typical& t, Draws d) {
  const double stiffness = 10 * t.force[p] / t.reach[p];
  return {{"position_SI", t.reach[p] * (1.5 - (1.2 + 0.2 * d.uniform()) * s)},
          {"stiffness_SI", stiffness},
          {"damping_SI", 0.1 * std::sqrt(stiffness * t.inertia[p])}};
}
Parameters wind(double s, Port p, const Typical& t, Draws d) {
  return {{"force_SI", 0.6 * s * t.force[p]}, {"correlation_s", d.log_between(0.1, 0.6)}};
}
Parameters periodic(double s, Port p, const Typical& t, Draws d) {
  return {{"force_SI", 0.7 * s * t.force[p]}, {"frequency_Hz", d.log_between(0.5, 4)}};
}
Parameters friction_drift(double s, Port p, const Typical& t, Draws d) {
  const double friction = 0.7 * s * t.force[p];
  return {{"friction_SI", friction}, {"heat_J", friction * t.velocity[p] * d.between(1.0, 2.5)}};
}
Parameters rough_patches(double s, Port p, const Typical& t, Draws d) {
  return {{"friction_SI", 0.8 * s * t.force[p]}, {"spatial_period_SI", spatial_period(d, p, t)}};
}
Parameters loose(double s, Port, const Typical&, Draws d) {
  return {{"share", 0.4 * s}, {"slip_s", d.between(0.03, 0.1)}};
}
Parameters supply_sag(double s, Port p, const Typical& t, Draws d) {
  return {{"droop_per_SI", 2 * s / t.input[p]}, {"recovery_s", d.between(0.2, 0.8)}};
}
Parameters gain_drift(double s, Port, const Typical&, Draws) { return {{"drift_1_s", -0.05 * s}}; }  // logs of 8 s
Parameters jitter(double s, Port, const Typical&, Draws) { return {{"delay_s", 0.12 * s}}; }
Parameters elastic(double s, Port p, const Typical& t, Draws d) {
  // a rotor within what a mass is known to: the spring is what shows
  const double rotor = 0.03 * t.inertia[p], hz = d.between(1.5, 2.5);
  // at most 80 Hz: faster than that no step of half a millisecond follows
  const double stiffness = std::min(t.inertia[p] * std::pow(2 * kPi * hz, 2) / s, rotor * std::pow(2 * kPi * 80, 2));
  return {{"stiffness_SI", stiffness}, {"rotor_inertia_SI", rotor}, {"damping_SI", 0.1 * std::sqrt(stiffness * rotor)}};
}
Parameters swinging(double s, Port, const Typical& t, Draws d) {
  return {{"mass_kg", s * t.mass}, {"length_m", d.between(0.1, 0.3)}};
}
Parameters eccentricity(double s, Port p, const Typical& t, Draws) {
  return {{"amplitude_SI", 0.3 * s * t.position[p]}, {"spatial_period_SI", t.turns[p] ? 2 * kPi : 2 * t.position[p]}};
}

}  // namespace

const std::vector<HiddenKind>& hidden_kind_table() {
  using P = HidingPlace;
  static const std::vector<HiddenKind> all = {
      {"viscous_friction", P::joint, true, viscous},
      {"coulomb_friction", P::joint, true, coulomb},
      {"stribeck_friction", P::joint, true, stribeck},
      {"asymmetric_friction", P::joint, true, asymmetric},
      {"quadratic_drag", P::joint, true, drag},
      {"load_friction", P::motor_joint, true, load_friction},
      {"lugre_friction", P::motor_joint, true, lugre},
      {"constant_offset", P::joint, true, offset},
      {"linear_spring", P::spring_joint, true, linear},
      {"cubic_spring", P::spring_joint, true, cubic},
      {"cogging", P::joint, true, cogging},
      {"torque_ripple", P::motor_joint, true, ripple},
      {"joint_inertia", P::ground_joint, true, inertia},
      {"actuator_lag", P::input, true, lag},
      {"input_delay", P::input, true, delay},
      {"dead_zone", P::input, true, dead_zone},
      {"saturation", P::input, true, saturation},
      {"actuator_gain", P::input, true, gain},
      {"backlash", P::ground_input, true, backlash},
      {"rate_limit", P::input, true, rate_limit},
      {"sensor_bias", P::gravity_sensor, true, bias},
      {"sensor_scale", P::spring_sensor, true, scale},
      {"tilt", P::body, true, tilt},
      {"payload", P::body, true, payload},
      {"square_spring", P::spring_joint, true, square_spring},
      {"hard_stop", P::spring_joint, true, hard_stop},
      {"position_friction", P::motor_joint, true, position_friction},
      {"supply_sag", P::input, true, supply_sag},
      {"elastic_joint", P::ground_input, true, elastic},
      {"gain_drift", P::input, true, gain_drift},

      {"gap_spring", P::spring_joint, false, gap_spring},
      {"wind_gusts", P::joint, false, wind},
      {"periodic_force", P::joint, false, periodic},
      {"friction_drift", P::motor_joint, false, friction_drift},
      {"rough_patches", P::motor_joint, false, rough_patches},
      {"loose_coupling", P::input, false, loose},
      {"command_jitter", P::input, false, jitter},
      {"swinging_load", P::body, false, swinging},
      {"encoder_eccentricity", P::sensor, true, eccentricity},
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
  const std::vector<double> fitted = fit_amplitude(plain, amplitude, "log_1");
  if (!record(plain, fitted, "log_1", 8.0, s, error)) return t;
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
    t.reach.push_back(rms(s.truth[j]));
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
