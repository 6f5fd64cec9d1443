// The steps of a fit: derivatives and trials of single windows, which threads share, and the parameters' step over all.
#include <algorithm>
#include <cmath>

#include "tools/gap/fit/elimination.hpp"
#include "tools/gap/fit/shooting.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kRescueSquares = 1.3;  // a value's: windows that leave more are started again
constexpr double kIrrational[4] = {0.41421356237309515, 0.7320508075688772, 0.23606797749978969, 0.6457513110645906};
constexpr double kParamShare[4] = {1, 0.4, 0.1, 0.02};
constexpr double kStateShare[4] = {1, 0.4, 0.1, 0};

}  // namespace

// Whitened y - rollout of every lane, after states and params were filled.
const double* Shooting::residual_lanes(Scratch& scratch, std::size_t index) {
  const Window& w = windows_[index];
  const double* predicted = scratch.rollout.run(w);
  double* rows = scratch.rows.data();
  const std::size_t m = w.points * rows_;
  for (std::size_t r = 0; r < m; ++r)
    for (std::uint32_t l = 0; l < kLanes; ++l) rows[r * kLanes + l] = measured_less(w, r, predicted[r * kLanes + l]);
  whitening_.apply(index, w, data_.grids[w.grid].period_s, rows);
  return rows;
}

void Shooting::lane_costs(Scratch& scratch, std::size_t index, const Fit& fit, double* cost) {
  std::fill_n(cost, kLanes, 0.0);
  const double* rows = residual_lanes(scratch, index);
  for (std::size_t r = 0; r < windows_[index].points * rows_; ++r)
    for (std::uint32_t l = 0; l < kLanes; ++l) cost[l] += rows[r * kLanes + l] * rows[r * kLanes + l];
  for (std::size_t i = 0; i < fit.unseen_sd.size(); ++i)
    for (std::uint32_t l = 0; l < kLanes && fit.unseen_sd[i] > 0; ++l) {
      const double z = scratch.rollout.unseen()[i * kLanes + l] / fit.unseen_sd[i];
      cost[l] += z * z;
    }
}

template <class Work>
void Shooting::share(std::size_t count, const Work& work) {
  const std::size_t threads = std::min(scratch_.size(), count);
  if (threads < 2) {
    for (std::size_t n = 0; n < count; ++n) work(scratch_[0], n);
    return;
  }
  struct Job {
    Shooting* self;
    const Work* work;
    std::size_t count, threads;
  } job = {this, &work, count, threads};
  threads_->run(
      static_cast<std::uint32_t>(threads),
      [](void* arg, std::uint32_t first) {
        const Job& j = *static_cast<const Job*>(arg);
        for (std::size_t n = first; n < j.count; n += j.threads) (*j.work)(j.self->scratch_[first], n);
      },
      &job);
}

