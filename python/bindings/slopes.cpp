#include "slopes.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "rollout/path.hpp"

namespace tiller::python {
namespace {

/// Two values of a parameter around its own.
struct Around {
  double low, high;
};

/// Steps are 6e-6, the cube root of the rounding error, of the parameter's size or of its prior's width, whichever is
/// more; where that would leave the prior's support, of which the parameter is in, the difference is one-sided.
Around around(const tiller_prior_t& prior, double value) {
  double size = std::fabs(value);
  bool bounded = false;
  if (prior.kind == tiller_prior_fixed) {
    if (size == 0.0) size = 1.0;
  } else {
    const double width = prior.kind == tiller_prior_uniform ? prior.high - prior.low : prior.b;
    if (std::isfinite(width)) size = std::max(size, width);
    bounded = value >= prior.low && value <= prior.high;
  }
  const double h = 6e-6 * size;
  Around at{value - h, value + h};
  if (bounded) at = {std::max(at.low, prior.low), std::min(at.high, prior.high)};
  return at;
}

/// One call's points, a point for each period of each trajectory, and the rows that kernels want.
class Points {
 public:
  explicit Points(const SlopesJob& job)
      : job_(job),
        robot_(*job.robot),
        nx_(robot_.nx()),
        nu_(robot_.nu()),
        np_(robot_.np()),
        nz_(robot_.nz()),
        count_(std::size_t{job.trajectories} * job.horizon),
        state_(count_ * nz_),
        next_(count_ * nz_) {}

  void run() {
    for (std::uint32_t n = 0; n < job_.trajectories; ++n) lay_out(n);
    linearise();
    if (job_.p) difference();
  }

 private:
  const double* params(std::size_t trajectory) const {
    return job_.params + (job_.shared_params ? 0 : trajectory * np_);
  }
  double* state(std::size_t point) { return state_.data() + point * nz_; }

  void lay_out(std::size_t n) {
    const double* const states = job_.states + n * (std::size_t{job_.horizon} + 1) * nx_;
    for (std::size_t k = 0; k < job_.horizon; ++k)
      std::copy(states + k * nx_, states + (k + 1) * nx_, state(n * job_.horizon + k));
    if (nz_ > nx_) follow_effects(n);
  }

  /// The effects' states along a trajectory, which begin at zero.
  void follow_effects(std::size_t n) {
    constexpr std::uint32_t kLanes = kLanePadding;
    const std::size_t ns = nz_ - nx_;
    std::vector<double> after(ns * kLanes);
    for (std::size_t k = 0; k + 1 < job_.horizon; ++k) {
      const std::size_t point = n * job_.horizon + k;
      RolloutJob<double> step = one_step(kLanes);
      step.state = {state(point), 0};
      step.effect_state = {state(point) + nx_, 0};
      step.params = {params(n), 0};
      step.controls = {job_.controls + point * nu_, 0};
      step.final_effect_state = after.data();
      robot_.table->rollout_f64(*robot_.model, step);
      for (std::size_t s = 0; s < ns; ++s) state(point + 1)[nx_ + s] = after[s * kLanes];
    }
  }

  RolloutJob<double> one_step(std::uint32_t lanes) const {
    RolloutJob<double> job;
    job.setup = &robot_.setup;
    job.lanes = lanes;
    job.horizon = 1;
    return job;
  }

  /// Points do not depend on each other: trajectories of shared parameters are one path.
  void linearise() {
    PathJob path;
    path.setup = &robot_.setup;
    path.param_count = np_;
    path.lq_states = nz_;
    const std::uint32_t calls = job_.shared_params ? 1 : job_.trajectories;
    path.horizon = static_cast<std::uint32_t>(count_ / calls);
    for (std::size_t n = 0; n < calls; ++n) {
      const std::size_t point = n * path.horizon;
      path.state = state(point);
      path.control = job_.controls + point * nu_;
      path.params = params(n);
      path.next = next_.data() + point * nz_;
      path.a = job_.a + point * nz_ * nz_;
      path.b = job_.b + point * nz_ * nu_;
      select_path(*robot_.table).linearise(*robot_.model, path);
    }
  }

  /// A pair of lanes for each point and parameter.
  void difference() {
    constexpr std::size_t kLanes = 64;
    std::vector<double> rows((nz_ + np_ + nu_ + nz_ + 1) * kLanes);
    double *const x = rows.data(), *const s = x + nx_ * kLanes, *const p = x + nz_ * kLanes, *const u = p + np_ * kLanes;
    double *const x_end = u + nu_ * kLanes, *const s_end = x_end + nx_ * kLanes;
    double width[kLanes / 2];
    RolloutJob<double> step = one_step(kLanes);
    step.state = {x, kLanes};
    step.effect_state = {s, kLanes};
    step.params = {p, kLanes};
    step.controls = {u, kLanes};
    step.final_state = x_end;
    step.final_effect_state = nz_ > nx_ ? s_end : nullptr;
    const std::size_t pairs = count_ * np_;
    for (std::size_t first = 0; first < pairs; first += kLanes / 2) {
      const std::size_t used = std::min(kLanes / 2, pairs - first);
      for (std::size_t j = 0; j < kLanes / 2; ++j) {
        const std::size_t pair = first + std::min(j, used - 1), point = pair / np_, i = pair % np_;
        const double* const at = params(point / job_.horizon);
        put_both(state(point), nz_, x + 2 * j, kLanes);
        put_both(job_.controls + point * nu_, nu_, u + 2 * j, kLanes);
        put_both(at, np_, p + 2 * j, kLanes);
        const Around two = around(robot_.robot->config.priors[i], at[i]);
        p[i * kLanes + 2 * j] = two.low;
        p[i * kLanes + 2 * j + 1] = two.high;
        width[j] = two.high - two.low;
      }
      robot_.table->rollout_f64(*robot_.model, step);
      for (std::size_t j = 0; j < used; ++j) {
        const std::size_t point = (first + j) / np_, i = (first + j) % np_;
        for (std::size_t r = 0; r < nz_; ++r)
          job_.p[(point * nz_ + r) * np_ + i] =
              width[j] > 0.0 ? (x_end[r * kLanes + 2 * j + 1] - x_end[r * kLanes + 2 * j]) / width[j] : 0.0;
      }
    }
  }
  static void put_both(const double* from, std::size_t count, double* to, std::size_t stride) {
    for (std::size_t i = 0; i < count; ++i) to[i * stride] = to[i * stride + 1] = from[i];
  }

