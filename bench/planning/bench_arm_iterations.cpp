// bench_arm_iterations ROBOT: iterations of `ilqr` on an imported arm of 7 joints over 30 steps of 10 ms, one JSON
// line. A part of ./dev bench robots, which gives crocoddyl the same problem (bench/peers/crocoddyl_arm.py): from rest
// at one posture to rest at another, semi-implicit Euler, quadratic in states and torques, no limit in reach.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <vector>

#include "bench/problems/planning_problem.hpp"
#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;
using bench::Planning;

constexpr std::uint32_t kJoints = 7, kHorizon = 30, kIterations = 10, kRounds = 100, kOptimal = 60;
constexpr double kPeriod_s = 0.01;
// as crocoddyl_arm.py has them, whose costs carry the factor 1/2 and, but for the end's, the step
constexpr double kStart_rad[kJoints] = {0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.5};
constexpr double kTarget_rad[kJoints] = {0.5, 0.0, 0.3, -1.5, 0.3, 1.8, 0.0};
constexpr double kPlace = 10.0, kSpeed = 0.1, kTorque = 1e-4, kPlaceEnd = 100.0, kSpeedEnd = 1.0;

Config problem_of(const Config& robot) {
  Config c;
  if (tiller_config_default(&c, robot.model) != tiller_status_ok) std::exit(2);
  c.period_s = kPeriod_s;
  c.substeps = 1;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body = robot.body;
  for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, robot.priors[i].a, 0, 0, 0};
  c.planner.kind = tiller_planner_ilqr;
  c.planner.horizon = kHorizon;
  c.planner.particles = 1;
  c.planner.regularisation = 0.0;
  for (std::uint32_t j = 0; j < kJoints; ++j) {
    c.initial_state[j] = kStart_rad[j];
    c.cost.target[j] = kTarget_rad[j];
    c.cost.state_weight[j] = 0.5 * kPeriod_s * kPlace;
    c.cost.state_weight[kJoints + j] = 0.5 * kPeriod_s * kSpeed;
    c.cost.terminal_weight[j] = 0.5 * kPlaceEnd;
    c.cost.terminal_weight[kJoints + j] = 0.5 * kSpeedEnd;
    c.cost.input_weight[j] = 0.5 * kPeriod_s * kTorque;
    c.safety.input_low[j] = -1e4;
    c.safety.input_high[j] = 1e4;
  }
  return c;
}

double seconds_of_a_solve(Planning& p) {
  const auto before = std::chrono::steady_clock::now();
  p.plan_cold();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "bench_arm_iterations ROBOT: a part of ./dev bench robots\n");
    return 2;
  }
  std::string errors;
  const auto robot = tools::read_robot_file(argv[1], errors);
  if (!robot || robot->config.model->state_count != 2 * kJoints || robot->config.model->input_count != kJoints) {
    std::fprintf(stderr, "%s", robot ? "an arm of 7 joints is needed\n" : errors.c_str());
    return 2;
  }
  Planning p(problem_of(robot->config));
  p.request.deadline.iterations = kOptimal;
  p.plan_cold();
  const double optimum = p.result.cost;
  std::vector<double> first(p.command, p.command + kJoints);
  p.request.deadline.iterations = kIterations;
  std::vector<double> each;
  for (std::uint32_t i = 0; i < kRounds; ++i) each.push_back(seconds_of_a_solve(p) / p.result.iterations);
  std::nth_element(each.begin(), each.begin() + kRounds / 2, each.end());
  std::printf("{\"iteration_us\": %.4g, \"iterations\": %u, \"cost\": %.12g, \"first_Nm\": [", each[kRounds / 2] * 1e6,
              p.result.iterations, optimum);
  for (std::uint32_t j = 0; j < kJoints; ++j) std::printf("%s%.9g", j ? ", " : "", first[j]);
  std::printf("]}\n");
  return 0;
}
