#include "bench/planning/lockstep.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace tiller::bench {

double RandomStream::normal() {
  return std::sqrt(-2.0 * std::log(uniform())) * std::cos(6.283185307179586 * uniform());
}

Plant::Plant(const tiller_config_t& c, const std::vector<double>& params) : config_(c), params_(params) {
  config_.integrator = tiller_integrator_rk4;
  config_.substeps = 10;
  if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
  std::copy(c.initial_state, c.initial_state + TILLER_MAX_STATES, x);
}

void Plant::advance(const double* u) {
  double next[TILLER_MAX_STATES * kLanePadding];
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = kLanePadding;
  job.horizon = 1;
  job.state = {x, 0};
  job.params = {params_.data(), 0};
  job.controls = {u, 0};
  job.final_state = next;
  select_rollout(*config_.model).rollout_f64(*config_.model, job);
  for (std::uint32_t i = 0; i < config_.model->state_count; ++i) x[i] = next[i * kLanePadding];
}

void Plant::disturb(RandomStream& random) {
  const tiller_model_t& model = *config_.model;
  const double h = config_.period_s;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const double sd = config_.process_sd[i];
    if (!(sd > 0.0)) continue;
    const double a = random.normal(), b = random.normal();
    x[i] += sd * std::sqrt(h) * a;
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      if (model.joints[j].velocity == i && model.joints[j].position != TILLER_NO_POSITION)
        x[model.joints[j].position] += sd * h * std::sqrt(h) * (0.5 * a + b / std::sqrt(12.0));
  }
}

tiller_measurement_t Plant::measure(std::int64_t now_us, std::uint32_t sequence, RandomStream& random) const {
  tiller_measurement_t m{};
  m.stamp_us = now_us;
  m.sequence = sequence;
  for (std::uint32_t i = 0; i < config_.measurement_count; ++i)
    m.value[i] = x[config_.measured_state[i]] + config_.measurement_sd[i] * random.normal();
  return m;
}

LockstepController::LockstepController(const std::string& name, const tiller_config_t& config) {
  const std::size_t size = tiller_size(&config);
  memory_.reset(::operator new (std::max<std::size_t>(size, 1), std::align_val_t{TILLER_ALIGNMENT}));
  const tiller_status_t status = tiller_init(&controller_, &config, nullptr, memory_.get(), size);
  if (status != tiller_status_ok) {
    const char* field = "";
    tiller_config_check(&config, &field);
    std::fprintf(stderr, "%s: %s (%s)\n", name.c_str(), tiller_status_text(status), field);
    std::exit(1);
  }
  tiller_arm(controller_);
}

double step_cost(const tiller_config_t& c, const double* x, const double* u) {
  double sum = 0.0;
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) {
    const double d = state_difference(*c.model, i, x[i], c.cost.target[i]);
    sum += c.cost.state_weight[i] * d * d;
  }
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) sum += c.cost.input_weight[i] * u[i] * u[i];
  return sum;
}

}  // namespace tiller::bench
