// Layout and the tick.

#include "posterior/conjugate/conjugate_posterior.hpp"

#include <cmath>

namespace tiller {

ConjugatePosterior::Whitening::Whitening(const PriorDistribution& prior, const tiller_config_t& config) {
  for (std::uint32_t j = 0; j < prior.dimension(); ++j) {
    const std::uint32_t d = prior.dimension();
    mean[j] = prior.is_mixture() ? config.prior_mixture->mean[j] : prior.marginal(j).a;
    if (!prior.is_mixture()) root[j][j] = prior.spread(j);
    for (std::uint32_t i = 0; i <= j && prior.is_mixture(); ++i) root[j][i] = config.prior_mixture->root[j * d + i];
  }
}

ConjugatePosterior* ConjugatePosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                                const RolloutTable& table) {
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count, np = config.param_count;
  auto* p = arena.take<ConjugatePosterior>(1);
  const Cloud cloud = Cloud::lay_out(arena, config);
  const std::uint32_t lanes = (cloud.d + kLanePadding) / kLanePadding * kLanePadding;  // d + 1, padded
  auto* standard = arena.take<double>(std::size_t{cloud.d} * cloud.n);
  const InputHistory inputs = InputHistory::lay_out(arena, config);
  auto* params = arena.take<double>(std::size_t{np} * lanes);
  auto* next = arena.take<double>(std::size_t{nx} * lanes);
  // noise on the measurements makes one-step residuals alternate, and the posterior wrong: that counts
  const bool tested = config.posterior.adequacy != 0 && config.posterior.enabled != 0;
  AdequacyTest* adequacy = tested ? AdequacyTest::lay_out(arena, config, true) : nullptr;
  if (arena.measuring() || !arena.fits()) return nullptr;

  p->config_ = &config;
  p->setup_ = setup;
  p->table_ = &table;
  p->nx_ = nx;
  p->nu_ = nu;
  p->np_ = np;
  p->d_ = cloud.d;
  p->lanes_ = lanes;
  p->enabled_ = config.posterior.enabled != 0;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) p->channel_[config.measured_state[k]] = k;
  p->cloud_ = cloud;
  p->prior_ = Whitening(cloud.prior, config);
  p->standard_ = standard;
  p->inputs_ = inputs;
  p->params_ = params;
  p->next_ = next;
  p->adequacy_ = adequacy;
  for (std::uint32_t i = 0, j = 0; i < np; ++i) {
    const bool inferred = config.priors[i].kind != tiller_prior_fixed;
    for (std::uint32_t l = 0; l < lanes; ++l) {
      double& value = params[i * lanes + l] = inferred ? p->prior_.mean[j] : config.priors[i].a;
      if (inferred && l >= 1 && l <= j + 1) value += p->prior_.root[j][l - 1];
    }
    j += inferred ? 1u : 0u;
  }
  p->reset();
  return p;
}

void ConjugatePosterior::reset() {
  regression_.reset(d_, config_->posterior.noise_scale_shape);
  cloud_.draw_prior();
  standardise();
  place_particles();
  clear_adequacy();
  for (std::uint32_t i = 0; i < nx_; ++i) {
    state_[i] = config_->initial_state[i];
    state_variance_[i] = config_->initial_state_sd[i] * config_->initial_state_sd[i];
  }
  complete_ = started_ = false;
}

/// The prior's draws (a Latin hypercube) as draws from N(0, I), their own mean and covariance taken out where there are
/// enough of them.
void ConjugatePosterior::standardise() {
  const std::uint32_t n = cloud_.n;
  double mean[TILLER_MAX_PARAMS] = {}, root[TILLER_MAX_PARAMS][TILLER_MAX_PARAMS] = {};
  // z = L^-1 (v - mean), forward substitution
  const auto solve = [&](const double(*lower)[TILLER_MAX_PARAMS], const double* centre, const double* from) {
    for (std::uint32_t k = 0; k < n; ++k)
      for (std::uint32_t j = 0; j < d_; ++j) {
        double rest = from[j * n + k] - centre[j];
        for (std::uint32_t i = 0; i < j; ++i) rest -= lower[j][i] * standard_[i * n + k];
        standard_[j * n + k] = rest / lower[j][j];
      }
  };
  solve(prior_.root, prior_.mean, cloud_.coordinate);
  if (n < 8 * d_) return;
  for (std::uint32_t j = 0; j < d_; ++j) {
    for (std::uint32_t k = 0; k < n; ++k) mean[j] += standard_[j * n + k] / n;
    for (std::uint32_t i = 0; i <= j; ++i) {
      double sum = 0.0;
      for (std::uint32_t k = 0; k < n; ++k)
        sum += (standard_[j * n + k] - mean[j]) * (standard_[i * n + k] - mean[i]) / n;
      for (std::uint32_t m = 0; m < i; ++m) sum -= root[j][m] * root[i][m];
      root[j][i] = i == j ? std::sqrt(sum) : sum / root[i][i];
    }
  }
  solve(root, mean, standard_);
}

