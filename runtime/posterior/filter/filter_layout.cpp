// Where a filter posterior's rows are in its block.

#include <cmath>

#include "core/bits.hpp"
#include "posterior/filter/filter_posterior.hpp"

namespace tiller {

namespace {

/// Standard deviations at which the prior of the noises' ratio is cut: beyond, process noise is as good as none, or all
/// there is.
constexpr double kWidestRatio = 2.0;

std::uint32_t round_up(std::uint32_t value, std::uint32_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

/// Whether the ratio of process to sensor noise is inferred: where there is process noise whose size may be misstated.
bool infers_ratio(const tiller_config_t& config) {
  bool any = false;
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) any = any || config.process_sd[i] > 0.0;
  return any && config.posterior.enabled && config.posterior.noise_ratio_sd > 0.0;
}

/// The ratio, then sizes, time and rates of what the model lacks.
ExtraCoordinates own_coordinates(const tiller_config_t& config, const DisturbanceStates& disturbances) {
  ExtraCoordinates extra;
  if (infers_ratio(config)) {
    const double sd = config.posterior.noise_ratio_sd;
    extra.prior[extra.count++] = {tiller_prior_normal, 0, 0.0, sd, -kWidestRatio * sd, kWidestRatio * sd};
  }
  for (std::uint32_t row = 0; config.posterior.enabled && row < disturbances.coordinates(); ++row)
    extra.prior[extra.count++] = disturbances.law_prior(row);
  return extra;
}

/// Rows of parameters that only a sensor's map reads: the filter's states do not say how it reads.
std::uint64_t sensor_rows(const tiller_config_t& config) {
  std::uint64_t rows = 0;
  std::uint32_t row = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    for (int i = 0; i < info.param_count; ++i, ++row)
      if (info.port == PortKind::sensor) rows |= std::uint64_t{1} << row;
  }
  return rows;
}

/// Parameters that a bank of filters (jumps.cpp) has as states: those that drift, and of the others as many as there is
/// room for. What a filter takes for known it makes up for in what may change.
std::uint64_t bank_params(const tiller_config_t& config, std::uint32_t room) {
  std::uint64_t chosen = config.posterior.drift;
  for (std::uint32_t i = 0; i < config.param_count && bit_count(chosen) < room; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) chosen |= (std::uint64_t{1} << i) & ~sensor_rows(config);
  return config.posterior.drift != 0 ? chosen : 0;
}

}  // namespace

/// Takes rows from the arena in a fixed order, which the arena's measuring pass repeats; the pointers go into the
/// posterior once there is memory for it.
class FilterPosterior::Layout {
 public:
  Layout(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table)
      : arena_(arena),
        config_(config),
        setup_(setup),
        disturbances_(config, setup, table, config.posterior.drift),
        bank_states_(config, setup, table,
                     bank_params(config, kMaxFilterStates - nx_ - disturbances_.states() + disturbances_.drifts())),
        extra_(own_coordinates(config, disturbances_)) {
    nf_ = nx_ + disturbances_.states();
  }

  void take_carried() {
    cloud_ = Cloud::lay_out(arena_, config_, extra_);
    carried_.filter = filter(n_, nf_);
    carried_.process_scale = rows(1, n_);
    if (disturbances_.states() > 0) carried_.law = rows(disturbances_.law_rows(), n_);
    if (disturbances_.drifts() > 0) carried_.present = rows(np_, n_);
    carried_.sums = rows(rows_, n_);
    carried_.base = rows(rows_, n_);
    carried_.log_likelihood = rows(1, n_);
  }

  void take_window() {
    window_ = arena_.take<Kept>(slots_);
    const std::uint32_t row = nu_ + ny_;
    double* const kept = rows(slots_, row);
    for (std::uint32_t k = 0; window_ != nullptr && kept != nullptr && k < slots_; ++k) {
      window_[k].input = kept + std::size_t{k} * row;
      window_[k].measured = window_[k].input + nu_;
    }
    window_history_ = arena_.take<double>(std::size_t{slots_} * setup_.delay_steps * nu_);
    input_history_ = rows(kHistory, nu_);
    summary_ = FilterSummary::lay_out(arena_, cloud_.d, nf_, ns_);
    before_ = NormalLaw::lay_out(arena_, cloud_.d);
  }

  void take_chunks() {
    chunks_ = arena_.take<Chunk>(n_ / kChunk);
    for (std::uint32_t i = 0; i < n_ / kChunk; ++i) {
      const Chunk taken = chunk(disturbances_);
      if (chunks_) chunks_[i] = taken;
    }
    take_banks();
    bool feels = false;
    for (std::uint32_t j = 0; j < disturbances_.joints(); ++j)
      feels = feels || std::isfinite(config_.safety.contact_force[config_.model->joints[j].velocity]);
    if (!feels) return;
    touch_ = arena_.take<Chunk>(1);
    const Chunk taken = chunk(disturbances_);
    if (touch_) *touch_ = taken;
  }

