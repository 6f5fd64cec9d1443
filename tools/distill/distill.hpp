#pragma once

#include <csignal>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/distill/pupil.hpp"

namespace tiller::tools::distill {

struct DistillOptions {
  std::string teacher;  ///< planner's name; empty: the robot file's
  std::vector<int> hidden = {32, 32};
  std::uint32_t reads = 0;  ///< tiller_policy_input_t, added up; 0: default_reads()
  std::uint32_t iterations =
      6;  ///< rounds of lessons: the first under the teacher, the others more and more the pupil's
  std::uint32_t episodes = 40;    ///< of a round
  double seconds = 5;             ///< robot time of each
  std::uint32_t validation = 16;  ///< undisturbed episodes after each round, which choose the round that is kept
  std::uint32_t test = 12;        ///< whole controllers on held-out draws in the end; 0: none
  std::uint64_t seed = 1;
  unsigned threads = 1;                              ///< episodes side by side; the results are the same bits
  std::function<void(const std::string&)> progress;  ///< a line a round, and of each test; may be empty
};

/// A round of lessons.
struct Round {
  std::size_t samples = 0;  ///< all so far
  StudyError error;
  double cost_ratio = 0;  ///< the pupil's mean cost over the teacher's, in the validation episodes
};

/// One held-out draw, both controllers on the same plant.
struct HeldOut {
  std::uint64_t seed = 0;
  double teacher_cost = 0, policy_cost = 0;        ///< mean stage cost a tick
  bool teacher_safe = false, policy_safe = false;  ///< latched SAFE
};

struct Distilled {
  std::vector<Round> rounds;
  std::size_t best = 0;  ///< of the rounds
  StoredPolicy policy;
  std::vector<HeldOut> tests;
  bool interrupted = false;
};

/// What a policy of this robot reads where nobody says: state, and mean and spread of what is not known; where the cost
/// has a reference, the difference from it.
std::uint32_t default_reads(const RobotFile& robot);

/// `robot` with this planner. False with a sentence in `error`: no such planner, or none that teaches.
bool with_teacher(const RobotFile& robot, const std::string& teacher, RobotFile& out, std::string& error);
/// `robot` under the policy, without a fallback. The policy is the robot's own.
bool with_policy(const RobotFile& robot, const StoredPolicy& policy, RobotFile& out, std::string& error);

/// DAgger on the robot's model over draws of its hidden parameters. Same options, same bits, whatever the threads.
/// False with a sentence in `error`. Cost: iterations x episodes x seconds / period plans of the teacher, and the fits.
bool distill(const RobotFile& robot, const DistillOptions& options, const volatile std::sig_atomic_t& stop,
             Distilled& result, std::string& error);

/// `robot` on a plant whose hidden parameters (and effects that have a prior) are drawn by `seed`.
RobotFile held_out_draw(const RobotFile& robot, std::uint64_t seed);
/// Whole controllers, posterior and all, in lockstep with the plant of [sim] (without one: the model) for `seconds`.
bool play_held_out(const RobotFile& teacher, const RobotFile& policy, std::uint64_t seed, double seconds,
                   const volatile std::sig_atomic_t& stop, HeldOut& result, std::string& error);

/// Sum of the policy's costs over the teacher's.
double cost_ratio(const std::vector<HeldOut>& tests);

/// The table that the command prints, and everything for the page (docs/guide/distill.md has the keys).
std::string distill_text(const Distilled& result);
std::string distill_json(const RobotFile& robot, const DistillOptions& options, const Distilled& result);

/// The robot file's text with [planner] kind = "policy", fallback = the teacher and [policy] file = `file`; what is not
/// about that stays as it is, comments too. False with a sentence in `error`.
bool policy_robot_text(const std::string& text, const std::string& teacher, const std::string& file, std::string& out,
                       std::string& error);

}  // namespace tiller::tools::distill
