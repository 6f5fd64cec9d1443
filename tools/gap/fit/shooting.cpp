#include "tools/gap/fit/shooting.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace tiller::tools::gap {
namespace {

constexpr double kRescueSquares = 1.3;  // a value's: windows that leave more are started anew
constexpr int kRescues = 3;
constexpr double kIrrational[4] = {0.41421356237309515, 0.7320508075688772, 0.23606797749978969, 0.6457513110645906};
constexpr double kParamShare[4] = {1, 0.4, 0.1, 0.02};
constexpr double kStateShare[4] = {1, 0.4, 0.1, 0};

template <int kMost>
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
template <int kMost>
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;
using StateSquare = Square<TILLER_MAX_STATES>;
using StateVector = Vector<TILLER_MAX_STATES>;
using ParamSquare = Square<TILLER_MAX_PARAMS>;
using ParamVector = Vector<TILLER_MAX_PARAMS>;
using Coupling = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, TILLER_MAX_STATES, TILLER_MAX_PARAMS>;

// A window's step of the start state for a step of the parameters: first + second * step.
struct Elimination {
  StateVector first;
  Coupling second;
};

using GramMap = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

Eigen::LDLT<StateSquare> damped(const GramMap& gram, std::uint32_t nx, double damping) {
  StateSquare a = gram.topLeftCorner(nx, nx);
  const double floor = 1e-9 * std::max(1e-12, a.diagonal().maxCoeff());
  for (std::uint32_t i = 0; i < nx; ++i) a(i, i) += damping * a(i, i) + floor;
  return Eigen::LDLT<StateSquare>(a);
}

Elimination eliminate(const GramMap& gram, std::uint32_t nx, std::uint32_t nf, double damping) {
  const Eigen::LDLT<StateSquare> factor = damped(gram, nx, damping);
  Elimination e;
  e.first = factor.solve(StateVector(gram.block(0, nx + nf, nx, 1)));
  e.second = -factor.solve(Coupling(gram.block(0, nx, nx, nf)));
  return e;
}

std::size_t most_points(const std::vector<Window>& windows) {
  std::size_t most = 0;
  for (const Window& w : windows) most = std::max<std::size_t>(most, w.points);
  return most;
}

double penalty_of(const Hypothesis& h, const double* params, std::size_t stride) {
  double sum = 0, slope, curvature;
  for (const FreeParam& f : h.free) sum += prior_penalty(f, params[f.index * stride], &slope, &curvature);
  return sum;
}

}  // namespace

Shooting::Shooting(const WindowData& data, const std::vector<Window>& windows, const tiller_config_t& config,
                   const Scales& scales)
    : data_(data),
      windows_(windows),
      config_(config),
      model_(*config.model),
      scales_(scales),
      nx_(config.model->state_count),
      ny_(config.measurement_count),
      rollout_(data, config, most_points(windows)),
      whitening_(config, windows.size(), most_points(windows)) {
  const std::size_t most = most_points(windows);
  rows_.resize(most * ny_ * kLanes);
  std::copy_n(config.measured_state, ny_, measured_);
  columns_.resize(most * ny_ * (kMostColumns + 1));
  gram_.resize(windows.size() * kMostColumns * kMostColumns);
  response_a_.resize(most * nx_ * nx_);
  response_b_.resize(most * nx_);
  response_position_.resize(most);
  deviation_.resize(std::size_t{nx_} * kLanes);
  products_.resize(std::size_t{kLanes} * (kLanes + 1));
}

std::size_t Shooting::bytes_for(const tiller_config_t& config, std::size_t windows, std::size_t points) {
  const std::size_t nx = config.model->state_count, ny = config.measurement_count;
  return WindowRollout::bytes_for(config, points) + Whitening::bytes_for(config, windows, points) +
         sizeof(double) * (points * (ny * (kLanes + kMostColumns + 1) + nx * nx + nx + 1) +
                           windows * kMostColumns * kMostColumns + (nx + kLanes + 1) * kLanes);
}

Fit Shooting::begin(const Hypothesis& h, const std::vector<double>& params, const Fit* warm) const {
  Fit fit;
  fit.params = params;
  const std::vector<double> centre = prior_centre(h.config);
  for (std::size_t i = fit.params.size(); i < h.config.param_count; ++i) fit.params.push_back(centre[i]);
  fit.params.resize(h.config.param_count);
  if (warm) {
    fit.x0 = warm->x0;
  } else {
    for (const Window& w : windows_) fit.x0.insert(fit.x0.end(), w.x0, w.x0 + nx_);
  }
  fit.cost.assign(windows_.size(), 0.0);
  return fit;
}

