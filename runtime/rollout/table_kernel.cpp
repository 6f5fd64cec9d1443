// Rollouts of a model that is written in C: one lane after the other through the same stepper as everybody's.
// Linearisation by central differences of the whole step, effects included.

#include <cmath>

#include "rollout/fading.hpp"
#include "rollout/output_cost.hpp"
#include "rollout/own_expansion.hpp"
#include "rollout/quadratise.hpp"
#include "rollout/residual.hpp"
#include "rollout/step.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

using Step = Stepper<TableModel, double>;

template <class T>
double cell(const Lanes<T>& rows, std::size_t row, std::uint32_t lane) {
  return static_cast<double>(rows.splat() ? rows.data[row] : rows.data[row * rows.stride + lane]);
}

template <class T>
void load_params(const TableModel& model, const StepSetup& setup, const Lanes<T>& params, std::uint32_t lane,
                 Parameters<TableModel, double>& p) {
  for (int i = 0; i < model.np(); ++i) p.model[i] = cell(params, static_cast<std::size_t>(i), lane);
  for (std::uint32_t e = 0; e < setup.effect_count; ++e) {
    const EffectSlot& slot = setup.effects[e];
    for (int i = slot.param; i < slot.param + effect_info(slot.kind).param_count; ++i)
      p.effect[i - model.np()] = cell(params, static_cast<std::size_t>(i), lane);
  }
  for (std::uint32_t i = 0; i < setup.extra_params(); ++i)
    fading_rows(model, setup, p)[i] = cell(params, setup.fading_param + i, lane);
}

template <class T>
void load(const TableModel& model, const StepSetup& setup, const Lanes<T>& state, const Lanes<T>& params,
          const Lanes<T>& effect_state, std::uint32_t lane, Trajectory<TableModel, double>& t,
          Parameters<TableModel, double>& p) {
  for (int i = 0; i < model.nx(); ++i) t.x[i] = cell(state, static_cast<std::size_t>(i), lane);
  for (std::uint32_t s = 0; s < setup.effect_state_count; ++s) t.effect_state[s] = cell(effect_state, s, lane);
  load_params(model, setup, params, lane, p);
}

template <class T>
double own_cost(const RolloutJob<T>& job, std::uint64_t row, const double* x, const double* u, const double* p) {
  const CostTerms<T>& cost = *job.cost;
  if (!cost.has(kCostOwnFunction)) return 0.0;
  const double time_s = static_cast<double>(row) * job.setup->period_s;
  if (u) return static_cast<double>(cost.own_weight) * cost.own->stage(x, u, p, time_s, cost.own->context);
  if (!cost.own->terminal) return 0.0;
  return static_cast<double>(cost.own_weight) * cost.own->terminal(x, p, time_s, cost.own->context);
}

using ModelParams = TableModel::Params<double>;

template <class T>
double stage_cost(const TableModel& model, const RolloutJob<T>& job, std::uint32_t step, const Step::State& x,
                  const Step::Input& u, const Step::Input& before, const ModelParams& p) {
  const std::uint64_t row = job.task_step + step;
  return every_state_cost<TableModel, double>(model, *job.cost, job.cost->state, row, x) +
         input_cost<TableModel, double>(model, *job.cost, u, before) +
         output_cost<TableModel, double>(model, *job.cost, false, row, x, p) + own_cost(job, row, x.v, u.v, p.v);
}

template <class T>
double terminal_cost(const TableModel& model, const RolloutJob<T>& job, const Step::State& x, const ModelParams& p) {
  const std::uint64_t row = job.task_step + job.horizon;
  return every_terminal_cost<TableModel, double>(model, *job.cost, row, x) +
         output_cost<TableModel, double>(model, *job.cost, true, row, x, p) + own_cost(job, row, x.v, nullptr, p.v);
}

template <class T>
double every_penalty(const TableModel& model, const CostTerms<T>& cost, const Step::State& x, const ModelParams& p) {
  return penalty_cost<TableModel, double>(model, cost, x) + output_penalty<TableModel, double>(model, cost, x, p);
}

