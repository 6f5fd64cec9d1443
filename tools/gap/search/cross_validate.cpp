#include "tools/gap/search/cross_validate.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <string>

#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/spatial_period_scan.hpp"

namespace tiller::tools::gap {
namespace {

// A window's difference, and the log that it is of.
struct Difference {
  double nats = 0;
  const std::string* log = nullptr;
};

double scatter(const std::vector<double>& of) {
  if (of.size() < 2) return 0.0;
  const double n = static_cast<double>(of.size()), mean = std::accumulate(of.begin(), of.end(), 0.0) / n;
  double squares = 0;
  for (const double v : of) squares += (v - mean) * (v - mean);
  return squares * n / (n - 1);
}

// The sum's variance, from squares about each log's own mean: a log in which little moves tells nothing of how sure one
// is of another (stratified sampling; Cochran 1977, chapter 5). About the common mean where a log contradicts the sum by
// more than its own error, or one has too few windows to tell.
double variance_of_sum(const std::vector<Difference>& d, double sum) {
  constexpr std::size_t kFewest = 3;
  std::map<std::string, std::vector<double>> logs;
  std::vector<double> all;
  for (const Difference& x : d) {
    logs[*x.log].push_back(x.nats);
    all.push_back(x.nats);
  }
  double within = 0;
  for (const auto& [log, of] : logs) {
    const double own = std::accumulate(of.begin(), of.end(), 0.0), variance = scatter(of);
    if (of.size() < kFewest || (own * sum < 0 && own * own > variance)) return scatter(all);
    within += variance;
  }
  return within;
}

// Sum over windows in standard errors; single windows cannot decide, so differences are clipped.
double paired_z(std::vector<Difference> d) {
  if (d.size() < 3) return 0;
  std::vector<double> size;
  for (const Difference& x : d) size.push_back(std::fabs(x.nats));
  std::nth_element(size.begin(), size.begin() + static_cast<std::ptrdiff_t>(size.size() * 3 / 4), size.end());
  const double most = std::max(kLeastClip_nats, 3 * size[size.size() * 3 / 4]);
  double sum = 0;
  for (Difference& x : d) {
    x.nats = std::clamp(x.nats, -most, most);
    sum += x.nats;
  }
  const double error = std::sqrt(variance_of_sum(d, sum));
  return error > 0 ? sum / error : 0;
}

}  // namespace

double prior_nats(const Hypothesis& h, const std::vector<double>& params) {
  double sum = 0, slope, curvature;
  for (const FreeParam& free : h.free) {
    if (free.index >= h.own_params) continue;
    const double z = std::sqrt(prior_penalty(free, params[free.index], &slope, &curvature));
    sum += z < kPriorBend ? 0.5 * z * z : kPriorBend * (z - 0.5 * kPriorBend);
  }
  return sum;
}

double Session::sigma(const std::vector<double>& cost, const std::vector<std::size_t>& which) const {
  double sum = 0, freedom = 0;
  for (const std::size_t w : which) {
    sum += cost[w];
    freedom += static_cast<double>(shooting->values(w)) - config.model->state_count;
  }
  return freedom > 0 ? std::sqrt(sum / freedom) : 0;
}

void cross_validate(Session& s, Candidate& entry) {
  const std::size_t nx = s.config.model->state_count;
  if (s.nominal_x0.empty()) s.nominal_x0 = entry.fit.x0;  // it is decided upon first
  entry.cv_cost.assign(s.windows.size(), 0.0);
  entry.unseen_nats = 0;
  for (int f = 0; f < 2; ++f) {
    Fit fit = entry.fit;
    FitSettings settings;
    settings.iterations = 4;
    settings.tolerance = 0.2;
    if (!entry.hypothesis.free.empty()) s.shooting->fit(entry.hypothesis, s.fold[1 - f], settings, fit);
    // Start states anew, from the nominal model's: those of the fit above have seen these windows, and where forces
    // change within the sensors' noise (fine teeth) they alone explain it, by a valley for each window.
    for (const std::size_t w : s.fold[f])
      std::copy_n(s.nominal_x0.begin() + static_cast<std::ptrdiff_t>(w * nx), nx,
                  fit.x0.begin() + static_cast<std::ptrdiff_t>(w * nx));
    std::fill(fit.unseen.begin(), fit.unseen.end(), 0.0);
    FitSettings states;
    states.fix_params = true;
    states.iterations = 8;
    states.tolerance = 0.05;
    s.shooting->fit(entry.hypothesis, s.fold[f], states, fit);
    for (const std::size_t w : s.fold[f]) {
      entry.cv_cost[w] = fit.cost[w];
      entry.unseen_nats += 0.5 * fit.unseen_cost[w];
    }
  }
  entry.choice_nats = choice_nats(s, entry.effects());
  // logs of before count as logs do
  entry.prior_nats =
      s.options.before ? 0.5 * entry.fit.penalty / s.dispersion : prior_nats(entry.hypothesis, entry.fit.params);
  // costs of fits that were stopped halfway compare with nothing; the nominal model has to be there
  entry.decided = !s.stopped() || entry.effects().empty();
}

double held_out_cost(const Session& s, const Candidate& e) {
  double sum = 0;
  for (const std::size_t w : s.work) sum += e.cv_cost[w];
  return sum;
}

double share_of_gap(const Session& s, const Candidate& nominal, const Candidate& better, const Candidate& worse) {
  const double whole = held_out_cost(s, nominal) - held_out_cost(s, better),
               part = held_out_cost(s, worse) - held_out_cost(s, better);
  return whole > 0 && part > 0 ? std::sqrt(part / whole) : 0;
}

Comparison compare(const Session& s, const Candidate& a, const Candidate& b) {
  return compare_on(s, s.work, a.cv_cost, b.cv_cost, a.ahead_nats() - b.ahead_nats());
}

Comparison compare_on(const Session& s, const std::vector<std::size_t>& which, const std::vector<double>& cost_a,
                      const std::vector<double>& cost_b, double ahead_nats) {
  Comparison c;
  const double share = ahead_nats / static_cast<double>(std::max<std::size_t>(1, which.size()));
  std::vector<Difference> gauss, robust;
  for (const std::size_t w : which) {
    const double d = 0.5 * (cost_b[w] - cost_a[w]) / s.dispersion + share;
    c.gain_nats += d;
    const std::string* log = &s.data.grids[s.windows[w].grid].path;
    gauss.push_back({d, log});
    const double floor = 1e-3 * static_cast<double>(s.shooting->values(w));
    const double half = 0.5 * static_cast<double>(s.shooting->values(w)) / s.dispersion;
    robust.push_back({share + half * std::log((cost_b[w] + floor) / (cost_a[w] + floor)), log});
  }
  c.z = paired_z(gauss);
  c.robust_z = paired_z(robust);
  return c;
}

double dispersion_of(Session& s, const Hypothesis& h, const Fit& fit) {
  constexpr int kLags = 20;
  const std::uint32_t ny = s.config.measurement_count;
  double at[kLags + 1] = {}, count = 0;
  std::vector<double> r;
  for (const std::size_t w : s.work) {
    s.shooting->residuals(h, fit, w, r);
    const std::size_t points = s.windows[w].points, gauges = s.data.gauges.count();
    const auto add = [&](std::size_t first, std::size_t stride) {
      for (std::size_t k = 0; k < points; ++k) {
        count += 1;
        for (std::size_t lag = 0; lag <= kLags && lag <= k; ++lag)
          at[lag] += r[first + k * stride] * r[first + (k - lag) * stride];
      }
    };
    for (std::uint32_t i = 0; i < ny; ++i) add(i, ny);
    for (std::size_t g = 0; g < gauges; ++g) add(points * ny + g, gauges);
  }
  if (count == 0 || !(at[0] > 0)) return 1;
  // Bartlett's weights; negative correlation, which the fitted start states make, does not count
  double inflation = 1;
  for (int lag = 1; lag <= kLags; ++lag)
    inflation += 2 * (1 - lag / (kLags + 1.0)) * std::max(0.0, at[lag] / at[0] - 2 / std::sqrt(count));
  return std::max(1.0, at[0] / count) * std::max(1.0, inflation);
}

double difference_sigma(Session& s, const Candidate& a, const Candidate& b) {
  double sum = 0, count = 0;
  std::vector<double> ra, rb;
  for (const std::size_t w : s.work) {
    s.shooting->residuals(a.hypothesis, a.fit, w, ra);
    s.shooting->residuals(b.hypothesis, b.fit, w, rb);
    for (std::size_t i = 0; i < ra.size(); ++i) sum += (ra[i] - rb[i]) * (ra[i] - rb[i]);
    count += static_cast<double>(s.shooting->values(w));
  }
  return count > 0 ? std::sqrt(sum / count) : 0;
}

}  // namespace tiller::tools::gap
