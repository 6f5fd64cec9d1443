#include "planners/path_plan.hpp"

namespace tiller {
namespace {

bool rate_weight(const tiller_config_t& config) {
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    if (config.cost.input_rate_weight[i] > 0.0) return true;
  return false;
}

void take_sizes(const tiller_config_t& config, const StepSetup& setup, std::uint32_t most_scenarios, PathPlan& p) {
  p.nx = config.model->state_count;
  p.ns = setup.effect_state_count;
  p.nz = p.nx + p.ns;
  p.nu = config.model->input_count;
  p.np = param_rows(config, setup);
  p.cones = make_input_cones(config.safety.cones, config.safety.cone_count);
  p.rate = rate_weight(config);
  p.n = p.nz + (p.rate ? p.nu : 0);
  p.horizon = config.planner.horizon;
  p.most_scenarios = config.planner.particles < most_scenarios ? config.planner.particles : most_scenarios;
  p.lanes = (p.horizon + 1 + kLanePadding - 1) / kLanePadding * kLanePadding;
}

void take_arrays(Arena& arena, PathPlan& p) {
  const std::size_t h = p.horizon, m = p.most_scenarios, n = p.n, s = m * n, nu = p.nu, nz = p.nz;
  const auto take = [&](double*& array, std::size_t count) { array = arena.take<double>(count); };
  take(p.state, (h + 1) * m * nz);
  take(p.control, h * nu);
  p.sequence = arena.take<float>(h * nu);
  take(p.settled, h * nu);
  take(p.start, m * nz);
  take(p.params, m * p.np);
  take(p.next, h * m * nz);
  take(p.a, h * s * n);
  take(p.b, h * s * nu);
  take(p.c, h * s);
  take(p.qxx, (h + 1) * s * n);
  take(p.qux, h * nu * s);
  take(p.quu, h * nu * nu);
  take(p.qx, (h + 1) * s);
  take(p.qu, h * nu);
  if (p.cones.count > 0) take(p.cone_quu, h * nu * nu);
  take(p.box_low, h * nu);
  take(p.box_high, h * nu);
  take(p.dx, (h + 1) * s);
  take(p.du, h * nu);
  take(p.candidate_state, (h + 1) * m * nz * kCandidates);
  take(p.candidate_control, h * nu * kCandidates);
  take(p.candidate_cost, m * kCandidates);
  const std::size_t nx = p.nx, lanes = p.lanes;
  take(p.lane_state, nx * lanes);
  take(p.lane_control, nu * lanes);
  take(p.lane_before, nu * lanes);
  take(p.lane_value, lanes);
  take(p.lane_lx, nx * lanes);
  take(p.lane_lu, nu * lanes);
  take(p.lane_lb, nu * lanes);
  take(p.lane_lxx, nx * nx * lanes);
  take(p.lane_luu, nu * nu * lanes);
  take(p.lane_lux, nu * nx * lanes);
  p.problem = LqProblem{};
  p.problem.states = p.n;
  p.problem.inputs = p.nu;
  p.problem.horizon = p.horizon;
  p.problem.scenarios = p.most_scenarios;
  p.factor = lay_out_lq_factor(arena, p.problem, true);
}

}  // namespace

void lay_out_path_plan(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                       PathPlan& p, std::uint32_t most_scenarios) {
  take_sizes(config, setup, most_scenarios, p);
  p.frame.lay_out(config);
  take_arrays(arena, p);
  if (config.cost.terminal == tiller_terminal_lqr) p.cost.cost_to_go = arena.take<double>(std::size_t{p.nx} * p.nx);
  if (arena.measuring() || !arena.fits()) return;
  p.settings = &config.planner;
  p.model = config.model;
  p.setup = &setup;
  p.table = &table;
  p.path = &select_path(table);
  // the check of the configuration has seen that the cost can be laid out
  if (lay_out_cost(config, setup, table, &p.cost, nullptr) != tiller_status_ok)
    p.cost = make_cost_terms<double>(config.cost, config.model->state_count);
  for (std::uint32_t i = 0; i < p.nu; ++i) {
    InputLimit& limit = p.limits[i];
    limit.low = p.low[i] = config.safety.input_low[i];
    limit.high = p.high[i] = config.safety.input_high[i];
    limit.step = p.most_change[i] = config.safety.input_rate_per_s[i] * config.period_s;
    p.rate_limited = p.rate_limited || limit.step < limit.high - limit.low;
    p.fallback[i] = config.safety.safe_command[i];
  }
  p.risk.lay_out(config.planner);
  p.problem.a = p.a;
  p.problem.b = p.b;
  p.problem.qxx = p.qxx;
  p.problem.quu = p.quu;
  p.problem.qx = p.qx;
  p.problem.qu = p.qu;
  p.problem.low = p.box_low;
  p.problem.high = p.box_high;
  reset_path_plan(p);
}

void reset_path_plan(PathPlan& p) {
  p.has_sequence = p.has_path = p.has_gain = p.hessians_stand = p.dynamics_stand = false;
  p.scenarios = 0;
  p.problem.regularisation = p.settings->regularisation;
  take_command(p, nullptr);
  for (std::size_t k = 0; k < std::size_t{p.horizon} * p.nu; ++k) {
    p.control[k] = admit_command(p.limits[k % p.nu], 0.0, 0.0);
    p.sequence[k] = static_cast<float>(p.control[k]);
    p.factor.held[k] = 0;
  }
}

}  // namespace tiller