/// The input of a closed loop: see RolloutFeedback.
template <class T>
void feed_back(const TableModel& model, const RolloutJob<T>& job, std::uint32_t step, std::uint32_t lane,
               const Step::State& x, const Step::Input& before, Step::Input& u) {
  const RolloutFeedback<T>& loop = *job.feedback;
  const int nx = model.nx(), nu = model.nu(), columns = static_cast<int>(loop.columns);
  const std::size_t first = std::size_t{step} * static_cast<std::size_t>(nu);
  const auto planned = [&](int i) { return cell(job.controls, first - static_cast<std::size_t>(nu - i), lane); };
  const auto reference = [&](int c) {
    return cell(loop.reference, std::size_t{step} * static_cast<std::size_t>(nx) + static_cast<std::size_t>(c), lane);
  };
  for (int i = 0; i < nu; ++i) {
    const T* row = loop.gain + (first + static_cast<std::size_t>(i)) * loop.columns;
    double wish = u[i];
    for (int c = 0; c < nx; ++c) wish += static_cast<double>(row[c]) * (x[c] - reference(c));
    for (int c = nx; c < columns; ++c) wish += static_cast<double>(row[c]) * (before[c - nx] - planned(c - nx));
    const double change = static_cast<double>(loop.most_change[i]);
    const double low = std::fmax(static_cast<double>(loop.low[i]), before[i] - change);
    const double high = std::fmin(static_cast<double>(loop.high[i]), before[i] + change);
    u[i] = wish < low ? low : wish > high ? high : wish;
  }
  if (!loop.cones) return;
  double most_change[TILLER_MAX_INPUTS];
  for (int i = 0; i < nu; ++i) most_change[i] = static_cast<double>(loop.most_change[i]);
  keep_cones(*loop.cones, static_cast<std::uint32_t>(nu), before.v, most_change, u.v);
}

template <class T>
void roll_lane(const TableModel& model, const Step& step, const RolloutJob<T>& job, std::uint32_t lane) {
  const StepSetup& setup = *job.setup;
  const int nx = model.nx(), nu = model.nu();
  Trajectory<TableModel, double> t{};
  Parameters<TableModel, double> p{};
  load(model, setup, job.state, job.params, job.effect_state, lane, t, p);
  Step::Input before{};
  for (int i = 0; i < nu; ++i)
    before[i] = job.previous_input ? static_cast<double>(job.previous_input[i])
                                   : cell(job.controls, static_cast<std::size_t>(i), lane);
  const auto keep = [&](T* rows) {
    for (int i = 0; i < nx; ++i) rows[static_cast<std::size_t>(i) * job.lanes + lane] = static_cast<T>(t.x[i]);
  };
  double cost = 0.0, penalty = 0.0;
  const Turn<double> kept = setup.fading > 0 ? turn_after(model, setup, p, 1.0) : Turn<double>{1.0, 0.0};
  for (std::uint32_t k = 0; k < job.horizon; ++k) {
    if (job.trajectory) keep(job.trajectory + static_cast<std::size_t>(k) * nx * job.lanes);
    Step::Input u{};
    for (int i = 0; i < nu; ++i) u[i] = cell(job.controls, static_cast<std::size_t>(k) * nu + i, lane);
    if (job.feedback && k >= job.feedback->from) feed_back(model, job, k, lane, t.x, before, u);
    if (job.cost) {
      cost += stage_cost(model, job, k, t.x, u, before, p.model);
      if (job.penalty_out) penalty += every_penalty(model, *job.cost, t.x, p.model);
      before = u;
    }
    const auto past = [&](int age, int input) {
      const int then = static_cast<int>(k) - age;
      return then >= 0
                 ? cell(job.controls,
                        static_cast<std::size_t>(then) * static_cast<std::size_t>(nu) + static_cast<std::size_t>(input),
                        lane)
                 : static_cast<double>(job.history[(-then - 1) * nu + input]);
    };
    step.advance(t, u, p, past);
    if (setup.fading > 0) fade(model, setup, kept, p);
    for (int i = 0; job.noise.data && i < nx; ++i)
      t.x[i] += cell(job.noise, static_cast<std::size_t>(k) * nx + i, lane);
  }
  if (job.cost && job.cost_out) job.cost_out[lane] = static_cast<T>(cost + terminal_cost(model, job, t.x, p.model));
  if (job.cost && job.penalty_out)
    job.penalty_out[lane] = static_cast<T>(penalty + every_penalty(model, *job.cost, t.x, p.model));
  if (job.trajectory) keep(job.trajectory + static_cast<std::size_t>(job.horizon) * nx * job.lanes);
  if (job.final_state) keep(job.final_state);
  if (job.final_effect_state)
    for (std::uint32_t s = 0; s < setup.effect_state_count; ++s)
      job.final_effect_state[static_cast<std::size_t>(s) * job.lanes + lane] = static_cast<T>(t.effect_state[s]);
}