tiller_status_t ConjugatePosterior::start(const double* measured) {
  for (std::uint32_t i = 0; i < nx_; ++i)
    if (std::isinf(measured[i])) return tiller_status_sensor_not_finite;
  complete_ = true;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double value = measured[channel_[i]], known = config_->measurement_sd[channel_[i]];
    const bool missing = std::isnan(value);
    const double sd = missing ? config_->initial_state_sd[i] : known;
    state_[i] = missing ? config_->initial_state[i] : value;
    state_variance_[i] = sd * sd;
    complete_ = complete_ && !missing;
  }
  inputs_.begin(config_->safety.safe_command);
  if (adequacy_) adequacy_->begin();
  disturbances_.begin();
  started_ = true;
  return tiller_status_ok;
}

tiller_status_t ConjugatePosterior::skip(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  Transition unseen = transition;
  for (std::uint32_t k = 0; k < nx_; ++k) unseen.measured[k] = NAN;
  const tiller_status_t refusal = check_transition(*config_, unseen);
  if (refusal != tiller_status_ok) return refusal;
  const bool usable = predict(unseen);
  settle(unseen);
  inputs_.push(unseen.input);
  return usable ? tiller_status_ok : tiller_status_posterior_degenerate;
}

tiller_status_t ConjugatePosterior::update(const Transition& transition) {
  if (!started_) return tiller_status_wrong_state;
  const tiller_status_t refusal = check_transition(*config_, transition);
  if (refusal != tiller_status_ok) return refusal;
  const bool usable = predict(transition) && (!complete_ || in_range(transition));
  if (usable && enabled_) {
    if (adequacy_ && complete_) test(transition);
    regression_.forget(config_->posterior.forgetting[0]);
    if (complete_) learn(transition);
    regression_.solve();
    place_particles();
  }
  settle(transition);
  inputs_.push(transition.input);
  return usable ? tiller_status_ok : tiller_status_posterior_degenerate;
}

/// Where the state goes at the prior's mean and one step along each direction; false if anywhere it is not finite.
bool ConjugatePosterior::predict(const Transition& transition) {
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = lanes_;
  job.period_s = transition.period_s;
  job.state = {state_, 0};
  job.params = {params_, lanes_};
  job.control = {transition.input, 0};
  job.history = inputs_.rows();
  job.next_state = next_;
  table_->linearise(*config_->model, job);
  bool finite = true;
  for (std::uint32_t i = 0; i < nx_; ++i)
    for (std::uint32_t l = 0; l <= d_; ++l) finite = finite && std::isfinite(next_[i * lanes_ + l]);
  return finite;
}

/// Whether the squares of every row are numbers.
bool ConjugatePosterior::in_range(const Transition& transition) const {
  constexpr double kLargest = 1e100;
  bool good = true;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double measured = transition.measured[channel_[i]], *f = next_ + i * lanes_;
    if (std::isnan(measured) || !(config_->process_sd[i] > 0.0)) continue;
    const double scale = 1.0 / (config_->process_sd[i] * std::sqrt(transition.period_s));
    good = good && std::fabs(measured - f[0]) * scale < kLargest;
    for (std::uint32_t j = 0; j < d_; ++j) good = good && std::fabs(f[j + 1] - f[0]) * scale < kLargest;
  }
  return good;
}

void ConjugatePosterior::learn(const Transition& transition) {
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double measured = transition.measured[channel_[i]];
    if (std::isnan(measured) || !(config_->process_sd[i] > 0.0)) continue;
    const double* f = next_ + i * lanes_;
    const double scale = 1.0 / (config_->process_sd[i] * std::sqrt(transition.period_s));
    double x[TILLER_MAX_PARAMS];
    for (std::uint32_t j = 0; j < d_; ++j) x[j] = (f[j + 1] - f[0]) * scale;
    regression_.add(x, state_difference(*config_->model, i, measured, f[0]) * scale);
  }
}

