// check, models, effects, help and version: commands that only tell.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "costs/cost_term_info.hpp"
#include "planners/planner.hpp"
#include "posterior/prior.hpp"
#include "tiller/config.hpp"
#include "tools/command/commands.hpp"
#include "tools/doctor/tick_forecast.hpp"
#include "tools/open/horizon.hpp"
#include "tools/open/substeps.hpp"
#include "tools/robot/effects_text.hpp"
#include "tools/robot/limits_text.hpp"
#include "tools/robot/robot_help.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

std::string prior_text(const tiller_prior_t& p) {
  const std::string a = number_text(p.a);
  const std::string b = number_text(p.b);
  std::string text;
  if (p.kind == tiller_prior_fixed) return a + " (known)";
  if (p.kind == tiller_prior_uniform) return "uniform on [" + number_text(p.low) + ", " + number_text(p.high) + "]";
  text = (p.kind == tiller_prior_normal ? "normal, mean " : "log-normal, median ") + a + ", sd " +
         (p.kind == tiller_prior_normal ? "" : "of the logarithm ") + b;
  if (std::isfinite(p.low)) text += ", at least " + number_text(p.low);
  if (std::isfinite(p.high)) text += ", at most " + number_text(p.high);
  return text;
}

/// "|x_N, y_N| <= 2 + 0.5 z_N"
std::string cone_text(const RobotFile& robot, const tiller_input_cone_t& cone) {
  Words norm;
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
    if ((cone.inputs >> i) & 1u) norm.push_back(robot.names.inputs[i]);
  std::string radius = cone.limit > 0.0 || !(cone.slope > 0.0) ? number_text(cone.limit) : "";
  if (cone.slope > 0.0)
    radius += (radius.empty() ? "" : " + ") + number_text(cone.slope) + " " + robot.names.inputs[cone.axis];
  return "|" + join(norm) + "| <= " + radius;
}

/// Terms of the cost beside the quadratic ones.
void print_cost(const RobotFile& robot) {
  const tiller_cost_config_t& c = robot.config.cost;
  Words terms;
  if (c.input_reference == tiller_input_reference_steady) terms.emplace_back("inputs from the steady one");
  if (c.terminal == tiller_terminal_lqr) terms.emplace_back("LQR cost-to-go at the end");
  if (c.saturating_weight > 0) terms.emplace_back("saturating");
  Words bounded;
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    if (c.bound_weight[i] > 0 || (c.hard_bounds >> i & 1)) bounded.push_back(robot.names.states[i]);
  if (!bounded.empty()) terms.push_back("bounds of " + join(bounded));
  for (std::uint32_t kind = 0; kind < tiller_cost_term_kind_count; ++kind) {
    const auto count =
        std::count_if(c.terms, c.terms + c.term_count, [&](const tiller_cost_term_t& t) { return t.kind == kind; });
    if (count > 0) terms.push_back(std::to_string(count) + " " + cost_term_info(kind).name + "(s)");
  }
  Words outputs;
  for (std::uint32_t j = 0; j < c.output_count; ++j)
    if (c.outputs[j].weight > 0 || c.outputs[j].terminal_weight > 0 || c.outputs[j].bound_weight > 0)
      outputs.push_back(robot.names.outputs[j]);
  if (!outputs.empty()) terms.push_back("outputs " + join(outputs));
  if (c.reference) terms.push_back(format("a reference of %.3g s", c.reference_steps * robot.config.period_s));
  if (c.demonstration_mean)
    terms.push_back(format("a demonstration of %.3g s", c.demonstration_steps * robot.config.period_s));
  if (c.own_weight > 0) terms.emplace_back("a cost of your own");
  if (!robot.names.outputs.empty()) std::printf("  outputs    %s\n", join(robot.names.outputs).c_str());
  std::printf("  cost       quadratic%s%s\n", terms.empty() ? "" : ", ", terms.empty() ? "" : join(terms).c_str());
}