template <class T>
void rollout(const tiller_model_t& table, const RolloutJob<T>& job) {
  const TableModel model(table);
  const Step step(model, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
  for (std::uint32_t lane = 0; lane < job.lanes; ++lane) roll_lane(model, step, job, lane);
}

/// One step from a state and a command, in full.
struct OneStep {
  const TableModel& model;
  const Step& step;
  const LineariseJob& job;
  Parameters<TableModel, double> p{};

  Trajectory<TableModel, double> operator()(Trajectory<TableModel, double> t, const Step::Input& u) const {
    const auto past = [&](int age, int input) {
      return age == 0 ? u[input] : job.history[(age - 1) * model.nu() + input];
    };
    step.advance(t, u, p, past);
    return t;
  }
};

/// Width of a central difference: cube root of the rounding unit, relative to the value's size.
double difference_width(double value) { return 6e-6 * (std::fabs(value) > 1.0 ? std::fabs(value) : 1.0); }

void linearise_lane(const TableModel& model, const Step& step, const LineariseJob& job, std::uint32_t lane) {
  const int nx = model.nx(), nu = model.nu();
  OneStep one{model, step, job};
  Trajectory<TableModel, double> t{};
  load(model, *job.setup, job.state, job.params, job.effect_state, lane, t, one.p);
  Step::Input u{};
  for (int i = 0; i < nu; ++i) u[i] = cell(job.control, static_cast<std::size_t>(i), lane);
  const auto at = [&](double* rows, int row) -> double& {
    return rows[static_cast<std::size_t>(row) * job.lanes + lane];
  };
  for (int c = 0; job.a && c < nx; ++c) {
    const double width = difference_width(t.x[c]);
    auto more = t, less = t;
    more.x[c] += width;
    less.x[c] -= width;
    more = one(more, u);
    less = one(less, u);
    for (int r = 0; r < nx; ++r) at(job.a, r * nx + c) = (more.x[r] - less.x[r]) / (2.0 * width);
  }
  for (int c = 0; job.b && c < nu; ++c) {
    const double width = difference_width(u[c]);
    auto more = u, less = u;
    more[c] += width;
    less[c] -= width;
    const auto high = one(t, more), low = one(t, less);
    for (int r = 0; r < nx; ++r) at(job.b, r * nu + c) = (high.x[r] - low.x[r]) / (2.0 * width);
  }
  const auto next = one(t, u);
  for (int i = 0; i < nx; ++i) at(job.next_state, i) = next.x[i];
  if (job.next_effect_state)
    for (std::uint32_t s = 0; s < job.setup->effect_state_count; ++s)
      at(job.next_effect_state, static_cast<int>(s)) = next.effect_state[s];
}

void linearise(const tiller_model_t& table, const LineariseJob& job) {
  const TableModel model(table);
  const Step step(model, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
  for (std::uint32_t lane = 0; lane < job.lanes; ++lane) linearise_lane(model, step, job, lane);
}

// ---- one-step residuals ------------------------------------------------------------------------------

/// One lane's sums over a block of steps, row by row.
struct ResidualSums {
  double squared[TILLER_MAX_STATES] = {}, projected[TILLER_MAX_STATES][kMaxBasis] = {};
};

/// Where `step` leads from its measured state.
Step::State step_from(const TableModel& model, Step& stepper, const MeasuredStep& step,
                      const Parameters<TableModel, double>& p) {
  Trajectory<TableModel, double> t{};
  Step::Input u{};
  for (int i = 0; i < model.nx(); ++i) t.x[i] = step.state[i];
  for (int i = 0; i < model.nu(); ++i) u[i] = step.input[i];
  const auto past = [&](int age, int input) {
    return age == 0 ? u[input] : step.history[(age - 1) * model.nu() + input];
  };
  stepper.substep_s = (step.period_s > 0.0 ? step.period_s : stepper.setup.period_s) / stepper.setup.substeps;
  stepper.advance(t, u, p, past);
  return t.x;
}

void residual_lane(const TableModel& model, Step& stepper, const ResidualJob& job, std::uint32_t lane) {
  const std::uint32_t nx = static_cast<std::uint32_t>(model.nx());
  Parameters<TableModel, double> p{};
  load_params(model, *job.setup, job.params, lane, p);
  ResidualSums sums;
  for (std::uint32_t k = 0; k < job.count; ++k) {
    const MeasuredStep& step = job.steps[k];
    const Step::State next = step_from(model, stepper, step, p);
    for (std::uint32_t i = 0; i < nx; ++i) {
      const double e = step.change[i] - (next.v[i] - step.state[i]);
      if (job.residual) job.residual[(static_cast<std::size_t>(k) * nx + i) * job.lanes + lane] = static_cast<float>(e);
      const bool missing = std::isnan(step.change[i]);
      if (missing && std::isfinite(next.v[i])) continue;
      sums.squared[i] += step.weight * e * e;
      for (std::uint32_t j = 0; j < job.basis_count; ++j) sums.projected[i][j] += step.weight * step.basis[j] * e;
    }
  }
  for (std::uint32_t i = 0; i < nx; ++i) {
    if (job.squared) job.squared[static_cast<std::size_t>(i) * job.lanes + lane] += sums.squared[i];
    for (std::uint32_t j = 0; job.projected && ((job.basis_rows >> i) & 1u) && j < job.basis_count; ++j)
      job.projected[(static_cast<std::size_t>(i) * job.basis_count + j) * job.lanes + lane] += sums.projected[i][j];
  }
}

void residual(const tiller_model_t& table, const ResidualJob& job) {
  const TableModel model(table);
  Step stepper(model, *job.setup, job.setup->period_s);
  for (std::uint32_t lane = 0; lane < job.lanes; ++lane) residual_lane(model, stepper, job, lane);
}

// ---- the cost to second order ------------------------------------------------------------------------

using PlainExpansion = Expansion<double, TILLER_MAX_STATES, TILLER_MAX_INPUTS>;

void store_expansion(const PlainExpansion& e, int nx, int nu, const QuadratiseJob& job, std::uint32_t lane) {
  const auto all = [&](double* rows, const double* values, int count) {
    if (rows)
      for (int i = 0; i < count; ++i) rows[static_cast<std::size_t>(i) * job.lanes + lane] = values[i];
  };
  all(job.value, &e.value, 1);
  all(job.lx, e.lx, nx);
  all(job.lu, e.lu, nu);
  all(job.lb, e.lb, nu);
  all(job.lxx, e.lxx, nx * nx);
  all(job.luu, e.luu, nu * nu);
  all(job.lux, e.lux, nu * nx);
}

void add_own_function(const TableModel& model, const QuadratiseJob& job, std::uint32_t lane, bool stage,
                      const Step::State& x, const Step::Input& u, PlainExpansion& e) {
  constexpr int kN = TILLER_MAX_STATES + TILLER_MAX_INPUTS;
  const int nx = model.nx(), nu = model.nu(), n = stage ? nx + nu : nx;
  double z[kN], p[TILLER_MAX_PARAMS] = {}, value, gradient[kN], hessian[kN * kN];
  for (int i = 0; i < nx; ++i) z[i] = x[i];
  for (int i = 0; i < nu; ++i) z[nx + i] = u[i];
  for (int i = 0; i < model.np(); ++i) p[i] = cell(job.params, static_cast<std::size_t>(i), lane);
  const double time_s = static_cast<double>(job.task_step + lane) * job.setup->period_s;
  difference_own(*job.cost->own, stage, nx, n, z, p, time_s, value, gradient, hessian);
  add_own<kN>(job.cost->own_weight, nx, nu, n, value, gradient, hessian, e);
}

/// Central differences, one state after the other.
template <class Due>
void add_outputs(const TableModel& model, const QuadratiseJob& job, std::uint32_t lane, bool terminal, const Due& due,
                 const Step::State& x, PlainExpansion& e) {
  const CostTerms<double>& cost = *job.cost;
  const int nx = model.nx(), ny = model.ny();
  ModelParams p{};
  for (int i = 0; i < model.np(); ++i) p[i] = cell(job.params, static_cast<std::size_t>(i), lane);
  const auto y = model.outputs<double>(x, p);
  double gradient[TILLER_MAX_OUTPUTS][TILLER_MAX_STATES];
  Step::State at = x;
  for (int k = 0; k < nx; ++k) {
    const double width = 6e-6 * (std::fabs(x[k]) > 1.0 ? std::fabs(x[k]) : 1.0);
    at[k] = x[k] + width;
    const auto above = model.outputs<double>(at, p);
    at[k] = x[k] - width;
    const auto below = model.outputs<double>(at, p);
    at[k] = x[k];
    for (int j = 0; j < ny; ++j) gradient[j][k] = (above[j] - below[j]) / (2.0 * width);
  }
  for (int j = 0; j < ny; ++j) {
    const tiller_output_cost_t& o = cost.outputs[j];
    const double target =
        cost.output_reference ? due(cost.output_reference, cost.output_reference_rows, ny, j) : o.target;
    expand_output<double>(o, target, terminal ? o.terminal_weight : o.weight, nx, y[j], gradient[j], e);
  }
}

void quadratise_lane(const TableModel& model, const QuadratiseJob& job, std::uint32_t lane, bool stage) {
  const CostTerms<double>& cost = *job.cost;
  const auto due = [&](const double* table, std::uint32_t rows, int count, int index) {
    return table[cost_row(job.task_step + lane, rows) * static_cast<std::size_t>(count) +
                 static_cast<std::size_t>(index)];
  };
  Step::State x{};
  Step::Input u{}, before{};
  for (int i = 0; i < model.nx(); ++i) x[i] = cell(job.state, static_cast<std::size_t>(i), lane);
  PlainExpansion e;
  e.clear(model.nx(), model.nu());
  expand_states<TILLER_MAX_STATES, TableModel, double>(model, cost, stage ? cost.state : cost.terminal, due, x, e);
  if (stage) {
    for (int i = 0; i < model.nu(); ++i) {
      u[i] = cell(job.control, static_cast<std::size_t>(i), lane);
      before[i] = cell(job.before, static_cast<std::size_t>(i), lane);
    }
    expand_inputs<TableModel, double>(model, cost, u, before, e);
  }
  if (cost.has(kCostOutputs) || cost.has(kCostOutputBounds)) add_outputs(model, job, lane, !stage, due, x, e);
  if (cost.has(kCostOwnFunction)) add_own_function(model, job, lane, stage, x, u, e);
  store_expansion(e, model.nx(), model.nu(), job, lane);
}

void quadratise(const tiller_model_t& table, const QuadratiseJob& job) {
  const TableModel model(table);
  for (std::uint32_t lane = 0; lane < job.stages; ++lane) quadratise_lane(model, job, lane, true);
  if (job.terminal) quadratise_lane(model, job, job.stages, false);
}

constexpr RolloutTable make() {
  RolloutTable t;
  t.rollout_f32 = &rollout<float>;
  t.rollout_f64 = &rollout<double>;
  t.linearise = &linearise;
  t.residual = &residual;
  t.quadratise = &quadratise;
  return t;
}

constexpr RolloutTable kTable = make();  // a constant: a static of the function would bring a lock along

}  // namespace

const RolloutTable& table_kernel();
const RolloutTable& table_kernel() { return kTable; }

}  // namespace tiller
