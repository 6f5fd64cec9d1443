#include "tools/gap/localise/localise.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/rng.hpp"
#include "tools/gap/localise/order_spectrum.hpp"
#include "tools/gap/localise/residual_force.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kCentreSpacing = 0.1;  // s between test functions: a sixth of their length
// s; between blocks as many centres are left out as their test functions would share: blocks of noise are independent.
constexpr double kBlock = 2.0, kBetweenBlocks = 0.5;
constexpr std::size_t kFewestBlocks = 6;
constexpr int kPermutations = 499;      // at least
constexpr double kFoundLevel = 0.05;    // that any of the maps is found where there is nothing
constexpr double kBinZ = 3.0;           // a bin of the region; 15 bins of noise reach it once in 25 maps
constexpr double kLeastCount = 4;       // test functions: the deviation of a bin with fewer is not known
constexpr std::uint32_t kPurpose = 64;  // of the random numbers

// One axis of one joint over all grids: the value at each point, in the order of the grids' points.
struct AxisValues {
  Axis axis;
  std::string label;
  std::vector<std::vector<double>> value;  // (grids) of (points)
};

std::vector<AxisValues> axes_of(const tiller_model_t& model, const std::vector<ResidualForce>& forces,
                                std::uint32_t j) {
  const tiller_joint_t& joint = model.joints[j];
  const std::string velocity = model.state_names[joint.velocity];
  std::vector<AxisValues> axes;
  const auto add = [&](Axis axis, const std::string& label, auto value) {
    AxisValues a{axis, label, {}};
    for (const ResidualForce& r : forces) {
      a.value.emplace_back();
      for (std::size_t k = 0; k < r.points(); ++k) a.value.back().push_back(value(r, k));
    }
    axes.push_back(std::move(a));
  };
  if (joint.position != TILLER_NO_POSITION)
    add(Axis::position, model.state_names[joint.position],
        [j](const ResidualForce& r, std::size_t k) { return r.position[j][k]; });
  add(Axis::velocity, velocity, [j](const ResidualForce& r, std::size_t k) { return r.velocity[j][k]; });
  if (joint.drive != 0) {
    const std::uint32_t d = joint.drive - 1u;
    const std::string input = model.input_names[d];
    add(Axis::input, input, [d](const ResidualForce& r, std::size_t k) { return r.input[d][k]; });
    add(Axis::input_rate, "d " + input + "/dt",
        [d](const ResidualForce& r, std::size_t k) { return r.input_rate[d][k]; });
    add(Axis::input_sign_square, "sign(" + velocity + ") " + input + "^2",
        [d, j](const ResidualForce& r, std::size_t k) {
          return std::copysign(r.input[d][k] * r.input[d][k], r.velocity[j][k]);
        });
  }
  add(Axis::time, "time_s", [](const ResidualForce& r, std::size_t k) { return r.time_s[k]; });
  return axes;
}

// ---- bins --------------------------------------------------------------------------------------------------------

double quantile_of(const std::vector<double>& sorted, double q) {
  return sorted[static_cast<std::size_t>(std::lround(q * static_cast<double>(sorted.size() - 1)))];
}

void append_quantiles(const std::vector<double>& sorted, int bins, std::vector<double>& edges) {
  for (int b = 1; b < bins; ++b) edges.push_back(quantile_of(sorted, static_cast<double>(b) / bins));
}

