#include "posterior/transition/bank.hpp"
#include "posterior/transition/transition_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace tiller {

namespace {

std::uint32_t at_least_one(std::uint32_t count) { return count > 0 ? count : 1; }

/// Same robot, one hypothesis.
tiller_config_t member_config(const tiller_config_t& config, std::uint32_t member, std::uint32_t rate) {
  tiller_config_t c = config;
  c.posterior.delay_hypotheses = 1;
  c.posterior.forgetting_count = 1;
  c.posterior.forgetting[0] = config.posterior.forgetting[rate];
  c.seed += member * 0x9E3779B97F4A7C15u;
  return c;
}

}  // namespace

bool BankPosterior::wanted(const tiller_config_t& config) {
  return config.posterior.delay_hypotheses > 1 || config.posterior.forgetting_count > 1;
}

BankPosterior* BankPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                      const RolloutTable& table, const tiller_hooks_t* hooks) {
  const DelayHypotheses hypotheses = DelayHypotheses::of(config, setup);
  const std::uint32_t delays = hypotheses.members, rows = hypotheses.param_count(config);
  const std::uint32_t rates = at_least_one(config.posterior.forgetting_count), members = delays + rates - 1;
  const std::uint32_t n = config.posterior.particles, nx = config.model->state_count;
  auto* p = arena.take<BankPosterior>(1);
  auto* configs = arena.take<tiller_config_t>(members);
  const tiller_mixture_t* mixture = hypotheses.fractional ? lay_out_delayed_mixture(arena, config) : nullptr;
  // with one more prior, of the fraction; while measuring, on the stack
  tiller_prior_t stand_in[TILLER_MAX_PARAMS];
  auto* placed = hypotheses.fractional ? arena.take<tiller_prior_t>(rows) : nullptr;
  tiller_prior_t* priors = placed ? placed : stand_in;
  const StepSetup member_setup = hypotheses.member_setup(config, setup);
  Posterior* engine[kMaxMembers] = {};
  for (std::uint32_t i = 0; i < members; ++i) {
    tiller_config_t one = member_config(config, i, i < delays ? 0 : i - delays + 1);
    hypotheses.add_fraction(one, priors, mixture);
    if (configs) configs[i] = one;
    engine[i] = Posterior::lay_out(arena, configs ? configs[i] : one, member_setup, table, hooks);
  }
  Scratch scratch;
  scratch.value = arena.take<double>(std::size_t{members} * n);
  scratch.share = arena.take<double>(std::size_t{members} * n);
  scratch.order = arena.take<std::uint32_t>(std::size_t{members} * n);
  scratch.drawn = arena.take<float>(std::size_t{rows + nx + setup.effect_state_count} * kColumns);
  scratch.owner = arena.take<std::uint32_t>(kColumns);
  auto* drawn_delay = arena.take<double>(kColumns);
  if (arena.measuring() || !arena.fits()) return nullptr;

  p->config_ = &config;
  p->hypotheses_ = hypotheses;
  p->delays_ = delays;
  p->rates_ = rates;
  p->members_ = members;
  p->n_ = n;
  p->nx_ = nx;
  p->nu_ = config.model->input_count;
  p->np_ = config.param_count;
  p->rows_ = rows;
  p->has_history_ = member_setup.delay_steps > 0;
  p->ns_ = setup.effect_state_count;
  p->ny_ = config.measurement_count;
  std::memcpy(p->engine_, engine, sizeof engine);
  p->scratch_ = scratch;
  p->drawn_delay_ = drawn_delay;
  p->reset();
  return p;
}

void BankPosterior::reset() {
  for (std::uint32_t i = 0; i < members_; ++i) engine_[i]->reset();
  for (std::uint32_t k = 0; k < ny_; ++k) last_[k] = NAN;
  started_ = false;
  restarts_ = 0;
  retired_ = {};
  forget_evidence();
}

