// Who is asked to go where: the moves' proposals.

#include "posterior/proposals.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "core/rng.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Best step of a random walk on a d-dimensional normal, in deviations (Roberts, Gelman and Gilks 1997); a
/// difference of two particles has twice the variance (ter Braak 2006).
constexpr double kOptimalStep = 2.38;
/// Share of differential evolution among the proposals; the rest is a random walk with the cloud's covariance.
constexpr double kEvolution = 0.7;
/// Share of those that take a whole difference, to cross between separate modes.
constexpr double kWholeDifference = 0.1;
/// Random walk added to a difference, so that particles that are copies of one another part.
constexpr double kJitter = 0.05;

/// Coordinate steps reach down to e^-14, a millionth, of the prior's spread.
constexpr double kWidestLog = 14.0;
/// Share of a variance that the coordinates before leave unexplained, below which they span no dimension more.
constexpr double kFlat = 1e-10;
/// Random numbers of coordinate steps, apart from others of the same stream.
constexpr std::uint64_t kWidening = std::uint64_t{1} << 60;

/// Mean (d) and lower triangle (d x d) of the covariance of the particles that stand still. Where compilers know d the
/// sums stay in registers: in memory each would wait for the one before, and the whole cloud for this one thread.
template <class Count>
void sum_moments(const Cloud& cloud, std::uint32_t first_still, std::uint32_t still, Count d, double* mean,
                 double* square) {
  constexpr std::uint32_t kKnown = std::is_same_v<Count, std::uint32_t> ? 0 : Count();
  double own_mean[kKnown + 1], own_square[kKnown * kKnown + 1], off[kKnown ? kKnown : kMaxCoordinates];
  double *const means = kKnown ? own_mean : mean, *const squares = kKnown ? own_square : square;
  const std::uint32_t n = cloud.n;
  const auto next = [n](std::uint32_t i) { return i + 1 < n ? i + 1 : 0; };
  std::fill_n(means, d, 0.0);
  std::fill_n(squares, d * d, 0.0);
  double sum = 0.0;
  for (std::uint32_t k = 0, i = first_still; k < still; ++k, i = next(i)) {
    sum += cloud.weight[i];
    for (std::uint32_t j = 0; j < d; ++j) means[j] += cloud.weight[i] * cloud.coordinate[j * n + i];
  }
  for (std::uint32_t j = 0; j < d; ++j) means[j] /= sum;
  for (std::uint32_t k = 0, i = first_still; k < still; ++k, i = next(i)) {
    const double share = cloud.weight[i] / sum;
    for (std::uint32_t j = 0; j < d; ++j) off[j] = cloud.coordinate[j * n + i] - means[j];
    for (std::uint32_t r = 0; r < d; ++r)
      for (std::uint32_t c = 0; c <= r; ++c) squares[r * d + c] += share * off[r] * off[c];
  }
  if (kKnown == 0) return;
  std::copy_n(means, d, mean);
  std::copy_n(squares, d * d, square);
}

/// Mean (d) and lower Cholesky factor (d x d) of the covariance of the particles that stand still. False:
/// they do not span all dimensions.
bool spread(const Cloud& cloud, std::uint32_t first_still, std::uint32_t still, double* mean, double* factor) {
  const std::uint32_t d = cloud.d;
  double square[kMaxCoordinates * kMaxCoordinates];
  const auto sum = [&](auto count) { sum_moments(cloud, first_still, still, count, mean, square); };
  switch (d) {
    case 2: sum(std::integral_constant<std::uint32_t, 2>()); break;
    case 3: sum(std::integral_constant<std::uint32_t, 3>()); break;
    case 4: sum(std::integral_constant<std::uint32_t, 4>()); break;
    default: sum(d);
  }
  bool whole = true;
  for (std::uint32_t r = 0; r < d; ++r) {
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = square[r * d + c];
      for (std::uint32_t k = 0; k < c; ++k) rest -= factor[r * d + k] * factor[c * d + k];
      // coordinates that are functions of one another leave nothing: the walk then stays on their line
      const double pivot = factor[c * d + c];
      if (r == c && !(rest > kFlat * square[r * d + r])) whole = false;
      factor[r * d + c] = r == c ? std::sqrt(std::fmax(rest, 0.0)) : pivot > 0.0 ? rest / pivot : 0.0;
    }
  }
  return whole;
}