/// The joint prior: weights, and each component's means and deviations (of the logarithm where the coordinate is that).
void print_joint_prior(const RobotFile& robot) {
  const tiller_mixture_t* m = robot.config.prior_mixture;
  if (!m) return;
  std::printf("  prior      a mixture of %u component(s) in the place of the parameters' own priors\n", m->components);
  for (std::uint32_t c = 0; c < m->components; ++c) {
    std::string text;
    std::uint32_t j = 0;
    for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
      const tiller_prior_t& prior = robot.config.priors[i];
      if (prior.kind == tiller_prior_fixed) continue;
      double square = 0.0;
      for (std::uint32_t k = 0; k <= j; ++k) {
        const double root = m->root[(c * m->dimension + j) * m->dimension + k];
        square += root * root;
      }
      const bool log = prior.kind == tiller_prior_log_normal;
      text += format("%s%s %.4g %s %.3g", text.empty() ? "" : "; ", robot.names.params[i].c_str(),
                     from_coordinate(prior, m->mean[c * m->dimension + j]), log ? "x/" : "+-",
                     log ? std::exp(std::sqrt(square)) : std::sqrt(square));
      ++j;
    }
    std::printf("             %4.1f %%  %s\n", 100.0 * m->weight[c], text.c_str());
  }
}

/// Settings that differ from their default and that the chosen planner does not read.
void print_unread(const RobotFile& robot) {
  Config plain;
  if (tiller_config_default(&plain, robot.config.model) != tiller_status_ok) return;
  const std::string planner = planner_names()[robot.config.planner.kind];
  Words unread;
  for (const KeySpec& key : robot_keys()) {
    if (std::string(key.section) != "planner" || key.offset < 0 || planner_reads(key, planner)) continue;
    const std::size_t size = key.kind == KeyKind::number ? sizeof(double) : sizeof(std::uint32_t);
    const auto* now = reinterpret_cast<const char*>(&robot.config) + key.offset;
    const auto* then = reinterpret_cast<const char*>(&plain) + key.offset;
    if (key.kind != KeyKind::input_numbers && std::memcmp(now, then, size) != 0) unread.emplace_back(key.key);
  }
  if (!unread.empty()) std::printf("             %s does not read %s\n", planner.c_str(), join(unread).c_str());
}

/// How far a plan looks ahead against what the model asks for.
void print_horizon(const RobotFile& robot) {
  const std::string text = horizon_text(robot.config);
  if (!text.empty()) std::printf("             %s\n", text.c_str());
}

/// Time of a tick on this machine, predicted from its work and measured; a warning where the robot would wait for it.
void print_tick(const RobotFile& robot) {
  constexpr double kBudget_s = 1.0;
  TickForecast forecast;
  std::string error;
  std::fflush(stdout);
  if (!forecast_tick(robot, kBudget_s, true, forecast, error)) {
    complain(robot.path + ": " + error);
    return;
  }
  std::printf("  tick       %s\n", forecast_text(robot, forecast).c_str());
  std::fflush(stdout);
  const std::string misfit = misfit_text(robot, forecast);
  if (!misfit.empty()) complain(misfit);
}

