#include "executive/steady_target.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_roles.hpp"
#include "rollout/attitude.hpp"

namespace tiller {
namespace {

/// Weight of standing still, in 1/s, over the largest of the target's: the robot drifts by a thousandth of what the
/// target pulls at it.
constexpr double kStill = 1e6;
/// Of a state without a weight, and of inputs that do the same, over the largest.
constexpr double kFree = 1e-6;
/// Of a state that does not give way.
constexpr double kFixed = 1e18;
constexpr int kFirstSteps = 8;
/// Farthest from the target that an angle, or a rotation, may have to give way, in rad. Beyond, what is linear about
/// the target says little: a pole that is pushed harder than gravity can balance has no steady state near it.
constexpr double kFarthest_rad = 0.5;

/// What acts at rest: a lag passes its command, and dry friction holds wherever the robot stands.
StepSetup at_rest(const StepSetup& setup) {
  StepSetup s = setup;
  s.effect_count = s.effect_state_count = s.delay_steps = 0;
  if (s.slip_states == 0) s.fading = 0;  // slips stand in these rows, at rates of zero
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kLinear | kSmooth)) s.effects[s.effect_count++] = setup.effects[e];
  return s;
}

/// m x = b in place by Cholesky; m (n x n) symmetric, its lower half read and spoilt. False where m is not positive.
bool solve_positive(std::uint32_t n, double* m, double* b) {
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = m[r * n + c];
      for (std::uint32_t k = 0; k < c; ++k) sum -= m[r * n + k] * m[c * n + k];
      if (r > c) {
        m[r * n + c] = sum / m[c * n + c];
        continue;
      }
      if (!(sum > 0.0)) return false;
      m[r * n + r] = std::sqrt(sum);
    }
  for (std::uint32_t r = 0; r < n; ++r) {
    for (std::uint32_t k = 0; k < r; ++k) b[r] -= m[r * n + k] * b[k];
    b[r] /= m[r * n + r];
  }
  for (std::uint32_t r = n; r-- > 0;) {
    for (std::uint32_t k = r + 1; k < n; ++k) b[r] -= m[k * n + r] * b[k];
    b[r] /= m[r * n + r];
  }
  return true;
}

}  // namespace

void SteadyTarget::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                           const RolloutTable& table) {
  if (config.cost.input_reference != tiller_input_reference_steady) return;
  config_ = &config;
  table_ = &table;
  rows_ = param_rows(config, setup);
  force_row_ = setup.fading_param;
  setup_ = at_rest(setup);
  const tiller_model_t& model = *config.model;
  nx_ = model.state_count;
  nu_ = model.input_count;
  n_ = nx_ + nu_;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (config.cost.state_weight[i] > 0.0) still_ |= 1u << i;
    largest_weight_ = std::fmax(largest_weight_, config.cost.state_weight[i]);
  }
  for (std::uint32_t j = 0; j < model.joint_count; ++j) still_ |= 1u << model.joints[j].velocity;
  const std::size_t sizes[] = {nx_,       nu_,       param_rows(config, setup),    nx_,
                               nx_ * nx_, nx_ * nu_, std::size_t{n_} * n_ + 2 * n_};
  double** const rows[] = {&state_, &input_, &params_, &next_, &a_, &b_, &work_};
  for (int i = 0; i < 7; ++i) *rows[i] = arena.take<double>(sizes[i]);
}

void SteadyTarget::update(const Posterior& posterior, const double* param_mean, const double* state_mean) {
  if (!asked()) return;
  if (config_->cost.reference != nullptr) return clear();
  std::copy(param_mean, param_mean + config_->param_count, params_);
  (void)posterior.forces(config_->planner.horizon * config_->period_s, params_ + force_row_, nullptr);
  int steps = 1;
  if (!stands_) {
    begin_at_target(state_mean);
    std::copy(config_->safety.safe_command, config_->safety.safe_command + nu_, input_);
    steps = kFirstSteps;
  }
  stands_ = true;
  for (int k = 0; k < steps && stands_; ++k) stands_ = step(state_mean, true);
  if (!stands_ || is_near()) return;
  begin_at_target(state_mean);
  stands_ = step(state_mean, false);
}