void ConjugatePosterior::clear_adequacy() {
  if (adequacy_) adequacy_->reset();
  disturbances_.begin();
}

/// Each value against what the data before it predict, noise and parameters unknown. Measured states forget nothing
/// over a step, so a disturbance stands in one innovation and no other.
void ConjugatePosterior::test(const Transition& transition) {
  Innovation now;
  double speed[TILLER_MAX_MEASUREMENTS];
  for (std::uint32_t k = 0; k < nx_; ++k) {
    const std::uint32_t i = config_->measured_state[k], rate = velocity_state(*config_->model, i);
    speed[k] = state_[rate < nx_ ? rate : i];
    const double* f = next_ + i * lanes_;
    double mean = f[0], variance = 0.0;
    for (std::uint32_t a = 0; a < d_; ++a) {
      mean += (f[a + 1] - f[0]) * regression_.mean()[a];
      for (std::uint32_t b = 0; b < d_; ++b)
        variance += (f[a + 1] - f[0]) * regression_.covariance(a, b) * (f[b + 1] - f[0]);
    }
    const double noise = noise_scale() * config_->process_sd[i];
    variance += noise * noise * transition.period_s;
    const double error = state_difference(*config_->model, i, transition.measured[k], mean);
    now.normalised[k] = config_->process_sd[i] > 0.0 ? error / std::sqrt(variance) : NAN;  // NaN where missing
  }
  disturbances_.observe(nx_, nu_, speed, nullptr, transition.input, now.response);
  adequacy_->take(now);
}

/// The state at the transition's end: as measured; what is missing goes where the mean parameters lead.
void ConjugatePosterior::settle(const Transition& transition) {
  complete_ = true;
  for (std::uint32_t i = 0; i < nx_; ++i) {
    const double measured = transition.measured[channel_[i]], known = config_->measurement_sd[channel_[i]];
    if (!std::isnan(measured)) {
      state_[i] = measured;
      state_variance_[i] = known * known;
      continue;
    }
    complete_ = false;
    const double* f = next_ + i * lanes_;
    double next = f[0];
    for (std::uint32_t j = 0; j < d_; ++j) next += (f[j + 1] - f[0]) * regression_.mean()[j];
    if (std::isfinite(next)) state_[i] = next;
    state_variance_[i] += config_->process_sd[i] * config_->process_sd[i] * transition.period_s;
  }
}

/// Each node of the noise scale gets its share of the particles.
void ConjugatePosterior::place_particles() {
  constexpr std::uint32_t kMax = ScaleRegression::kMax;
  double w_mean[kMax] = {}, w_root[kMax * kMax] = {}, mean[kMax] = {}, root[kMax][kMax] = {}, v[kMax] = {};
  double end = 0.0;
  for (std::uint32_t node = 0, k = 0; node < ScaleRegression::kNodes && k < cloud_.n; ++node) {
    end += regression_.node_weight(node);
    const bool last = node + 1 == ScaleRegression::kNodes;
    if (!last && !(k + 0.5 < end * cloud_.n)) continue;
    regression_.law(node, w_mean, w_root);
    for (std::uint32_t r = 0; r < d_; ++r) {
      mean[r] = prior_.mean[r];
      for (std::uint32_t i = 0; i <= r; ++i) mean[r] += prior_.root[r][i] * w_mean[i];
      for (std::uint32_t c = 0; c < d_; ++c) {
        root[r][c] = 0.0;
        for (std::uint32_t i = 0; i <= r; ++i) root[r][c] += prior_.root[r][i] * w_root[i * kMax + c];
      }
    }
    for (; k < cloud_.n && (last || k + 0.5 < end * cloud_.n); ++k) {
      for (std::uint32_t r = 0; r < d_; ++r) {
        v[r] = mean[r];
        for (std::uint32_t c = 0; c < d_; ++c) v[r] += root[r][c] * standard_[c * cloud_.n + k];
      }
      cloud_.set_coordinate(k, v);
    }
  }
}

namespace {
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* /*hooks*/) {
  return ConjugatePosterior::lay_out(arena, config, setup, table);
}
}  // namespace

extern const PosteriorTable conjugate_posterior;
const PosteriorTable conjugate_posterior = {lay_out_engine, ConjugatePosterior::check};

}  // namespace tiller