int check_command(const std::string& path) {
  const auto robot = read_robot_or_complain(path);
  if (!robot) return kExitBadInput;
  const tiller_config_t& c = robot->config;
  std::printf("%s: %s is valid\n", path.c_str(), robot->name.c_str());
  std::printf("  model      %s: states %s; inputs %s\n", robot->config.model->name, join(robot->names.states).c_str(),
              join(robot->names.inputs).c_str());
  std::printf("  period     %s s, %u substep(s) of %s\n", number_text(c.period_s).c_str(), c.substeps,
              integrator_names()[c.integrator].c_str());
  std::printf("  step error %s\n", step_error_text(*robot).c_str());
  for (std::size_t i = 0; i < robot->names.params.size(); ++i) {
    std::printf("  parameter  %-24s %s\n", robot->names.params[i].c_str(), prior_text(c.priors[i]).c_str());
  }
  print_joint_prior(*robot);
  for (std::size_t i = 0; i < robot->names.measurements.size(); ++i) {
    std::printf("  measured   %-24s sd %s\n", robot->names.measurements[i].c_str(),
                number_text(c.measurement_sd[i]).c_str());
  }
  for (std::size_t i = 0; i < robot->names.inputs.size(); ++i) {
    std::printf("  input      %-24s %s .. %s, safe %s\n", robot->names.inputs[i].c_str(),
                number_text(c.safety.input_low[i]).c_str(), number_text(c.safety.input_high[i]).c_str(),
                number_text(c.safety.safe_command[i]).c_str());
  }
  for (std::uint32_t k = 0; k < c.safety.cone_count; ++k)
    std::printf("  cone       %s\n", cone_text(*robot, c.safety.cones[k]).c_str());
  const std::string planner = planner_names()[c.planner.kind];
  const bool samples = planner_reads(*find_key("planner", "rollouts"), planner);
  std::printf("  planner    %s, %u steps ahead (%.3g s), %s%u particles x %u iterations\n", planner.c_str(),
              c.planner.horizon, c.planner.horizon * c.period_s,
              samples ? format("%u rollouts x ", c.planner.rollouts).c_str() : "", c.planner.particles,
              c.planner.iterations);
  print_horizon(*robot);
  print_unread(*robot);
  print_cost(*robot);
  std::printf("  posterior  %s, %u particles%s\n", c.posterior.enabled ? "learning" : "frozen at the prior",
              c.posterior.particles, c.posterior.disturbance ? ", beside forces that the model lacks" : "");
  std::printf("  memory     %zu bytes\n", tiller_size(&c));
  print_tick(*robot);
  return kExitOk;
}

void print_model(const tiller_model_t& m) {
  const auto names = [](const char* const* list, std::uint32_t n) { return join(Words(list, list + n)); };
  Words joints;
  for (std::uint32_t i = 0; i < m.joint_count; ++i) joints.emplace_back(m.joints[i].name);
  std::printf("%s\n  states      %s\n  inputs      %s\n  parameters  %s\n  joints      %s\n", m.name,
              names(m.state_names, m.state_count).c_str(), names(m.input_names, m.input_count).c_str(),
              names(m.param_names, m.param_count).c_str(), join(joints).c_str());
}

int models_command() {
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i) print_model(*model);
  std::printf("\nA model of your own: [model] file = \"my_model.hpp\", type = \"MyModel\" (docs/guide/own_model.md)\n");
  return kExitOk;
}

/// The keys of [planner] that a planner reads, several to a line.
void print_settings(const std::string& planner) {
  std::string line;
  for (const KeySpec& key : robot_keys()) {
    if (std::string(key.section) != "planner" || std::string(key.key) == "kind" || !planner_reads(key, planner))
      continue;
    if (line.size() + std::string(key.key).size() > 96) {
      std::printf("  %s\n", line.c_str());
      line.clear();
    }
    line += (line.empty() ? "" : " ") + std::string(key.key);
  }
  std::printf("  %s\n", line.c_str());
}

int planners_command() {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    const std::string name = planner_names()[kind];
    std::printf("%-18s %s\n", name.c_str(), planner_help(kind));
    print_settings(name);
  }
  std::printf("\nSettings of [planner]: tiller help robot-file. When to use which: docs/theory/planners.md\n");
  return kExitOk;
}

int effects_command(bool markdown) {
  std::fputs((markdown ? effects_markdown() : effects_help()).c_str(), stdout);
  return kExitOk;
}