// Edges of bins that cover every value. Axes that have a zero get one edge there and as many values in each bin of a
// side; where the axis rests at zero (a held command's rate), a bin of its own.
std::vector<double> make_edges(const AxisValues& axis) {
  std::vector<double> all;
  for (const auto& grid : axis.value)
    for (const double v : grid)
      if (std::isfinite(v)) all.push_back(v);
  if (all.size() < 100) return {};
  std::sort(all.begin(), all.end());
  if (!(all.back() > all.front())) return {};
  std::vector<double> edges = {all.front()};
  if (axis.axis == Axis::time) {
    append_quantiles(all, 8, edges);
  } else if (axis.axis == Axis::position) {  // even: what repeats along the way shows
    const double low = quantile_of(all, 0.01), high = quantile_of(all, 0.99);
    for (int b = 1; b < 16; ++b) edges.push_back(low + (high - low) * b / 16);
  } else {
    const double rest = 0.01 * std::max(std::fabs(quantile_of(all, 0.02)), std::fabs(quantile_of(all, 0.98)));
    std::vector<double> below, above;
    for (const double v : all)
      if (std::fabs(v) > rest) (v < 0 ? below : above).push_back(v);
    const std::size_t resting = all.size() - below.size() - above.size();
    const std::size_t enough = all.size() / 20;
    if (below.size() > enough) append_quantiles(below, 5, edges);
    if (below.size() > enough && above.size() > enough && resting <= enough) edges.push_back(0);
    if (below.size() > enough && resting > enough) edges.push_back(-rest);
    if (above.size() > enough && resting > enough) edges.push_back(rest);
    if (above.size() > enough) append_quantiles(above, 5, edges);
  }
  edges.push_back(all.back());
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

std::size_t bin_of(const std::vector<double>& edges, double value) {
  const auto after = std::upper_bound(edges.begin() + 1, edges.end() - 1, value);
  return static_cast<std::size_t>(after - edges.begin()) - 1;
}

// ---- the weak form -----------------------------------------------------------------------------------------------

// Centres of test functions whose whole support is known, of a joint.
struct Centre {
  std::size_t grid, point;
};
std::vector<Centre> make_centres(const std::vector<ResidualForce>& forces, std::uint32_t joint) {
  std::vector<Centre> centres;
  for (std::size_t g = 0; g < forces.size(); ++g) {
    const ResidualForce& r = forces[g];
    const std::size_t half = test_function(kTestHalfWidth, r.period_s / r.time_scale).size() / 2;
    const auto stride = static_cast<std::size_t>(std::max(1.0, std::round(kCentreSpacing * r.time_scale / r.period_s)));
    std::size_t last_bad = 0;
    for (std::size_t k = 0, next = half; k < r.points(); ++k) {
      if (!std::isfinite(r.force[joint][k])) last_bad = k + 1;
      if (k < next + half) continue;
      if (last_bad + 2 * half <= k) centres.push_back({g, k - half});
      next = k - half + stride;
    }
  }
  return centres;
}

// Runs of neighbouring centres, cut into blocks of one length with the same distance between them. What does not fill
// a block is left out. `block` becomes the number of centres in each.
std::vector<Centre> in_blocks(const std::vector<Centre>& centres, const std::vector<ResidualForce>& forces,
                              std::size_t& block) {
  std::vector<std::size_t> first = {0};  // of each run
  for (std::size_t c = 1; c < centres.size(); ++c) {
    const double step = forces[centres[c].grid].period_s / forces[centres[c].grid].time_scale;
    const bool same = centres[c].grid == centres[c - 1].grid &&
                      static_cast<double>(centres[c].point - centres[c - 1].point) * step < 1.5 * kCentreSpacing;
    if (!same) first.push_back(c);
  }
  first.push_back(centres.size());
  std::size_t longest = 0;
  for (std::size_t r = 0; r + 1 < first.size(); ++r) longest = std::max(longest, first[r + 1] - first[r]);
  const auto between = static_cast<std::size_t>(kBetweenBlocks / kCentreSpacing);
  const auto wanted = static_cast<std::size_t>(kBlock / kCentreSpacing) + between;
  // as many as come nearest to the wanted length; few logs are cut finer
  std::size_t count = std::max<std::size_t>(1, (longest + between + wanted / 2) / wanted);
  if (centres.size() / wanted < kFewestBlocks) count = std::max(count, kFewestBlocks * longest / centres.size());
  block = (longest + between) / count;
  block = block > 2 * between ? block - between : between;
  std::vector<Centre> kept;
  for (std::size_t r = 0; r + 1 < first.size(); ++r)
    for (std::size_t c = first[r]; c + block <= first[r + 1]; c += block + between)
      kept.insert(kept.end(), centres.begin() + static_cast<std::ptrdiff_t>(c),
                  centres.begin() + static_cast<std::ptrdiff_t>(c + block));
  return kept;
}

std::vector<double> weak_residual(const std::vector<ResidualForce>& forces, const std::vector<Centre>& centres,
                                  std::uint32_t joint) {
  std::vector<double> weak;
  for (const Centre& c : centres) {
    const ResidualForce& r = forces[c.grid];
    const std::vector<double> bump = test_function(kTestHalfWidth, r.period_s / r.time_scale);
    const double* f = r.force[joint].data() + c.point - bump.size() / 2;
    weak.push_back(std::inner_product(bump.begin(), bump.end(), f, 0.0));
  }
  return weak;
}

// Row-major (centres x bins): share of each bin in each test function.
std::vector<double> occupancy(const std::vector<ResidualForce>& forces, const std::vector<Centre>& centres,
                              const AxisValues& axis, const std::vector<double>& edges) {
  const std::size_t bins = edges.size() - 1;
  std::vector<double> rows(centres.size() * bins, 0.0);
  for (std::size_t c = 0; c < centres.size(); ++c) {
    const ResidualForce& r = forces[centres[c].grid];
    const std::vector<double> bump = test_function(kTestHalfWidth, r.period_s / r.time_scale);
    const double* value = axis.value[centres[c].grid].data() + centres[c].point - bump.size() / 2;
    for (std::size_t k = 0; k < bump.size(); ++k)
      if (std::isfinite(value[k])) rows[c * bins + bin_of(edges, value[k])] += bump[k];
  }
  return rows;
}

// Least squares of a residual on the bins, factorised once for all permutations. The ridge is far below what a bin with
// data weighs and keeps one without finite.
class BinFit {
 public:
  BinFit(std::vector<double> rows, std::size_t bins) : rows_(std::move(rows)), n_(bins) {
    const std::size_t count = rows_.size() / n_;
    root_.assign(n_ * n_, 0.0);
    for (std::size_t c = 0; c < count; ++c)
      for (std::size_t a = 0; a < n_; ++a)
        for (std::size_t b = 0; b <= a; ++b) root_[a * n_ + b] += rows_[c * n_ + a] * rows_[c * n_ + b];
    double trace = 0;
    for (std::size_t a = 0; a < n_; ++a) trace += root_[a * n_ + a];
    for (std::size_t a = 0; a < n_; ++a) root_[a * n_ + a] += 1e-4 * trace / static_cast<double>(n_);
    for (std::size_t a = 0; a < n_; ++a)  // Cholesky
      for (std::size_t b = 0; b <= a; ++b) {
        double sum = root_[a * n_ + b];
        for (std::size_t k = 0; k < b; ++k) sum -= root_[a * n_ + k] * root_[b * n_ + k];
        root_[a * n_ + b] = a == b ? std::sqrt(std::max(sum, 1e-300)) : sum / root_[b * n_ + b];
      }
  }
  /// Share of the residual's square that the bins take up, 0..1.
  double explained(const std::vector<double>& residual) const {
    double square = 0;
    for (const double r : residual) square += r * r;
    const std::vector<double> half = forward(moments(residual));
    return square > 0 ? std::inner_product(half.begin(), half.end(), half.begin(), 0.0) / square : 0.0;
  }
  std::vector<double> coefficients(const std::vector<double>& residual) const {
    return backward(forward(moments(residual)));
  }
  /// Standard deviations of the coefficients with blocks of `block` rows taken as what is independent (sandwich of
  /// clusters: Liang and Zeger 1986).
  std::vector<double> deviations(const std::vector<double>& residual, std::size_t block) const {
    const std::vector<double> c = coefficients(residual);
    std::vector<double> variance(n_, 0.0);
    const std::size_t blocks = (residual.size() + block - 1) / block;
    for (std::size_t from = 0; from < residual.size(); from += block) {
      std::vector<double> score(n_, 0.0);
      for (std::size_t k = from; k < std::min(from + block, residual.size()); ++k) {
        double left = residual[k];
        for (std::size_t a = 0; a < n_; ++a) left -= rows_[k * n_ + a] * c[a];
        for (std::size_t a = 0; a < n_; ++a) score[a] += rows_[k * n_ + a] * left;
      }
      const std::vector<double> change = backward(forward(score));
      for (std::size_t a = 0; a < n_; ++a) variance[a] += change[a] * change[a];
    }
    const double spare = static_cast<double>(blocks) / std::max(1.0, static_cast<double>(blocks) - 1);
    for (double& v : variance) v = std::sqrt(v * spare);
    return variance;
  }
  double count(std::size_t bin) const {
    double sum = 0;
    for (std::size_t k = bin; k < rows_.size(); k += n_) sum += rows_[k];
    return sum;
  }

 private:
  std::vector<double> moments(const std::vector<double>& residual) const {
    std::vector<double> sum(n_, 0.0);
    for (std::size_t k = 0; k < residual.size(); ++k)
      for (std::size_t a = 0; a < n_; ++a) sum[a] += rows_[k * n_ + a] * residual[k];
    return sum;
  }
  std::vector<double> forward(std::vector<double> b) const {
    for (std::size_t a = 0; a < n_; ++a) {
      for (std::size_t k = 0; k < a; ++k) b[a] -= root_[a * n_ + k] * b[k];
      b[a] /= root_[a * n_ + a];
    }
    return b;
  }
  std::vector<double> backward(std::vector<double> b) const {
    for (std::size_t a = n_; a-- > 0;) {
      for (std::size_t k = a + 1; k < n_; ++k) b[a] -= root_[k * n_ + a] * b[k];
      b[a] /= root_[a * n_ + a];
    }
    return b;
  }

  std::vector<double> rows_;  // (rows x bins)
  std::size_t n_;
  std::vector<double> root_;  // lower triangle
};

// ---- the null ----------------------------------------------------------------------------------------------------

// The residual with its blocks in another order and with other signs.
std::vector<double> shuffled(const std::vector<double>& residual, std::size_t block, Rng& rng) {
  std::vector<std::size_t> order(residual.size() / block);
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1], order[rng.below(static_cast<std::uint32_t>(i))]);
  std::vector<double> out;
  for (const std::size_t from : order) {
    const double sign = (rng.next_u32() & 1u) != 0 ? 1.0 : -1.0;
    for (std::size_t k = 0; k < block; ++k) out.push_back(sign * residual[from * block + k]);
  }
  return out;
}

