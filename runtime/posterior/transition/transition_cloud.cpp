// Layout, and the tick: residuals of all particles, robust weight, exponent, moves, and what leaves the ring.

#include "posterior/transition/transition_cloud.hpp"

#include <cmath>
#include <cstring>

namespace tiller {

TransitionCloud* TransitionCloud::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  const Evidence evidence(config);
  auto* const c = arena.take<TransitionCloud>(1);
  TransitionCloud made;
  made.config_ = &config;
  made.evidence_ = evidence;
  made.particles_ = TransitionParticles::lay_out(arena, config, evidence);
  made.ring_ = TransitionRing::lay_out(arena, config, setup, evidence);
  made.sums_ = ResidualSums::lay_out(arena, config, setup, table, hooks, evidence, TransitionMoves::lanes_of(config));
  made.discrepancy_ = Discrepancy::lay_out(arena, config, setup, table, evidence);
  made.moves_ = TransitionMoves::lay_out(arena, made.particles_);
  made.past_ = TransitionPast::lay_out(arena, made.particles_, evidence);
  auto* const matrices = arena.take<double>(evidence.matrix_count());
  if (arena.measuring() || !arena.fits()) return nullptr;

  made.evidence_.use(matrices);
  *c = made;
  c->sums_.bind(c->ring_, c->evidence_);
  c->reset();
  return c;
}

void TransitionCloud::reset(double keep) {
  keep_ = keep;
  evidence_.believe_configuration();
  for (std::uint32_t r = 0; r < evidence_.nx(); ++r)
    noise_variance_[r] = calm_variance_[r] = evidence_.configured_variance(r);
  begin();
}

void TransitionCloud::restart() {
  evidence_.believe(calm_variance_, kNoiseWorth);
  std::memcpy(noise_variance_, calm_variance_, sizeof noise_variance_);
  begin();
}

void TransitionCloud::begin() {
  particles_.draw_prior();
  tempering_ = {};
  evidence_.clear();
  ring_.clear();
  sums_.begin_tick();
  discrepancy_.clear();
  robust_.clear();
  moves_.reset();
  past_.clear();
  tick_ = 0;
  log_predictive_ = discrepancy_share_ = 0.0;
}

tiller_status_t TransitionCloud::update(const MeasuredStep& step, bool follows) {
  sums_.begin_tick();
  remember(step, follows);
  particles_.clear_fresh();
  sums_.sum_fresh(particles_, ring_.end() - 1, ring_.end());
  if (!any_alive()) {
    ring_.drop_newest();
    return tiller_status_posterior_degenerate;
  }
  ++tick_;
  const float* const whitened = discrepancy_.whiten(data());
  if (config_->posterior.adequacy) measure_innovation(whitened);
  const double weight = robust_.find(data(), whitened);
  ring_.set_weight(ring_.newest(), weight);
  forget();
  const double before = evidence_.log_constant();
  evidence_.count(ring_.counted(ring_.newest()));
  evidence_.prepare();
  particles_.add_fresh(weight);
  discrepancy_.keep(data());
  take_evidence(evidence_.log_constant() - before);
  if (config_->posterior.enabled && config_->posterior.moves_per_tick && particles_.cloud.d) move();
  past_.retire(data(), converged());
  measure_noise();
  return exponent() < 1.0 ? tiller_status_tempered : tiller_status_ok;
}

/// A glitch tells nothing of what comes after it.
void TransitionCloud::remember(const MeasuredStep& step, bool follows) {
  const std::uint32_t slot = ring_.push(step);
  discrepancy_.set_basis(data(), slot);
  if (follows && ring_.end() >= 2 && robust_.weight() == 1.0) ring_.link(slot, evidence_);
}

/// Whether a particle with weight has a finite residual; the others' sums are left to temper(), or to stay where the
/// cloud is frozen.
bool TransitionCloud::any_alive() {
  const std::uint32_t n = particles_.n(), rows = particles_.rows;
  transition_table().find_broken(n, rows, particles_.fresh, particles_.base);
  bool any = false;
  for (std::uint32_t i = 0; i < n; ++i) {
    const bool finite = particles_.base[i] == 0.0;
    any = any || (finite && particles_.cloud.weight[i] > 0.0);
    for (std::uint32_t r = 0; r < rows && !finite && !config_->posterior.enabled; ++r)
      particles_.fresh[r * n + i] = 0.0;
  }
  return any;
}

/// Every sum of squares loses its share; the newest transition, already in the ring, does not.
void TransitionCloud::forget() {
  if (keep_ == 1.0) return;
  evidence_.forget(keep_);
  past_.forget(keep_);
  particles_.forget(keep_);
  for (std::uint64_t k = ring_.begin(); k + 1 < ring_.end(); ++k)
    ring_.set_weight(ring_.slot(k), ring_.steps(ring_.slot(k))->weight * keep_);

  // the weights are those of what is left, before the new residual counts: its predictive density is taken under them
  TransitionParticles& p = particles_;
  evidence_.prepare();
  evidence_.log_likelihood(p.n(), p.total, p.n(), p.gain);
  p.split_weights(exponent(), p.gain, p.gain);
  p.cloud.set_weights(p.base, p.gain, exponent());
  std::memcpy(p.log_likelihood, p.gain, sizeof(double) * p.n());
}

