#pragma once

// What calls of tiller.jax need of a robot, made once. Compiled programs know a robot by its number.

#include <cstdint>
#include <vector>

#include "robot.hpp"
#include "rollout/cost.hpp"
#include "rollout/rollout.hpp"

namespace tiller::python {

struct JaxRobot {
  Robot robot;
  const tiller_model_t* model;
  const RolloutTable* table;
  StepSetup setup;
  CostTerms<double> exact;
  CostTerms<float> lanes;
  std::vector<double> exact_to_go;
  std::vector<float> lanes_to_go;

  std::uint32_t nx() const { return model->state_count; }
  std::uint32_t nu() const { return model->input_count; }
  std::uint32_t np() const { return robot->config.param_count; }
  /// The model's states with the effects' behind them.
  std::uint32_t nz() const { return nx() + setup.effect_state_count; }

  const CostTerms<double>* cost(double) const { return &exact; }
  const CostTerms<float>* cost(float) const { return &lanes; }
};

/// The number of a robot: the same for the same file that was read. Raises StatusError where its cost cannot be laid
/// out.
std::int64_t jax_number(const Robot& robot);
/// The robot of a number; null: there is none. From any thread.
const JaxRobot* jax_robot(std::int64_t number);

}  // namespace tiller::python
