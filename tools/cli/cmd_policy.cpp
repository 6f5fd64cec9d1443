#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/stop_flag.hpp"
#include "tools/command/commands.hpp"
#include "tools/local_models/guided.hpp"
#include "tools/policy_search/policy_file.hpp"
#include "tools/policy_search/reps_search.hpp"
#include "tools/policy_search/search_json.hpp"
#include "tools/policy_search/search_task.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
using policy::Matrix;
using policy::Vector;

struct PolicyArguments {
  std::string robot, out, page, method = "pilco";
  policy::TaskOptions task;
  policy::SearchOptions search;
  int conditions = 4, iterations = 8;
  double epsilon = 0.5;
  bool quiet = false;
};

void name_policy(const RobotFile& robot, const PolicyArguments& a, policy::Policy& p) {
  p.states = robot.states;
  p.commands = robot.inputs;
  p.period_s = a.task.period_s;
}

policy::TrialOptions trial_options(const RobotFile& robot, const PolicyArguments& a, const policy::SearchTask& task) {
  policy::TrialOptions options;
  options.period_s = a.task.period_s;
  options.horizon = task.horizon;
  options.noise_sd = policy::measured_deviation(robot, a.task.period_s);
  options.start_mean = task.start_mean;
  options.start_covariance = task.start_covariance;
  options.seed = a.search.seed;
  return options;
}

bool write_policy(const PolicyArguments& a, const policy::SearchTask& task, const policy::Policy& p) {
  std::string error;
  if (!replace_file(a.out, policy::policy_text(p, task.angles), error)) {
    complain(error);
    return false;
  }
  std::printf("policy: %s\n", fs::absolute(a.out).c_str());
  return true;
}

/// The page and, beside it, the numbers that it is drawn from.
bool write_page(const PolicyArguments& a, const policy::SearchTask& task, const policy::SearchResult& result) {
  if (a.page.empty()) return true;
  // a name of its own: the policy may lie beside the page, under the same one
  const fs::path page = a.page;
  const std::string json = (page.parent_path() / (page.stem().string() + "_search.json")).string();
  std::string error;
  if (!can_write_file(json, error) ||
      !replace_file(json, policy::search_text(task, result, a.robot, a.method), error) ||
      !draw_page("policy_report", json, a.page, error)) {
    complain(error);
    return false;
  }
  std::printf("page: %s\n", fs::absolute(a.page).c_str());
  return true;
}

int search(const PolicyArguments& a, const RobotFile& robot, const policy::SearchTask& task) {
  const StopFlag stop;
  const auto after = [&](const policy::SearchStep& step, int index) {
    if (a.quiet) return;
    if (std::isnan(step.predicted))
      std::fprintf(stderr, "trial %d: random commands, cost %.3f of %d\n", index + 1, step.cost, task.horizon);
    else
      std::fprintf(stderr, "trial %d: cost %.3f of %d (expected %.3f), %.1f s of search\n", index + 1, step.cost,
                   task.horizon, step.predicted, step.seconds);
  };
  policy::SearchResult result;
  std::string error;
  const policy::RunTrial run = policy::trials_on_plant(robot, trial_options(robot, a, task));
  const bool good = a.method == "pilco" ? policy::pilco(task, run, a.search, after, stop.flag(), result, error)
                                        : policy::reps_search(task, run, a.search, policy::RepsOptions(), after,
                                                              stop.flag(), result, error);
  if (!good) return complain(error);
  if (result.steps.size() <= static_cast<std::size_t>(a.search.random_trials)) return kExitInterrupted;
  name_policy(robot, a, result.policy);
  if (!write_policy(a, task, result.policy) || !write_page(a, task, result)) return kExitLogIncomplete;
  return result.interrupted ? kExitInterrupted : kExitOk;
}

local::GuidedOptions guided_options(const RobotFile& robot, const PolicyArguments& a) {
  const tiller_cost_config_t& cost = robot.config.cost;
  const auto nx = static_cast<Eigen::Index>(robot.states.size()), nu = static_cast<Eigen::Index>(robot.inputs.size());
  local::GuidedOptions options;
  options.iterations = a.iterations;
  options.epsilon = a.epsilon;
  options.seed = a.search.seed;
  options.target = Eigen::Map<const Vector>(cost.target, nx);
  options.state_weight = Eigen::Map<const Vector>(cost.state_weight, nx).asDiagonal();
  options.terminal_weight = Eigen::Map<const Vector>(cost.terminal_weight, nx).asDiagonal();
  options.input_weight = Eigen::Map<const Vector>(cost.input_weight, nu).cwiseMax(1e-6).asDiagonal();
  return options;
}

