#include "posterior/filter/filter_summary.hpp"

#include <cmath>
#include <cstring>

#include "posterior/filter/lane_filter.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Points of the design per term: each costs a filtered transition per tick.
constexpr double kPointsPerTerm = 2.5;
/// Share of a deviation below which the rest of a root's row counts as nothing: rounding, whose logarithm is noise.
constexpr double kLeastRoot = 1e-7;

/// Lower root of a covariance given as the upper triangle of element i at p[i * stride]: to[r] the logarithm of
/// diagonal r, then the elements left of it over the diagonal's scale.
void to_root(std::uint32_t n, const double* p, std::uint32_t stride, double* to, std::uint32_t to_stride) {
  double root[kMaxFilterStates][kMaxFilterStates];
  for (std::uint32_t r = 0; r < n; ++r) {
    const double variance = std::fmax(p[triangle_row(n, r, r) * stride], kVarianceFloor),
                 deviation = std::sqrt(variance);
    double rest = variance;
    for (std::uint32_t c = 0; c < r; ++c) {
      double sum = p[triangle_row(n, c, r) * stride];
      for (std::uint32_t k = 0; k < c; ++k) sum -= root[r][k] * root[c][k];
      root[r][c] = sum / root[c][c];
      rest -= root[r][c] * root[r][c];
    }
    const double least = kLeastRoot * deviation;
    root[r][r] = std::sqrt(std::fmax(rest, least * least));
    to[triangle_row(n, r, r) * to_stride] = math::log(root[r][r]);
    for (std::uint32_t c = 0; c < r; ++c) to[triangle_row(n, c, r) * to_stride] = root[r][c] / root[r][r];
  }
}

/// The other way.
void from_root(std::uint32_t n, const double* from, std::uint32_t from_stride, double* p, std::uint32_t stride) {
  double root[kMaxFilterStates][kMaxFilterStates];
  for (std::uint32_t r = 0; r < n; ++r) {
    // NOLINTBEGIN(clang-analyzer-core.*): the caller has filled the whole triangle
    root[r][r] = math::exp(from[triangle_row(n, r, r) * from_stride]);
    for (std::uint32_t c = 0; c < r; ++c) root[r][c] = from[triangle_row(n, c, r) * from_stride] * root[r][r];
    // NOLINTEND(clang-analyzer-core.*)
  }
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = r; c < n; ++c) {
      double sum = 0.0;
      for (std::uint32_t k = 0; k <= r; ++k) sum += root[r][k] * root[c][k];
      p[triangle_row(n, r, c) * stride] = sum;
    }
}

}  // namespace

FilterSummary FilterSummary::lay_out(Arena& arena, std::uint32_t d, std::uint32_t nx, std::uint32_t ns) {
  FilterSummary s;
  s.nx_ = nx;
  s.ns_ = ns;
  s.triangle_ = triangle_rows(nx);
  s.design_ = PolynomialDesign::lay_out(arena, d, kPointsPerTerm);
  const std::size_t terms = s.design_.terms(), points = s.design_.points();
  s.gram_ = arena.take<double>(terms * (terms + 1) / 2);
  s.tilt_ = arena.take<double>(terms);
  s.law_ = arena.take<double>((nx + ns + s.triangle_) * terms);
  s.scratch_ = arena.take<double>(s.triangle_ * points > terms ? s.triangle_ * points : terms);
  s.filters_ = lay_out_filters(arena, nx, ns, s.design_.points());
  return s;
}

void FilterSummary::clear() {
  const std::size_t terms = design_.terms();
  std::memset(gram_, 0, sizeof(double) * terms * (terms + 1) / 2);
  std::memset(tilt_, 0, sizeof(double) * terms);
  std::memset(law_, 0, sizeof(double) * (nx_ + ns_ + triangle_) * terms);
  design_.clear();
  empty_ = true;
}

void FilterSummary::forget(double keep) {
  if (keep == 1.0 || empty_) return;
  const std::uint32_t terms = design_.terms();
  for (std::uint32_t i = 0; i < terms * (terms + 1) / 2; ++i) gram_[i] *= keep;
  for (std::uint32_t i = 0; i < terms; ++i) tilt_[i] *= keep;
}

void FilterSummary::centre_on(const Cloud& cloud) {
  const bool before = design_.laid();
  design_.centre_on(cloud);
  if (!before) return;
  const std::size_t terms = design_.terms();
  design_.translate_form(gram_);
  design_.translate(tilt_, scratch_);
  for (std::uint32_t i = 0; i < nx_ + ns_ + triangle_; ++i) design_.translate(law_ + i * terms, scratch_);
  read_filters(design_.points(), design_.at(), design_.points(), filters_);
}

void FilterSummary::add(double weight, std::uint32_t ny, const double* z, const double* log_variance) {
  const std::uint32_t terms = design_.terms(), points = design_.points();
  double c[PolynomialDesign::kMaxTerms];
  for (std::uint32_t k = 0; k < ny; ++k) {
    design_.fit(z + std::size_t{k} * points, c);
    design_.add_square(c, weight, gram_);
  }
  design_.fit(log_variance, c);
  for (std::uint32_t i = 0; i < terms; ++i) tilt_[i] += weight * c[i];
  empty_ = false;
}

void FilterSummary::fit_filters() {
  const std::uint32_t terms = design_.terms(), points = design_.points();
  for (std::uint32_t i = 0; i < nx_; ++i) design_.fit(filters_.state + i * points, law_ + i * terms);
  for (std::uint32_t i = 0; i < ns_; ++i) design_.fit(filters_.effect_state + i * points, law_ + (nx_ + i) * terms);
  for (std::uint32_t k = 0; k < points; ++k) to_root(nx_, filters_.covariance + k, points, scratch_ + k, points);
  for (std::uint32_t i = 0; i < triangle_; ++i) design_.fit(scratch_ + i * points, law_ + (nx_ + ns_ + i) * terms);
}

void FilterSummary::add_sums(std::uint32_t lanes, const double* coordinate, std::uint32_t coordinate_stride,
                             double factor, double* sums, std::uint32_t stride) const {
  if (empty_) return;
  PolynomialJob past = design_.job(lanes, coordinate, coordinate_stride);
  past.squares = 1;
  past.linear = 1;
  past.gram = gram_;
  past.tilt = tilt_;
  past.factor = factor;
  past.sums = sums;
  past.stride = stride;
  filter_table().polynomial(past);
}

void FilterSummary::read_filters(std::uint32_t lanes, const double* coordinate, std::uint32_t coordinate_stride,
                                 const FilterRows& to) const {
  const std::size_t terms = design_.terms();
  PolynomialJob law = design_.job(lanes, coordinate, coordinate_stride);
  law.stride = to.stride;
  const auto read = [&](std::uint32_t first, std::uint32_t rows, double* into) {
    if (rows == 0) return;
    std::memset(into, 0, sizeof(double) * rows * to.stride);
    law.linear = rows;
    law.tilt = law_ + first * terms;
    law.sums = into;
    filter_table().polynomial(law);
  };
  read(0, nx_, to.state);
  read(nx_, ns_, to.effect_state);
  read(nx_ + ns_, triangle_, to.covariance);
  for (std::uint32_t l = 0; l < lanes; ++l) {
    double root[triangle_rows(kMaxFilterStates)];
    for (std::uint32_t i = 0; i < triangle_; ++i) root[i] = to.covariance[i * to.stride + l];
    from_root(nx_, root, 1, to.covariance + l, to.stride);
  }
}

}  // namespace tiller