tiller_status_t BankPosterior::start(const double* measured) {
  for (std::uint32_t k = 0; k < ny_; ++k)
    if (std::isinf(measured[k])) return tiller_status_sensor_not_finite;
  for (std::uint32_t i = 0; i < members_; ++i) {
    const tiller_status_t status = engine_[i]->start(measured);
    if (status != tiller_status_ok) return status;
  }
  std::memcpy(last_, measured, sizeof(double) * ny_);
  for (auto& input : input_)
    for (std::uint32_t j = 0; j < nu_; ++j) input[j] = config_->safety.safe_command[j];
  started_ = true;
  return tiller_status_ok;
}

tiller_status_t BankPosterior::skip(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  Transition unseen = transition;
  std::fill(unseen.measured, unseen.measured + ny_, NAN);
  const tiller_status_t refusal = check_transition(*config_, unseen);
  if (refusal != tiller_status_ok) return refusal;
  remember_input(transition.input);
  tiller_status_t leaders = tiller_status_ok;
  for (std::uint32_t i = 0; i < members_; ++i) {
    const tiller_status_t status = engine_[i]->skip(late_for(i, transition));
    if (i == leader_) leaders = status;
  }
  return leaders;
}

tiller_status_t BankPosterior::update(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  const tiller_status_t refusal = check_transition(*config_, transition);
  if (refusal != tiller_status_ok) return refusal;
  remember_input(transition.input);
  tiller_status_t status[kMaxMembers];
  double log_predictive[kMaxMembers];
  for (std::uint32_t i = 0; i < members_; ++i) {
    status[i] = engine_[i]->update(late_for(i, transition));
    log_predictive[i] = engine_[i]->log_predictive();
  }
  std::memcpy(last_, transition.measured, sizeof(double) * ny_);
  log_predictive_ = log_predictive[leader_];
  const std::uint32_t led = best_delay_;
  weigh_delays(log_predictive);
  if (best_delay_ != led) follow_delay(transition);
  weigh_rates(log_predictive);
  leave_what_has_changed();
  set_member_weights();
  return status[leader_];
}

/// As a member's delay has it. The history that an engine keeps of what it was fed begins one period further back,
/// which is what acts in the first part of the period, up to the fraction.
Transition BankPosterior::late_for(std::uint32_t member, const Transition& transition) const {
  Transition late = transition;
  std::memcpy(late.input, input_[delay_of(member)], sizeof(double) * nu_);
  return late;
}

void BankPosterior::remember_input(const double* input) {
  for (std::uint32_t row = TILLER_MAX_HYPOTHESES - 1; row > 0; --row)
    std::memcpy(input_[row], input_[row - 1], sizeof(double) * nu_);
  std::memcpy(input_[0], input, sizeof(double) * nu_);
}

/// The rates' clouds are fed another delay's inputs from now on. What they know, the noise included, was learnt
/// with those of the last one. The newest of the inputs is the history of the next transition; that one does not
/// count, since the engine's state has gone on by the period that was skipped.
void BankPosterior::follow_delay(const Transition& transition) {
  for (std::uint32_t k = delays_; k < members_; ++k) {
    engine_[k]->reset();
    (void)engine_[k]->start(last_);
    if (has_history_) (void)engine_[k]->skip(late_for(k, transition));
  }
}

/// The delays' clouds share the first rate, and so its fate; what they have found out about the delay stays.
void BankPosterior::restart_rate(std::uint32_t rate) {
  if (rate > 0) {
    restart_member(member_of_rate(rate));
  } else {
    for (std::uint32_t j = 0; j < delays_; ++j) restart_member(j);
  }
}

/// An engine that starts again may count from zero again; what it counted until then stays counted.
void BankPosterior::restart_member(std::uint32_t member) {
  retired_.add(*engine_[member]);
  engine_[member]->restart(last_);
  retired_.subtract(*engine_[member]);
}

namespace {
/// One hypothesis is an engine by itself.
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  if (BankPosterior::wanted(config)) return BankPosterior::lay_out(arena, config, setup, table, hooks);
  return TransitionPosterior::lay_out(arena, config, setup, table, hooks);
}
}  // namespace

extern const PosteriorTable transition_posterior;
const PosteriorTable transition_posterior = {lay_out_engine, TransitionPosterior::check, nullptr, true, true, true};

}  // namespace tiller