// Columns of one window: whitened derivatives of the prediction by start state and parameters, then the residual; and
// their products.
void Shooting::differentiate(Scratch& scratch, const Hypothesis& h, std::size_t index, const Fit& fit, bool params) {
  WindowRollout& rollout = scratch.rollout;
  double *rows = scratch.rows.data(), *columns = scratch.columns.data();
  const Window& w = windows_[index];
  const std::uint32_t nf = params ? static_cast<std::uint32_t>(h.free.size()) : 0, starts = starts_of(h),
                      count = starts + nf;
  const std::size_t m = w.points * rows_;
  for (std::uint32_t first = 0; first < count; first += kLanes - 1) {
    double step[kLanes] = {};
    const std::uint32_t here = std::min(count - first, kLanes - 1);
    fill_start(rollout, h, index, fit);
    fill_params(rollout, h, fit);
    for (std::uint32_t c = 0; c < here; ++c) {
      const std::uint32_t which = first + c, lane = c + 1;
      if (which < nx_) {
        step[lane] = 1e-5 * scales_.channel[which];
        rollout.states()[which * kLanes + lane] += step[lane];
      } else if (which < starts) {  // in units of its deviation
        step[lane] = 1e-5;
        rollout.unseen()[(which - nx_) * kLanes + lane] += step[lane] * fit.unseen_sd[which - nx_];
      } else {
        const FreeParam& f = h.free[which - starts];
        step[lane] = 1e-5 * std::max(std::fabs(fit.params[f.index]), 0.05 * f.scale);
        if (fit.params[f.index] + step[lane] > f.high) step[lane] = -step[lane];
        rollout.params()[f.index * kLanes + lane] += step[lane];
      }
    }
    const double* predicted = rollout.run(w);
    for (std::size_t r = 0; r < m; ++r) {
      const double* row = predicted + r * kLanes;
      rows[r * kLanes] = measured_less(w, r, row[0]);
      for (std::uint32_t l = 1; l < kLanes; ++l) rows[r * kLanes + l] = step[l] != 0 ? (row[l] - row[0]) / step[l] : 0;
    }
    whitening_.apply(index, w, data_.grids[w.grid].period_s, rows);
    for (std::size_t r = 0; r < m; ++r) {
      for (std::uint32_t c = 0; c < here; ++c) columns[r * stride_ + first + c] = rows[r * kLanes + c + 1];
      columns[r * stride_ + count] = rows[r * kLanes];
    }
  }
  for (std::uint32_t i = 0; i < starts - nx_; ++i) {  // a prior is a measurement
    double* row = columns + (m + i) * stride_;
    std::fill_n(row, stride_, 0.0);
    row[nx_ + i] = 1;
    if (fit.unseen_sd[i] > 0) row[count] = -fit.unseen[index * h.unseen.size() + i] / fit.unseen_sd[i];
  }
  double* gram = gram_.data() + index * kMostColumns * kMostColumns;
  std::fill_n(gram, stride_ * stride_, 0.0);
  for (std::size_t r = 0; r < m + starts - nx_; ++r) {
    const double* row = columns + r * stride_;
    for (std::uint32_t a = 0; a < stride_; ++a)
      for (std::uint32_t b = 0; b < stride_; ++b) gram[a * stride_ + b] += row[a] * row[b];
  }
}

void Shooting::linearise(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, bool params) {
  stride_ = starts_of(h) + (params ? static_cast<std::uint32_t>(h.free.size()) : 0) + 1;
  share(which.size(), [&](Scratch& scratch, std::size_t n) { differentiate(scratch, h, which[n], fit, params); });
}

