#include "tools/gap/fit/shooting.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/gap/fit/elimination.hpp"
#include "tools/gap/fit/unseen.hpp"

namespace tiller::tools::gap {
namespace {

constexpr int kRescues = 3;
constexpr std::size_t kUnseenWindows = 32;  // from which the spread of unseen states is taken

std::size_t most_points(const std::vector<Window>& windows) {
  std::size_t most = 0;
  for (const Window& w : windows) most = std::max<std::size_t>(most, w.points);
  return most;
}

// Of each unseen state.
std::vector<EffectAt> owners_of(const Hypothesis& h) {
  std::vector<EffectAt> owners;
  for (const std::uint32_t row : h.unseen)
    for (std::uint32_t e = 0; e < h.setup.effect_count; ++e) {
      const EffectSlot& slot = h.setup.effects[e];
      const auto count = static_cast<std::uint32_t>(effect_info(slot.kind).state_count);
      if (row >= slot.state && row < slot.state + count) owners.push_back({slot.kind, slot.port});
    }
  return owners;
}

}  // namespace

Shooting::Shooting(const WindowData& data, const std::vector<Window>& windows, const tiller_config_t& config,
                   const Scales& scales, ThreadPool* threads)
    : data_(data),
      windows_(windows),
      config_(config),
      model_(*config.model),
      scales_(scales),
      nx_(config.model->state_count),
      ny_(config.measurement_count),
      rows_(config.measurement_count + data.gauges.count()),
      threads_(threads),
      whitening_(config, data.gauges, windows.size(), most_points(windows)) {
  const std::size_t most = most_points(windows);
  const unsigned count = threads ? threads->size() : 1;
  scratch_.reserve(count);
  for (unsigned i = 0; i < count; ++i)
    scratch_.push_back({WindowRollout(data, config, most), std::vector<double>(most * rows_ * kLanes),
                        std::vector<double>((most * rows_ + kMostUnseen) * kMostColumns)});
  std::copy_n(config.measured_state, ny_, measured_);
  gram_.resize(windows.size() * kMostColumns * kMostColumns);
  response_a_.resize(most * nx_ * nx_);
  response_b_.resize(most * nx_);
  response_position_.resize(most);
  response_c_.resize(most * (rows_ - ny_) * nx_);
  deviation_.resize(std::size_t{nx_} * kLanes);
  products_.resize(std::size_t{kLanes} * (kLanes + 1));
}

std::size_t Shooting::bytes_for(const tiller_config_t& config, std::size_t windows, std::size_t points,
                                std::size_t gauges, unsigned threads) {
  const std::size_t nx = config.model->state_count, rows = config.measurement_count + gauges;
  const std::size_t scratch = sizeof(Scratch) + WindowRollout::bytes_for(config, points, gauges) +
                              sizeof(double) * (points * rows * kLanes + (points * rows + kMostUnseen) * kMostColumns);
  return threads * scratch + Whitening::bytes_for(config, windows, points, gauges) +
         sizeof(double) * (points * (nx * nx + nx * (1 + gauges) + 1) + windows * kMostColumns * kMostColumns +
                           (nx + kLanes + 1) * kLanes);
}

Fit Shooting::begin(const Hypothesis& h, const std::vector<double>& params, const Fit* warm) const {
  Fit fit;
  fit.params = params;
  const std::vector<double> centre = prior_centre(h.config);
  for (std::size_t i = fit.params.size(); i < h.config.param_count; ++i) fit.params.push_back(centre[i]);
  fit.params.resize(h.config.param_count);
  if (warm) {
    fit.x0 = warm->x0;
    if (warm->unseen_of == owners_of(h)) fit.unseen = warm->unseen;
  } else {
    for (const Window& w : windows_) fit.x0.insert(fit.x0.end(), w.x0, w.x0 + nx_);
  }
  fit.cost.assign(windows_.size(), 0.0);
  fit.unseen_cost = fit.cost;
  return fit;
}

void Shooting::fill_params(WindowRollout& rollout, const Hypothesis& h, const Fit& fit) const {
  for (std::uint32_t i = 0; i < h.config.param_count; ++i)
    std::fill_n(rollout.params() + i * kLanes, kLanes, fit.params[i]);
}

void Shooting::fill_start(WindowRollout& rollout, const Hypothesis& h, std::size_t index, const Fit& fit) const {
  const std::size_t unseen = fit.unseen.empty() ? 0 : h.unseen.size();
  for (std::uint32_t i = 0; i < nx_; ++i) std::fill_n(rollout.states() + i * kLanes, kLanes, fit.x0[index * nx_ + i]);
  for (std::size_t i = 0; i < unseen; ++i)
    std::fill_n(rollout.unseen() + i * kLanes, kLanes, fit.unseen[index * unseen + i]);
}

void Shooting::measure_unseen(const Hypothesis& h, Fit& fit) {
  const std::size_t count = h.unseen.size(), some = std::min(windows_.size(), kUnseenWindows);
  fit.unseen_of = owners_of(h);
  if (fit.unseen.size() != windows_.size() * count) fit.unseen.assign(windows_.size() * count, 0.0);
  fit.unseen_sd.assign(count, 0.0);
  if (count == 0) return;
  WindowRollout& rollout = scratch_[0].rollout;
  fill_params(rollout, h, fit);
  for (std::size_t n = 0; n < some; ++n) {
    const double* states = rollout.effects_at_start(windows_[n * windows_.size() / some]);
    for (std::size_t i = 0; i < count; ++i) {
      const double at = states[h.unseen[i] * kLanes];
      fit.unseen_sd[i] += at * at / static_cast<double>(some);
    }
  }
  for (double& sd : fit.unseen_sd) sd = std::isfinite(sd) ? std::sqrt(sd) : 0;
}

void Shooting::charge_unseen(const Hypothesis& h, const std::vector<std::size_t>& which, Fit& fit) {
  const std::size_t count = h.unseen.size();
  std::vector<Told> told;
  for (const std::size_t index : which) {
    UnseenVector found(count);
    for (std::size_t i = 0; i < count; ++i)
      found(static_cast<Eigen::Index>(i)) = fit.unseen_sd[i] > 0 ? fit.unseen[index * count + i] / fit.unseen_sd[i] : 0;
    told.push_back(told_of(GramMap(gram_.data() + index * kMostColumns * kMostColumns, stride_, stride_), nx_, found));
  }
  const UnseenVector variance = likely_variance(told);
  for (std::size_t n = 0; n < which.size(); ++n) {
    fit.unseen_cost[which[n]] = price_of(told[n], variance);
    fit.data_cost += fit.unseen_cost[which[n]];
  }
}

void Shooting::descend(const Hypothesis& h, const std::vector<std::size_t>& which, const FitSettings& settings,
                       Fit& fit, bool& current) {
  const bool params = !settings.fix_params && !h.free.empty();
  double damping = 1e-6;
  std::vector<double> step;
  for (int i = 0; i < settings.iterations && !stopped(); ++i, ++fit.iterations) {
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
  for (Scratch& scratch : scratch_) scratch.rollout.use(h);
  const bool params = !settings.fix_params && !h.free.empty();
  if (!settings.fix_params || fit.unseen_sd.size() != h.unseen.size()) measure_unseen(h, fit);
  linearise(h, which, fit, params);
  fit.data_cost = 0;
  fit.iterations = 0;
  const std::uint32_t starts = starts_of(h);
  for (const std::size_t index : which) {
    fit.cost[index] = gram_[index * kMostColumns * kMostColumns + stride_ * stride_ - 1];
    fit.unseen_cost[index] = 0;
    fit.data_cost += fit.cost[index];
  }
  fit.penalty = penalty_of(h, fit.params.data(), 1);
  fit.finite = std::isfinite(fit.total());
  bool current = true;
  for (int round = 0; round < kRescues; ++round) {
    descend(h, which, settings, fit, current);
    const double before = fit.total();
    if (settings.iterations < 2 || !fit.finite || stopped() || !rescue(h, which, fit)) break;
    current = false;
    if (before - fit.total() < settings.tolerance) break;
  }
  const bool information = settings.information && params;
  if (!current && fit.finite && (information || starts > nx_)) linearise(h, which, fit, params);
  if (starts > nx_ && fit.finite) charge_unseen(h, which, fit);
  if (!information) return;
  const std::uint32_t nf = stride_ - starts - 1;
  fit.information.assign(std::size_t{nf} * nf, 0.0);
  fit.slopes.assign(which.size() * nf, 0.0);
  for (std::size_t n = 0; n < which.size(); ++n) {
    const GramMap gram(gram_.data() + which[n] * kMostColumns * kMostColumns, stride_, stride_);
    const Elimination e = eliminate(gram, starts, nf, 0);
    const ParamSquare s = gram.block(starts, starts, nf, nf) + gram.block(starts, 0, nf, starts) * e.second;
    const ParamVector g = gram.block(starts, starts + nf, nf, 1) - gram.block(starts, 0, nf, starts) * e.first;
    for (std::uint32_t i = 0; i < nf; ++i) {
      fit.slopes[n * nf + i] = g(i);
      for (std::uint32_t j = 0; j < nf; ++j) fit.information[i * nf + j] += s(i, j);
    }
  }
  std::vector<double> slope(nf);
  add_prior(h, fit.params, slope.data(), fit.information.data());
}

void Shooting::prepare_whitening(const Hypothesis& nominal, const Fit& fit) {
  WindowRollout& rollout = scratch_[0].rollout;
  rollout.use(nominal);
  for (std::size_t index = 0; index < windows_.size(); ++index) {
    const Window& w = windows_[index];
    fill_start(rollout, nominal, index, fit);
    fill_params(rollout, nominal, fit);
    rollout.run(w);
    whitening_.prepare(index, nominal, data_, w, rollout.trajectory(), kLanes, fit.params.data());
  }
}

const double* Shooting::predict(const Hypothesis& h, const Fit& fit, std::size_t index) {
  WindowRollout& rollout = scratch_[0].rollout;
  rollout.use(h);
  fill_start(rollout, h, index, fit);
  fill_params(rollout, h, fit);
  return rollout.run(windows_[index]);
}

void Shooting::residuals(const Hypothesis& h, const Fit& fit, std::size_t index, std::vector<double>& out) {
  const Window& w = windows_[index];
  std::vector<double>& lanes = scratch_[0].rows;
  const double* predicted = predict(h, fit, index);
  const std::size_t m = w.points * rows_;
  for (std::size_t r = 0; r < m; ++r)
    for (std::uint32_t l = 0; l < kLanes; ++l) lanes[r * kLanes + l] = measured_less(w, r, predicted[r * kLanes + l]);
  whitening_.apply(index, w, data_.grids[w.grid].period_s, lanes.data());
  out.resize(m);
  for (std::size_t r = 0; r < m; ++r) out[r] = lanes[r * kLanes];
}

}  // namespace tiller::tools::gap
