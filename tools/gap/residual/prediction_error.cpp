#include "tools/gap/residual/prediction_error.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "effects/effect_roles.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kHalfWidth_s = 0.05;  // of the parabola that gives a stretch's first state
constexpr double kDoubt = 3.0;         // its deviation over what the sensors leave: a parabola is no motion
constexpr double kLargest = 1e6;       // of an innovation in deviations: beyond it a pass has diverged

}  // namespace

PredictionError::PredictionError(const tiller_config_t& config, const std::vector<Grid>& grids,
                                 std::vector<std::uint32_t> free, std::vector<std::uint32_t> force_parts)
    : config_(config),
      model_(*config.model),
      grids_(grids),
      free_(std::move(free)),
      force_parts_(std::move(force_parts)),
      table_(select_rollout(model_)) {
  if (make_step_setup(config, setup_) != tiller_status_ok) std::abort();  // the configuration was checked
  lanes_ = (static_cast<std::uint32_t>(free_.size()) + kLanePadding) / kLanePadding * kLanePadding;
  const std::uint32_t nx = model_.state_count;
  params_.resize(std::size_t{config.param_count} * lanes_);
  next_.resize(std::size_t{nx} * lanes_);
  a_.resize(std::size_t{nx} * nx * lanes_);
  effect_state_.resize(setup_.effect_state_count + 1);
  next_effect_.resize((setup_.effect_state_count + 1) * lanes_);
  history_.resize(std::size_t{setup_.delay_steps + 1} * model_.input_count);
  for (const Grid& grid : grids_) {
    starts_.emplace_back();
    for (std::size_t point = 0; point < grid.points(); ++point) {
      double state[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
      if (!estimate_state(grid, config_, point, kHalfWidth_s, state, sd)) continue;
      starts_.back().push_back(
          {point, Eigen::Map<Eigen::VectorXd>(state, nx), kDoubt * Eigen::Map<Eigen::VectorXd>(sd, nx)});
      break;
    }
  }
}

PredictionSums PredictionError::run(const std::vector<double>& params, const std::vector<double>& step,
                                    double force_sd) {
  const auto d = static_cast<Eigen::Index>(free_.size()), nx = static_cast<Eigen::Index>(model_.state_count);
  for (std::uint32_t i = 0; i < config_.param_count; ++i) std::fill_n(params_.begin() + i * lanes_, lanes_, params[i]);
  for (std::size_t j = 0; j < free_.size(); ++j) params_[free_[j] * lanes_ + j + 1] += step[j];
  step_ = step;
  PredictionSums sums;
  sums.gradient = Eigen::VectorXd::Zero(d);
  sums.information = Eigen::MatrixXd::Zero(d, d);
  response_ = Eigen::VectorXd::Zero(nx);
  double steps = 0.0;
  sums.finite = true;
  for (std::size_t g = 0; g < grids_.size() && sums.finite; ++g) {
    if (starts_[g].empty()) continue;
    const Start& start = starts_[g][0];
    x_ = start.state;
    p_ = start.sd.cwiseAbs2().asDiagonal();
    s_ = Eigen::MatrixXd::Zero(nx, d);
    std::fill(effect_state_.begin(), effect_state_.end(), 0.0);
    for (std::uint32_t e = 0; e < setup_.effect_count; ++e)
      if (has_role(setup_.effects[e].kind, kFollows))
        effect_state_[setup_.effects[e].state] = grids_[g].input[setup_.effects[e].port][start.point];
      else if (has_role(setup_.effects[e].kind, kClock))
        effect_state_[setup_.effects[e].state] = grids_[g].since_start_s(start.point);
    for (std::size_t k = start.point; k + 1 < grids_[g].points() && sums.finite; ++k) {
      sums.finite = advance(grids_[g], k, force_sd);
      if (sums.finite) correct(grids_[g], k + 1, sums);
      ++steps;
      const std::size_t since = k + 1 - start.point;
      if (kept_ && static_cast<double>(since) * grids_[g].period_s >= 1.0 && since % every_ == 0)
        kept_->push_back({g, k + 1, x_, p_});
    }
  }
  sums.finite = sums.finite && sums.count > 0.0 && std::isfinite(sums.log_likelihood);
  sums.response = (response_ / std::max(steps, 1.0)).cwiseSqrt();
  return sums;
}

std::vector<Filtered> PredictionError::filter(const std::vector<double>& params, const std::vector<double>& step,
                                              double force_sd, std::size_t every) {
  std::vector<Filtered> kept;
  kept_ = &kept;
  every_ = every;
  if (!run(params, step, force_sd).finite) kept.clear();
  kept_ = nullptr;
  return kept;
}

/// From grid point `point` to the next: the state, its derivatives and its covariance.
bool PredictionError::advance(const Grid& grid, std::size_t point, double force_sd) {
  const std::uint32_t nx = model_.state_count, nu = model_.input_count;
  double control[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < nu; ++i) control[i] = grid.input[i][point];
  for (std::size_t age = 0; age < setup_.delay_steps; ++age)
    for (std::uint32_t i = 0; i < nu; ++i) history_[age * nu + i] = grid.input[i][point > age ? point - 1 - age : 0];
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = lanes_;
  job.period_s = grid.period_s;
  job.state = {x_.data(), 0};
  job.params = {params_.data(), lanes_};
  job.effect_state = {effect_state_.data(), 0};
  job.control = {control, 0};
  job.history = history_.data();
  job.next_state = next_.data();
  job.next_effect_state = next_effect_.data();
  job.a = a_.data();
  table_.linearise(model_, job);
  Eigen::MatrixXd a(nx, nx), b(nx, static_cast<Eigen::Index>(free_.size()));
  for (std::uint32_t r = 0; r < nx; ++r) {
    for (std::uint32_t c = 0; c < nx; ++c) a(r, c) = a_[(r * nx + c) * lanes_];
    for (std::size_t j = 0; j < free_.size(); ++j)
      b(r, static_cast<Eigen::Index>(j)) = (next_[r * lanes_ + j + 1] - next_[r * lanes_]) / step_[j];
    x_(r) = next_[r * lanes_];
  }
  for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i) effect_state_[i] = next_effect_[i * lanes_];
  push_ = Eigen::VectorXd::Zero(nx);
  for (std::size_t j = 0; j < free_.size(); ++j)
    if (std::find(force_parts_.begin(), force_parts_.end(), free_[j]) != force_parts_.end())
      push_ += b.col(static_cast<Eigen::Index>(j));
  response_ += push_.cwiseAbs2();
  s_ = a * s_ + b;
  p_ = a * p_ * a.transpose() + force_sd * force_sd * push_ * push_.transpose();
  for (std::uint32_t i = 0; i < nx; ++i) p_(i, i) += config_.process_sd[i] * config_.process_sd[i] * grid.period_s;
  return x_.allFinite() && s_.allFinite() && p_.allFinite();
}

/// One value after the other, each with its own variance.
void PredictionError::correct(const Grid& grid, std::size_t point, PredictionSums& sums) {
  for (std::uint32_t c = 0; c < config_.measurement_count; ++c) {
    const std::uint32_t i = config_.measured_state[c];
    const double value = grid.state[i][point];
    if (!std::isfinite(value)) continue;
    const double error = state_difference(model_, i, value, x_(i));
    const double variance = p_(i, i) + config_.measurement_sd[c] * config_.measurement_sd[c];
    if (!(error * error < kLargest * kLargest * variance)) {
      sums.finite = false;
      return;
    }
    const Eigen::VectorXd gain = p_.col(i) / variance;
    const Eigen::RowVectorXd slope = s_.row(i), spread = p_.row(i);
    sums.log_likelihood -= 0.5 * (std::log(variance) + error * error / variance);
    sums.squared += error * error / variance;
    sums.count += 1.0;
    sums.gradient += slope.transpose() * (error / variance);
    sums.information += slope.transpose() * slope / variance;
    x_ += gain * error;
    s_ -= gain * slope;
    p_ -= gain * spread;
    p_ = 0.5 * (p_ + p_.transpose().eval());
  }
}

}  // namespace tiller::tools::gap
