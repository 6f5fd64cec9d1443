// Layout, and the tick: residuals of all particles, robust weight, exponent, moves, and what leaves the ring.

#include "posterior/transition/transition_cloud.hpp"

#include <cmath>
#include <cstring>

namespace tiller {

namespace {

std::uint32_t round_up(std::uint32_t value, std::uint32_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

TransitionCloud* TransitionCloud::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  const std::uint32_t n = config.posterior.particles, nx = config.model->state_count, np = config.param_count;
  const Evidence evidence(config);
  const std::uint32_t rows = evidence.rows(), columns = evidence.columns();
  const std::uint32_t longest = 2 * config.posterior.window, lanes = round_up(n / 2, 16);
  const std::uint32_t capacity = columns > 0 ? longest + 1 : longest, lead_in = columns > 0 ? 1 : 0;
  auto* c = arena.take<TransitionCloud>(1);
  TransitionCloud made;
  made.cloud_ = Cloud::lay_out(arena, config);
  made.params_ = arena.take<float>(std::size_t{np} * n);
  made.total_ = arena.take<double>(std::size_t{rows} * n);
  made.ring_sums_ = arena.take<double>(std::size_t{rows} * n);
  made.log_likelihood_ = arena.take<double>(n);
  made.fresh_ = arena.take<double>(std::size_t{rows} * n);
  made.base_ = arena.take<double>(n);
  made.gain_ = arena.take<double>(n);
  made.summary_ = ResidualSummary::lay_out(arena, made.cloud_.d, evidence);
  made.steps_ = arena.take<MeasuredStep>(capacity);
  made.weight_ = arena.take<float>(std::size_t{capacity} * nx);
  made.basis_ = arena.take<float>(std::size_t{capacity} * columns);
  auto* matrices = arena.take<double>(evidence.matrix_count());
  made.linked_ = arena.take<float>(std::size_t{capacity} * evidence.pushed_count());
  made.whitened_ = arena.take<float>(columns);
  made.history_ = arena.take<double>(std::size_t{capacity} * setup.delay_steps * config.model->input_count);
  made.proposed_change_ = arena.take<double>(lanes);
  made.proposed_uniform_ = arena.take<double>(lanes);
  made.proposed_params_ = arena.take<float>(std::size_t{np} * lanes);
  made.proposed_coordinate_ = arena.take<double>(std::size_t{made.cloud_.d} * lanes);
  made.present_coordinate_ = arena.take<double>(std::size_t{made.cloud_.d} * lanes);
  made.proposed_ring_ = arena.take<double>(std::size_t{rows} * lanes);
  made.proposed_total_ = arena.take<double>(std::size_t{rows} * lanes);
  made.proposed_likelihood_ = arena.take<double>(lanes);
  // all particles at one transition, or the moves at a block of them
  const std::uint32_t at_one = round_up(n, kChunk) * (1 + lead_in);
  const std::uint32_t at_block = round_up(lanes, kChunk) * (kBlock + lead_in);
  made.residual_ = arena.take<float>(std::size_t{at_one > at_block ? at_one : at_block} * nx);
  made.design_params_ = arena.take<float>(std::size_t{np} * made.summary_.design().points());
  made.design_residual_ = arena.take<float>(std::size_t{nx} * made.summary_.design().points() * (1 + lead_in));
  if (evidence.joints() > 0) made.response_ = ForceResponse::lay_out(arena, config, setup, table, evidence.joints());
  if (arena.measuring() || !arena.fits()) return nullptr;

  made.config_ = &config;
  made.setup_ = setup;
  made.table_ = &table;
  made.hooks_ = hooks;
  made.n_ = n;
  made.nx_ = nx;
  made.nu_ = config.model->input_count;
  made.np_ = np;
  made.d_ = made.cloud_.d;
  made.rows_ = rows;
  made.columns_ = columns;
  made.window_ = config.posterior.window;
  made.longest_ = longest;
  made.capacity_ = capacity;
  made.steps_of_one_ = 1 + lead_in;
  made.lanes_ = lanes;
  made.evidence_ = evidence;
  made.evidence_.use(matrices);
  made.flat_prior_ = !made.cloud_.prior.is_mixture();
  for (std::uint32_t j = 0; j < made.d_; ++j)
    made.flat_prior_ = made.flat_prior_ && made.cloud_.prior.marginal(j).kind == tiller_prior_uniform;
  *c = made;
  c->reset();
  return c;
}

void TransitionCloud::reset(double keep) {
  keep_ = keep;
  evidence_.believe_configuration();
  for (std::uint32_t r = 0; r < nx_; ++r) noise_variance_[r] = calm_variance_[r] = evidence_.configured_variance(r);
  begin();
}

void TransitionCloud::restart() {
  evidence_.believe(calm_variance_, kNoiseWorth);
  for (std::uint32_t r = 0; r < nx_; ++r) noise_variance_[r] = calm_variance_[r];
  begin();
}

void TransitionCloud::begin() {
  cloud_.draw_prior();
  load_params();
  std::memset(total_, 0, sizeof(double) * rows_ * n_);
  std::memset(ring_sums_, 0, sizeof(double) * rows_ * n_);
  std::memset(log_likelihood_, 0, sizeof(double) * n_);
  evidence_.clear();
  summary_.clear();
  discrepancy_begun_ = false;
  begin_ = end_ = batch_ = tick_ = 0;
  begun_at_ = again_ = again_end_ = 0;
  exponent_ = robust_weight_ = 1.0;
  acceptance_ = log_predictive_ = discrepancy_share_ = 0.0;
  cursor_ = moved_ = doubted_run_ = 0;
  resamplings_ = outliers_ = lost_ = work_ = 0;
}

void TransitionCloud::load_params() {
  for (std::size_t i = 0; i < std::size_t{np_} * n_; ++i) params_[i] = static_cast<float>(cloud_.params[i]);
}

tiller_status_t TransitionCloud::update(const MeasuredStep& step, bool follows) {
  work_ = 0;
  remember(step, follows);
  const std::uint32_t slot = static_cast<std::uint32_t>((end_ - 1) % capacity_);
  std::memset(fresh_, 0, sizeof(double) * rows_ * n_);
  sum({{params_, n_}, n_, slot, 1, fresh_, n_});
  if (!any_alive()) {
    --end_;
    return tiller_status_posterior_degenerate;
  }
  ++tick_;
  if (columns_ > 0) whiten_basis(slot);
  if (config_->posterior.adequacy) measure_innovation(slot);
  robust_weight_ = config_->posterior.robust ? find_robust_weight(slot) : 1.0;
  set_weight(slot, robust_weight_);
  forget();
  const double before = evidence_.log_constant();
  evidence_.count(counted(slot));
  evidence_.prepare();
  const std::uint32_t all = rows_ * n_;
  transition_table().add_scaled(all, robust_weight_, fresh_, total_);
  transition_table().add_scaled(all, robust_weight_, fresh_, ring_sums_);
  keep_discrepancy();
  take_evidence(evidence_.log_constant() - before);
  if (config_->posterior.enabled && config_->posterior.moves_per_tick && d_) move();
  retire();
  measure_noise();
  return exponent_ < 1.0 ? tiller_status_tempered : tiller_status_ok;
}

/// Whether a particle with weight has a finite residual; the others' sums are left to temper(), or to stay where the
/// cloud is frozen.
bool TransitionCloud::any_alive() {
  transition_table().find_broken(n_, rows_, fresh_, base_);
  bool any = false;
  for (std::uint32_t i = 0; i < n_; ++i) {
    const bool finite = base_[i] == 0.0;
    any = any || (finite && cloud_.weight[i] > 0.0);
    for (std::uint32_t r = 0; r < rows_ && !finite && !config_->posterior.enabled; ++r) fresh_[r * n_ + i] = 0.0;
  }
  return any;
}

/// A glitch tells nothing of what comes after it.
void TransitionCloud::link(std::uint32_t slot, bool follows) {
  const std::uint32_t before = slot_before(slot), pushed_count = evidence_.pushed_count();
  const bool whole = follows && end_ >= 2 && robust_weight_ == 1.0;
  for (std::uint32_t j = 0; j < pushed_count; ++j) {
    const bool there = whole && weight_[before * nx_ + evidence_.pushed(j)] > 0.0f;
    linked_[slot * pushed_count + j] = there ? 1.0f : 0.0f;
  }
}

bool TransitionCloud::linked(std::uint32_t slot) const {
  bool any = false;
  for (std::uint32_t j = 0; j < evidence_.pushed_count(); ++j)
    any = any || linked_[slot * evidence_.pushed_count() + j] > 0.0f;
  return any;
}

Evidence::Counted TransitionCloud::counted(std::uint32_t slot) const {
  return {weight_ + slot * nx_, basis_ + slot * columns_, linked_ + slot * evidence_.pushed_count(),
          basis_ + slot_before(slot) * columns_};
}

void TransitionCloud::remember(const MeasuredStep& step, bool follows) {
  const std::uint32_t slot = static_cast<std::uint32_t>(end_++ % capacity_);
  MeasuredStep& to = steps_[slot];
  to = step;
  const std::uint32_t row = setup_.delay_steps * nu_;
  to.history = nullptr;
  if (row) {
    std::memcpy(history_ + std::size_t{slot} * row, step.history, sizeof(double) * row);
    to.history = history_ + std::size_t{slot} * row;
  }
  set_weight(slot, 1.0);
  set_basis(slot);
  link(slot, follows);
}

void TransitionCloud::set_weight(std::uint32_t slot, double weight) {
  steps_[slot].weight = weight;
  for (std::uint32_t r = 0; r < nx_; ++r)
    weight_[slot * nx_ + r] = std::isnan(steps_[slot].change[r]) ? 0.0f : static_cast<float>(weight);
}

/// Every sum of squares loses its share; the newest transition, already in the ring, does not.
void TransitionCloud::forget() {
  if (keep_ == 1.0) return;
  evidence_.forget(keep_);
  summary_.forget(keep_);
  for (std::size_t i = 0; i < std::size_t{rows_} * n_; ++i) {
    total_[i] *= keep_;
    ring_sums_[i] *= keep_;
  }
  for (std::uint64_t k = begin_; k + 1 < end_; ++k)
    set_weight(static_cast<std::uint32_t>(k % capacity_), steps_[k % capacity_].weight * keep_);

  // the weights are those of what is left, before the new residual counts: its predictive density is taken under them
  evidence_.prepare();
  evidence_.log_likelihood(n_, total_, n_, gain_);
  transition_table().split_weights(n_, cloud_.log_weight, log_likelihood_, exponent_, gain_, base_, gain_);
  cloud_.set_weights(base_, gain_, exponent_);
  std::memcpy(log_likelihood_, gain_, sizeof(double) * n_);
}

std::uint64_t TransitionCloud::work_limit() const {
  const tiller_posterior_config_t& p = config_->posterior;
  std::uint64_t moves = std::uint64_t{p.moves_per_tick} * (p.window + kProposalWork);
  if (columns_ > 0 && moves < renewal_work()) moves = renewal_work();
  return (std::uint64_t{3} * n_ + 4 * summary_.design().points()) * steps_of_one_ + moves;
}

}  // namespace tiller