// What an axis leaves unexplained, on a scale on which nearly everything and everything differ.
double evidence(double explained) { return -std::log(std::max(1 - explained, 1e-9)); }

AxisMap make_map(std::uint32_t joint, const AxisValues& axis, const std::vector<double>& edges, const BinFit& fit,
                 const std::vector<double>& weak, std::size_t block, int permutations, Rng& rng) {
  AxisMap map;
  map.joint = joint;
  map.axis = axis.axis;
  map.axis_label = axis.label;
  const std::vector<double> mean = fit.coefficients(weak), sd = fit.deviations(weak, block);
  for (std::size_t b = 0; b + 1 < edges.size(); ++b)
    map.bins.push_back({edges[b], edges[b + 1], mean[b], sd[b], fit.count(b)});
  map.statistic = evidence(fit.explained(weak));
  double sum = 0, square = 0;
  int above = 0;
  for (int i = 0; i < permutations; ++i) {
    const double value = evidence(fit.explained(shuffled(weak, block, rng)));
    map.null.push_back(value);
    sum += value;
    square += value * value;
    above += value >= map.statistic ? 1 : 0;
  }
  const double centre = sum / permutations;
  map.z = (map.statistic - centre) / std::sqrt(std::max(square / permutations - centre * centre, 1e-300));
  map.p_value = (1.0 + above) / (1.0 + permutations);
  return map;
}

