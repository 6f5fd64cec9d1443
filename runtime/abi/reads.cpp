#include <algorithm>

#include "abi/controller.hpp"
#include "posterior/contraction.hpp"

extern "C" {

void tiller_get_info(const tiller_t* t, tiller_info_t* info) {
  if (info == nullptr) return;
  *info = t != nullptr ? t->executive->info() : tiller_info_t{};
}

tiller_status_t tiller_get_covariance(const tiller_t* t, double* covariance) {
  if (t == nullptr || covariance == nullptr) return tiller_status_null_argument;
  t->executive->posterior().covariance(covariance);
  return tiller_status_ok;
}

tiller_status_t tiller_get_contraction(const tiller_t* t, uint32_t* d, double* variance_ratio, double* direction) {
  if (t == nullptr || d == nullptr) return tiller_status_null_argument;
  const tiller_config_t& config = t->executive->config();
  tiller::Contraction found;
  if (!tiller::contract(config, t->executive->posterior(), found)) return tiller_status_posterior_degenerate;
  *d = found.d;
  for (uint32_t i = 0; i < found.d; ++i) {
    if (variance_ratio != nullptr) variance_ratio[i] = found.variance_ratio[i];
    const double* from = found.direction + i * found.d;
    for (uint32_t p = 0; p < config.param_count && direction != nullptr; ++p)
      direction[i * config.param_count + p] = config.priors[p].kind != tiller_prior_fixed ? *from++ : 0.0;
  }
  return tiller_status_ok;
}

tiller_status_t tiller_get_quantile(const tiller_t* t, uint32_t param, double q, double* value) {
  if (t == nullptr || value == nullptr) return tiller_status_null_argument;
  if (param >= t->executive->config().param_count) return tiller_status_bad_dimension;
  if (!(q >= 0.0 && q <= 1.0)) return tiller_status_bad_limit;
  *value = t->executive->posterior().quantile(param, q);
  return tiller_status_ok;
}

uint32_t tiller_get_plan(const tiller_t* t, double* inputs, uint32_t steps) {
  if (t == nullptr || inputs == nullptr) return 0;
  const tiller::PlanMemory& plan = t->executive->plan();
  const uint32_t nu = t->executive->config().model->input_count;
  const uint32_t first = plan.step_at(t->executive->last_now_us());
  const uint32_t count = std::min(steps, plan.horizon() - first);
  for (uint32_t i = 0; i < count; ++i) std::copy(plan.step(first + i), plan.step(first + i) + nu, inputs + i * nu);
  return count;
}

tiller_status_t tiller_get_feedback(const tiller_t* t, uint32_t step, double* gain, double* state, double* input) {
  if (t == nullptr) return tiller_status_null_argument;
  const tiller::PlannerTable& planner = t->executive->planner_table();
  const bool open = planner.feedback_if_closed && t->executive->config().planner.closed_loop == 0;
  if (planner.feedback == nullptr || open) return tiller_status_bad_planner;
  const bool there = planner.feedback(t->executive->planner(), step, gain, state, input);
  // the planner's angles come less whole turns; the caller's do not
  for (uint32_t i = 0; there && state != nullptr && i < t->executive->config().model->state_count; ++i)
    state[i] += t->executive->origin()[i];
  return there ? tiller_status_ok : tiller_status_bad_dimension;
}

tiller_status_t tiller_get_prediction(const tiller_t* t, uint32_t step, double* mean, double* sd) {
  if (t == nullptr) return tiller_status_null_argument;
  const tiller_config_t& config = t->executive->config();
  const tiller::Prediction& prediction = t->executive->prediction();
  if (config.planner.predict_spread == 0) return tiller_status_bad_planner;
  if (!prediction.made()) return tiller_status_wrong_state;
  if (step > config.planner.horizon) return tiller_status_bad_dimension;
  for (uint32_t i = 0; i < config.model->state_count; ++i) {
    if (mean != nullptr) mean[i] = prediction.mean(step)[i] + t->executive->origin()[i];
    if (sd != nullptr) sd[i] = prediction.sd(step)[i];
  }
  return tiller_status_ok;
}

tiller_status_t tiller_get_particle(const tiller_t* t, uint32_t index, double* params, double* state, double* weight) {
  if (t == nullptr) return tiller_status_null_argument;
  if (index >= t->executive->posterior().size()) return tiller_status_bad_dimension;
  t->executive->posterior().particle(index, params, state, weight);
  return tiller_status_ok;
}

tiller_status_t tiller_get_outputs(const tiller_t* t, double* y) {
  if (t == nullptr || y == nullptr) return tiller_status_null_argument;
  const tiller_model_t& model = *t->executive->config().model;
  if (model.output_count == 0) return tiller_status_bad_model;
  model.outputs(t->executive->info().state_mean, t->executive->info().param_mean, y);
  return tiller_status_ok;
}

tiller_status_t tiller_get_record(const tiller_t* t, uint64_t tick, tiller_record_t* record) {
  if (t == nullptr || record == nullptr) return tiller_status_null_argument;
  const tiller::Recorder& recorder = t->executive->recorder();
  if (recorder.read(tick, *record)) return tiller_status_ok;
  return recorder.overwritten(tick) ? tiller_status_record_overwritten : tiller_status_bad_dimension;
}

}  // extern "C"
