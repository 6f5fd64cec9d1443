#include "harness/gap_worlds/gap_setup.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace tiller::bench {
namespace {

constexpr double kPi = 3.14159265358979323846;
// what the robot file says where nothing disturbs the plant: below every sensor after a second
constexpr double kLeastProcess = 1e-4;

const std::vector<WorldPlant>& plants() {
  static const std::vector<WorldPlant> all = {
      {"pendulum",
       {{"mass_kg", 0.3, 0.8, true}, {"length_m", 0.3, 0.7, false}},
       {0, 0},
       {1.8},
       {{0, 1.6, 0.01, 1.5, 3.6}},
       0.15,
       2.5,
       0.6,
       false},
      {"cart_pole",
       {{"cart_mass_kg", 0.7, 1.5, true}, {"pole_mass_kg", 0.1, 0.3, true}, {"half_length_m", 0.3, 0.6, false}},
       {0, kPi, 0, 0},
       {1.2, 1.2},
       {{0, 0.8, 0.001, -0.8, 0.8}},
       0.25,
       2.0,
       0.15,
       true},
      {"two_link_arm",
       {{"upper_mass_kg", 0.8, 1.5, true},
        {"lower_mass_kg", 0.4, 1.0, true},
        {"upper_length_m", 0.3, 0.5, false},
        {"lower_length_m", 0.3, 0.5, false}},
       {0, 0, 0, 0},
       {1.3, 1.5},
       {{0, 1.6, 0.01, -1.5, 1.5}, {1, 2.0, 0.02, -1.5, 1.5}},
       0.15,
       2.5,
       0.4,
       false},
      {"linear_axis", {{"mass_kg", 2.0, 20.0, true}}, {0, 0}, {0.4}, {{0, 1.2, 1e-5, -0.4, 0.4}}, 0.25, 2.0, 0.6, true},
  };
  return all;
}

std::string number(double value) {
  std::ostringstream out;
  out.precision(17);
  out << value;
  return out.str();
}

/// A weighed part: the scales are right to 2.5 % (normal), or the maker promises 5 % (uniform).
void draw_weighed(Draws& draws, double nominal, double& truth, std::string& prior) {
  const bool normal = draws.uniform() < 0.5;
  const double off = normal ? 0.025 * draws.normal() : 0.05 * (2 * draws.uniform() - 1);
  truth = nominal * (1 + std::clamp(off, -0.05, 0.05));
  std::ostringstream text;
  if (normal) {
    text << "{ normal = [" << nominal << ", " << 0.025 * nominal << "], low = " << 0.9 * nominal
         << ", high = " << 1.1 * nominal << " }";
  } else {
    text << "{ uniform = [" << 0.95 * nominal << ", " << 1.05 * nominal << "] }";
  }
  prior = text.str();
}

double rounded(double value) { return std::round(value * 1e3) / 1e3; }

/// Two rods of even thickness: the rest of the arm's parameters.
void add_rods(std::map<std::string, double>& p) {
  for (const char* link : {"upper", "lower"}) {
    const std::string name = link;
    const double length = p.at(name + "_length_m");
    p[name + "_com_m"] = 0.5 * length;
    p[name + "_inertia_kgm2"] = p.at(name + "_mass_kg") * length * length / 12;
  }
}

std::vector<double> inertia_of(const std::string& kind, const std::map<std::string, double>& p) {
  if (kind == "pendulum") return {p.at("mass_kg") * std::pow(p.at("length_m"), 2)};
  if (kind == "cart_pole") return {p.at("cart_mass_kg") + p.at("pole_mass_kg")};
  if (kind == "linear_axis") return {p.at("mass_kg")};
  const double m1 = p.at("upper_mass_kg"), m2 = p.at("lower_mass_kg"), l1 = p.at("upper_length_m"),
               l2 = p.at("lower_length_m");
  return {m1 * l1 * l1 / 3 + m2 * (l1 * l1 + l2 * l2 / 3 + l1 * l2), m2 * l2 * l2 / 3};
}

}  // namespace

const WorldPlant* find_world_plant(const std::string& kind) {
  for (const WorldPlant& plant : plants()) {
    if (plant.kind == kind) return &plant;
  }
  return nullptr;
}

std::vector<std::string> world_plants() {
  std::vector<std::string> names;
  for (const WorldPlant& plant : plants()) names.push_back(plant.kind);
  return names;
}

