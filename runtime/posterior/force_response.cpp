#include "posterior/force_response.hpp"

#include <cmath>
#include <cstring>

namespace tiller {

namespace {

/// Strength of the forces whose effect is linear: small against any that matters, large against rounding.
constexpr double kSmall = 1e-4;
constexpr std::uint16_t kKinds[kDiscrepancyBasis] = {tiller_effect_constant_offset, tiller_effect_viscous_friction,
                                                     tiller_effect_coulomb_friction};

}  // namespace

ForceResponse ForceResponse::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                     const RolloutTable& table, std::uint32_t joints) {
  ForceResponse r;
  r.config_ = &config;
  r.table_ = &table;
  r.setup_ = setup;
  r.joints_ = joints;
  r.first_row_ = config.param_count;
  const std::uint32_t strengths = config.param_count - config.model->param_count;
  if (setup.effect_count + kDiscrepancyBasis > TILLER_MAX_EFFECTS ||
      strengths + kDiscrepancyBasis > TILLER_MAX_PARAMS) {
    r.setup_.effect_count = r.setup_.delay_steps = 0;
    r.first_row_ = config.model->param_count;
  }
  r.params_ = arena.take<double>((config.param_count + kDiscrepancyBasis) * kLanePadding);
  r.next_ = arena.take<double>(config.model->state_count * kLanePadding);
  return r;
}

void ForceResponse::observe(const double* params, const double* state, const double* effect_state, const double* input,
                            double period_s, const double* history, const double* dry_force, double* change) {
  const std::uint32_t np = config_->param_count, nx = config_->model->state_count;
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::uint32_t l = 0; l < kLanePadding; ++l) params_[i * kLanePadding + l] = params[i];
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const double strength[kDiscrepancyBasis] = {kSmall, kSmall, dry_force[j]};
    StepSetup with = setup_;
    for (std::uint32_t k = 0; k < kDiscrepancyBasis; ++k) {
      with.effects[with.effect_count++] = {kKinds[k], static_cast<std::uint16_t>(j),
                                           static_cast<std::uint16_t>(first_row_ + k), 0};
      // lane 1 + k has the force k
      double* row = params_ + (first_row_ + k) * kLanePadding;
      for (std::uint32_t l = 0; l < kLanePadding; ++l) row[l] = l == 1 + k ? strength[k] : 0.0;
    }
    RolloutJob<double> job;
    job.setup = &with;
    job.lanes = kLanePadding;
    job.horizon = 1;
    job.period_s = period_s;
    job.state = {state, 0};
    job.params = {params_, kLanePadding};
    job.effect_state = {effect_state, 0};
    job.controls = {input, 0};
    job.history = history;
    job.final_state = next_;
    table_->rollout_f64(*config_->model, job);
    for (std::uint32_t i = 0; i < nx; ++i) {
      const double* next = next_ + i * kLanePadding;
      for (std::uint32_t k = 0; k < kDiscrepancyBasis; ++k) {
        const double d = (next[1 + k] - next[0]) / strength[k];
        change[(i * joints_ + j) * kDiscrepancyBasis + k] = std::isfinite(d) ? d : 0.0;
      }
    }
  }
}

}  // namespace tiller
