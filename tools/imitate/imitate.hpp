#pragma once

#include <string>
#include <vector>

#include "tools/imitate/demonstration.hpp"
#include "tools/imitate/matching.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools::imitate {

/// What `tiller imitate` is asked to do.
struct ImitateOptions {
  std::string robot;
  std::vector<std::string> logs;
  std::string method = "maxent";     ///< maxent, matching: weights; adversarial, wasserstein: a policy
  std::vector<std::string> keep;     ///< paths of weights that stay as they are
  std::vector<std::string> targets;  ///< states whose targets are learnt too, by maxent
  std::string reference;             ///< path of the input weight that fixes the scale; empty: the first one
  std::int64_t horizon = -1;         ///< periods; 0: each demonstration is one plan to its end; -1: the planner's, and
                                     ///< 60 of a policy's rollouts
  std::uint32_t every = 0;           ///< periods between judged inputs of a receding horizon; 0: chosen by the length
  int rounds = 40;                   ///< of matching
  int iterations = 400;              ///< of a policy
  std::uint64_t seed = 1;            ///< of a policy's weights, rollouts and draws
};

/// What the adversarial methods learn.
struct ImitatedPolicy {
  StoredPolicy stored;      ///< as a robot file's [policy] takes it, watched within what it was shown and does
  std::vector<double> gap;  ///< by iteration: the critic's mean over the demonstrations less that over rollouts
};

/// A demonstration beside what a cost, or a policy, makes of it.
struct Replayed {
  const Demonstration* demonstration = nullptr;
  Motion before, after;                  ///< by the robot file's weights (of a policy: by cloning), by what is learnt
  double cost_demonstrated = 0;          ///< of the demonstration under the learnt cost
  double cost_after = 0;                 ///< of `after` under the learnt cost
  double rms_before = 0, rms_after = 0;  ///< of the states' distance, each over its spread in the demonstrations
};

struct Imitated {
  std::vector<Demonstration> demonstrations;
  std::vector<CostTerm> kept;
  MaxentFit fit;         ///< by matching: its weights alone, without intervals
  MatchingFit matching;  ///< by matching
  ImitatedPolicy policy;
  std::uint32_t horizon = 0, every = 1;
  std::vector<Replayed> replayed;
  std::vector<std::string> warnings;
  std::string text;  ///< the robot file with the learnt weights and targets; of a policy as it was
};

/// Reads, learns and replays. `text` is the robot file's. False with every reason in `error`.
bool imitate(const RobotFile& robot, const std::string& text, const ImitateOptions& options, Imitated& result,
             std::string& error);

/// The configuration with the learnt weights and targets.
CostEdit learnt_cost(const RobotFile& robot, const MaxentFit& fit);

/// The tables that the command prints.
std::string imitate_text(const RobotFile& robot, const ImitateOptions& options, const Imitated& result);
/// Everything, for programs and for the page: see docs/guide/imitate.md for the keys.
std::string imitate_json(const RobotFile& robot, const ImitateOptions& options, const Imitated& result);

}  // namespace tiller::tools::imitate