bool make_setup(const WorldCase& world, Setup& setup, std::string& error) {
  setup = Setup{};
  setup.plant = find_world_plant(world.plant);
  if (setup.plant == nullptr) {
    error = "no worlds are made of plant '" + world.plant + "'; known:";
    for (const std::string& name : world_plants()) error += " " + name;
    return false;
  }
  setup.world = world;
  sim::PlantOptions& o = setup.options;
  o.kind = world.plant;
  o.effects = world.effects;
  o.step_s = kWorldStep;
  o.command_limit = 1e9;
  o.watchdog_timeout_s = 0;
  for (const WorldPlant::Parameter& p : setup.plant->parameters) {
    Draws draws(world.seed, "parameter." + p.name);
    const double nominal = rounded(draws.log_between(p.low, p.high));
    double truth = nominal;
    std::string prior = number(nominal);
    if (p.weighed) draw_weighed(draws, nominal, truth, prior);
    setup.nominal[p.name] = nominal;
    setup.priors[p.name] = prior;
    o.parameters[p.name] = truth;
  }
  if (world.plant == "two_link_arm") {
    add_rods(setup.nominal);
    for (const auto& [name, value] : setup.nominal) {
      if (setup.priors.emplace(name, number(value)).second) o.parameters[name] = value;
    }
  }
  setup.inertia = inertia_of(world.plant, setup.nominal);
  setup.sensor_sd = std::sqrt(std::pow(world.noise_sd, 2) + std::pow(world.encoder_step, 2) / 12);
  const auto plant = sim::Plant::make(o, error);
  return plant != nullptr;
}

/// A table of a robot file, "{ a = 1, b = 1 }", over some names.
template <class Value>
std::string table(const std::vector<std::string>& names, Value value) {
  std::ostringstream out;
  for (std::size_t i = 0; i < names.size(); ++i) out << (i ? ", " : "{ ") << names[i] << " = " << value(i);
  return out.str() + " }";
}

std::string robot_text(const Setup& setup, const sim::Plant& plant, const std::vector<double>& amplitude) {
  const WorldPlant& kind = *setup.plant;
  const std::size_t positions = kind.excursion.size();
  std::vector<std::string> states, rates, inputs;
  for (std::size_t i = 0; i < plant.states().size(); ++i) {
    states.push_back(plant.states()[i].name);
    if (i >= positions) rates.push_back(plant.states()[i].name);
  }
  for (const sim::Channel& c : plant.commands()) inputs.push_back(c.name);
  std::vector<double> weight(2 * positions, 0.02), target = kind.rest;
  for (std::size_t i = 0; i < kind.motors.size(); ++i) {
    weight[kind.motors[i].state] = 4;
    Draws draws(setup.world.seed, "target." + inputs[i]);
    target[kind.motors[i].state] = rounded(draws.between(kind.motors[i].target_low, kind.motors[i].target_high));
  }
  // what a random force of so many N, held for 1 ms each, does to a rate within a second
  const double kick = setup.world.process_sd * std::sqrt(1e-3);
  std::ostringstream out;
  out << "# " << kind.kind << ": what is known of it.\n\n[robot]\nname = \"" << kind.kind << "\"\n\n[model]\nname = \""
      << kind.kind << "\"\nperiod_s = " << kWorldPeriod << "\nintegrator = \"rk4\"\n\n[parameters]\n";
  for (const auto& [name, prior] : setup.priors) out << name << " = " << prior << "\n";
  if (kind.kind == "pendulum") out << "damping_Nms = 0\n";
  out << "\n[measurement]\n";
  for (std::size_t i = 0; i < positions; ++i) out << states[i] << " = { sd = " << number(setup.sensor_sd) << " }\n";
  out << "\n[noise]\nprocess_sd = "
      << table(rates,
               [&](std::size_t i) {
                 return number(std::max(kLeastProcess, kind.motors.size() > i ? kick / setup.inertia[i] : 0.0));
               })
      << "\n\n[start]\nstate = " << table(states, [&](std::size_t i) { return number(kind.rest[i]); })
      << "\nsd = " << table(states, [&](std::size_t i) { return i < positions ? 0.3 : 0.05; })
      << "\n\n[planner]\nkind = \"mppi\"\nhorizon = 60\nknots = 8\nrollouts = 64\nparticles = 1\niterations = 1\nnoise_sd = "
      << table(inputs, [&](std::size_t i) { return number(rounded(0.7 * amplitude[i])); })
      << "\n\n[cost]\ntarget = " << table(states, [&](std::size_t i) { return number(target[i]); })
      << "\nstate_weight = " << table(states, [&](std::size_t i) { return number(weight[i]); })
      << "\nterminal_weight = " << table(states, [&](std::size_t i) { return number(10 * weight[i]); })
      << "\ninput_weight = " << table(inputs, [&](std::size_t i) { return number(kind.motors[i].weight); })
      << "\n\n[limits]\n";
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const double most = std::ceil(40 * amplitude[i]) / 10;
    out << inputs[i] << " = { low = " << -most << ", high = " << most << " }\n";
  }
  return out.str();
}

}  // namespace tiller::bench
