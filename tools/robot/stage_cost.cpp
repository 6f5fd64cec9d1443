#include "tools/robot/stage_cost.hpp"

#include <algorithm>

#include "rollout/rollout.hpp"

namespace tiller::tools {

const double* reference_row(const tiller_cost_config_t& cost, std::size_t nx, std::uint64_t step) {
  return cost.reference + nx * std::min<std::uint64_t>(step, cost.reference_steps - std::uint64_t{1});
}

double stage_cost(const tiller_config_t& config, std::uint64_t step, const double* x, const double* u,
                  const double* params, const double* output_target) {
  const tiller_cost_config_t& cost = config.cost;
  const std::uint32_t nx = config.model->state_count;
  const double* target = cost.reference ? reference_row(cost, nx, step) : cost.target;
  double sum = 0.0, off[TILLER_MAX_STATES];
  state_differences(*config.model, x, target, off);
  for (std::uint32_t i = 0; i < nx; ++i) sum += cost.state_weight[i] * off[i] * off[i];
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) sum += cost.input_weight[i] * u[i] * u[i];
  if (!params || !cost.outputs) return sum;
  double y[TILLER_MAX_OUTPUTS];
  config.model->outputs(x, params, y);
  for (std::uint32_t j = 0; j < cost.output_count; ++j) {
    const double miss = y[j] - (output_target ? output_target[j] : cost.outputs[j].target);
    sum += cost.outputs[j].weight * miss * miss;
  }
  return sum;
}

}  // namespace tiller::tools