/// Law of the particles that stand still, with the tails of six degrees of freedom: what is drawn from it owes nothing
/// to where a particle is, so that one accepted step is a whole one. Where the posterior is near to it that is one in
/// two or three, which a walk in many coordinates takes dozens of steps for.
struct StillLaw {
  static constexpr double kDegrees = 6.0;
  const double *mean, *factor;
  std::uint32_t d;

  /// Up to a constant.
  double log_density(const double* v) const {
    double z[kMaxCoordinates], square = 0.0;
    for (std::uint32_t r = 0; r < d; ++r) {
      double rest = v[r] - mean[r];
      for (std::uint32_t k = 0; k < r; ++k) rest -= factor[r * d + k] * z[k];
      z[r] = rest / factor[r * d + r];
      square += z[r] * z[r];
    }
    return -0.5 * (kDegrees + d) * math::log(1.0 + square / kDegrees);
  }
  void draw(Rng& rng, double* v) const {
    double z[kMaxCoordinates], square = 0.0;  // chi^2 of six degrees: three exponentials
    for (std::uint32_t j = 0; j < d; ++j) z[j] = rng.normal();
    for (int i = 0; i < 3; ++i) square -= 2.0 * math::log(rng.uniform());
    const double wide = std::sqrt(kDegrees / square);
    for (std::uint32_t j = 0; j < d; ++j) {
      v[j] = mean[j];
      for (std::uint32_t k = 0; k <= j; ++k) v[j] += wide * factor[j * d + k] * z[k];
    }
  }
};

/// Shares of draws from the still particles' law, and of steps along one coordinate, where there are many coordinates.
constexpr double kAnew = 0.4, kAlong = 0.3;

}  // namespace

CoordinateStep draw_coordinate_step(const PriorDistribution& prior, Rng& rng) {
  CoordinateStep step;
  step.coordinate = rng.below(prior.dimension());
  const double length = prior.spread(step.coordinate) * math::exp(-kWidestLog * rng.uniform());
  step.length = length * rng.normal();
  return step;
}

Stepper::Stepper(const Cloud& cloud, std::uint64_t tick, std::uint32_t first_still, std::uint32_t still)
    : cloud_(cloud), tick_(tick), first_still_(first_still), still_(still), many_(cloud.d - cloud.named > 1) {
  whole_ = spread(cloud, first_still, still, mean_, factor_);
}

Rng Stepper::random(std::uint32_t particle) const { return {cloud_.config->seed, kRngMove, tick_ * 4096 + particle}; }

Rng Stepper::widening(std::uint32_t particle) const {
  return {cloud_.config->seed, kRngScout, kWidening + tick_ * 4096 + particle};
}

void Stepper::walk(Rng& rng, const double* present, double* to) const {
  const std::uint32_t n = cloud_.n, d = cloud_.d, named = cloud_.named;
  const double best = kOptimalStep / std::sqrt(static_cast<double>(d));
  double walk[kMaxCoordinates], difference = 0.0, noise = kJitter;
  const std::uint32_t a = (first_still_ + rng.below(still_)) % n, b = (first_still_ + rng.below(still_)) % n;
  if (rng.uniform() < kEvolution)
    difference = rng.uniform() < kWholeDifference ? 1.0 : best * 0.70710678 * (0.3 + 0.7 * rng.uniform());
  else
    noise = best * math::exp(-2.3 * rng.uniform());  // a decade of step lengths: far and near both occur
  for (std::uint32_t j = 0; j < d; ++j) walk[j] = noise * rng.normal();

  // where an engine has several coordinates of its own, the parameters and these move apart half of the time: a step
  // of few coordinates may be longer
  const double block = many_ && named > 0 ? 4.0 * rng.uniform() : 0.0;
  const std::uint32_t first = block >= 3.0 ? named : 0, last = block >= 2.0 && block < 3.0 ? named : d;
  for (std::uint32_t j = 0; j < d; ++j) to[j] = present[j];
  for (std::uint32_t j = first; j < last; ++j) {
    const double* row = cloud_.coordinate + j * n;
    // no reflection at a bound: of one coordinate of a correlated step it is not symmetric
    to[j] += difference * (row[a] - row[b]);
    for (std::uint32_t k = 0; k <= j; ++k) to[j] += factor_[j * d + k] * walk[k];
  }
}