  const SlopesJob& job_;
  const JaxRobot& robot_;
  std::uint32_t nx_, nu_, np_, nz_;
  std::size_t count_;
  std::vector<double> state_, next_;
};

/// A trajectory's steps as the lanes that the second-order kernel wants, of which the first order is kept.
class Stages {
 public:
  explicit Stages(const CostSlopesJob& job)
      : job_(job),
        robot_(*job.robot),
        nx_(robot_.nx()),
        nu_(robot_.nu()),
        lanes_((job.horizon + 1 + kLanePadding - 1) / kLanePadding * kLanePadding),
        rows_((2 * nx_ + 4 * nu_ + 1) * lanes_) {
    state_ = rows_.data();
    control_ = state_ + nx_ * lanes_;
    before_ = control_ + nu_ * lanes_;
    lx_ = before_ + nu_ * lanes_;
    lu_ = lx_ + nx_ * lanes_;
    lb_ = lu_ + nu_ * lanes_;
    value_ = lb_ + nu_ * lanes_;
  }

  void run() {
    lay_out();
    evaluate(job_.params, true);
    const std::size_t horizon = job_.horizon;
    for (std::size_t k = 0; k <= horizon; ++k)
      for (std::size_t i = 0; i < nx_; ++i) job_.by_state[k * nx_ + i] = lx_[i * lanes_ + k];
    for (std::size_t k = 0; k < horizon; ++k)
      for (std::size_t i = 0; i < nu_; ++i)
        job_.by_control[k * nu_ + i] =
            lu_[i * lanes_ + k] + (k + 1 < horizon ? lb_[i * lanes_ + k + 1] : 0.0) + (k == 0 ? lb_[i * lanes_] : 0.0);
    difference();
  }

 private:
  /// The command before the first one is the first one, as in a rollout.
  void lay_out() {
    for (std::size_t l = 0; l < lanes_; ++l) {
      const std::size_t k = std::min<std::size_t>(l, job_.horizon), stage = std::min<std::size_t>(l, job_.horizon - 1);
      for (std::size_t i = 0; i < nx_; ++i) state_[i * lanes_ + l] = job_.states[k * nx_ + i];
      for (std::size_t i = 0; i < nu_; ++i) {
        control_[i * lanes_ + l] = job_.controls[stage * nu_ + i];
        before_[i * lanes_ + l] = job_.controls[(stage > 0 ? stage - 1 : 0) * nu_ + i];
      }
    }
  }

  /// The sum of the stages' values at these parameters.
  double evaluate(const double* params, bool slopes) {
    QuadratiseJob q;
    q.setup = &robot_.setup;
    q.cost = &robot_.exact;
    q.lanes = static_cast<std::uint32_t>(lanes_);
    q.stages = job_.horizon;
    q.terminal = true;
    q.state = {state_, q.lanes};
    q.control = {control_, q.lanes};
    q.before = {before_, q.lanes};
    q.params = {params, 0};
    q.value = value_;
    if (slopes) q.lx = lx_, q.lu = lu_, q.lb = lb_;
    robot_.table->quadratise(*robot_.model, q);
    double sum = 0.0;
    for (std::size_t k = 0; k <= job_.horizon; ++k) sum += value_[k];
    return sum;
  }

  /// Costs of outputs and of one's own see the parameters themselves, beside the states that follow from them.
  void difference() {
    const CostTerms<double>& cost = robot_.exact;
    const bool sees = cost.has(kCostOutputs) || cost.has(kCostOutputBounds) || cost.has(kCostOwnFunction) ||
                      cost.has(kCostOwnTemplate);
    std::vector<double> p(job_.params, job_.params + robot_.np());
    for (std::size_t i = 0; i < p.size(); ++i) {
      job_.by_param[i] = 0.0;
      if (!sees) continue;
      const double kept = p[i];
      const Around two = around(robot_.robot->config.priors[i], kept);
      p[i] = two.high;
      const double high = evaluate(p.data(), false);
      p[i] = two.low;
      if (two.high > two.low) job_.by_param[i] = (high - evaluate(p.data(), false)) / (two.high - two.low);
      p[i] = kept;
    }
  }

  const CostSlopesJob& job_;
  const JaxRobot& robot_;
  std::size_t nx_, nu_, lanes_;
  std::vector<double> rows_;
  double *state_, *control_, *before_, *lx_, *lu_, *lb_, *value_;
};

}  // namespace

void find_slopes(const SlopesJob& job) { Points(job).run(); }
void find_cost_slopes(const CostSlopesJob& job) { Stages(job).run(); }

}  // namespace tiller::python
