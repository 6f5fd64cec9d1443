#include "jax_robot.hpp"

#include <memory>
#include <mutex>

#include "errors.hpp"

namespace tiller::python {
namespace {

/// Robots stay: a compiled program may be called after the last name of its robot is gone.
struct Register {
  std::mutex mutex;
  std::vector<std::unique_ptr<JaxRobot>> robots;
};

Register& all() {
  static Register* const one = new Register;
  return *one;
}

std::unique_ptr<JaxRobot> make(const Robot& robot) {
  auto made = std::make_unique<JaxRobot>();
  made->robot = robot;
  made->model = robot->config.model;
  made->table = &select_rollout(*made->model);
  check_status(make_step_setup(robot->config, made->setup), "tiller.jax");
  const std::size_t square = std::size_t{made->nx()} * made->nx();
  made->exact_to_go.resize(square);
  made->lanes_to_go.resize(square);
  made->exact.cost_to_go = made->exact_to_go.data();
  made->lanes.cost_to_go = made->lanes_to_go.data();
  check_status(lay_out_cost(robot->config, made->setup, *made->table, &made->exact, &made->lanes), "tiller.jax");
  return made;
}

}  // namespace

std::int64_t jax_number(const Robot& robot) {
  Register& known = all();
  const std::lock_guard<std::mutex> lock(known.mutex);
  for (std::size_t i = 0; i < known.robots.size(); ++i)
    if (known.robots[i]->robot.file == robot.file) return static_cast<std::int64_t>(i);
  known.robots.push_back(make(robot));
  return static_cast<std::int64_t>(known.robots.size() - 1);
}

const JaxRobot* jax_robot(std::int64_t number) {
  Register& known = all();
  const std::lock_guard<std::mutex> lock(known.mutex);
  const auto at = static_cast<std::size_t>(number);
  return at < known.robots.size() ? known.robots[at].get() : nullptr;
}

}  // namespace tiller::python
