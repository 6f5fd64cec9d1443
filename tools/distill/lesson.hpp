#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/distill/belief_story.hpp"
#include "tools/distill/lone_planner.hpp"

namespace tiller::tools::distill {

/// What a policy is shown, and what its teacher does there; a column a sample.
struct Examples {
  std::vector<double> in;         // (samples x inputs)
  std::vector<double> share;      // (samples x nu) the teacher's command: -1 lower limit, 1 upper
  std::vector<std::uint32_t> of;  // (samples) number of the episode
  std::size_t count() const { return of.size(); }
  void append(const Examples& more);
};

struct LessonOptions {
  std::uint64_t seed = 1;    ///< of hidden parameters, start, noise and pushes
  std::uint32_t number = 0;  ///< kept with each sample
  double seconds = 5;        ///< of robot time
  std::uint32_t reads = tiller_policy_state;
  double teacher_share = 1;   ///< of the time in which the teacher drives, half a second at a time; the rest: the pupil
  double pushes_per_s = 0.5;  ///< stretches of a tenth of a second under a random command; 0: an undisturbed episode
  std::uint32_t nearby = 2;   ///< further samples around each one, answered by the teacher's feedback where it has any
};

/// An episode's end.
struct LessonResult {
  Examples examples;
  double cost = 0;    ///< mean stage cost of the ticks at the true state; those after a loss cost what the last one did
  bool lost = false;  ///< it ended early: the state was no longer finite, or left what its sensors can read
};

/// One episode on the model itself with hidden parameters of its own, in closed loop: the teacher says at each tick
/// what it would do (DAgger: Ross, Gordon and Bagnell, AISTATS 2011), whoever drives. `pupil` may be null where
/// teacher_share is 1; `teacher` may be null where it is 0, and nothing is then recorded. Both are reset. Same seed,
/// same bits. Cost: a
/// teacher's plan a tick.
LessonResult give_lesson(const tiller_config_t& config, const PriorMoments& prior, LonePlanner* teacher,
                         LonePlanner* pupil, const LessonOptions& options);

}  // namespace tiller::tools::distill