// Whether a constant explains as much of the residual as the map's bins, but for what bins of noise would: the gap is
// the same everywhere, which no axis can claim.
bool is_constant(const AxisMap& map, const std::vector<double>& weak) {
  const double mean = std::accumulate(weak.begin(), weak.end(), 0.0) / static_cast<double>(weak.size());
  const double square = std::inner_product(weak.begin(), weak.end(), weak.begin(), 0.0);
  const double constant = evidence(static_cast<double>(weak.size()) * mean * mean / square);
  const double independent = static_cast<double>(weak.size()) * kCentreSpacing / (2 * kTestHalfWidth);
  return independent * (map.statistic - constant) < 3 * static_cast<double>(map.bins.size());
}

// Puts in front which of the leading joint's maps takes up most of the residual beyond chance, of those whose z are the
// same. A z stands on a deviation from so many permutations, which is known to 1 / sqrt(2 n) of itself: z within
// 2 / sqrt(n) of each other (two deviations of the difference) are in no order.
void order_equals(std::vector<AxisMap>& maps) {
  const auto excess = [](const AxisMap& m) {
    return m.statistic - std::accumulate(m.null.begin(), m.null.end(), 0.0) / static_cast<double>(m.null.size());
  };
  const double least_z = maps[0].z * (1 - 2 / std::sqrt(static_cast<double>(maps[0].null.size())));
  std::size_t best = 0;
  for (std::size_t i = 1; i < maps.size() && maps[i].z >= least_z; ++i)
    if (maps[i].joint == maps[0].joint && excess(maps[i]) > excess(maps[best])) best = i;
  const auto begin = maps.begin();
  std::rotate(begin, begin + static_cast<std::ptrdiff_t>(best), begin + static_cast<std::ptrdiff_t>(best) + 1);
}

// ---- the region --------------------------------------------------------------------------------------------------

double bin_z(const AxisMap::Bin& bin) { return bin.sd > 0 && bin.count >= kLeastCount ? bin.mean / bin.sd : 0; }

