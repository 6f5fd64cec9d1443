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
    constexpr std::uint32_t kPadded = kLanePadding;
    const std::size_t ns = nz_ - nx_;
    std::vector<double> after(ns * kPadded);
    for (std::size_t k = 0; k + 1 < job_.horizon; ++k) {
      const std::size_t point = n * job_.horizon + k;
      RolloutJob<double> step = one_step(kPadded);
      step.state = {state(point), 0};
      step.effect_state = {state(point) + nx_, 0};
      step.params = {params(n), 0};
      step.controls = {job_.controls + point * nu_, 0};
      step.final_effect_state = after.data();
      robot_.table->rollout_f64(*robot_.model, step);
      for (std::size_t s = 0; s < ns; ++s) state(point + 1)[nx_ + s] = after[s * kPadded];
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

  /// Blocks of points in half of the lanes with a parameter's lower value, in the other half with its upper one.
  void difference() {
    Block block(*this);
    for (std::size_t first = 0; first < count_; first += kHalf) {
      block.load(first, std::min(kHalf, count_ - first));
      for (std::uint32_t i = 0; i < np_; ++i) block.differ(i);
    }
  }
  static constexpr std::size_t kHalf = 32, kLanes = 2 * kHalf;

  /// Lanes of a block: rows of kLanes.
  class Block {
   public:
    explicit Block(const Points& points)
        : all_(points),
          rows_((2 * points.nz_ + points.np_ + points.nu_) * kLanes),
          x_(rows_.data()),
          p_(x_ + points.nz_ * kLanes),
          u_(p_ + points.np_ * kLanes),
          end_(u_ + points.nu_ * kLanes),
          step_(points.one_step(kLanes)) {
      step_.state = {x_, kLanes};
      step_.effect_state = {x_ + points.nx_ * kLanes, kLanes};
      step_.params = {p_, kLanes};
      step_.controls = {u_, kLanes};
      step_.final_state = end_;
      step_.final_effect_state = points.nz_ > points.nx_ ? end_ + points.nx_ * kLanes : nullptr;
    }

    /// The last point stands for those behind it.
    void load(std::size_t first, std::size_t used) {
      first_ = first, used_ = used;
      for (std::size_t l = 0; l < kHalf; ++l) {
        const std::size_t point = first + std::min(l, used - 1);
        put(all_.state_.data() + point * all_.nz_, all_.nz_, x_ + l);
        put(all_.job_.controls + point * all_.nu_, all_.nu_, u_ + l);
        put(all_.params(point / all_.job_.horizon), all_.np_, p_ + l);
      }
    }

    void differ(std::uint32_t i) {
      const tiller_prior_t& prior = all_.robot_.robot->config.priors[i];
      double value[kHalf], inverse[kHalf];
      double* const row = p_ + i * kLanes;
      for (std::size_t l = 0; l < kHalf; ++l) {
        value[l] = row[l];
        const Around two = around(prior, value[l]);
        row[l] = two.low, row[kHalf + l] = two.high;
        inverse[l] = two.high > two.low ? 1.0 / (two.high - two.low) : 0.0;
      }
      all_.robot_.table->rollout_f64(*all_.robot_.model, step_);
      double* const out = all_.job_.p + first_ * all_.nz_ * all_.np_ + i;
      for (std::size_t r = 0; r < all_.nz_; ++r)
        for (std::size_t l = 0; l < used_; ++l)
          out[(l * all_.nz_ + r) * all_.np_] = (end_[r * kLanes + kHalf + l] - end_[r * kLanes + l]) * inverse[l];
      for (std::size_t l = 0; l < kHalf; ++l) row[l] = row[kHalf + l] = value[l];
    }

   private:
    static void put(const double* from, std::size_t count, double* to) {
      for (std::size_t i = 0; i < count; ++i) to[i * kLanes] = to[i * kLanes + kHalf] = from[i];
    }

    const Points& all_;
    std::vector<double> rows_;
    double *x_, *p_, *u_, *end_;
    RolloutJob<double> step_;
    std::size_t first_ = 0, used_ = 0;
  };

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