// Whitened y - rollout of every lane, after states and params were filled.
const double* Shooting::residual_lanes(const Window& w, std::size_t index) {
  const double* predicted = rollout_.run(w);
  const double* measured = data_.measured[w.grid].data() + w.start * ny_;
  const std::size_t m = std::size_t{w.points} * ny_;
  for (std::size_t r = 0; r < m; ++r)
    for (std::uint32_t l = 0; l < kLanes; ++l) rows_[r * kLanes + l] = measured[r] - predicted[r * kLanes + l];
  whitening_.apply(index, w, rows_.data());
  ++rollouts_;
  return rows_.data();
}

// Columns of one window: whitened derivatives of the prediction by start state and parameters, then the residual; and
// their products.
void Shooting::differentiate(const Hypothesis& h, std::size_t index, const Fit& fit, bool params) {
  const Window& w = windows_[index];
  const std::uint32_t nf = params ? static_cast<std::uint32_t>(h.free.size()) : 0, count = nx_ + nf,
                      np = h.config.param_count;
  const std::size_t m = std::size_t{w.points} * ny_;
  const double* measured = data_.measured[w.grid].data() + w.start * ny_;
  for (std::uint32_t first = 0; first < count; first += kLanes - 1) {
    double step[kLanes] = {};
    const std::uint32_t here = std::min(count - first, kLanes - 1);
    for (std::uint32_t i = 0; i < nx_; ++i)
      std::fill_n(rollout_.states() + i * kLanes, kLanes, fit.x0[index * nx_ + i]);
    for (std::uint32_t i = 0; i < np; ++i) std::fill_n(rollout_.params() + i * kLanes, kLanes, fit.params[i]);
    for (std::uint32_t c = 0; c < here; ++c) {
      const std::uint32_t which = first + c, lane = c + 1;
      if (which < nx_) {
        step[lane] = 1e-5 * scales_.channel[which];
        rollout_.states()[which * kLanes + lane] += step[lane];
      } else {
        const FreeParam& f = h.free[which - nx_];
        step[lane] = 1e-5 * std::max(std::fabs(fit.params[f.index]), 0.05 * f.scale);
        if (fit.params[f.index] + step[lane] > f.high) step[lane] = -step[lane];
        rollout_.params()[f.index * kLanes + lane] += step[lane];
      }
    }
    const double* predicted = rollout_.run(w);
    ++rollouts_;
    for (std::size_t r = 0; r < m; ++r) {
      const double* row = predicted + r * kLanes;
      rows_[r * kLanes] = measured[r] - row[0];
      for (std::uint32_t l = 1; l < kLanes; ++l) rows_[r * kLanes + l] = step[l] != 0 ? (row[l] - row[0]) / step[l] : 0;
    }
    whitening_.apply(index, w, rows_.data());
    for (std::size_t r = 0; r < m; ++r) {
      for (std::uint32_t c = 0; c < here; ++c) columns_[r * stride_ + first + c] = rows_[r * kLanes + c + 1];
      columns_[r * stride_ + count] = rows_[r * kLanes];
    }
  }
  double* gram = gram_.data() + index * kMostColumns * kMostColumns;
  std::fill_n(gram, stride_ * stride_, 0.0);
  for (std::size_t r = 0; r < m; ++r) {
    const double* row = columns_.data() + r * stride_;
    for (std::uint32_t a = 0; a < stride_; ++a)
      for (std::uint32_t b = 0; b < stride_; ++b) gram[a * stride_ + b] += row[a] * row[b];
  }
}

void Shooting::linearise(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, bool params) {
  stride_ = nx_ + (params ? static_cast<std::uint32_t>(h.free.size()) : 0) + 1;
  for (const std::size_t index : which) differentiate(h, index, fit, params);
}