// The neighbouring bins of one sign that are no noise and weigh most together.
Region strongest_stretch(const AxisMap& map) {
  Region best;
  double most = 0;
  for (std::size_t first = 0; first < map.bins.size(); ++first) {
    double weight = 0, force = 0, variance = 0, square = 0;
    for (std::size_t b = first; b < map.bins.size(); ++b) {
      const AxisMap::Bin& bin = map.bins[b];
      if (std::fabs(bin_z(bin)) < kBinZ || (bin.mean > 0) != (map.bins[first].mean > 0)) break;
      weight += bin.count;
      force += bin.count * bin.mean;
      variance += std::pow(bin.count * bin.sd, 2);
      square += bin_z(bin) * bin_z(bin);
      if (square <= most) continue;
      most = square;
      best = {true,
              map.joint,
              map.axis,
              map.bins[first].low,
              bin.high,
              force / weight,
              std::sqrt(variance) / weight,
              std::sqrt(square)};
    }
  }
  return best;
}

// ---- over time ---------------------------------------------------------------------------------------------------

constexpr std::size_t kShownPoints = 1000;  // as many as a page is wide

std::vector<MissingForce> along_the_longest(const std::vector<Grid>& grids, const std::vector<ResidualForce>& forces) {
  std::size_t longest = 0;
  for (std::size_t g = 1; g < forces.size(); ++g)
    if (forces[g].points() > forces[longest].points()) longest = g;
  const ResidualForce& r = forces[longest];
  const std::size_t every = (r.points() + kShownPoints - 1) / kShownPoints;
  std::vector<MissingForce> shown;
  for (std::size_t j = 0; j < r.force.size(); ++j) {
    shown.push_back({static_cast<std::uint32_t>(j), grids[longest].path, {}, {}, {}});
    for (std::size_t k = 0; k < r.points(); k += every) {
      shown.back().time_s.push_back(r.time_s[k]);
      shown.back().mean.push_back(r.force[j][k]);
      shown.back().sd.push_back(r.force_sd[j][k]);
    }
  }
  return shown;
}

}  // namespace

double found_level(std::size_t maps) { return kFoundLevel / static_cast<double>(maps); }

int permutation_count(std::size_t maps) {
  return std::max(kPermutations, static_cast<int>(std::ceil(1.0 / found_level(maps))));
}

void localise(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params, std::uint64_t seed,
              Result& result) {
  result.maps.clear();
  result.forces.clear();
  result.orders.clear();
  result.region = {};
  std::string why;
  const std::vector<ResidualForce> forces = residual_forces(config, grids, params, why);
  if (!why.empty()) {
    result.notes.push_back("The gap was not localised: " + why + ".");
    return;
  }
  result.forces = along_the_longest(grids, forces);
  result.orders = order_spectra(config, grids, forces);
  const tiller_model_t& model = *config.model;
  std::vector<std::vector<double>> weak(model.joint_count);
  const int permutations = permutation_count(model.joint_count * static_cast<std::size_t>(Axis::count));
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    std::size_t block = 1;
    const std::vector<Centre> centres = in_blocks(make_centres(forces, j), forces, block);
    if (centres.size() < 24) continue;  // 2.4 s: four independent test functions
    weak[j] = weak_residual(forces, centres, j);
    for (const AxisValues& axis : axes_of(model, forces, j)) {
      const std::vector<double> edges = make_edges(axis);
      if (edges.size() < 3) continue;
      const BinFit fit(occupancy(forces, centres, axis, edges), edges.size() - 1);
      Rng rng(seed, kPurpose, j * static_cast<std::uint64_t>(Axis::count) + static_cast<std::uint64_t>(axis.axis));
      result.maps.push_back(make_map(j, axis, edges, fit, weak[j], block, permutations, rng));
    }
  }
  std::stable_sort(result.maps.begin(), result.maps.end(),
                   [](const AxisMap& a, const AxisMap& b) { return a.z > b.z; });
  if (result.maps.empty()) {
    result.notes.push_back("The gap was not localised: no joint has 3 s of data without a hole.");
    return;
  }
  order_equals(result.maps);
  if (result.maps.front().p_value > found_level(result.maps.size())) return;
  if (is_constant(result.maps.front(), weak[result.maps.front().joint]))
    std::stable_partition(result.maps.begin(), result.maps.end(), [j = result.maps.front().joint](const AxisMap& m) {
      return m.joint == j && m.axis == Axis::time;
    });
  result.region = strongest_stretch(result.maps.front());
}

}  // namespace tiller::tools::gap
