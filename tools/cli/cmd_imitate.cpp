#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "planners/planner.hpp"
#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/command/commands.hpp"
#include "tools/distill/distill.hpp"
#include "tools/imitate/imitate_policy.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

struct ImitateArguments {
  imitate::ImitateOptions options;
  std::string out, page, horizon;
};

bool read_horizon(ImitateArguments& a) {
  if (a.horizon.empty()) return true;
  if (a.horizon == "whole") {
    a.options.horizon = 0;
    return true;
  }
  char* end = nullptr;
  const long periods = std::strtol(a.horizon.c_str(), &end, 10);
  a.options.horizon = periods;
  if (*end == '\0' && periods >= 2 && periods <= 2000) return true;
  complain("--horizon " + a.horizon + ": is neither \"whole\" nor a number of periods in 2 .. 2000");
  return false;
}

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream stream;
  stream << file.rdbuf();
  return stream.str();
}

/// The new file is read back from where it is going to stand: what it names lies beside the old one.
bool write_robot(const ImitateArguments& a, const std::string& text) {
  std::string error, errors;
  if (!parse_robot_file(text, a.out, errors)) {
    complain(a.out + ": the learnt file names files relative to the robot file; write it beside it with -o\n" + errors);
    return false;
  }
  if (!replace_file(a.out, text, error)) {
    complain(error);
    return false;
  }
  std::printf("\nrobot file: %s\n  next: tiller run %s --sim\n", fs::absolute(a.out).c_str(), a.out.c_str());
  return true;
}

/// The policy beside the robot file that is to name it.
bool write_policy(const ImitateArguments& a, const RobotFile& robot, imitate::Imitated& result) {
  const fs::path out = a.out, path = out.parent_path() / (out.stem().string() + "_policy.json");
  const std::string planner = find_planner(robot.config.planner.kind)->name, old = result.text;
  std::string error;
  if (!distill::policy_robot_text(old, planner, path.filename().string(), result.text, error) ||
      !save_policy(path.string(), result.policy.stored, error)) {
    complain(error);
    return false;
  }
  std::printf("\npolicy: %s, %zu weights\n", fs::absolute(path).c_str(), result.policy.stored.network.weights.size());
  return true;
}

/// The JSON lies beside the page, under its name.
int write_page(const ImitateArguments& a, const std::string& json) {
  const fs::path given = a.page, page = given.extension() == ".html" ? given : given / "imitate.html";
  const fs::path data = fs::path(page).replace_extension(".json");
  std::string error;
  if (!replace_file(data.string(), json, error) || !draw_page("imitate_report", data.string(), page.string(), error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  std::printf("result: %s\nreport: %s\n", fs::absolute(data).c_str(), fs::absolute(page).c_str());
  return kExitOk;
}

int imitate_command(ImitateArguments& a) {
  const auto robot = read_robot_or_complain(a.options.robot);
  if (!robot || !read_horizon(a)) return kExitBadInput;
  std::string error;
  std::error_code code;
  if (!a.out.empty() && fs::equivalent(a.out, a.options.robot, code))
    return complain("-o " + a.out + ": is the robot file itself; name another");
  imitate::Imitated result;
  const bool good = imitate::imitate(*robot, text_of(a.options.robot), a.options, result, error);
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (!good) return complain(error);
  std::fputs(imitate::imitate_text(*robot, a.options, result).c_str(), stdout);
  const bool acts = imitate::learns_policy(a.options.method);
  if (!a.out.empty() && acts && !write_policy(a, *robot, result)) return kExitLogIncomplete;
  if (!a.out.empty() && !write_robot(a, result.text)) return kExitLogIncomplete;
  return a.page.empty() ? static_cast<int>(kExitOk) : write_page(a, imitate::imitate_json(*robot, a.options, result));
}

}  // namespace

void add_imitate_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("imitate", "learn the weights of the cost from demonstrations");
  auto a = std::make_shared<ImitateArguments>();
  imitate::ImitateOptions& o = a->options;
  command->add_option("ROBOT", o.robot, "robot file (.toml): model, parameters, sensors, and a [cost] to begin with")
      ->required();
  command->add_option("LOGS", o.logs, "demonstrations: CSV, or what tiller run --record and lcm-logger write")
      ->required();
  command->add_option("-o,--out", a->out,
                      "robot file with the learnt weights; of a policy: with [policy], and OUT_policy.json");
  command->add_option("--page", a->page, "an HTML page, and its JSON beside it; a folder: imitate.html in it");
  command
      ->add_option("--method", o.method,
                   "maxent (default), matching: weights of the cost; adversarial (GAIL), wasserstein: a network that "
                   "acts (docs/theory/imitation.md)")
      ->check(CLI::IsMember({"maxent", "matching", "adversarial", "wasserstein"}));
  command->add_option("--keep", o.keep, "weights that stay as they are: cost.state_weight.angle_rad")
      ->allow_extra_args(false);
  command->add_option("--target", o.targets, "maxent: a state whose target is learnt with the weights: angle_rad")
      ->allow_extra_args(false);
  command->add_option("--scale", o.reference,
                      "the weight that stays, for the scale: demonstrations tell ratios alone (default: the first "
                      "input's)");
  command->add_option("--horizon", a->horizon,
                      "periods that the demonstrator looked ahead (default: the planner's), or \"whole\": each "
                      "demonstration is one plan to its end; of a policy: periods of a rollout (default 60)");
  command->add_option("--every", o.every, "with a horizon: judge each n-th input (default: about 400 in all)")
      ->check(CLI::Range(1, 100000));
  command->add_option("--rounds", o.rounds, "of matching: plans of every demonstration (default 40)")
      ->check(CLI::Range(1, 100000));
  command->add_option("--iterations", o.iterations, "of a policy: rollouts, critic and policy in turn (default 400)")
      ->check(CLI::Range(1, 100000));
  command->add_option("--seed", o.seed, "of a policy: its first weights, rollouts and draws (default 1)")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 40));
  command->footer(
      "Every weight of [cost] above 0 that stands in the file as a number is learnt, but for the first input's. Weights\n"
      "come with intervals; one that the demonstrations do not tell is named and stays near the file's.\n"
      "A policy imitates without a cost: a critic learns to tell its rollouts on the model from the demonstrations, and\n"
      "the policy to be mistaken for them. Its robot file plans as before wherever the policy was shown nothing.\n\n"
      "Examples:\n"
      "  tiller imitate my_robot.toml demos/*.csv -o my_robot_imitated.toml --page out/imitate.html\n"
      "      weights that explain what was done, and a page with what they do from the same starts\n"
      "  tiller imitate my_robot.toml reach1.csv reach2.csv --horizon whole --keep cost.bounds.angle_rad.weight\n"
      "      motions that were planned from start to end; the price of the joint's ends stays\n"
      "  tiller imitate my_robot.toml demos/*.csv --method wasserstein -o my_robot_acts.toml --page out/acts.html\n"
      "      a network of 24 x 24 in my_robot_acts_policy.json, which tiller run my_robot_acts.toml --sim follows");
  command->callback([a, &exit_code] { exit_code = imitate_command(*a); });
}

}  // namespace tiller::tools