// The parameters' step within their bounds: those that a step would push out are held at the bound, and the others are
// solved for again.
bool Shooting::solve(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, double damping,
                     std::vector<double>& step) {
  const std::uint32_t nf = stride_ - nx_ - 1;
  step.assign(nf, 0.0);
  if (nf == 0) return true;
  ParamSquare s = ParamSquare::Zero(nf, nf);
  ParamVector g = ParamVector::Zero(nf);
  for (const std::size_t index : which) {
    const GramMap gram(gram_.data() + index * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, nx_, nf, 0);
    s += gram.block(nx_, nx_, nf, nf) + gram.block(nx_, 0, nf, nx_) * e.second;
    g += gram.block(nx_, nx_ + nf, nf, 1) - gram.block(nx_, 0, nf, nx_) * e.first;
  }
  for (std::uint32_t i = 0; i < nf; ++i) {
    double slope, curvature;
    prior_penalty(h.free[i], fit.params[h.free[i].index], &slope, &curvature);
    s(i, i) += curvature;
    g(i) -= slope;
  }
  ParamVector size(nf), fixed = ParamVector::Zero(nf);
  for (std::uint32_t i = 0; i < nf; ++i) {
    // in units of the typical magnitude, so that one that the data do not see stays where it is
    size(i) = 1 / std::max(1e-12, h.free[i].scale);
    s(i, i) += damping * s(i, i) + 1e-8 * size(i) * size(i);
  }
  std::uint32_t held = 0;
  for (std::uint32_t round = 0; round <= nf; ++round) {
    ParamSquare a = s;
    ParamVector b = g;
    for (std::uint32_t i = 0; i < nf; ++i)
      if (held >> i & 1u) b -= s.col(i) * fixed(i);
    for (std::uint32_t i = 0; i < nf; ++i)
      if (held >> i & 1u) {
        a.row(i).setZero();
        a.col(i).setZero();
        a(i, i) = 1;
        b(i) = fixed(i);
      }
    ParamVector d = ParamVector(1.0 / a.diagonal().array().sqrt());
    const ParamSquare scaled = d.asDiagonal() * a * d.asDiagonal();
    const ParamVector x = d.asDiagonal() * scaled.ldlt().solve(d.asDiagonal() * b);
    if (!x.allFinite()) return false;
    bool more = false;
    for (std::uint32_t i = 0; i < nf; ++i) {
      if (held >> i & 1u) continue;
      const double at = fit.params[h.free[i].index], to = std::clamp(at + x(i), h.free[i].low, h.free[i].high);
      if (to == at + x(i)) continue;
      fixed(i) = to - at;
      held |= 1u << i;
      more = true;
    }
    if (more) continue;
    for (std::uint32_t i = 0; i < nf; ++i) step[i] = x(i);
    return true;
  }
  return false;
}

// Sixteen trials of every window: total cost after the best, which is taken where it is below the fit's; else the
// fit stays.
double Shooting::try_steps(const Hypothesis& h, const std::vector<std::size_t>& which, const std::vector<double>& step,
                           double damping, Fit& fit) {
  const std::uint32_t nf = stride_ - nx_ - 1, np = h.config.param_count;
  std::vector<double> params(std::size_t{np} * kLanes), best(which.size() * 4), x0(which.size() * 4 * nx_);
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    for (std::uint32_t i = 0; i < np; ++i) params[i * kLanes + l] = fit.params[i];
    for (std::uint32_t i = 0; i < nf; ++i)
      params[h.free[i].index * kLanes + l] =
          std::clamp(fit.params[h.free[i].index] + kParamShare[l / 4] * step[i], h.free[i].low, h.free[i].high);
  }
  double total[4];
  for (int s = 0; s < 4; ++s) total[s] = penalty_of(h, params.data() + 4 * s, kLanes);
  for (std::size_t n = 0; n < which.size(); ++n) {
    const std::size_t index = which[n];
    const Window& w = windows_[index];
    const GramMap gram(gram_.data() + index * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, nx_, nf, damping);
    std::copy(params.begin(), params.end(), rollout_.params());
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      StateVector d = e.first;
      for (std::uint32_t i = 0; i < nf; ++i) d += kParamShare[l / 4] * step[i] * e.second.col(i);
      for (std::uint32_t i = 0; i < nx_; ++i)
        rollout_.states()[i * kLanes + l] = fit.x0[index * nx_ + i] + kStateShare[l % 4] * d(i);
    }
    double cost[kLanes] = {};
    const double* rows = residual_lanes(w, index);
    for (std::size_t r = 0; r < std::size_t{w.points} * ny_; ++r)
      for (std::uint32_t l = 0; l < kLanes; ++l) cost[l] += rows[r * kLanes + l] * rows[r * kLanes + l];
    for (std::uint32_t s = 0; s < 4; ++s) {
      std::uint32_t lane = 4 * s;
      for (std::uint32_t l = 4 * s + 1; l < 4 * s + 4; ++l)
        if (cost[l] < cost[lane] || !std::isfinite(cost[lane])) lane = l;
      best[n * 4 + s] = cost[lane];
      total[s] += cost[lane];
      for (std::uint32_t i = 0; i < nx_; ++i) x0[(n * 4 + s) * nx_ + i] = rollout_.states()[i * kLanes + lane];
    }
  }
  std::uint32_t s = 0;
  for (std::uint32_t i = 1; i < 4; ++i)
    if (total[i] < total[s] || !std::isfinite(total[s])) s = i;
  if (!std::isfinite(total[s]) || (fit.finite && total[s] >= fit.total())) return INFINITY;
  for (std::uint32_t i = 0; i < np; ++i) fit.params[i] = params[i * kLanes + 4 * s];
  fit.penalty = penalty_of(h, fit.params.data(), 1);
  fit.data_cost = 0;
  for (std::size_t n = 0; n < which.size(); ++n) {
    fit.cost[which[n]] = best[n * 4 + s];
    fit.data_cost += best[n * 4 + s];
    std::copy_n(x0.begin() + static_cast<std::ptrdiff_t>((n * 4 + s) * nx_), nx_,
                fit.x0.begin() + static_cast<std::ptrdiff_t>(which[n] * nx_));
  }
  fit.finite = true;
  return total[s];
}

