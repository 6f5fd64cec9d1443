#include "tools/robot/robot_equations.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "posterior/prior.hpp"

namespace tiller::tools {
namespace {

/// What the equations are evaluated at.
struct Point {
  std::vector<double> x, u, p;
};

class Equations {
 public:
  explicit Equations(const RobotFile& robot) : robot_(robot), config_(robot.config), model_(*robot.config.model) {}

  /// The start: expected state, safe command, and every parameter at its prior's median.
  Point start() const {
    Point point;
    point.x.assign(config_.initial_state, config_.initial_state + model_.state_count);
    for (std::uint32_t j = 0; j < model_.input_count; ++j)
      point.u.push_back(
          std::clamp(config_.safety.safe_command[j], config_.safety.input_low[j], config_.safety.input_high[j]));
    for (std::uint32_t i = 0; i < model_.param_count; ++i) point.p.push_back(parameter(i, 0.5));
    return point;
  }

  /// Anywhere where the start may lie by its deviations and the sensors' limits leave it, with inputs within [limits].
  Point somewhere(Rng& rng) const {
    constexpr double kDeviations = 2.0;
    Point point = start();
    for (std::uint32_t i = 0; i < model_.state_count; ++i) {
      double low = point.x[i] - kDeviations * config_.initial_state_sd[i];
      double high = point.x[i] + kDeviations * config_.initial_state_sd[i];
      for (std::uint32_t k = 0; k < config_.measurement_count; ++k)
        if (config_.measured_state[k] == i) {
          const double least = config_.safety.measurement_low ? config_.safety.measurement_low[k] : -INFINITY;
          const double most = config_.safety.measurement_high ? config_.safety.measurement_high[k] : INFINITY;
          low = std::isfinite(least) ? least : std::min(low, most);
          high = std::isfinite(most) ? most : std::max(high, least);
        }
      point.x[i] = low + (high - low) * rng.uniform();
    }
    for (std::uint32_t j = 0; j < model_.input_count; ++j)
      point.u[j] =
          config_.safety.input_low[j] + (config_.safety.input_high[j] - config_.safety.input_low[j]) * rng.uniform();
    for (std::uint32_t i = 0; i < model_.param_count; ++i) point.p[i] = parameter(i, rng.uniform());
    return point;
  }

  /// "volume_L' = nan, ..." for the equations without a finite value; "" where all have one.
  std::string defects(const Point& point) const {
    double rates[TILLER_MAX_STATES] = {}, forces[TILLER_MAX_JOINTS] = {}, shown[TILLER_MAX_OUTPUTS] = {};
    Words found;
    model_.dynamics(point.x.data(), point.u.data(), forces, &config_.body, point.p.data(), rates);
    for (std::uint32_t i = 0; i < model_.state_count; ++i)
      if (!std::isfinite(rates[i]))
        found.push_back("the rate of " + robot_.names.states[i] + " is " + number(rates[i]));
    if (model_.output_count > 0) model_.outputs(point.x.data(), point.p.data(), shown);
    for (std::uint32_t i = 0; i < model_.output_count; ++i)
      if (!std::isfinite(shown[i]))
        found.push_back("the output " + robot_.names.outputs[i] + " is " + number(shown[i]));
    if (const tiller_own_cost_t* own = config_.cost.own) {
      const double cost = own->stage(point.x.data(), point.u.data(), point.p.data(), 0.0, own->context);
      if (!std::isfinite(cost)) found.push_back("the cost of the model's file is " + number(cost));
    }
    return found.empty() ? "" : join(found);
  }

  /// The numbers of a defective point that alone mend it where they are moved a little, "volume_L = 0"; empty: none
  /// does.
  Words culprits(const Point& point) const {
    Words found;
    const auto each = [&](std::vector<double> Point::*part, const Words& names) {
      for (std::size_t i = 0; i < (point.*part).size(); ++i) {
        constexpr double kStep = 1e-3;
        for (const double sign : {1.0, -1.0}) {
          Point moved = point;
          double& value = (moved.*part)[i];
          value += sign * kStep * std::max(1.0, std::abs(value));
          if (!defects(moved).empty()) continue;
          found.push_back(names[i] + " = " + number((point.*part)[i]));
          break;
        }
      }
    };
    each(&Point::x, robot_.names.states);
    each(&Point::u, robot_.names.inputs);
    each(&Point::p, robot_.names.params);
    return found;
  }

  std::string all_numbers(const Point& point) const {
    Words all;
    for (std::size_t i = 0; i < point.x.size(); ++i) all.push_back(robot_.names.states[i] + " = " + number(point.x[i]));
    for (std::size_t i = 0; i < point.u.size(); ++i) all.push_back(robot_.names.inputs[i] + " = " + number(point.u[i]));
    for (std::size_t i = 0; i < point.p.size(); ++i) all.push_back(robot_.names.params[i] + " = " + number(point.p[i]));
    return join(all);
  }

  /// "because of volume_L = 0" or "at x = 1, ...".
  std::string where(const Point& point) const {
    const Words names = culprits(point);
    return names.empty() ? "at " + all_numbers(point) : "because of " + join(names, " or ");
  }

 private:
  double parameter(std::uint32_t i, double share) const { return parameter_at(config_.priors[i], share); }
  static std::string number(double value) { return std::isnan(value) ? "nan" : format("%.4g", value); }

  const RobotFile& robot_;
  const tiller_config_t& config_;
  const tiller_model_t& model_;
};

constexpr const char* kGuard =
    "guard the equation, e.g. by select(x > least, x, least) in C++, x > least ? x : least in C";

}  // namespace

double parameter_at(const tiller_prior_t& prior, double share) {
  constexpr double kEdge = 1e-3;  // quantiles are of the open interval
  if (prior.kind == tiller_prior_fixed) return prior.a;
  return from_coordinate(prior, prior_quantile(prior, std::clamp(share, kEdge, 1.0 - kEdge)));
}

void check_start(FileErrors& errors, const toml::table& root, const RobotFile& robot) {
  if (!robot.config.model->dynamics) return;
  const Equations equations(robot);
  const Point start = equations.start();
  const std::string defects = equations.defects(start);
  if (defects.empty()) return;
  const toml::node* state = root["start"]["state"].node();
  const toml::node* section = state ? state : root["model"].node();
  errors.at_table(*section, state ? "start.state" : "start",
                  "the model has no finite motion there: " + defects + ", " + equations.where(start),
                  "give other values in [start] state or [parameters], or " + std::string(kGuard));
}

void hint_at_equations(FileErrors& hints, const toml::table& root, const RobotFile& robot) {
  constexpr int kPoints = 64;
  if (!robot.config.model->dynamics) return;
  const Equations equations(robot);
  int bad = 0;
  std::string first;
  for (int k = 0; k < kPoints; ++k) {
    Rng rng(1, kRngPrior, static_cast<std::uint64_t>(k));
    const Point point = equations.somewhere(rng);
    const std::string defects = equations.defects(point);
    if (defects.empty() || bad++ > 0) continue;
    first = defects + " at " + equations.all_numbers(point);
  }
  if (bad == 0) return;
  hints.at_table(*root["model"].node(), "model",
                 "the model has no finite motion at " + std::to_string(bad) + " of " + std::to_string(kPoints) +
                     " random points within [start] sd, the limits of [measurement] and [limits]: " + first,
                 "narrow these, or " + std::string(kGuard));
}

}  // namespace tiller::tools
