#pragma once

// The rows of Online BayesSim's Table I as tasks with exact posteriors, contact among them; the hopper's friction is
// left out.

#include <vector>

#include "harness/accuracy/measured_task.hpp"

namespace tiller::bench {

/// A task, and what moves it.
struct PaperTask {
  AccuracyTask task;
  /// The inputs of a seed's episode; empty: the task's own excitation.
  std::function<CommandSource(std::uint64_t seed)> commands;
  Episode episode(double sigma, std::uint32_t ticks, std::uint64_t seed) const;
};

/// A puck on a table, hit every second and left to slide to rest: a linear axis with dry friction, mass known. The
/// friction's force is learnt, uniform on [1, 9] N for 1 kg: a coefficient of 0.1 to 0.9.
PaperTask slide_friction();

/// A finger that goes to and fro along the face of a box while it pushes it (the quasi-static pusher_slider): whether
/// it sticks or slides there tells of its friction, uniform on [0.1, 0.9]. What the ground does is known: in a
/// quasi-static push it acts through the limit surface alone.
PaperTask push_friction();

/// Those of accuracy_tasks(), then push and slide friction.
std::vector<PaperTask> paper_tasks();

}  // namespace tiller::bench
