#include "tools/gap/fit/whitening.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools::gap {
namespace {
constexpr std::uint32_t kLanes = WindowRollout::kLanes;
}

Whitening::Whitening(const tiller_config_t& config, const Gauges& gauges, std::size_t windows, std::size_t points)
    : nx_(config.model->state_count),
      ny_(config.measurement_count),
      points_(points),
      gauges_(gauges),
      values_(windows, 0) {
  for (std::uint32_t i = 0; i < nx_; ++i) process_ = process_ || config.process_sd[i] > 0;
  std::copy_n(config.measured_state, ny_, measured_);
  g_.resize(windows * points * ny_);
  w_.resize(windows * points * gauges.count());
  if (!process_) return;
  a_.resize(windows * points * nx_ * nx_);
  k_.resize(windows * points * ny_ * nx_);
  c_.resize(windows * points * gauges.count() * nx_);
  lanes_.resize(std::size_t{nx_ + TILLER_MAX_EFFECT_STATES + 1 + TILLER_MAX_INPUTS + nx_ + nx_ * nx_} * kLanes);
}

// The linearisation of the steps from sixteen points of a path at once.
struct Whitening::Steps {
  const Hypothesis& nominal;
  const WindowData& data;
  const Window& w;
  const double* path;
  std::size_t stride;
  const double* params;
  double *x, *effect, *u, *next, *a;  // (rows x lanes), a: (nx * nx)

  void linearise(std::size_t first) const {
    const tiller_model_t& model = *nominal.config.model;
    const std::uint32_t nx = model.state_count, nu = model.input_count;
    const double no_history[(TILLER_MAX_DELAY_STEPS + 2) * TILLER_MAX_INPUTS] = {};
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const std::size_t at = std::min<std::size_t>(first + l, w.points - 1);
      for (std::uint32_t i = 0; i < nx; ++i) x[i * kLanes + l] = path[(at * nx + i) * stride];
      for (std::uint32_t i = 0; i < nu; ++i) u[i * kLanes + l] = data.controls[w.grid][(w.start + at) * nu + i];
    }
    LineariseJob job;
    job.setup = &nominal.setup;
    job.lanes = kLanes;
    job.period_s = data.grids[w.grid].period_s;
    job.state = {x, kLanes};
    job.params.data = params;
    job.effect_state = {effect, kLanes};
    job.control = {u, kLanes};
    job.history = no_history;
    job.next_state = next;
    job.a = a;
    select_rollout(model).linearise(model, job);
  }
};

void Whitening::prepare(std::size_t index, const Hypothesis& nominal, const WindowData& data, const Window& w,
                        const double* path, std::size_t stride, const double* params) {
  const tiller_config_t& config = nominal.config;
  weigh_measured(index, config, data, w);
  if (!process_) return;
  const double period_s = data.grids[w.grid].period_s;

  double *x = lanes_.data(), *effect = x + nx_ * kLanes, *u = effect + (TILLER_MAX_EFFECT_STATES + 1) * kLanes,
         *next = u + TILLER_MAX_INPUTS * kLanes, *a = next + nx_ * kLanes;
  const Steps steps = {nominal, data, w, path, stride, params, x, effect, u, next, a};
  std::fill_n(effect, (TILLER_MAX_EFFECT_STATES + 1) * kLanes, 0.0);
  double p[TILLER_MAX_STATES * TILLER_MAX_STATES] = {}, p_last[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};
  for (std::size_t k = 0; k < w.points; ++k) {
    const std::uint32_t lane = k % kLanes;
    if (lane == 0) steps.linearise(k);
    double* step = a_.data() + (index * points_ + k) * nx_ * nx_;
    for (std::uint32_t i = 0; i < nx_ * nx_; ++i) step[i] = a[i * kLanes + lane];
    correct(index * points_ + k, p);
    if (gauges_.count() > 0) {
      double state[TILLER_MAX_STATES];
      for (std::uint32_t i = 0; i < nx_; ++i) state[i] = path[(k * nx_ + i) * stride];
      weigh_gauges(index * points_ + k, k, config, period_s, state, params, p, p_last);
      std::copy_n(p, nx_ * nx_, p_last);
    }
    propagate(config, period_s, step, p);
  }
}

