#include "bench/learned/imitate_worlds.hpp"

#include <algorithm>
#include <cmath>

#include "tools/links/trial_plant.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::bench {
namespace {

/// Base weights of the states, of the inputs, and how far from the target demonstrations start.
struct Base {
  const char* robot;
  double state[4], input[2], spread[4], target[4];
};
constexpr Base kBases[] = {{"cart_pole", {2, 5, 0.5, 0.5}, {0.02, 0}, {0.6, 0.4, 0.4, 0.8}, {0, 0, 0, 0}},
                           {"two_link_arm", {8, 5, 0.3, 0.2}, {0.01, 0.02}, {0.8, 0.8, 1, 1}, {0.6, 0.4, 0, 0}}};
constexpr std::uint32_t kHorizon = 100;

void know_parameters(tiller::Config& config) {
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    config.priors[i] = {tiller_prior_fixed, 0, tools::centre_of(config.priors[i]), 0.0, -INFINITY, INFINITY};
}

void plan_alone(tiller::Config& config) {
  config.planner.kind = tiller_planner_ilqr;
  config.planner.horizon = kHorizon;
  config.planner.particles = 1;
  config.planner.iterations = 300;
  config.planner.deadline_us = 0;
  config.planner.risk = tiller_risk_mean;
  for (double& rate : config.safety.input_rate_per_s) rate = INFINITY;
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) {  // limits are another row's matter
    config.safety.input_low[i] = -1e4;
    config.safety.input_high[i] = 1e4;
  }
}

void take_cost(const Base& base, std::uint64_t seed, ImitateWorld& world) {
  Rng rng(seed, kRngPrior, 7);
  imi::CostEdit cost(world.config);
  cost.clear();
  const tiller_model_t& model = *world.config.model;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const double q = base.state[i] * std::exp2(2 * rng.uniform() - 1);
    world.learnt.push_back({imi::CostTerm::state, i, std::string("Q ") + model.state_names[i], base.state[i]});
    world.truth.push_back(q);
  }
  for (std::uint32_t i = 1; i < model.input_count; ++i) {
    world.learnt.push_back({imi::CostTerm::input, i, std::string("R ") + model.input_names[i], base.input[i]});
    world.truth.push_back(base.input[i] * std::exp2(2 * rng.uniform() - 1));
  }
  for (std::uint32_t i = 0; i < 4; ++i) {
    world.learnt.push_back({imi::CostTerm::terminal, i, std::string("Qf ") + model.state_names[i], base.state[i]});
    world.truth.push_back(5 * world.truth[i]);
  }
  cost.set({imi::CostTerm::input, 0, "", 0}, base.input[0]);
  for (std::size_t t = 0; t < world.learnt.size(); ++t) cost.set(world.learnt[t], world.truth[t]);
  world.config = cost.get();
  world.config.cost.outputs = nullptr;
  world.config.cost.output_count = 0;
  for (std::uint32_t i = 0; i < 4; ++i) world.config.cost.target[i] = base.target[i];
  world.spread.assign(base.spread, base.spread + 4);
}

}  // namespace

bool make_world(const std::string& robot, std::uint64_t seed, ImitateWorld& world, std::string& error) {
  const auto file = tools::read_robot_file(std::string(TILLER_ROBOTS) + "/" + robot + ".toml", error);
  if (!file) return false;
  const Base& base = robot == kBases[0].robot ? kBases[0] : kBases[1];
  world.name = robot;
  world.config = file->config;
  know_parameters(world.config);
  plan_alone(world.config);
  take_cost(base, seed, world);
  return world.scene.make(world.config, error);
}

imi::Vector draw_start(const ImitateWorld& world, Rng& rng) {
  imi::Vector x(4);
  for (int i = 0; i < 4; ++i)
    x(i) = world.config.cost.target[i] + world.spread[static_cast<std::size_t>(i)] * (2 * rng.uniform() - 1);
  return x;
}

imi::Motion best_motion(const ImitateWorld& world, const tiller_config_t& cost, const imi::Vector& start, int steps) {
  imi::Motion motion;
  imi::Matrix guess(world.scene.nu(), 0);
  for (int length = 20; guess.cols() < steps; length += 20) {
    const Eigen::Index now = std::min(length, steps), before = guess.cols();
    guess.conservativeResize(Eigen::NoChange, now);
    guess.rightCols(now - before).setZero();
    motion = imi::replan(world.scene, cost, start, guess);
    guess = motion.input;
  }
  return motion;
}

Expert::Expert(const ImitateWorld& of) : world_(of), planning_(of.config) {}

void Expert::plan(const imi::Vector& start) {
  gain_.assign(kHorizon, imi::Matrix());
  if (world_.name == kBases[0].robot) {
    planned_ = best_motion(world_, world_.config, start, kHorizon);
    gain_ = imi::policy_along(imi::expand(world_.scene, planned_, world_.config, {}, {}), imi::Vector::Ones(1)).gain;
    return;
  }
  planning_.set_state(start.data());
  planning_.plan_cold();
  const float* u = planning_.planner->sequence(planning_.self);
  planned_.input = Eigen::Map<const Eigen::MatrixXf>(u, world_.scene.nu(), kHorizon).cast<double>();
  planned_.state = world_.scene.roll(start, planned_.input);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> gain(world_.scene.nu(), 4);
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    gain.setZero();
    (void)planning_.planner->feedback(planning_.self, k, gain.data(), nullptr, nullptr);
    gain_[k] = gain;
  }
}

imi::Motion Expert::follow(const imi::Vector& start, double share, Rng& rng) {
  plan(start);
  const imi::Vector sd = share * planned_.input.rowwise().norm() / std::sqrt(static_cast<double>(kHorizon));
  imi::Motion motion = planned_;
  for (std::uint32_t k = 0; k < kHorizon; ++k) {
    imi::Vector u = planned_.input.col(k);
    u += gain_[k] * world_.scene.difference(motion.state.col(k), planned_.state.col(k));
    for (Eigen::Index i = 0; i < u.size(); ++i) u(i) += sd(i) * rng.normal();
    motion.input.col(k) = u;
    motion.state.col(k + 1) = world_.scene.step(motion.state.col(k), u);
  }
  return motion;
}

tools::Grid measure(const ImitateWorld& world, const imi::Motion& motion, Rng& rng) {
  tools::Grid grid;
  grid.path = world.name;
  grid.period_s = world.config.period_s;
  const auto points = static_cast<std::size_t>(motion.state.cols());
  grid.state.assign(4, std::vector<double>(points, NAN));
  grid.input.assign(world.scene.nu(), std::vector<double>(points, 0.0));
  for (std::uint32_t c = 0; c < world.config.measurement_count; ++c) {
    const std::uint32_t i = world.config.measured_state[c];
    for (std::size_t p = 0; p < points; ++p)
      grid.state[i][p] = motion.state(i, static_cast<Eigen::Index>(p)) + world.config.measurement_sd[c] * rng.normal();
  }
  for (std::uint32_t i = 0; i < world.scene.nu(); ++i)
    for (std::size_t p = 0; p + 1 < points; ++p) grid.input[i][p] = motion.input(i, static_cast<Eigen::Index>(p));
  return grid;
}

}  // namespace tiller::bench
