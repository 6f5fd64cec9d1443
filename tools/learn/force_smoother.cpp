#include "tools/learn/force_smoother.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "tools/identify/grid_rollout.hpp"

namespace tiller::tools::learn {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double kHalfWidth_s = 0.05;  // of the parabolas that begin a filter
constexpr std::size_t kBegins = 10;    // periods whose forces still hang on the filter's beginning

/// The configuration with a constant force at every joint, whose values are its last parameters.
bool with_forces(const tiller_config_t& config, Config& out, std::string& error) {
  const std::uint32_t nf = config.model->joint_count;
  if (config.effect_count + nf > TILLER_MAX_EFFECTS || config.param_count + nf > TILLER_MAX_PARAMS) {
    error = "learn: no room for " + std::to_string(nf) + " forces beside the robot's " +
            std::to_string(config.effect_count) + " effects and " + std::to_string(config.param_count) + " parameters";
    return false;
  }
  out = config;
  for (std::uint32_t j = 0; j < nf; ++j) {
    out.effects[out.effect_count++] = {tiller_effect_constant_offset, j};
    out.priors[out.param_count++] = {tiller_prior_fixed, 0, 0.0, 0.0, -HUGE_VAL, HUGE_VAL};
  }
  out.prior_mixture = nullptr;
  return true;
}

/// One period of the model with forces, and its slopes along state and forces.
class ForcedStep {
 public:
  ForcedStep(const tiller_config_t& config, const std::vector<double>& params, const Vector& force_step)
      : nx_(config.model->state_count),
        nf_(config.model->joint_count),
        np_(static_cast<std::uint32_t>(params.size())),
        model_(*config.model),
        rollout_(config, padded(1 + 2 * (nx_ + nf_))),
        force_step_(force_step) {
    const std::uint32_t lanes = rollout_.lanes();
    for (std::uint32_t p = 0; p < np_; ++p) std::fill_n(rollout_.params() + p * lanes, lanes, params[p]);
    state_.resize(std::size_t{nx_} * lanes);
    next_.resize(std::size_t{nx_} * lanes);
    effect_.resize(std::size_t{rollout_.setup().effect_state_count + 1} * lanes);
    effect_next_ = effect_;
  }
  void begin(const Grid& grid, std::size_t point) {
    const std::vector<double> first = rollout_.first_effect_state(grid, point);
    const std::uint32_t lanes = rollout_.lanes();
    for (std::size_t s = 0; s < rollout_.setup().effect_state_count; ++s)
      std::fill_n(&effect_[s * lanes], lanes, first[s]);
  }
  /// z (nx + nf): next (nx), slope (nx x (nx + nf)). The effects' own states go on from the middle lane's.
  bool run(const Grid& grid, std::size_t point, const Vector& z, Vector& next, Matrix& slope) {
    const std::uint32_t lanes = rollout_.lanes(), n = nx_ + nf_;
    for (std::uint32_t i = 0; i < n; ++i) {
      double* const row = i < nx_ ? &state_[std::size_t{i} * lanes] : rollout_.params() + (np_ + i - nx_) * lanes;
      std::fill_n(row, lanes, z(i));
      row[1 + 2 * i] += step_of(i, z(i));
      row[2 + 2 * i] -= step_of(i, z(i));
    }
    RolloutJob<double> job = rollout_.job(grid, point, 1);
    job.state = {state_.data(), lanes};
    job.effect_state = {effect_.data(), lanes};
    job.final_state = next_.data();
    job.final_effect_state = effect_next_.data();
    select_rollout(model_).rollout_f64(model_, job);
    next.resize(nx_);
    slope.resize(nx_, n);
    for (std::uint32_t r = 0; r < nx_; ++r) {
      const double* const row = &next_[std::size_t{r} * lanes];
      next(r) = row[0];
      for (std::uint32_t c = 0; c < n; ++c) slope(r, c) = (row[1 + 2 * c] - row[2 + 2 * c]) / (2.0 * step_of(c, z(c)));
    }
    for (std::size_t s = 0; s < rollout_.setup().effect_state_count; ++s)
      std::fill_n(&effect_[s * lanes], lanes, effect_next_[s * lanes]);
    return next.allFinite() && slope.allFinite();
  }

 private:
  static std::uint32_t padded(std::uint32_t lanes) { return (lanes + kLanePadding - 1) / kLanePadding * kLanePadding; }
  double step_of(std::uint32_t i, double value) const {
    return i < nx_ ? 1e-5 * (1.0 + std::fabs(value)) : force_step_(i - nx_);
  }

  std::uint32_t nx_, nf_, np_;
  const tiller_model_t& model_;
  GridRollout rollout_;
  Vector force_step_;
  std::vector<double> state_, next_, effect_, effect_next_;
};

/// What the smoother needs of one period.
struct Pass {
  Vector z, next;          // filtered at its beginning, predicted at its end
  Matrix p, p_next, gain;  // covariances of both; slope of the whole step
};

class Smoother {
 public:
  Smoother(const tiller_config_t& plain, const tiller_config_t& forced, const std::vector<double>& params,
           const Vector& force_sd)
      : plain_(plain),
        nx_(plain.model->state_count),
        nf_(plain.model->joint_count),
        force_sd_(force_sd),
        step_(forced, params, 1e-3 * force_sd.cwiseMax(1e-9)) {}

