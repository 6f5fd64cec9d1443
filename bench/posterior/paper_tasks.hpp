#pragma once

// The rows of Online BayesSim's Table I, contact among them, as tasks with exact posteriors.

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

/// A finger that goes to and fro along the face of a box while it pushes it (the quasi-static pusher_slider): whether it
/// sticks or slides there tells of its friction, uniform on [0.1, 0.9]. What the ground does is known: in a quasi-static
/// push it acts through the limit surface alone.
PaperTask push_friction();

/// A hopper under a planner that knows the centres of the priors, with torques at the hip that make its foot slip. Of
/// the robot file robots/hopper.toml; ground friction uniform on [0.2, 0.8], the rest known.
PaperTask hopper_friction();

/// The same with body mass, leg stiffness and ground friction unknown, within the robot file's priors.
PaperTask hopper_three();

/// Mean stage cost of `ticks` periods of the true hopper under the planner with `params`, no noise.
double hopping_cost(const PaperTask& hopper, const std::vector<double>& truth, const std::vector<double>& params,
                    std::uint32_t ticks, std::uint64_t seed);

/// Every row: those of accuracy_tasks(), then hopper, push and slide friction.
std::vector<PaperTask> paper_tasks();

}  // namespace tiller::bench