int help_command(CLI::App& app, const std::string& topic, bool markdown) {
  if (topic == "robot-file") {
    std::fputs((markdown ? robot_file_markdown() : robot_file_help()).c_str(), stdout);
    return kExitOk;
  }
  if (topic == "limits") {
    std::fputs((markdown ? limits_markdown() : limits_help()).c_str(), stdout);
    return kExitOk;
  }
  if (topic.empty()) {
    std::fputs(app.help().c_str(), stdout);
    return kExitOk;
  }
  Words known = {"robot-file", "limits"};
  for (const CLI::App* command : app.get_subcommands(nullptr)) {
    if (command->get_name() == topic) {
      std::fputs(command->help().c_str(), stdout);
      return kExitOk;
    }
    known.push_back(command->get_name());
  }
  const std::string near = nearest(topic, known);
  return complain("help: no topic '" + topic + "'; " + (near.empty() ? "" : "did you mean " + near + "? ") +
                  "known: " + join(known));
}

}  // namespace

void add_check_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("check", "read a robot file and say what it means, or what is wrong with it");
  auto path = std::make_shared<std::string>();
  command->add_option("ROBOT", *path, "robot file (.toml)")->required();
  command->footer(
      "Every error is told at once: file, line, key, value and remedy. A right file's controller then runs for a second or\n"
      "two on its own model, to tell what a tick takes on this computer against the period.\n\n"
      "Examples:\n"
      "  tiller check robots/cart_pole.toml\n"
      "      model, priors, sensors, planner, the bytes that the controller needs and the time of its tick\n"
      "  tiller check my_robot.toml && tiller run my_robot.toml --sim --seconds 5\n"
      "      only a right file goes on");
  command->callback([path, &exit_code] { exit_code = check_command(*path); });
}

void add_models_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("models", "the built-in models: states, inputs, parameters, joints");
  command->footer("Examples:\n  tiller models\n      all of them\n  tiller models | grep -A4 pendulum\n      one");
  command->callback([&exit_code] { exit_code = models_command(); });
}

void add_effects_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("effects", "physics that can be added to any model: friction, lag, delay, ...");
  command->footer(
      "Examples:\n  tiller effects\n      ports and parameters of each\n"
      "  tiller effects | grep friction\n      only these");
  auto markdown = std::make_shared<bool>(false);
  command->add_flag("--markdown", *markdown, "the tables of docs/reference/effects.md");
  command->callback([markdown, &exit_code] { exit_code = effects_command(*markdown); });
}

void add_planners_command(CLI::App& app, int& exit_code) {
  auto* command =
      app.add_subcommand("planners", "how commands can be planned, and the settings that each planner reads");
  command->footer(
      "Examples:\n  tiller planners\n      all of them\n"
      "  tiller run robots/cart_pole.toml --sim --planner cem\n      another than the robot file's");
  command->callback([&exit_code] { exit_code = planners_command(); });
}

void add_help_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("help", "help on a command, or on the robot file");
  auto topic = std::make_shared<std::string>();
  auto markdown = std::make_shared<bool>(false);
  command->add_option("TOPIC", *topic, "a command, robot-file, or limits");
  command->add_flag("--markdown", *markdown,
                    "robot-file or limits as the tables of docs/reference/robot_file.md and docs/reference/limits.md");
  command->footer(
      "Examples:\n  tiller help robot-file\n      every key with unit, range and default\n"
      "  tiller help limits\n      how many states, inputs, parameters, effects, particles, ... there may be\n"
      "  tiller help run\n      the same as tiller run --help");
  command->callback([&app, topic, markdown, &exit_code] { exit_code = help_command(app, *topic, *markdown); });
}

void add_version_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("version", "version and instruction set");
  command->footer(
      "Examples:\n  tiller version\n      \"tiller 0.2, avx512\"\n"
      "  tiller version | cut -d, -f1\n      the version alone");
  command->callback([&exit_code] {
    std::printf("%s\n", version_text().c_str());
    exit_code = kExitOk;
  });
}

}  // namespace tiller::tools