double Stepper::step(Rng& rng, Rng& widening, bool flat, const double* present, double* to) const {
  const std::uint32_t d = cloud_.d;
  walk(rng, present, to);
  // of several more coordinates some are as good as not known: a step along one of them may be as wide as its prior
  const double kind = whole_ && many_ ? rng.uniform() : 1.0;
  const bool anew = kind < kAnew, along = kind >= kAnew && kind < kAnew + kAlong;
  if (along || (!whole_ && flat)) {
    const CoordinateStep step = draw_coordinate_step(cloud_.prior, widening);
    for (std::uint32_t j = 0; j < d; ++j) to[j] = present[j];
    to[step.coordinate] += step.length;
  }
  const StillLaw law = {mean_, factor_, d};
  if (anew) law.draw(rng, to);
  const double scouts = cloud_.config->posterior.prior_proposal_fraction;
  double change = 0.0;
  if (scouts > 0.0 && rng.uniform() < scouts) {
    // a scout: an independent draw from the prior, whose density cancels out of the ratio
    cloud_.prior.draw_one(rng, to);
    change = cloud_.prior.log_excess(to) - cloud_.prior.log_excess(present);
  } else {
    change = cloud_.prior.log_density(to) - cloud_.prior.log_density(present);
    if (anew) change += law.log_density(present) - law.log_density(to);
  }
  if (std::isfinite(change)) return change;
  for (std::uint32_t j = 0; j < d; ++j) to[j] = present[j];
  return -INFINITY;
}

namespace {

/// The end of a walk of kSteps from `present`, whose target is prior x likelihood^exponent as the shape has it; returns
/// what is left to be judged: less the change that the walk was judged by.
double rehearse(const Stepper& stepper, const Guides& guides, Rng& rng, Rng& widening, const double* present,
                std::uint32_t d, double* to) {
  constexpr int kSteps = 8;  // one in three or four is accepted: a walk of a few whole steps
  const LikelihoodShape& shape = *guides.shape;
  const double begin = shape.at(present);
  double here = begin, at[kMaxCoordinates];
  std::copy(present, present + d, to);
  if (std::isinf(begin)) return -INFINITY;
  for (int i = 0; i < kSteps; ++i) {
    const double change = stepper.step(rng, widening, false, to, at), there = shape.at(at);
    if (!(guides.exponent * (there - here) + change > math::log(rng.uniform()))) continue;
    std::copy(at, at + d, to);
    here = there;
  }
  return guides.exponent * (begin - here);
}

}  // namespace

Proposer::Proposer(const Cloud& cloud, std::uint64_t tick, std::uint32_t cursor, std::uint32_t moves,
                   const Guides* guides)
    : cloud_(cloud),
      cursor_(cursor),
      guides_(guides),
      stepper_(cloud, tick, (cursor + moves) % cloud.n, cloud.n - moves) {
  if (guides == nullptr) return;
  // anew in every tick: a walk judged by what its particle was fitted to would not leave the target as it is
  guides->shape->clear();
  if (stepper_.whole())
    guides->shape->fit(cloud, (cursor + moves) % cloud.n, cloud.n - moves, stepper_.mean(), stepper_.factor(),
                       guides->log_likelihood);
}

void Proposer::read_present(std::uint32_t m, double* coordinate) const {
  for (std::uint32_t j = 0; j < cloud_.d; ++j) coordinate[j] = cloud_.coordinate[j * cloud_.n + particle(m)];
}

void Proposer::draw(std::uint32_t m, Proposal& p) const {
  constexpr double kSwings = 0.2;
  p.particle = particle(m);
  Rng rng = stepper_.random(p.particle), widening = stepper_.widening(p.particle);
  double present[kMaxCoordinates];
  read_present(m, present);
  // every other one, so that the cloud gets to where the shape is not believed, and away from there
  if (guides_ != nullptr && guides_->shape->fitted() && m % 2 == 0)
    p.log_correction = rehearse(stepper_, *guides_, rng, widening, present, cloud_.d, p.coordinate);
  else if (guides_ != nullptr && guides_->swing != nullptr && rng.uniform() < kSwings)
    p.log_correction = guides_->swing->step(cloud_.prior, rng, present, p.coordinate);
  else
    p.log_correction = stepper_.step(rng, widening, m % 2 == 1, present, p.coordinate);
  p.log_uniform = math::log(rng.uniform());
}

}  // namespace tiller