  void take_banks() {
    banks_ = arena_.take<JumpBank>(disturbances_.drifts());
    bank_chunks_ = arena_.take<Chunk>(disturbances_.drifts());
    for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) {
      const Chunk taken = chunk(bank_states_);
      if (bank_chunks_) bank_chunks_[i] = taken;
    }
    if (disturbances_.drifts() > 0)
      bank_room_ = arena_.take<DisturbanceStates>(1);
    else
      banks_ = nullptr;
  }

  void take_scratch() {
    scratch_ = rows(rows_ + 2, n_);
    proposals_ = arena_.take<Proposal>(n_ / 2);
    double* const proposed = rows(cloud_.d, n_ / 2);
    for (std::uint32_t m = 0; proposals_ != nullptr && proposed != nullptr && m < n_ / 2; ++m)
      proposals_[m].coordinate = proposed + std::size_t{m} * cloud_.d;
    proposed_sums_ = rows(rows_, move_lanes_);
    move_coordinate_ = rows(cloud_.d, move_lanes_);
    if (extra_.count > 1) shape_ = LikelihoodShape::lay_out(arena_, cloud_.d);
    if (disturbances_.swings()) swing_ = SwingLaw::lay_out(arena_, disturbances_.joints());
    point_innovation_ = rows(ny_ + 1, summary_.design().points());
    start_.state = rows(nf_, 1);
    start_.covariance = rows(triangle_rows(nf_), 1);
    start_.effect_state = rows(ns_, 1);
    start_.measured = rows(ny_, 1);
  }

  void take_tests() {
    // a cloud that does not learn has innovations that go with whatever its parameters are off by
    const bool tested = config_.posterior.adequacy != 0 && config_.posterior.enabled != 0;
    const std::uint32_t frictions = disturbances_.has_friction() ? 2 * disturbances_.joints() : 0;
    adequacy_ = tested ? AdequacyTest::lay_out(arena_, config_, false, frictions) : nullptr;
    response_ = tested ? DisturbanceResponse::lay_out(arena_, config_, nf_) : nullptr;
    response_scratch_ = rows(tested ? nx_ + nx_ * nx_ + nx_ * nu_ : 0, kChunk);
  }

  void fill(FilterPosterior& p) const {
    fill_sizes(p);
    p.cloud_ = cloud_;
    p.carried_ = carried_;
    p.evidence_ = ScaleEvidence(config_);
    p.window_ = Ring<Kept>(window_, slots_);
    p.window_history_ = window_history_;
    p.input_history_ = input_history_;
    p.summary_ = summary_;
    p.before_ = before_;
    p.disturbances_ = disturbances_;
    p.shape_ = shape_;
    p.swing_ = swing_;
    p.bank_states_ = bank_room_;
    if (bank_room_) *bank_room_ = bank_states_;
    for (std::uint32_t i = 0; i < n_ / kChunk; ++i) chunks_[i].lacking = &p.disturbances_;
    if (touch_) touch_->lacking = &p.disturbances_;
    for (std::uint32_t i = 0; i < disturbances_.drifts(); ++i) bank_chunks_[i].lacking = bank_room_;
    p.rest_ = RestGuard(config_);
    p.bank_evidence_ = ScaleEvidence(config_);
    p.chunks_ = chunks_;
    p.touch_ = touch_;
    p.banks_ = banks_;
    p.bank_chunks_ = bank_chunks_;
    p.scratch_ = scratch_;
    p.proposals_ = proposals_;
    p.proposed_sums_ = proposed_sums_;
    p.move_coordinate_ = move_coordinate_;
    p.point_innovation_ = point_innovation_;
    p.start_ = start_;
    p.adequacy_ = adequacy_;
    p.response_ = response_;
    p.response_scratch_ = response_scratch_;
  }

 private:
  double* rows(std::uint32_t count, std::uint32_t stride) { return arena_.take<double>(std::size_t{count} * stride); }

  FilterRows filter(std::uint32_t stride, std::uint32_t states) {
    FilterRows f;
    f.state = rows(states, stride);
    f.covariance = rows(triangle_rows(states), stride);
    f.effect_state = rows(ns_, stride);
    f.stride = stride;
    return f;
  }

  Chunk chunk(const DisturbanceStates& lacking) {
    Chunk c;
    c.nf = nx_ + lacking.states();
    c.params = rows(np_, kChunk);
    if (lacking.states() > 0) c.drifted = rows(np_ + 1, kChunk);
    c.coordinate = rows(cloud_.d, kChunk);
    c.filter = filter(kChunk, c.nf);
    c.predicted = filter(kChunk, c.nf);
    c.process_scale = rows(1, kChunk);
    if (lacking.states() > 0) c.law = rows(lacking.law_rows(), kChunk);
    c.jacobian = rows(c.nf * c.nf, kChunk);
    c.sums = rows(rows_, kChunk);
    c.normalised = rows(ny_, kChunk);
    c.unit = rows(nx_ * lacking.sources(), kChunk);
    c.push = rows(nx_ * lacking.states(), kChunk);
    if (has_sensor_effects(config_)) {
      c.gain = rows(ny_, kChunk);
      c.offset = rows(ny_, kChunk);
    }
    return c;
  }

  void fill_sizes(FilterPosterior& p) const {
    p.n_ = n_;
    p.nx_ = nx_;
    p.quaternions_ = config_.model->quaternion_mask;
    p.nu_ = nu_;
    p.np_ = np_;
    p.ns_ = ns_;
    p.ny_ = ny_;
    p.triangle_ = triangle_rows(nf_);
    p.d_ = cloud_.d;
    p.lacks_ = disturbances_.states();
    p.nf_ = nf_;
    p.move_lanes_ = move_lanes_;
    for (std::uint32_t k = 0; k < ny_; ++k)
      p.measurement_variance_[k] = config_.measurement_sd[k] * config_.measurement_sd[k];
    p.enabled_ = config_.posterior.enabled != 0;
    p.has_ratio_ = infers_ratio(config_);
    p.keep_ = config_.posterior.forgetting_count > 0 ? config_.posterior.forgetting[0] : 1.0;
  }

  Arena& arena_;
  const tiller_config_t& config_;
  const StepSetup& setup_;
  const std::uint32_t n_ = config_.posterior.particles, nx_ = config_.model->state_count;
  const std::uint32_t nu_ = config_.model->input_count, np_ = config_.param_count, ns_ = setup_.effect_state_count;
  const std::uint32_t ny_ = config_.measurement_count;
  const std::uint32_t slots_ = config_.posterior.window + 1, move_lanes_ = round_up(n_ / 2, kChunk);
  const DisturbanceStates disturbances_, bank_states_;
  DisturbanceStates* bank_room_ = nullptr;
  const ExtraCoordinates extra_;
  std::uint32_t nf_ = 0;

  Cloud cloud_;
  Carried carried_;
  FilterSummary summary_;
  NormalLaw before_;
  LikelihoodShape shape_;
  SwingLaw swing_;
  Kept* window_ = nullptr;
  double *window_history_ = nullptr, *input_history_ = nullptr;
  InitialStateDistribution start_;
  Chunk *chunks_ = nullptr, *touch_ = nullptr, *bank_chunks_ = nullptr;
  JumpBank* banks_ = nullptr;
  Proposal* proposals_ = nullptr;
  double *scratch_ = nullptr, *proposed_sums_ = nullptr, *move_coordinate_ = nullptr, *point_innovation_ = nullptr;
  AdequacyTest* adequacy_ = nullptr;
  DisturbanceResponse* response_ = nullptr;
  double* response_scratch_ = nullptr;
};