void Whitening::weigh_measured(std::size_t index, const tiller_config_t& config, const WindowData& data,
                               const Window& w) {
  const std::vector<double>& measured = data.measured[w.grid];
  values_[index] = 0;
  for (std::size_t k = 0; k < w.points; ++k)
    for (std::uint32_t i = 0; i < ny_; ++i) {
      const bool there = std::isfinite(measured[(w.start + k) * ny_ + i]);
      values_[index] += there;
      g_[(index * points_ + k) * ny_ + i] = there ? 1 / config.measurement_sd[i] : 0;
    }
  const std::size_t count = gauges_.count();
  for (std::size_t k = 0; k < w.points; ++k)
    for (std::size_t g = 0; g < count; ++g) {
      const bool there = k >= gauges_.before(g) && std::isfinite(data.gauged[w.grid][(w.start + k) * count + g]);
      values_[index] += there;
      w_[(index * points_ + k) * count + g] = there ? 1 / gauges_.sd(g) : 0;
    }
}

// A change over a period, as foreseen at its start, carries the process noise of that period, and what the estimate
// there was off by. What is read of a state is off by what its estimate is.
void Whitening::weigh_gauges(std::size_t point, std::size_t k, const tiller_config_t& config, double period_s,
                             const double* state, const double* params, const double* p, const double* p_last) {
  const auto spread = [&](const double* c, const double* of) {
    double sum = 0;
    for (std::uint32_t i = 0; i < nx_; ++i)
      for (std::uint32_t j = 0; j < nx_; ++j) sum += c[i] * of[i * nx_ + j] * c[j];
    return sum;
  };
  for (std::size_t g = 0; g < gauges_.count(); ++g) {
    double* c = &c_[(point * gauges_.count() + g) * nx_];
    gauges_.slope(g, state, params, c);
    double& weight = w_[point * gauges_.count() + g];
    if (weight == 0) continue;
    double variance = 1 / (weight * weight);
    if (gauges_.before(g) == 0) {
      variance += spread(c, p);
    } else if (k > 0) {
      const double *last = c - gauges_.count() * nx_, *step = a_.data() + (point - 1) * nx_ * nx_;
      double change[TILLER_MAX_STATES], kicks = 0;
      for (std::uint32_t j = 0; j < nx_; ++j) {
        change[j] = -last[j];
        for (std::uint32_t i = 0; i < nx_; ++i) change[j] += c[i] * step[i * nx_ + j];
        kicks += c[j] * c[j] * config.process_sd[j] * config.process_sd[j] * period_s;
      }
      variance += (spread(change, p_last) + kicks) / (period_s * period_s);
    }
    weight = 1 / std::sqrt(variance);
  }
}

void Whitening::correct(std::size_t point, double* p) {
  double ap[TILLER_MAX_STATES * TILLER_MAX_STATES];
  for (std::uint32_t i = 0; i < ny_; ++i) {
    double* gain = k_.data() + (point * ny_ + i) * nx_;
    std::fill_n(gain, nx_, 0.0);
    double& weight = g_[point * ny_ + i];
    if (weight == 0) continue;
    const std::uint32_t s = measured_[i];
    const double variance = p[s * nx_ + s] + 1 / (weight * weight);
    for (std::uint32_t r = 0; r < nx_; ++r) gain[r] = p[r * nx_ + s] / variance;
    for (std::uint32_t r = 0; r < nx_; ++r)
      for (std::uint32_t c = 0; c < nx_; ++c) ap[r * nx_ + c] = p[r * nx_ + c] - gain[r] * p[s * nx_ + c];
    std::copy_n(ap, nx_ * nx_, p);
    weight = 1 / std::sqrt(variance);
  }
}

void Whitening::propagate(const tiller_config_t& config, double period_s, const double* step, double* p) const {
  double ap[TILLER_MAX_STATES * TILLER_MAX_STATES];
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t c = 0; c < nx_; ++c) {
      ap[r * nx_ + c] = 0;
      for (std::uint32_t m = 0; m < nx_; ++m) ap[r * nx_ + c] += step[r * nx_ + m] * p[m * nx_ + c];
    }
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t c = 0; c < nx_; ++c) {
      p[r * nx_ + c] = r == c ? config.process_sd[r] * config.process_sd[r] * period_s : 0.0;
      for (std::uint32_t m = 0; m < nx_; ++m) p[r * nx_ + c] += ap[r * nx_ + m] * step[c * nx_ + m];
    }
}