/// Sweeps while the work lasts: a short ring is cheap, so early on a tick may sweep the whole cloud and raise the
/// exponent more than once. Once the cloud has been swept at the full exponent, moves_per_tick is enough.
void TransitionCloud::move() {
  const std::uint32_t per_tick = config_->posterior.moves_per_tick, more = sums_.steps_of_one() - 1;
  const std::uint64_t budget = std::uint64_t{per_tick} * (config_->posterior.window + kProposalWork);
  // less what was spent beyond the one transition of an ordinary tick
  const std::uint64_t spent = sums_.work() - std::uint64_t{particles_.n()} * (1 + more);
  std::uint64_t left = budget > spent ? budget - spent : 0;
  const std::uint64_t cost = ring_.size() + more + kProposalWork;
  std::uint32_t done = 0;
  for (;;) {
    std::uint64_t moves = left / cost;
    if (moves > particles_.n() / 2) moves = particles_.n() / 2;
    if (converged()) {
      if (done >= per_tick) return;
      if (moves > per_tick - done) moves = per_tick - done;
    }
    moves = moves / 8 * 8;
    if (moves == 0) return;
    moves_.move(data(), past_.summary(), tempering_, static_cast<std::uint32_t>(moves));
    done += static_cast<std::uint32_t>(moves);
    left -= moves * cost;
    if (exponent() < 1.0 && tempering_.swept(particles_.cloud)) raise();
  }
}

std::uint64_t TransitionCloud::work_limit() const {
  const tiller_posterior_config_t& p = config_->posterior;
  std::uint64_t moves = std::uint64_t{p.moves_per_tick} * (p.window + kProposalWork);
  const std::uint64_t renewal = Discrepancy::work_limit(particles_.n());
  if (evidence_.columns() > 0 && moves < renewal) moves = renewal;
  return (std::uint64_t{3} * particles_.n() + 4 * past_.summary().design().points()) * sums_.steps_of_one() + moves;
}

/// What the adequacy test is fed with: the newest transition, normalised by what the noise and the particles'
/// disagreement let expect; before it is counted. The witnesses' mean is off by an eighth of what the particles disagree
/// about, which is part of the deviation by which it is divided. Cost: O(kSubsample nx).
void TransitionCloud::measure_innovation(const float* whitened) {
  const TransitionParticles& p = particles_;
  const MeasuredStep& step = *ring_.steps(ring_.newest());
  for (std::uint32_t r = 0; r < evidence_.nx(); ++r) {
    innovation_[r] = NAN;
    if (std::isnan(step.change[r])) continue;
    double weight = 0.0, mean = 0.0, square = 0.0, within = 0.0;
    for (std::uint32_t i = 0; i < p.n(); i += p.sample_stride()) {
      const double w = p.cloud.weight[i], raw = sums_.newest(p.n(), i, r);
      if (!(w > 0.0) || !std::isfinite(raw)) continue;
      const double e = evidence_.innovation(p.total + i, p.n(), r, raw, whitened);
      weight += w;
      mean += w * e;
      square += w * e * e;
      within += w * evidence_.scale_square(p.total + i, p.n(), r, whitened);
    }
    if (!(weight > 0.0)) continue;
    mean /= weight;
    const double between = std::fmax(0.0, square / weight - mean * mean);
    innovation_[r] = mean / std::sqrt(within / weight + between);
  }
}

void TransitionCloud::measure_noise() {
  // particles differ by less than colours do: few speak for all
  constexpr std::uint32_t kSpeakers = 16;
  const TransitionParticles& p = particles_;
  double left[TILLER_MAX_STATES], before[TILLER_MAX_STATES];
  evidence_.lead(p.n(), p.total, p.n(), p.cloud.weight, p.n() > kSpeakers ? p.n() / kSpeakers : 1);
  if (!evidence_.mean_errors(p.n(), p.total, p.n(), p.cloud.weight, left, before)) return;
  discrepancy_share_ = 0.0;
  for (std::uint32_t r = 0; r < evidence_.nx(); ++r) {
    noise_variance_[r] = evidence_.noise_variance(left[r], r);
    calm_variance_[r] = std::fmin(noise_variance_[r], kNoiseGrowth * calm_variance_[r]);
    if (before[r] > 0.0 && 1.0 - left[r] / before[r] > discrepancy_share_)
      discrepancy_share_ = 1.0 - left[r] / before[r];
  }
}

}  // namespace tiller