FilterPosterior* FilterPosterior::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  auto* p = arena.take<FilterPosterior>(1);
  Layout layout(arena, config, setup, table);
  layout.take_carried();
  layout.take_window();
  layout.take_chunks();
  layout.take_scratch();
  layout.take_tests();
  if (arena.measuring() || !arena.fits()) return nullptr;

  p->config_ = &config;
  p->setup_ = setup;
  p->table_ = &table;
  p->filter_ = &filter_table();
  p->hooks_ = hooks;
  layout.fill(*p);
  p->reset();
  return p;
}

namespace {
Posterior* lay_out_engine(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table, const tiller_hooks_t* hooks) {
  return FilterPosterior::lay_out(arena, config, setup, table, hooks);
}

tiller_status_t check_drift(const tiller_config_t& config, const StepSetup& /*setup*/, const RolloutTable& /*table*/,
                            const char** field) {
  std::uint64_t may = 0;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) may |= std::uint64_t{1} << i;
  may &= ~sensor_rows(config);
  if ((config.posterior.drift & ~may) == 0 && bit_count(config.posterior.drift) <= TILLER_MAX_DRIFTS)
    return tiller_status_ok;
  *field = "posterior.drift";
  return tiller_status_bad_posterior;
}
}  // namespace

extern const PosteriorTable filter_posterior;
const PosteriorTable filter_posterior = {lay_out_engine, check_drift, DisturbanceStates::joints_of, false, false,
                                         true,           true,        DisturbanceStates::slips_of};

}  // namespace tiller