void Whitening::apply_gauges(std::size_t point, std::size_t k, const Deviations& d, double period_s,
                             double* rows) const {
  for (std::size_t g = 0; g < gauges_.count(); ++g) {
    const double weight = w_[point * gauges_.count() + g];
    double* row = rows + g * kLanes;
    if (weight == 0) {
      std::fill_n(row, kLanes, 0.0);
      continue;
    }
    const double* c = &c_[(point * gauges_.count() + g) * nx_];
    const bool change = gauges_.before(g) > 0 && k > 0;
    for (std::uint32_t i = 0; i < nx_; ++i) {
      const double before = change ? *(c + i - gauges_.count() * nx_) : 0;
      for (std::uint32_t l = 0; l < kLanes; ++l)
        row[l] -= change ? (c[i] * d.foreseen[i][l] - before * d.last[i][l]) / period_s : c[i] * d.now[i][l];
    }
    for (std::uint32_t l = 0; l < kLanes; ++l) row[l] *= weight;
  }
}

void Whitening::apply(std::size_t index, const Window& w, double period_s, double* rows) const {
  const double* g = g_.data() + index * points_ * ny_;
  if (!process_) {
    const std::size_t own = std::size_t{w.points} * ny_;
    const double* weights = w_.data() + index * points_ * gauges_.count();
    const auto weigh = [](double* row, double weight) {
      for (std::uint32_t l = 0; l < kLanes; ++l) row[l] = weight == 0 ? 0 : row[l] * weight;
    };
    for (std::size_t r = 0; r < own; ++r) weigh(rows + r * kLanes, g[r]);
    for (std::size_t r = 0; r < w.points * gauges_.count(); ++r) weigh(rows + (own + r) * kLanes, weights[r]);
    return;
  }
  Deviations all = {};
  auto& d = all.now;
  double next[TILLER_MAX_STATES][kLanes];
  for (std::size_t k = 0; k < w.points; ++k) {
    if (gauges_.count() > 0)
      for (std::uint32_t r = 0; r < nx_; ++r) std::copy_n(d[r], kLanes, all.foreseen[r]);
    for (std::uint32_t i = 0; i < ny_; ++i) {
      const double weight = g[k * ny_ + i];
      double* row = rows + (k * ny_ + i) * kLanes;
      if (weight == 0) {
        std::fill_n(row, kLanes, 0.0);
        continue;
      }
      const double* gain = k_.data() + ((index * points_ + k) * ny_ + i) * nx_;
      double e[kLanes];
      for (std::uint32_t l = 0; l < kLanes; ++l) e[l] = row[l] - d[measured_[i]][l];
      for (std::uint32_t r = 0; r < nx_; ++r)
        for (std::uint32_t l = 0; l < kLanes; ++l) d[r][l] += gain[r] * e[l];
      for (std::uint32_t l = 0; l < kLanes; ++l) row[l] = e[l] * weight;
    }
    if (gauges_.count() > 0) {
      apply_gauges(index * points_ + k, k, all, period_s, rows + (w.points * ny_ + k * gauges_.count()) * kLanes);
      for (std::uint32_t r = 0; r < nx_; ++r) std::copy_n(d[r], kLanes, all.last[r]);
    }
    const double* a = a_.data() + (index * points_ + k) * nx_ * nx_;
    for (std::uint32_t r = 0; r < nx_; ++r) {
      for (std::uint32_t l = 0; l < kLanes; ++l) next[r][l] = a[r * nx_] * d[0][l];
      for (std::uint32_t c = 1; c < nx_; ++c)
        for (std::uint32_t l = 0; l < kLanes; ++l) next[r][l] += a[r * nx_ + c] * d[c][l];
    }
    for (std::uint32_t r = 0; r < nx_; ++r) std::copy_n(next[r], kLanes, d[r]);
  }
}

std::size_t Whitening::bytes_for(const tiller_config_t& config, std::size_t windows, std::size_t points,
                                 std::size_t gauges) {
  const std::size_t nx = config.model->state_count, ny = config.measurement_count;
  const std::size_t lanes = nx + TILLER_MAX_EFFECT_STATES + 1 + TILLER_MAX_INPUTS + nx + nx * nx;
  return sizeof(double) * (windows * (points * (ny + nx * nx + ny * nx + gauges * (nx + 1)) + 1) + lanes * kLanes);
}

}  // namespace tiller::tools::gap