  bool run(const Grid& grid, SmoothedForces& out) {
    passes_.clear();
    std::size_t point = 0;
    double state[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
    while (point < grid.points() && !estimate_state(grid, plain_, point, kHalfWidth_s, state, sd)) ++point;
    if (point + 2 > grid.points()) return true;  // nothing to learn from
    begin(state, sd);
    step_.begin(grid, point);
    const std::size_t first = point;
    for (; point + 1 < grid.points(); ++point) {
      measure(grid, point, out);
      if (!predict(grid, point)) return false;
    }
    smooth_back(grid, first, out);
    return true;
  }

 private:
  void begin(const double* state, const double* sd) {
    z_ = Vector::Zero(nx_ + nf_);
    p_ = Matrix::Zero(nx_ + nf_, nx_ + nf_);
    for (std::uint32_t i = 0; i < nx_; ++i) {
      z_(i) = state[i];
      const double wide = 3.0 * (std::isfinite(sd[i]) ? sd[i] : 0.0) + 1e-6;
      p_(i, i) = wide * wide;
    }
    // a force unknown to what it walks in a second
    for (std::uint32_t j = 0; j < nf_; ++j) p_(nx_ + j, nx_ + j) = std::pow(force_sd_(j), 2);
  }
  /// One measured state after the other.
  void measure(const Grid& grid, std::size_t point, SmoothedForces& out) {
    for (std::uint32_t c = 0; c < plain_.measurement_count; ++c) {
      const std::uint32_t i = plain_.measured_state[c];
      const double measured = grid.state[i][point];
      if (!std::isfinite(measured)) continue;
      const double innovation = state_difference(*plain_.model, i, measured, z_(i));
      const double variance = p_(i, i) + std::pow(plain_.measurement_sd[c], 2);
      out.log_likelihood -= 0.5 * (innovation * innovation / variance + std::log(variance));
      const Vector column = p_.col(i);
      z_ += column * (innovation / variance);
      p_ -= column * column.transpose() / variance;
    }
  }
  bool predict(const Grid& grid, std::size_t point) {
    Pass pass;
    pass.z = z_;
    pass.p = p_;
    Vector next;
    Matrix slope;
    if (!step_.run(grid, point, z_, next, slope)) return false;
    pass.gain = Matrix::Identity(nx_ + nf_, nx_ + nf_);
    pass.gain.topRows(nx_) = slope;
    pass.next = z_;
    pass.next.head(nx_) = next;
    pass.p_next = pass.gain * p_ * pass.gain.transpose();
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double unit = 1e-9 * (1.0 + std::fabs(next(i)));  // keeps the covariance regular
      pass.p_next(i, i) += std::pow(plain_.process_sd[i], 2) * grid.period_s + unit * unit;
    }
    for (std::uint32_t j = 0; j < nf_; ++j) pass.p_next(nx_ + j, nx_ + j) += std::pow(force_sd_(j), 2) * grid.period_s;
    z_ = pass.next;
    p_ = 0.5 * (pass.p_next + pass.p_next.transpose());
    passes_.push_back(std::move(pass));
    return z_.allFinite() && p_.allFinite() && z_.cwiseAbs().maxCoeff() < 1e9;
  }
  /// From the last period to the first: each beginning, given its end.
  void smooth_back(const Grid& grid, std::size_t first, SmoothedForces& out) {
    Vector z = z_;
    Matrix p = p_;
    const auto count = static_cast<Eigen::Index>(passes_.size());
    const Eigen::Index at = out.state.cols();
    const std::uint32_t nu = plain_.model->input_count;
    out.state.conservativeResize(nx_, at + count);
    out.filtered.conservativeResize(nx_, at + count);
    out.input.conservativeResize(nu, at + count);
    out.force.conservativeResize(nf_, at + count);
    out.variance.conservativeResize(nf_, at + count);
    out.weight.resize(static_cast<std::size_t>(at + count), 1.0);
    for (Eigen::Index k = count; k-- > 0;) {
      const Pass& pass = passes_[static_cast<std::size_t>(k)];
      const Matrix back = pass.p_next.ldlt().solve(pass.gain * pass.p).transpose();
      z = pass.z + back * (z - pass.next);
      p = pass.p + back * (p - pass.p_next) * back.transpose();
      out.state.col(at + k) = z.head(nx_);
      out.filtered.col(at + k) = pass.z.head(nx_);
      out.force.col(at + k) = z.tail(nf_);
      out.variance.col(at + k) = p.diagonal().tail(nf_).cwiseMax(1e-12);
      for (std::uint32_t i = 0; i < nu; ++i) out.input(i, at + k) = grid.input[i][first + static_cast<std::size_t>(k)];
      if (static_cast<std::size_t>(k) < kBegins) out.weight[static_cast<std::size_t>(at + k)] = 0.0;
    }
  }