// Start states of windows that are far from explained, drawn anew about what the measurements say: under dry friction a
// start at rest has no slope to leave it by. The first lane is the fit's own, so that nothing gets worse.
bool Shooting::rescue(const Hypothesis& h, const std::vector<std::size_t>& which, Fit& fit) {
  bool any = false;
  for (const std::size_t index : which) {
    const Window& w = windows_[index];
    if (fit.cost[index] < kRescueSquares * static_cast<double>(whitening_.values(index))) continue;
    for (std::uint32_t i = 0; i < h.config.param_count; ++i)
      std::fill_n(rollout_.params() + i * kLanes, kLanes, fit.params[i]);
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double now = fit.x0[index * nx_ + i], seen = w.x0[i];
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        // a lattice over the states (Kronecker's sequence by the roots of two and others), about the measurements
        const double turn = static_cast<double>(l) * kIrrational[i % 4] + 0.13 * i,
                     place = 2 * (turn - std::floor(turn)) - 1;
        double at = seen + 3 * w.x0_sd[i] * place;
        if (l == 0) at = now;
        if (l == 1) at = seen;
        if (l == 2) at = seen - (now - seen);
        rollout_.states()[i * kLanes + l] = at;
      }
    }
    double cost[kLanes] = {};
    const double* rows = residual_lanes(w, index);
    for (std::size_t r = 0; r < std::size_t{w.points} * ny_; ++r)
      for (std::uint32_t l = 0; l < kLanes; ++l) cost[l] += rows[r * kLanes + l] * rows[r * kLanes + l];
    std::uint32_t lane = 0;
    for (std::uint32_t l = 1; l < kLanes; ++l)
      if (cost[l] < cost[lane]) lane = l;
    if (lane == 0 || !(cost[lane] < fit.cost[index])) continue;
    fit.data_cost += cost[lane] - fit.cost[index];
    fit.cost[index] = cost[lane];
    for (std::uint32_t i = 0; i < nx_; ++i) fit.x0[index * nx_ + i] = rollout_.states()[i * kLanes + lane];
    any = true;
  }
  return any;
}

void Shooting::descend(const Hypothesis& h, const std::vector<std::size_t>& which, const FitSettings& settings,
                       Fit& fit, bool& current) {
  const bool params = !settings.fix_params && !h.free.empty();
  double damping = 1e-6;
  std::vector<double> step;
  for (int i = 0; i < settings.iterations; ++i, ++fit.iterations) {
    if (!current) linearise(h, which, fit, params);
    current = true;
    const double before = fit.finite ? fit.total() : INFINITY;
    double after = INFINITY;
    for (int attempt = 0; attempt < 3 && !(after < before); ++attempt) {
      if (solve(h, which, fit, damping, step)) after = try_steps(h, which, step, damping, fit);
      damping = after < before ? std::max(1e-9, 0.2 * damping) : std::max(1e-3, damping * 30);
    }
    if (!(after < before)) return;
    current = false;
    if (before - after < settings.tolerance) return;
  }
}

