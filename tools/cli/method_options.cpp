#include "tools/cli/method_options.hpp"

#include <algorithm>

#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"

namespace tiller::tools {
namespace {

/// An option and the methods that read it.
struct MethodOption {
  const char* option;
  Words readers;
};

const std::vector<MethodOption>& method_options() {
  static const std::vector<MethodOption> list = {
      {"--simulations",
       {"reps", "simopt", "trajectory_simopt", "abc", "abc_regression", "smc_abc", "mcmc_abc", "bayes_sim"}},
      {"--iterations", {"simopt", "trajectory_simopt", "bayes_sim"}},
      {"--kl", {"reps", "simopt", "trajectory_simopt"}},
      {"--eta", {"reps"}},
      {"--epsilon", {"abc", "abc_regression"}},
      {"--accept", {"abc", "abc_regression", "mcmc_abc"}},
      {"--rollout", {"trajectory_simopt"}},
      {"--discrepancy", {"simopt", "trajectory_simopt"}},
      {"--l1", {"simopt", "trajectory_simopt"}},
      {"--l2", {"simopt", "trajectory_simopt"}},
      {"--scale", {"simopt", "trajectory_simopt"}},
  };
  return list;
}

bool is_among(const std::string& name, const Words& names) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

std::string check_method(const std::string& name, const Words& known) {
  return is_among(name, known) ? "" : "there is no method '" + name + "'; known are " + join(known);
}

void add_abc_options(CLI::App& command, MethodOptions& how) {
  command.add_option("--epsilon", how.epsilon, "tolerance of abc (default: so that one in a hundred is kept)")
      ->check(number_between(1e-9, 1e9));
  command
      .add_option("--accept", how.accept,
                  "share that abc keeps where no --epsilon is given, and that sets mcmc_abc's tolerance (default 0.01)")
      ->check(number_between(1e-6, 1));
}

void add_discrepancy_options(CLI::App& command, MethodOptions& how) {
  command
      .add_option("--rollout", how.rollout_s, "seconds of trajectory_simopt's rollouts; 0: whole stretches (default 2)")
      ->check(number_between(0, 3600));
  command
      .add_option("--discrepancy", how.discrepancy,
                  "of simopt, trajectory_simopt: residual (default; errors step by step) or wasserstein (sliced "
                  "Wasserstein-1 distance of the distributions of steps)")
      ->check(CLI::IsMember({"residual", "wasserstein"}));
  command
      .add_option("--l1", how.weight_l1,
                  "weight of absolute errors in a residual discrepancy (default: simopt 0, trajectory_simopt 1)")
      ->check(number_between(0, 1e9));
  command.add_option("--l2", how.weight_l2, "weight of squared errors (default 1)")->check(number_between(0, 1e9));
  // by a function, which a flag that is not given does not call: left out, the method decides
  command.add_flag_function(
      "--scale,!--no-scale", [&how](std::int64_t times) { how.scale = times > 0; },
      "divide each channel by its RMS in the logs, so that radians and radians per second count alike "
      "(default: trajectory_simopt and wasserstein do, simopt takes SI units as they are)");
}

/// The option as it was given.
std::string given(const CLI::App& command, const std::string& name) {
  const std::string value = join(command.get_option(name)->results(), " ");
  if (name == "--scale") return value == "false" ? std::string("--no-scale") : name;
  return name + " " + value;
}

bool has(const CLI::App& command, const std::string& name) {
  return command.get_option_no_throw(name) != nullptr && command.count(name) > 0;
}

}  // namespace

void add_method_options(CLI::App& command, const MethodOptionsText& text, std::string& method, MethodOptions& how) {
  const Words known = text.methods;
  command.add_option("--method", method, text.what + ": " + join(known) + " (default " + known.front() + ")")
      ->check([known](const std::string& name) { return check_method(name, known); });
  command.add_option("--simulations", how.simulations, "parameter vectors tried in all (default 10000)")
      ->check(CLI::Range(100, 10000000));
  command.add_option("--iterations", how.iterations, "of simopt, trajectory_simopt " + text.iterations)
      ->check(CLI::Range(1, 1000));
  command.add_option("--kl", how.kl, "bound of reps, simopt, trajectory_simopt in an iteration " + text.kl)
      ->check(number_between(1e-6, 100));
  command
      .add_option("--eta", how.eta,
                  "temperature of reps, in the place of --kl: weights ~ prior x exp(log likelihood / eta). 1 is the "
                  "Bayesian posterior for the robot file's noise; 2 trusts the logs half as much")
      ->check(number_between(1e-6, 1e9));
  if (is_among("abc", known)) add_abc_options(command, how);
  add_discrepancy_options(command, how);
}

std::string misplaced_option(const CLI::App& command, const Words& methods, const std::string& method,
                             const MethodOptions& how) {
  for (const MethodOption& option : method_options()) {
    if (!has(command, option.option) || is_among(method, option.readers)) continue;
    Words readers;
    for (const std::string& reader : option.readers)
      if (is_among(reader, methods)) readers.push_back(reader);
    return given(command, option.option) + ": the method " + method +
           " does not read it; leave it out, or choose --method " + join(readers, " or ");
  }
  if (has(command, "--eta") && has(command, "--kl"))
    return given(command, "--eta") + ", " + given(command, "--kl") +
           ": both set the temperature of reps; --eta fixes it, --kl bounds how far the weights may go; give one";
  for (const char* weight : {"--l1", "--l2"})
    if (has(command, weight) && how.discrepancy == "wasserstein")
      return given(command, weight) + ": --discrepancy wasserstein has no such norm; leave it out, or choose residual";
  return "";
}

}  // namespace tiller::tools
