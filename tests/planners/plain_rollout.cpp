#include "plain_rollout.hpp"

#include <algorithm>
#include <vector>

#include "rollout/path.hpp"

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

// ---- for gradient planners: the same steps, one point or one candidate after the other -----------

void euler(const tiller_model_t& model, const tiller::StepSetup& setup, const double* x, const double* u,
           const double* p, double* next) {
  double dxdt[TILLER_MAX_STATES];
  const double force[TILLER_MAX_JOINTS] = {};
  model.dynamics(x, u, force, &setup.body, p, dxdt);
  for (std::uint32_t i = 0; i < model.state_count; ++i) next[i] = x[i] + setup.period_s * dxdt[i];
}

void linearise(const tiller_model_t& model, const tiller::PathJob& job) {
  if (on_plain_rollout) on_plain_rollout();
  const std::size_t nx = model.state_count, nu = model.input_count, n = job.lq_states;
  for (std::size_t k = 0; k < job.horizon; ++k)
    for (std::size_t j = 0; j < job.scenarios; ++j) {
      const std::size_t at = k * job.scenarios + j;
      const double *x = job.state + at * nx, *u = job.control + k * nu, *p = job.params + j * job.param_count;
      euler(model, *job.setup, x, u, p, job.next + at * nx);
      for (std::size_t c = 0; job.a && c < nx + nu; ++c) {
        double xu[2][TILLER_MAX_STATES + TILLER_MAX_INPUTS], next[2][TILLER_MAX_STATES];
        const double width = 1e-3;  // the models here are linear: wide is exact
        for (int side = 0; side < 2; ++side) {
          std::copy(x, x + nx, xu[side]);
          std::copy(u, u + nu, xu[side] + nx);
          xu[side][c] += side ? width : -width;
          euler(model, *job.setup, xu[side], xu[side] + nx, p, next[side]);
        }
        for (std::size_t r = 0; r < nx; ++r) {
          const double slope = (next[1][r] - next[0][r]) / (2.0 * width);
          if (c < nx)
            job.a[(at * n + r) * n + c] = slope;
          else
            job.b[(at * n + r) * nu + c - nx] = slope;
        }
      }
    }
}

double quadratic(const tiller_model_t& model, const tiller::CostTerms<double>& w, const double* weight,
                 const double* x) {
  double sum = 0.0;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const double e = tiller::state_difference(model, i, x[i], w.target[i]);
    sum += weight[i] * e * e;
  }
  return sum;
}

void feedback(const tiller_model_t& model, const tiller::FeedbackJob& job) {
  if (on_plain_rollout) on_plain_rollout();
  constexpr std::size_t kLanes = tiller::kCandidates;
  const std::size_t nx = model.state_count, nu = model.input_count, n = job.lq_states, count = job.scenarios;
  const tiller::CostTerms<double>& w = *job.cost;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    // no vectors: the heap's test counts every call
    double x[TILLER_MAX_SCENARIOS * TILLER_MAX_STATES], cost[TILLER_MAX_SCENARIOS] = {};
    double before[TILLER_MAX_INPUTS], u[TILLER_MAX_INPUTS];
    std::copy(job.start, job.start + count * nx, x);
    std::copy(job.previous_input, job.previous_input + nu, before);
    const auto keep = [&](std::size_t k) {
      for (std::size_t i = 0; i < count * nx; ++i) job.state_out[(k * count * nx + i) * kLanes + lane] = x[i];
    };
    for (std::size_t k = 0; k < job.horizon; ++k) {
      double inputs = 0.0;
      for (std::size_t i = 0; i < nu; ++i) {
        const double* gain = job.gain + (k * nu + i) * count * n;
        double wish = job.control[k * nu + i] + job.alpha[lane] * job.step[k * nu + i];
        for (std::size_t j = 0; j < count; ++j) {
          for (std::size_t c = 0; c < nx; ++c)
            wish += job.beta[lane] * gain[j * n + c] * (x[j * nx + c] - job.state[(k * count + j) * nx + c]);
          for (std::size_t c = 0; n > nx && c < nu; ++c)
            wish += job.beta[lane] * gain[j * n + nx + c] *
                    (before[c] - (k > 0 ? job.control[(k - 1) * nu + c] : job.previous_input[c]));
        }
        const double low = std::max(job.low[i], before[i] - job.most_change[i]);
        const double high = std::min(job.high[i], before[i] + job.most_change[i]);
        u[i] = wish < low ? low : wish > high ? high : wish;
        job.control_out[(k * nu + i) * kLanes + lane] = u[i];
        inputs += w.input[i] * u[i] * u[i] + w.input_rate[i] * (u[i] - before[i]) * (u[i] - before[i]);
      }
      keep(k);
      for (std::size_t j = 0; j < count; ++j) {
        cost[j] += inputs + quadratic(model, w, w.state, &x[j * nx]);
        double next[TILLER_MAX_STATES];
        euler(model, *job.setup, &x[j * nx], u, job.params + j * job.param_count, next);
        std::copy(next, next + nx, &x[j * nx]);
      }
      std::copy(u, u + nu, before);
    }
    keep(job.horizon);
    for (std::size_t j = 0; j < count; ++j)
      job.cost_out[j * kLanes + lane] = cost[j] + quadratic(model, w, w.terminal, &x[j * nx]);
  }
}

constexpr tiller::PathKernel kPlainPath = {linearise, feedback};

}  // namespace

const tiller::RolloutTable& plain_rollout() {
  static const tiller::RolloutTable table = [] {
    tiller::RolloutTable t;
    t.isa = tiller::best_isa();  // the planner's lanes follow it; the rollout itself has none
    t.rollout_f32 = rollout;
    t.path = &kPlainPath;
    return t;
  }();
  return table;
}

}  // namespace tiller_test