// The parameters' step within their bounds: those that a step would push out are held at the bound, and the others are
// solved for again.
bool Shooting::solve(const Hypothesis& h, const std::vector<std::size_t>& which, const Fit& fit, double damping,
                     std::vector<double>& step) {
  const std::uint32_t starts = starts_of(h), nf = stride_ - starts - 1;
  step.assign(nf, 0.0);
  if (nf == 0) return true;
  ParamSquare s = ParamSquare::Zero(nf, nf);
  ParamVector g = ParamVector::Zero(nf);
  for (const std::size_t index : which) {
    const GramMap gram(gram_.data() + index * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, starts, nf, 0);
    s += gram.block(starts, starts, nf, nf) + gram.block(starts, 0, nf, starts) * e.second;
    g += gram.block(starts, starts + nf, nf, 1) - gram.block(starts, 0, nf, starts) * e.first;
  }
  std::vector<double> slope(nf), curvature(std::size_t{nf} * nf);
  add_prior(h, fit.params, slope.data(), curvature.data());
  for (std::uint32_t i = 0; i < nf; ++i) {
    g(i) -= slope[i];
    for (std::uint32_t j = 0; j < nf; ++j) s(i, j) += curvature[i * nf + j];
  }
  ParamVector size(nf), fixed = ParamVector::Zero(nf);
  for (std::uint32_t i = 0; i < nf; ++i) {
    // in units of the typical magnitude, so that one that the data do not see stays where it is
    size(i) = 1 / std::max(1e-12, h.free[i].scale);
    s(i, i) += damping * s(i, i) + 1e-8 * size(i) * size(i);
  }
  std::uint64_t held = 0;  // a bit for each: an arm with friction at every joint has more than 32
  static_assert(TILLER_MAX_PARAMS <= 64, "what is held at a bound is a word of 64 bits");
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
      held |= std::uint64_t{1} << i;
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
  const std::uint32_t starts = starts_of(h), nf = stride_ - starts - 1, np = h.config.param_count, nh = starts - nx_;
  std::vector<double> params(std::size_t{np} * kLanes), best(which.size() * 4), start(which.size() * 4 * starts);
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    for (std::uint32_t i = 0; i < np; ++i) params[i * kLanes + l] = fit.params[i];
    for (std::uint32_t i = 0; i < nf; ++i)
      params[h.free[i].index * kLanes + l] =
          std::clamp(fit.params[h.free[i].index] + kParamShare[l / 4] * step[i], h.free[i].low, h.free[i].high);
  }
  double total[4];
  for (int s = 0; s < 4; ++s) total[s] = penalty_of(h, params.data() + 4 * s, kLanes);
  share(which.size(), [&](Scratch& scratch, std::size_t n) {
    const std::size_t index = which[n];
    WindowRollout& rollout = scratch.rollout;
    const GramMap gram(gram_.data() + index * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, starts, nf, damping);
    std::copy(params.begin(), params.end(), rollout.params());
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      StateVector d = e.first;
      for (std::uint32_t i = 0; i < nf; ++i) d += kParamShare[l / 4] * step[i] * e.second.col(i);
      for (std::uint32_t i = 0; i < nx_; ++i)
        rollout.states()[i * kLanes + l] = fit.x0[index * nx_ + i] + kStateShare[l % 4] * d(i);
      for (std::uint32_t i = 0; i < nh; ++i)
        rollout.unseen()[i * kLanes + l] =
            fit.unseen[index * nh + i] + kStateShare[l % 4] * fit.unseen_sd[i] * d(nx_ + i);
    }
    double cost[kLanes];
    lane_costs(scratch, index, fit, cost);
    for (std::uint32_t s = 0; s < 4; ++s) {
      std::uint32_t lane = 4 * s;
      for (std::uint32_t l = 4 * s + 1; l < 4 * s + 4; ++l)
        if (cost[l] < cost[lane] || !std::isfinite(cost[lane])) lane = l;
      best[n * 4 + s] = cost[lane];
      double* kept = start.data() + (n * 4 + s) * starts;
      for (std::uint32_t i = 0; i < nx_; ++i) kept[i] = rollout.states()[i * kLanes + lane];
      for (std::uint32_t i = 0; i < nh; ++i) kept[nx_ + i] = rollout.unseen()[i * kLanes + lane];
    }
  });
  for (std::size_t n = 0; n < which.size(); ++n)
    for (std::uint32_t s = 0; s < 4; ++s) total[s] += best[n * 4 + s];
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
    const double* kept = start.data() + (n * 4 + s) * starts;
    std::copy_n(kept, nx_, fit.x0.data() + which[n] * nx_);
    std::copy_n(kept + nx_, nh, fit.unseen.data() + which[n] * nh);
  }
  fit.finite = true;
  return total[s];
}

// Start states of windows that are far from explained, drawn again about what the measurements say: under dry friction
// a start at rest has no slope to leave it by. The first lane is the fit's own, so that nothing gets worse.
double Shooting::rescue_window(Scratch& scratch, const Hypothesis& h, std::size_t index, Fit& fit) {
  if (fit.cost[index] < kRescueSquares * static_cast<double>(whitening_.values(index))) return 0;
  const Window& w = windows_[index];
  WindowRollout& rollout = scratch.rollout;
  fill_start(rollout, h, index, fit);
  fill_params(rollout, h, fit);
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
      rollout.states()[i * kLanes + l] = at;
    }
  }
  double cost[kLanes];
  lane_costs(scratch, index, fit, cost);
  std::uint32_t lane = 0;
  for (std::uint32_t l = 1; l < kLanes; ++l)
    if (cost[l] < cost[lane]) lane = l;
  if (lane == 0 || !(cost[lane] < fit.cost[index])) return 0;
  const double saved = fit.cost[index] - cost[lane];
  fit.cost[index] = cost[lane];
  for (std::uint32_t i = 0; i < nx_; ++i) fit.x0[index * nx_ + i] = rollout.states()[i * kLanes + lane];
  return saved;
}

bool Shooting::rescue(const Hypothesis& h, const std::vector<std::size_t>& which, Fit& fit) {
  std::vector<double> saved(which.size());
  share(which.size(), [&](Scratch& scratch, std::size_t n) { saved[n] = rescue_window(scratch, h, which[n], fit); });
  bool any = false;
  for (const double less : saved) {
    fit.data_cost -= less;
    any = any || less > 0;
  }
  return any;
}

}  // namespace tiller::tools::gap
