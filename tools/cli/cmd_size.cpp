// size: what a controller takes of a small computer.

#include <cstdio>
#include <nlohmann/json.hpp>

#include "abi/controller.hpp"
#include "executive/part_sizes.hpp"
#include "tools/command/commands.hpp"
#include "tools/doctor/stack_use.hpp"
#include "tools/doctor/work_count.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kTicks = 50;

struct Report {
  PartSizes parts;
  std::size_t total = 0;
  StackUse stack;
  ModelWork mean, most;
  double instructions = 0.0, most_instructions = 0.0;
  std::string stand_in;  // whose steps were measured, where the model's own were not
};

/// The layout of tiller_size, with a listener.
void measure_parts(const tiller_config_t& config, Report& report) {
  Arena arena;
  (void)arena.take<tiller_controller>(1);
  (void)Executive::lay_out(arena, config, nullptr, &report.parts);
  report.total = tiller_size(&config);
}

void print_table(const RobotFile& robot, const Report& r) {
  std::printf("%s: %s, %s, %u particles\n\n", robot.path.c_str(), robot.config.model->name,
              planner_names()[robot.config.planner.kind].c_str(), robot.config.posterior.particles);
  std::printf("  RAM, one block                bytes  share\n");
  for (std::uint32_t i = 0; i < r.parts.count; ++i)
    if (r.parts.part[i].bytes > 0)
      std::printf("    %-20s  %11zu  %4.1f %%\n", r.parts.part[i].name, r.parts.part[i].bytes,
                  100.0 * static_cast<double>(r.parts.part[i].bytes) / static_cast<double>(r.total));
  std::printf("    %-20s  %11zu\n", "together", r.total);
  const auto row = [](const char* what, std::uint64_t mean, std::uint64_t most) {
    if (most > 0)
      std::printf("    %-20s  %11llu  %11llu\n", what, static_cast<unsigned long long>(mean),
                  static_cast<unsigned long long>(most));
  };
  std::printf("\n  stack of the calling thread, measured here\n");
  std::printf("    %-20s  %11zu\n", "tiller_init", r.stack.init_bytes);
  std::printf("    %-20s  %11zu\n", "tiller_tick", r.stack.tick_bytes);
  if (const StackBound bound = stack_bound(robot.config); bound.tick_bytes > 0) {
    std::printf("\n  stack on a Cortex-M7, a bound for up to 12 states\n");
    std::printf("    %-20s  %11zu\n", "tiller_init", bound.init_bytes);
    std::printf("    %-20s  %11zu\n", "tiller_tick", bound.tick_bytes);
  }
  std::printf("\n  model steps per tick           mean         most\n");
  row("samples (f32)", r.mean.rollout_f32, r.most.rollout_f32);
  row("predictions (f64)", r.mean.rollout_f64, r.most.rollout_f64);
  row("filters (f64, d/dx)", r.mean.linearise, r.most.linearise);
  row("residuals (f32)", r.mean.residual, r.most.residual);
  row("plan (f64, d/dx)", r.mean.path_linearise, r.most.path_linearise);
  row("line search (f64)", r.mean.path_feedback, r.most.path_feedback);
  std::printf("\n  instructions per tick on a Cortex-M7, about %.1f million, at most %.1f\n", 1e-6 * r.instructions,
              1e-6 * r.most_instructions);
  std::printf("  at %.4g s a tick: %.0f million instructions a second\n", robot.config.period_s,
              1e-6 * r.instructions / robot.config.period_s);
  if (!r.stand_in.empty())
    std::printf(
        "  (%s was not measured there: its steps count as those of %s,"
        " too few for a model with more joints)\n",
        robot.config.model->name, r.stand_in.c_str());
}

nlohmann::json work_json(const ModelWork& w) {
  return {{"rollout_f32", w.rollout_f32}, {"rollout_f64", w.rollout_f64},       {"linearise", w.linearise},
          {"residual", w.residual},       {"path_linearise", w.path_linearise}, {"path_feedback", w.path_feedback}};
}

void print_json(const RobotFile& robot, const Report& r) {
  nlohmann::ordered_json out;
  out["robot"] = robot.name;
  out["model"] = robot.config.model->name;
  out["block_bytes"] = r.total;
  for (std::uint32_t i = 0; i < r.parts.count; ++i) out["parts"][r.parts.part[i].name] = r.parts.part[i].bytes;
  out["stack_bytes"] = {{"init", r.stack.init_bytes}, {"tick", r.stack.tick_bytes}};
  if (const StackBound bound = stack_bound(robot.config); bound.tick_bytes > 0)
    out["cortex_m7_stack_bound_bytes"] = {{"init", bound.init_bytes}, {"tick", bound.tick_bytes}};
  out["model_steps_per_tick"] = {{"mean", work_json(r.mean)}, {"most", work_json(r.most)}};
  out["cortex_m7_instructions_per_tick"] = {{"mean", r.instructions}, {"most", r.most_instructions}};
  out["measured_on"] = r.stand_in.empty() ? std::string(robot.config.model->name) : r.stand_in;
  std::printf("%s\n", out.dump(2).c_str());
}

int size_command(const std::string& path, const Overrides& overrides, bool json) {
  const auto robot = read_robot_or_complain(path);
  if (!robot || !apply_overrides(overrides, *robot)) return kExitBadInput;
  const char* field = nullptr;
  const tiller_status_t status = tiller_config_check(&robot->config, &field);
  if (status != tiller_status_ok) return complain(path + ": " + field + ": " + tiller_status_text(status));
  Report report;
  measure_parts(robot->config, report);
  std::string error;
  if (!count_work(robot->config, kTicks, report.mean, report.most, error) ||
      !measure_stack(robot->config, kTicks, report.stack, error))
    return complain(path + ": " + error);
  report.instructions = kBesideSteps * report.mean.instructions(robot->config, report.stand_in);
  report.most_instructions = kBesideSteps * report.most.instructions(robot->config, report.stand_in);
  if (json)
    print_json(*robot, report);
  else
    print_table(*robot, report);
  return kExitOk;
}

}  // namespace

void add_size_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("size", "what a robot file's controller takes: RAM by part, stack, work per tick");
  auto path = std::make_shared<std::string>();
  auto overrides = std::make_shared<Overrides>();
  auto json = std::make_shared<bool>(false);
  command->add_option("ROBOT", *path, "robot file (.toml)")->required();
  command->add_flag("--json", *json, "as JSON");
  add_override_options(*command, *overrides);
  command->footer(
      "RAM is exact for this machine; where pointers have 32 bits it is a little less. Stack is measured here, with\n"
      "the lanes that this processor has: the deepest call that ran. Of models that an image of the project's tests\n"
      "has, a bound by the calls of that image stands beside it. The model's steps are counted while the controller\n"
      "runs on its own model; what a step costs was measured on a Cortex-M7 (docs/guide/targets.md).\n\n"
      "Examples:\n"
      "  tiller size robots/pendulum.toml\n"
      "      a table\n"
      "  tiller size robots/pendulum.toml --planner ilqr --json | jq .block_bytes\n"
      "      one figure of another planner");
  command->callback([path, overrides, json, &exit_code] { exit_code = size_command(*path, *overrides, *json); });
}

}  // namespace tiller::tools
