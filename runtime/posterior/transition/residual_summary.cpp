#include "posterior/transition/residual_summary.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {

ResidualSummary ResidualSummary::lay_out(Arena& arena, std::uint32_t d, const Evidence& evidence) {
  ResidualSummary s;
  s.nx_ = evidence.nx();
  s.regressors_ = evidence.regressors();
  s.pushed_count_ = evidence.pushed_count();
  s.projections_ = evidence.columns();
  for (std::uint32_t b = 0; b < s.pushed_count_; ++b) s.pushed_[b] = evidence.pushed(b);
  s.design_ = PolynomialDesign::lay_out(arena, d, kPointsPerTerm);
  const std::uint32_t terms = s.design_.terms();
  s.triangle_ = terms * (terms + 1) / 2;
  s.gram_ = arena.take<double>(std::size_t{s.forms()} * s.triangle_);
  s.tilt_ = arena.take<double>(std::size_t{kLags} * s.projections_ * terms);
  s.scratch_ = arena.take<double>(terms);
  return s;
}

void ResidualSummary::clear() {
  // either may be empty, and then it has no address
  std::fill_n(gram_, std::size_t{forms()} * triangle_, 0.0);
  std::fill_n(tilt_, std::size_t{kLags} * projections_ * design_.terms(), 0.0);
  empty_ = true;
  design_.clear();
}

void ResidualSummary::forget(double keep) {
  if (keep == 1.0 || empty_) return;
  for (std::uint32_t i = 0; i < forms() * triangle_; ++i) gram_[i] *= keep;
  for (std::uint32_t i = 0; i < kLags * projections_ * design_.terms(); ++i) tilt_[i] *= keep;
}

void ResidualSummary::centre_on(const Cloud& cloud) {
  design_.centre_on(cloud);
  if (empty_) return;
  for (std::uint32_t r = 0; r < forms(); ++r) design_.translate_form(gram_ + std::size_t{r} * triangle_);
  for (std::uint32_t j = 0; j < kLags * projections_; ++j)
    design_.translate(tilt_ + std::size_t{j} * design_.terms(), scratch_);
}

bool ResidualSummary::all_finite(const float* residual, const float* before, const Evidence::Counted& one) const {
  const std::uint32_t points = design_.points();
  for (std::uint32_t r = 0; r < nx_; ++r) {
    std::uint32_t place = 0;
    while (place < pushed_count_ && pushed_[place] != r) ++place;
    const bool linked = place < pushed_count_ && one.linked[place] > 0.0f;
    for (std::uint32_t k = 0; k < points && one.weight[r] > 0.0f; ++k)
      if (!std::isfinite(residual[r * points + k]) || (linked && !std::isfinite(before[r * points + k]))) return false;
  }
  return true;
}

void ResidualSummary::fit(const float* residual, double* c) const {
  double e[kMaxPoints];
  for (std::uint32_t k = 0; k < design_.points(); ++k) e[k] = static_cast<double>(residual[k]);
  design_.fit(e, c);
}

bool ResidualSummary::add(const float* residual, const float* before, const Evidence::Counted& one) {
  const std::uint32_t points = design_.points(), terms = design_.terms();
  if (!all_finite(residual, before, one)) return false;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    if (!(one.weight[r] > 0.0f)) continue;
    double c[PolynomialDesign::kMaxTerms], c_before[PolynomialDesign::kMaxTerms] = {};
    fit(residual + r * points, c);
    const double w = static_cast<double>(one.weight[r]);
    design_.add_square(c, w, gram_ + std::size_t{r} * triangle_);
    for (std::uint32_t place = 0; place < pushed_count_; ++place) {
      if (pushed_[place] != r) continue;
      for (std::uint32_t b = 0; b < regressors_; ++b) {
        const std::uint32_t at = place * regressors_ + b;
        for (std::uint32_t i = 0; i < terms; ++i)
          tilt_[at * terms + i] += w * static_cast<double>(one.basis[at]) * c[i];
      }
      if (one.linked[place] > 0.0f) fit(before + r * points, c_before);
      add_lagged(place, c, c_before, one);
    }
  }
  empty_ = false;
  return true;
}

/// q1 and q2. A product is a difference of squares: c d' + d c' = ((c + d)(c + d)' - (c - d)(c - d)') / 2.
void ResidualSummary::add_lagged(std::uint32_t place, const double* c, const double* before,
                                 const Evidence::Counted& one) {
  const std::uint32_t terms = design_.terms();
  const double w = static_cast<double>(one.weight[pushed_[place]]);
  const bool linked = one.linked[place] > 0.0f;
  double* q1 = gram_ + std::size_t{nx_ + place} * triangle_;
  double* q2 = q1 + std::size_t{pushed_count_} * triangle_;
  double *t1 = tilt_ + std::size_t{projections_} * terms, *t2 = t1 + std::size_t{projections_} * terms;
  design_.add_square(linked ? before : c, linked ? w : -w, q2);
  if (linked) {
    double sum[PolynomialDesign::kMaxTerms], difference[PolynomialDesign::kMaxTerms];
    for (std::uint32_t i = 0; i < terms; ++i) {
      sum[i] = c[i] + before[i];
      difference[i] = c[i] - before[i];
    }
    design_.add_square(sum, 0.5 * w, q1);
    design_.add_square(difference, -0.5 * w, q1);
  }
  for (std::uint32_t b = 0; b < regressors_; ++b) {
    const std::uint32_t at = place * regressors_ + b;
    const double now = w * static_cast<double>(one.basis[at]), then = w * static_cast<double>(one.before[at]);
    for (std::uint32_t i = 0; i < terms; ++i) {
      if (linked) t1[at * terms + i] += now * before[i] + then * c[i];
      t2[at * terms + i] += linked ? then * before[i] : -now * c[i];
    }
  }
}

void ResidualSummary::add_sums(std::uint32_t lanes, const double* coordinate, double factor, double* sums,
                               std::uint32_t stride) const {
  if (empty_) return;
  PolynomialJob job = design_.job(lanes, coordinate, stride);
  job.factor = factor;
  job.stride = stride;
  job.linear = projections_;
  job.sums = sums;
  job.gram = gram_;
  for (std::uint32_t lag = 0; lag < (projections_ > 0 ? kLags : 1); ++lag) {
    job.squares = lag == 0 ? nx_ : pushed_count_;
    job.tilt = tilt_ + std::size_t{lag} * projections_ * design_.terms();
    filter_table().polynomial(job);
    job.sums += std::size_t{job.squares + projections_} * stride;
    job.gram += std::size_t{job.squares} * triangle_;
  }
}

}  // namespace tiller
