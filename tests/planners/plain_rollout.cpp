#include "plain_rollout.hpp"

#include <algorithm>
#include <vector>

namespace tiller_test {

void (*on_plain_rollout)() = nullptr;

namespace {

double lane_of(const tiller::Lanes<float>& rows, std::uint32_t row, std::uint32_t lane) {
  return static_cast<double>(rows.splat() ? rows.data[row] : rows.data[row * rows.stride + lane]);
}

void rollout(const tiller_model_t& model, const tiller::RolloutJob<float>& job) {
  if (on_plain_rollout) on_plain_rollout();
  const double dt = job.setup->period_s;
  const tiller::CostTerms<float>& w = *job.cost;
  for (std::uint32_t lane = 0; lane < job.lanes; ++lane) {
    double x[TILLER_MAX_STATES], p[TILLER_MAX_PARAMS] = {}, u[TILLER_MAX_INPUTS], before[TILLER_MAX_INPUTS];
    double dxdt[TILLER_MAX_STATES];
    const double force[TILLER_MAX_JOINTS] = {};
    for (std::uint32_t i = 0; i < model.state_count; ++i) x[i] = lane_of(job.state, i, lane);
    for (std::uint32_t i = 0; i < model.param_count; ++i) p[i] = lane_of(job.params, i, lane);
    for (std::uint32_t i = 0; i < model.input_count; ++i) before[i] = static_cast<double>(job.previous_input[i]);
    double cost = 0.0;
    for (std::uint32_t t = 0; t < job.horizon; ++t) {
      for (std::uint32_t i = 0; i < model.input_count; ++i)
        u[i] = lane_of(job.controls, t * model.input_count + i, lane);
      for (std::uint32_t i = 0; i < model.state_count; ++i) {
        const double e = tiller::state_difference(model, i, x[i], static_cast<double>(w.target[i]));
        cost += static_cast<double>(w.state[i]) * e * e;
      }
      for (std::uint32_t i = 0; i < model.input_count; ++i) {
        const double change = u[i] - before[i];
        cost += static_cast<double>(w.input[i]) * u[i] * u[i] + static_cast<double>(w.input_rate[i]) * change * change;
        before[i] = u[i];
      }
      model.dynamics(x, u, force, &job.setup->body, p, dxdt);
      for (std::uint32_t i = 0; i < model.state_count; ++i) x[i] += dt * dxdt[i];
    }
    for (std::uint32_t i = 0; i < model.state_count; ++i) {
      const double e = tiller::state_difference(model, i, x[i], static_cast<double>(w.target[i]));
      cost += static_cast<double>(w.terminal[i]) * e * e;
    }
    job.cost_out[lane] = static_cast<float>(cost);
  }
}

}  // namespace

const tiller::RolloutTable& plain_rollout() {
  static const tiller::RolloutTable table = [] {
    tiller::RolloutTable t;
    t.isa = tiller::best_isa();  // the planner's lanes follow it; the rollout itself has none
    t.rollout_f32 = rollout;
    return t;
  }();
  return table;
}

}  // namespace tiller_test