void Shooting::fit(const Hypothesis& h, const std::vector<std::size_t>& which, const FitSettings& settings, Fit& fit) {
  rollout_.use(h);
  const bool params = !settings.fix_params && !h.free.empty();
  linearise(h, which, fit, params);
  fit.data_cost = 0;
  fit.iterations = 0;
  for (const std::size_t index : which) {
    fit.cost[index] = gram_[index * kMostColumns * kMostColumns + stride_ * stride_ - 1];
    fit.data_cost += fit.cost[index];
  }
  fit.penalty = penalty_of(h, fit.params.data(), 1);
  fit.finite = std::isfinite(fit.total());
  bool current = true;
  for (int round = 0; round < kRescues; ++round) {
    descend(h, which, settings, fit, current);
    const double before = fit.total();
    if (settings.iterations < 2 || !fit.finite || !rescue(h, which, fit)) break;
    current = false;
    if (before - fit.total() < settings.tolerance) break;
  }
  if (!settings.information || !params) return;
  if (!current) linearise(h, which, fit, params);
  const std::uint32_t nf = stride_ - nx_ - 1;
  fit.information.assign(std::size_t{nf} * nf, 0.0);
  fit.slopes.assign(which.size() * nf, 0.0);
  for (std::size_t n = 0; n < which.size(); ++n) {
    const GramMap gram(gram_.data() + which[n] * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, nx_, nf, 0);
    const ParamSquare s = gram.block(nx_, nx_, nf, nf) + gram.block(nx_, 0, nf, nx_) * e.second;
    const ParamVector g = gram.block(nx_, nx_ + nf, nf, 1) - gram.block(nx_, 0, nf, nx_) * e.first;
    for (std::uint32_t i = 0; i < nf; ++i) {
      fit.slopes[n * nf + i] = g(i);
      for (std::uint32_t j = 0; j < nf; ++j) fit.information[i * nf + j] += s(i, j);
    }
  }
  for (std::uint32_t i = 0; i < nf; ++i) {
    double slope, curvature;
    prior_penalty(h.free[i], fit.params[h.free[i].index], &slope, &curvature);
    fit.information[i * nf + i] += curvature;
  }
}

void Shooting::prepare_whitening(const Hypothesis& nominal, const Fit& fit) {
  rollout_.use(nominal);
  for (std::size_t index = 0; index < windows_.size(); ++index) {
    const Window& w = windows_[index];
    for (std::uint32_t i = 0; i < nx_; ++i)
      std::fill_n(rollout_.states() + i * kLanes, kLanes, fit.x0[index * nx_ + i]);
    for (std::uint32_t i = 0; i < nominal.config.param_count; ++i)
      std::fill_n(rollout_.params() + i * kLanes, kLanes, fit.params[i]);
    rollout_.run(w);
    whitening_.prepare(index, nominal, data_, w, rollout_.trajectory(), kLanes, fit.params.data());
  }
}

const double* Shooting::predict(const Hypothesis& h, const Fit& fit, std::size_t index) {
  rollout_.use(h);
  for (std::uint32_t i = 0; i < nx_; ++i) std::fill_n(rollout_.states() + i * kLanes, kLanes, fit.x0[index * nx_ + i]);
  for (std::uint32_t i = 0; i < h.config.param_count; ++i)
    std::fill_n(rollout_.params() + i * kLanes, kLanes, fit.params[i]);
  return rollout_.run(windows_[index]);
}

void Shooting::residuals(const Hypothesis& h, const Fit& fit, std::size_t index, std::vector<double>& out) {
  const Window& w = windows_[index];
  const double* predicted = predict(h, fit, index);
  const double* measured = data_.measured[w.grid].data() + w.start * ny_;
  const std::size_t m = std::size_t{w.points} * ny_;
  for (std::size_t r = 0; r < m; ++r)
    for (std::uint32_t l = 0; l < kLanes; ++l) rows_[r * kLanes + l] = measured[r] - predicted[r * kLanes + l];
  whitening_.apply(index, w, rows_.data());
  out.resize(m);
  for (std::size_t r = 0; r < m; ++r) out[r] = rows_[r * kLanes];
}

}  // namespace tiller::tools::gap