/// What no weight says where to be is where the robot is.
void SteadyTarget::begin_at_target(const double* state_mean) {
  for (std::uint32_t i = 0; i < nx_; ++i) state_[i] = ((still_ >> i) & 1u) ? config_->cost.target[i] : state_mean[i];
  for_quaternions(config_->model->quaternion_mask, [&](std::uint32_t first) {
    if (!is_attitude(state_ + first)) std::copy(state_mean + first, state_mean + first + 4, state_ + first);
  });
}

bool SteadyTarget::is_near() const {
  double off[TILLER_MAX_STATES];
  state_differences(*config_->model, state_, config_->cost.target, off);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const bool turns = (quaternion_states(config_->model->quaternion_mask) >> i) & 1u;
    const bool angle = (config_->model->angle_mask >> i) & 1u;
    if (((still_ >> i) & 1u) && (angle || turns) && !(std::fabs(off[i]) < (turns ? 0.5 : 1.0) * kFarthest_rad))
      return false;
  }
  return true;
}

/// gives_way: the state may; else the input alone is looked for, which holds the state where it is best.
bool SteadyTarget::step(const double* state_mean, bool gives_way) {
  PathJob job;
  job.setup = &setup_;
  job.horizon = 1;
  job.state = state_;
  job.control = input_;
  job.params = params_;
  job.param_count = rows_;
  job.next = next_;
  job.a = a_;
  job.b = b_;
  job.lq_states = nx_;
  select_path(*table_).linearise(*config_->model, job);
  const std::uint32_t turns = config_->model->quaternion_mask;
  if (turns != 0) {
    to_tangent_columns(turns, state_, 1, nx_, nx_, a_, 1);
    to_tangent_rows(turns, next_, 1, nx_, a_, 1);
    to_tangent_rows(turns, next_, 1, nu_, b_, 1);
  }
  if (!solve(state_mean, gives_way)) return false;
  const double* const change = work_ + std::size_t{n_} * n_;
  add_differences(*config_->model, state_, change, state_);
  for (std::uint32_t i = 0; i < nu_; ++i)
    input_[i] = std::clamp(input_[i] + change[nx_ + i], config_->safety.input_low[i], config_->safety.input_high[i]);
  return std::all_of(state_, state_ + nx_, [](double v) { return std::isfinite(v); });
}

/// The step (n) behind the matrix; false where it is not finite.
bool SteadyTarget::solve(const double* state_mean, bool gives_way) {
  double *m = work_, *change = work_ + std::size_t{n_} * n_, *row = change + n_;
  std::fill(m, m + std::size_t{n_} * n_ + n_, 0.0);
  double pull[TILLER_MAX_STATES], here[TILLER_MAX_STATES], drift[TILLER_MAX_STATES];
  state_differences(*config_->model, config_->cost.target, state_, pull);
  state_differences(*config_->model, state_mean, state_, here);
  state_differences(*config_->model, state_, next_, drift);
  const double largest = largest_weight_ > 0.0 ? largest_weight_ : 1.0;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double own = config_->cost.state_weight[i] / largest;
    m[i * n_ + i] += gives_way ? own + kFree : kFixed;
    change[i] += own * pull[i] + (own > 0.0 ? 0.0 : kFree * here[i]);
  }
  const double per_s = 1.0 / config_->period_s;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    if (((still_ >> i) & 1u) == 0) continue;
    for (std::uint32_t c = 0; c < nx_; ++c) row[c] = per_s * (a_[i * nx_ + c] - (c == i ? 1.0 : 0.0));
    for (std::uint32_t c = 0; c < nu_; ++c) row[nx_ + c] = per_s * b_[i * nu_ + c];
    for (std::uint32_t r = 0; r < n_; ++r) {
      for (std::uint32_t c = 0; c <= r; ++c) m[r * n_ + c] += kStill * row[r] * row[c];
      change[r] += kStill * row[r] * per_s * drift[i];
    }
  }
  // of inputs that do the same the smallest change
  double largest_input = 0.0;
  for (std::uint32_t i = nx_; i < n_; ++i) largest_input = std::fmax(largest_input, m[i * n_ + i]);
  for (std::uint32_t i = nx_; i < n_; ++i) m[i * n_ + i] += 1e-12 * largest_input + 1e-300;
  return solve_positive(n_, m, change) && std::all_of(change, change + n_, [](double v) { return std::isfinite(v); });
}

}  // namespace tiller
