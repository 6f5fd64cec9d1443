#include "tools/gap/search/spatial_period_scan.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::uint32_t kLanes = kLanePadding;
constexpr double kTurn = 6.283185307179586;

struct Peak {
  double spatial_period = 0, reduction = 0;
  std::vector<double> amplitude;
};

// The whole excursion of a joint over the windows, and its typical step.
double excursion(const Session& s, const std::vector<std::size_t>& which, std::uint32_t state) {
  double low = INFINITY, high = -INFINITY;
  for (const std::size_t i : which) {
    const Window& w = s.windows[i];
    for (std::size_t k = w.start; k < w.start + w.points; ++k) {
      const double q = s.data.grids[w.grid].state[state][k];
      if (std::isfinite(q)) low = std::min(low, q), high = std::max(high, q);
    }
  }
  return high - low;
}

double sensor_sd(const Session& s, std::uint32_t state) {
  for (std::uint32_t k = 0; k < s.config.measurement_count; ++k)
    if (s.config.measured_state[k] == state) return s.config.measurement_sd[k];
  return 0;
}

bool has_pitch(const EffectInfo& info) {
  return info.param_count > 2 && info.params[info.param_count - 1].scale == Scale::spatial_period;
}

// Whether the robot file says that a drive train lies before the joint: the motor's orders are no whole ones of it.
bool has_gear(const tiller_config_t& config, std::uint32_t joint) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    for (const std::uint32_t kind : {tiller_effect_joint_inertia, tiller_effect_elastic_joint, tiller_effect_backlash})
      if (config.effects[e].kind == kind && config.effects[e].port == joint) return true;
  return false;
}

std::vector<double> orders(double turn, double shortest, double longest) {
  std::vector<double> frequency;
  for (double n = std::ceil(turn / longest); n * shortest <= turn; n += 1) frequency.push_back(n / turn);
  return frequency;
}

// Periods per unit of position that a scan compares.
std::vector<double> frequencies(const Session& s, const EffectAt& effect) {
  const EffectInfo& info = effect_info(effect.kind);
  const EffectParam& spatial_period = info.params[info.param_count - 1];
  const double range = excursion(s, s.work, s.config.model->joints[effect.port].position);
  const double shortest =
      std::max({spatial_period.low > 0 ? spatial_period.low : 0.0, 3 * s.scales.joint[effect.port].step,
                kSpatialPeriodNoise * sensor_sd(s, s.config.model->joints[effect.port].position)});
  const double longest =
      std::min(spatial_period.high, travel_of(s.scales, *s.config.model, effect.kind, effect.port) / kLeastRepeats);
  if (!(range > 0) || !(longest > shortest)) return {};
  const double span = 1 / shortest - 1 / longest, due = span * range / kPitchStep;
  const double turn = turn_of(s.scales, *s.config.model, effect.kind, effect.port);
  const bool gear = has_gear(s.config, effect.port);
  if (turn > 0 && !gear && due > static_cast<double>(kMostPitches)) return orders(turn, shortest, longest);
  const std::size_t most = gear ? kMostGearPitches : kMostPitches;
  const std::size_t count = std::clamp<std::size_t>(static_cast<std::size_t>(due), 8, most);
  std::vector<double> frequency(count);
  for (std::size_t i = 0; i < count; ++i)
    frequency[i] =
        1 / longest + static_cast<double>(i) * std::min(span / static_cast<double>(count), kPitchStep / range);
  return frequency;
}

}  // namespace

double choice_nats(const Session& s, const std::vector<EffectAt>& effects) {
  double sum = 0;
  for (const EffectAt& e : effects)
    if (has_pitch(info_of(e.kind))) sum += std::log(std::max(1.0, static_cast<double>(frequencies(s, e).size())));
  return sum;
}

namespace {

// Normal equations of every spatial period for the mean of a friction and amplitudes of its harmonics, summed over the
// working windows.
class PeriodFits {
 public:
  PeriodFits(Session& s, const EffectAt& effect, const EffectInfo& info)
      : s_(s),
        info_(info),
        joint_(s.config.model->joints[effect.port]),
        port_(effect.port),
        harmonics_(static_cast<std::uint32_t>(info.param_count - 1) / 2),
        means_(static_cast<std::uint32_t>(info.param_count - 1) % 2),
        opposes_(hook_of(effect.kind) == Hook::dissipation),
        frequency_(frequencies(s, effect)),
        square_(frequency_.size() * columns() * columns(), 0.0),
        cross_(frequency_.size() * columns(), 0.0) {}