int guide(const PolicyArguments& a, const RobotFile& robot, policy::SearchTask& task) {
  task.physics = policy::physics_of(robot, a.task.period_s);
  std::vector<local::Condition> conditions;
  for (int c = 0; c < a.conditions; ++c) {
    policy::TrialOptions options = trial_options(robot, a, task);
    // quantiles of the start along its diagonal: the same spread for any number of conditions
    const double share = a.conditions > 1 ? 2.0 * c / (a.conditions - 1) - 1.0 : 0.0;
    options.start_mean = task.start_mean + 1.5 * share * task.start_covariance.diagonal().cwiseSqrt();
    options.start_covariance *= 0.01;
    options.seed = a.search.seed + 100 * static_cast<std::uint64_t>(c);
    conditions.push_back({options.start_mean, policy::trials_on_plant(robot, options)});
  }
  const StopFlag stop;
  const auto after = [&](const local::GuidedStep& step, int index) {
    if (!a.quiet)
      std::fprintf(stderr, "iteration %d: cost %.4g by the local laws, %.4g by the network; divergence %.2g a step\n",
                   index + 1, step.local_cost, step.policy_cost, step.divergence);
  };
  local::GuidedResult result;
  std::string error;
  if (!local::guided_search(task, conditions, guided_options(robot, a), after, stop.flag(), result, error))
    return complain(error);
  if (result.steps.empty()) return kExitInterrupted;
  name_policy(robot, a, result.policy);
  if (!write_policy(a, task, result.policy)) return kExitLogIncomplete;
  return result.interrupted ? kExitInterrupted : kExitOk;
}

bool costs_outputs(const RobotFile& robot) {
  const tiller_cost_config_t& cost = robot.config.cost;
  return cost.outputs && std::any_of(cost.outputs, cost.outputs + cost.output_count,
                                     [](const tiller_output_cost_t& o) { return o.weight > 0; });
}

int policy_command(PolicyArguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  if (robot->sim.line == 0) return complain(a.robot + ": has no [sim] section; trials need a simulated plant");
  if (a.method == "guided" && costs_outputs(*robot))
    return complain(a.robot +
                    ": cost.outputs: guided knows costs of states alone; take them out of a copy of the "
                    "file, with state_weight in their place");
  policy::SearchTask task;
  std::string error;
  if (!policy::make_task(*robot, a.task, task, error)) return complain(error);
  if (a.out.empty()) {
    const fs::path path = a.robot;
    a.out = (path.parent_path() / (path.stem().string() + "_policy.json")).string();
  }
  if (!can_write_file(a.out, error)) return complain("-o " + error + "; name a file that can be written");
  return a.method == "guided" ? guide(a, *robot, task) : search(a, *robot, task);
}

}  // namespace

void add_policy_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("policy", "search a feedback policy in few trials on the simulated plant");
  auto a = std::make_shared<PolicyArguments>();
  command->add_option("ROBOT", a->robot, "robot file (.toml) with a [sim] section")->required();
  command
      ->add_option("--method", a->method,
                   "pilco: gradients of the expected cost on a Gaussian process; reps: samples on the same process; "
                   "guided: local laws that teach a network, priors from the file's model (default pilco)")
      ->check(CLI::IsMember({"pilco", "reps", "guided"}));
  command->add_option("--trials", a->search.trials, "trials with a policy, after a random one (default 8)")
      ->check(CLI::Range(1, 1000));
  command->add_option("--seconds", a->task.seconds, "robot time of each trial (default 4)")
      ->check(number_between(0.1, 600));
  command->add_option("--period", a->task.period_s, "seconds between the policy's commands (default 0.1)")
      ->check(number_between(0.001, 10));
  command->add_option("--kind", a->search.kind, "pilco, reps: rbf or linear (default rbf)")
      ->check(CLI::IsMember({"rbf", "linear"}));
  command->add_option("--bumps", a->search.bumps, "basis functions of rbf (default 20)")->check(CLI::Range(1, 500));
  command->add_option("--evaluations", a->search.evaluations, "pilco: costs and gradients before a trial (default 100)")
      ->check(CLI::Range(1, 100000));
  a->search.restarts = 1;
  command
      ->add_option("--restarts", a->search.restarts,
                   "pilco: searches from fresh policies before a trial, as long as most of the cost is expected "
                   "(default 1)")
      ->check(CLI::Range(0, 100));
  command
      ->add_option("--width", a->task.width,
                   "pilco, reps: deviation at which the cost saturates, times the root of a weight (default: a "
                   "quarter of the start's)")
      ->check(number_between(1e-6, 1e6));
  command->add_flag("--physics", a->task.physics, "pilco, reps: learn only what the file's model leaves unexplained");
  command->add_option("--conditions", a->conditions, "guided: starts (default 4)")->check(CLI::Range(1, 100));
  command->add_option("--iterations", a->iterations, "guided: rounds of 5 trials a start (default 8)")
      ->check(CLI::Range(1, 1000));
  command
      ->add_option(
          "--epsilon", a->epsilon,
          "guided: largest mean KL divergence of a round's control laws from the network, nats per period (default 0.5)")
      ->check(number_between(1e-3, 1e3));
  command->add_option("--seed", a->search.seed, "of commands, noise, starts and first policy (default 1)")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1} << 40));
  command->add_option("-o,--out", a->out, "the policy (default: ROBOT_policy.json beside the robot file)");
  command->add_option("--page", a->page, "pilco, reps: an HTML page of the trials");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Trials run the plant of [sim] from [start]; every state is measured with the sensors' noise. The task is [cost]'s\n"
      "target and state weights within [limits] (docs/guide/policy.md).\n\n"
      "Examples:\n"
      "  tiller policy robots/pendulum.toml --trials 6 -o out/policy.json --page out/policy.html\n"
      "      a swing-up from nothing but trials\n"
      "  tiller policy robots/emps.toml --method guided --seconds 2 --period 0.05 -o out/axis_policy.json\n"
      "      a network, taught by local laws; its cost is on states alone, since those know no outputs");
  command->callback([a, &exit_code] { exit_code = policy_command(*a); });
}

}  // namespace tiller::tools
