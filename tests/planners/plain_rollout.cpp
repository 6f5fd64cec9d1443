#include "plain_rollout.hpp"

#include <algorithm>
#include <vector>

#include "rollout/path.hpp"

namespace tiller_test {

void (*on_plain_rollout)() = nullptr;

namespace {

constexpr std::uint32_t kBlock = 8;  // lanes whose sums the compiler may take side by side

using Block = double[kBlock];

/// A row of `count` lanes from `lane` on.
void take(const tiller::Lanes<float>& rows, std::uint32_t row, std::uint32_t lane, std::uint32_t count, Block& out) {
  if (rows.splat())
    for (double& v : out) v = static_cast<double>(rows.data[row]);
  else
    for (std::uint32_t l = 0; l < count; ++l) out[l] = static_cast<double>(rows.data[row * rows.stride + lane + l]);
}

/// Adds weight * (value - target)^2, of an angle the short way round.
void add_square(const tiller_model_t& model, std::uint32_t i, double weight, double target, const Block& value,
                Block& cost) {
  if ((model.angle_mask >> i & 1u) != 0) {
    for (std::uint32_t l = 0; l < kBlock; ++l) {
      const double e = tiller::state_difference(model, i, value[l], target);
      cost[l] += weight * e * e;
    }
  } else {
    for (std::uint32_t l = 0; l < kBlock; ++l) cost[l] += weight * (value[l] - target) * (value[l] - target);
  }
}

void step(const tiller_model_t& model, const tiller::StepSetup& setup, std::uint32_t count, const Block* u,
          const Block* p, Block* x) {
  const double force[TILLER_MAX_JOINTS] = {};
  double state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS], params[TILLER_MAX_PARAMS], dxdt[TILLER_MAX_STATES];
  for (std::uint32_t l = 0; l < count; ++l) {
    for (std::uint32_t i = 0; i < model.state_count; ++i) state[i] = x[i][l];
    for (std::uint32_t i = 0; i < model.input_count; ++i) input[i] = u[i][l];
    for (std::uint32_t i = 0; i < model.param_count; ++i) params[i] = p[i][l];
    model.dynamics(state, input, force, &setup.body, params, dxdt);
    for (std::uint32_t i = 0; i < model.state_count; ++i) x[i][l] = state[i] + setup.period_s * dxdt[i];
  }
}

/// The closed loop's inputs of step t, one lane after the other.
void feed_back(const tiller_model_t& model, const tiller::RolloutJob<float>& job, std::uint32_t t, std::uint32_t lane,
               std::uint32_t count, const Block* x, const Block* before, Block* u) {
  const tiller::RolloutFeedback<float>& law = *job.feedback;
  const std::uint32_t nx = model.state_count, nu = model.input_count;
  for (std::uint32_t i = 0; i < nu; ++i) {
    const float* gain = law.gain + (t * nu + i) * law.columns;
    Block wish, reference, planned;
    std::copy(u[i], u[i] + kBlock, wish);
    for (std::uint32_t c = 0; c < nx; ++c) {
      take(law.reference, t * nx + c, lane, count, reference);
      for (std::uint32_t l = 0; l < count; ++l) wish[l] += static_cast<double>(gain[c]) * (x[c][l] - reference[l]);
    }
    for (std::uint32_t c = 0; nx + c < law.columns; ++c) {
      take(job.controls, (t - 1) * nu + c, lane, count, planned);
      for (std::uint32_t l = 0; l < count; ++l)
        wish[l] += static_cast<double>(gain[nx + c]) * (before[c][l] - planned[l]);
    }
    const double change = static_cast<double>(law.most_change[i]);
    for (std::uint32_t l = 0; l < count; ++l) {
      const double low = std::max(static_cast<double>(law.low[i]), before[i][l] - change);
      const double high = std::min(static_cast<double>(law.high[i]), before[i][l] + change);
      u[i][l] = wish[l] < low ? low : wish[l] > high ? high : wish[l];
    }
  }
}

void rollout(const tiller_model_t& model, const tiller::RolloutJob<float>& job) {
  if (on_plain_rollout) on_plain_rollout();
  static const tiller::CostTerms<float> no_cost{};
  const tiller::CostTerms<float>& w = job.cost ? *job.cost : no_cost;
  Block x[TILLER_MAX_STATES] = {}, p[TILLER_MAX_PARAMS] = {}, u[TILLER_MAX_INPUTS] = {}, before[TILLER_MAX_INPUTS] = {};
  for (std::uint32_t lane = 0; lane < job.lanes; lane += kBlock) {
    const std::uint32_t count = std::min(kBlock, job.lanes - lane);
    for (std::uint32_t i = 0; i < model.state_count; ++i) take(job.state, i, lane, count, x[i]);
    for (std::uint32_t i = 0; i < model.param_count; ++i) take(job.params, i, lane, count, p[i]);
    for (std::uint32_t i = 0; i < model.input_count; ++i)
      for (double& v : before[i]) v = static_cast<double>(job.previous_input[i]);
    Block cost = {};
    const auto keep = [&](std::uint32_t t) {
      for (std::uint32_t i = 0; job.trajectory && i < model.state_count; ++i)
        for (std::uint32_t l = 0; l < count; ++l)
          job.trajectory[(t * model.state_count + i) * job.lanes + lane + l] = static_cast<float>(x[i][l]);
    };
    for (std::uint32_t t = 0; t < job.horizon; ++t) {
      keep(t);
      for (std::uint32_t i = 0; i < model.input_count; ++i)
        take(job.controls, t * model.input_count + i, lane, count, u[i]);
      if (job.feedback && t >= job.feedback->from) feed_back(model, job, t, lane, count, x, before, u);
      for (std::uint32_t i = 0; i < model.state_count; ++i)
        add_square(model, i, static_cast<double>(w.state[i]), static_cast<double>(w.target[i]), x[i], cost);
      for (std::uint32_t i = 0; i < model.input_count; ++i) {
        const double weight = static_cast<double>(w.input[i]), rate_weight = static_cast<double>(w.input_rate[i]);
        for (std::uint32_t l = 0; l < kBlock; ++l) {
          const double change = u[i][l] - before[i][l];
          cost[l] += weight * u[i][l] * u[i][l] + rate_weight * change * change;
          before[i][l] = u[i][l];
        }
      }
      step(model, *job.setup, count, u, p, x);
    }
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      add_square(model, i, static_cast<double>(w.terminal[i]), static_cast<double>(w.target[i]), x[i], cost);
    keep(job.horizon);
    for (std::uint32_t l = 0; job.cost_out && l < count; ++l) job.cost_out[lane + l] = static_cast<float>(cost[l]);
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