  std::uint32_t columns() const { return means_ + 2 * harmonics_; }
  std::size_t count() const { return frequency_.size(); }

  void add_window(const Candidate& base, std::size_t index) {
    if (!s_.shooting->open_response(base.hypothesis, base.fit, index, port_)) return;
    const std::uint32_t per_run = kLanes / columns();
    for (std::size_t first = 0; first < count(); first += per_run)
      add_frequencies(index, first, std::min<std::size_t>(per_run, count() - first));
  }

  std::vector<Peak> solve() const {
    const std::uint32_t n = columns();
    std::vector<Peak> peaks(count());
    for (std::size_t i = 0; i < count(); ++i) {
      Eigen::MatrixXd a = Eigen::Map<const Eigen::MatrixXd>(square_.data() + i * n * n, n, n);
      const Eigen::VectorXd b = Eigen::Map<const Eigen::VectorXd>(cross_.data() + i * n, n);
      a.diagonal().array() += 1e-9 * a.diagonal().maxCoeff() + 1e-12;
      const Eigen::VectorXd x = a.ldlt().solve(b);
      peaks[i] = {1 / frequency_[i], b.dot(x), std::vector<double>(x.data(), x.data() + n)};
      if (!std::isfinite(peaks[i].reduction)) peaks[i].reduction = 0;
    }
    return peaks;
  }

 private:
  void add_frequencies(std::size_t index, std::size_t first, std::size_t here) {
    const Window& w = s_.windows[index];
    const std::uint32_t n = columns();
    double before = NAN, way = 0;  // of the motion: what friction is against
    s_.shooting->force_response(index, [&](std::size_t k, double q, double* force) {
      const double drive =
          info_.needs_drive && joint_.drive != 0 ? s_.data.grids[w.grid].input[joint_.drive - 1][w.start + k] : 1.0;
      if (q != before && std::isfinite(before)) way = q > before ? 1 : -1;
      before = q;
      const double size = opposes_ ? -way : drive;
      for (std::size_t f = 0; f < here; ++f) {
        if (means_ > 0) force[f * n] = size;
        for (std::uint32_t h = 0; h < harmonics_; ++h) {
          const double phase = kTurn * q * frequency_[first + f] * (h + 1);
          force[f * n + means_ + 2 * h] = size * std::cos(phase);
          force[f * n + means_ + 2 * h + 1] = size * std::sin(phase);
        }
      }
    });
    const double* products = s_.shooting->response_products();  // (lanes x lanes), then (lanes) with the residual
    for (std::size_t f = 0; f < here; ++f)
      for (std::uint32_t a = 0; a < n; ++a) {
        cross_[(first + f) * n + a] += products[kLanes * kLanes + f * n + a];
        for (std::uint32_t b = 0; b < n; ++b)
          square_[((first + f) * n + a) * n + b] += products[(f * n + a) * kLanes + f * n + b];
      }
  }

  Session& s_;
  const EffectInfo& info_;
  const tiller_joint_t& joint_;
  std::uint32_t port_, harmonics_, means_;
  bool opposes_;
  std::vector<double> frequency_, square_, cross_;
};

// Indices of the local maxima, the largest first.
std::vector<std::size_t> maxima(const std::vector<Peak>& peaks) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < peaks.size(); ++i)
    if ((i == 0 || peaks[i].reduction >= peaks[i - 1].reduction) &&
        (i + 1 == peaks.size() || peaks[i].reduction >= peaks[i + 1].reduction))
      order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return peaks[a].reduction > peaks[b].reduction; });
  return order;
}

}  // namespace

std::vector<std::vector<double>> scan_spatial_periods(Session& s, const Candidate& base, const EffectAt& effect,
                                                      std::size_t starts) {
  const EffectInfo& info = effect_info(effect.kind);
  if (info.param_count < 3 || !has_pitch(info)) return {};
  PeriodFits fits(s, effect, info);
  if (fits.columns() > kLanes || fits.count() == 0) return {};
  for (const std::size_t index : s.work) fits.add_window(base, index);
  const std::vector<Peak> peaks = fits.solve();
  std::vector<std::vector<double>> found;
  for (const std::size_t i : maxima(peaks)) {
    if (found.size() >= starts) break;
    std::vector<double> start = peaks[i].amplitude;
    for (std::size_t p = 0; p < start.size(); ++p)
      start[p] =
          std::clamp(start[p], 0.9 * std::max(-1e300, info.params[p].low), 0.9 * std::min(1e300, info.params[p].high));
    start.push_back(peaks[i].spatial_period);
    found.push_back(start);
  }
  return found;
}

}  // namespace tiller::tools::gap