  const tiller_config_t& plain_;
  std::uint32_t nx_, nf_;
  Vector force_sd_;
  ForcedStep step_;
  Vector z_;
  Matrix p_;
  std::vector<Pass> passes_;
};

}  // namespace

bool smooth_forces(const tiller_config_t& config, const std::vector<Grid>& grids, const std::vector<double>& params,
                   const Eigen::VectorXd& force_sd, SmoothedForces& out, std::string& error) {
  Config forced;
  if (!with_forces(config, forced, error)) return false;
  out = SmoothedForces{};
  Smoother smoother(config, forced, params, force_sd);
  for (const Grid& grid : grids)
    if (!smoother.run(grid, out)) {
      error = "learn: the model runs away on " + grid.path + "; its parameters are far off: `tiller identify` first";
      return false;
    }
  if (out.force.cols() > 0) return true;
  error = "learn: no log holds ten periods in which every measured state is known";
  return false;
}

Eigen::VectorXd typical_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                               const std::vector<double>& params) {
  const std::uint32_t nx = config.model->state_count, nf = config.model->joint_count;
  Vector squares = Vector::Zero(nf), count = Vector::Zero(nf), response = Vector::Zero(nf);
  Config forced;
  std::string error;
  if (!with_forces(config, forced, error)) return squares;
  ForcedStep step(forced, params, Vector::Ones(nf));
  int responses = 0;
  for (const Grid& grid : grids) {
    // twentieths of a second: between neighbours at a kilohertz the sensors' noise is most of the difference
    const auto every = static_cast<std::size_t>(std::max(2.0, std::round(0.05 / grid.period_s)));
    double before[TILLER_MAX_STATES], state[TILLER_MAX_STATES];
    bool knew = false;
    for (std::size_t point = 0; point + 1 < grid.points(); point += every) {
      const bool knows = estimate_state(grid, config, point, kHalfWidth_s, state);
      Vector z = Vector::Zero(nx + nf), next;
      Matrix slope;
      for (std::uint32_t i = 0; knows && i < nx; ++i) z(i) = state[i];
      step.begin(grid, point);
      if (knows && step.run(grid, point, z, next, slope)) {
        for (std::uint32_t j = 0; j < nf; ++j)
          response(j) += std::fabs(slope(config.model->joints[j].velocity, nx + j)) / grid.period_s;
        ++responses;
      }
      for (std::uint32_t j = 0; knows && knew && j < nf; ++j) {
        const std::uint32_t v = config.model->joints[j].velocity;
        squares(j) += std::pow((state[v] - before[v]) / (static_cast<double>(every) * grid.period_s), 2);
        count(j) += 1;
      }
      std::copy(state, state + nx, before);
      knew = knows;
    }
  }
  for (std::uint32_t j = 0; j < nf; ++j)
    squares(j) = count(j) > 0 && response(j) > 0 ? std::sqrt(squares(j) / count(j)) * responses / response(j) : 0.0;
  return squares;
}

Eigen::VectorXd choose_force_sd(const tiller_config_t& config, const std::vector<Grid>& grids,
                                const std::vector<double>& params, const Eigen::VectorXd& typical,
                                double* log_likelihood) {
  const auto likelihood = [&](const Vector& sd) {
    SmoothedForces out;
    std::string error;
    return smooth_forces(config, grids, params, sd, out, error) ? out.log_likelihood : -HUGE_VAL;
  };
  // walks that reach the typical force in three hundred seconds to three milliseconds
  constexpr double kFactors[] = {0.05, 0.15, 0.5, 1.5, 5.0, 15.0};
  Vector best = typical;
  double most = -HUGE_VAL;
  for (const double factor : kFactors) {
    const double value = likelihood(factor * typical);
    if (value > most) {
      most = value;
      best = factor * typical;
    }
  }
  for (Eigen::Index j = 0; best.size() > 1 && j < best.size(); ++j)
    for (const double factor : {0.1, 0.33, 3.0}) {
      Vector other = best;
      other(j) *= factor;
      const double value = likelihood(other);
      if (!(value > most)) continue;
      most = value;
      best = other;
    }
  if (log_likelihood) *log_likelihood = most;
  return best;
}

Config with_honest_sensors(const tiller_config_t& config, const std::vector<Grid>& grids,
                           const std::vector<double>& params, const Eigen::VectorXd& typical,
                           Eigen::VectorXd& force_sd) {
  Config best = config;
  double most = -HUGE_VAL;
  for (const double factor : {1.0, 2.0, 4.0, 8.0}) {
    Config with = config;
    for (std::uint32_t c = 0; c < config.measurement_count; ++c) with.measurement_sd[c] *= factor;
    double likelihood = -HUGE_VAL;
    const Vector sd = choose_force_sd(with, grids, params, typical, &likelihood);
    if (!(likelihood > most)) {
      if (std::isfinite(most)) break;  // it has one maximum
      continue;
    }
    most = likelihood;
    best = with;
    force_sd = sd;
  }
  return best;
}

}  // namespace tiller::tools::learn
