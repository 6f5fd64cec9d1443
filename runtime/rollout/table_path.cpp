// Paths of a model that is written in C: one point after the other through the same stepper, central differences.

#include <cmath>

#include "rollout/fading.hpp"
#include "rollout/output_cost.hpp"
#include "rollout/path.hpp"
#include "rollout/step.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

using Step = Stepper<TableModel, double>;
using Point = Trajectory<TableModel, double>;

/// Width of a central difference, relative to the value's size. What is differenced is one period, whose curvature is
/// that of the dynamics times the period: wider than the textbook's cube root of the rounding unit, and 1e-12 good.
double difference_width(double value) { return 5e-5 * (std::fabs(value) > 1.0 ? std::fabs(value) : 1.0); }

/// z = (x, effect states) in one index.
struct Plane {
  int nx, ns;
  int nz() const { return nx + ns; }
  double& of(Point& t, int i) const { return i < nx ? t.x[i] : t.effect_state[i - nx]; }
  void load(const double* z, Point& t) const {
    for (int i = 0; i < nz(); ++i) of(t, i) = z[i];
  }
};

/// Of stage k: forces that fade are less by then.
void load_params(const TableModel& model, const StepSetup& setup, const double* row, std::size_t count, std::size_t k,
                 Parameters<TableModel, double>& p) {
  const std::size_t np = static_cast<std::size_t>(model.np());
  for (std::size_t i = 0; i < np; ++i) p.model.v[i] = row[i];
  for (std::size_t i = np; i < count; ++i) p.effect[i - np] = row[i];
  if (setup.fading > 0) fade(model, setup, turn_after(model, setup, p, static_cast<double>(k)), p);
}

void linearise(const tiller_model_t& table, const PathJob& job) {
  const TableModel model(table);
  const Step step(model, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
  const Plane plane = {model.nx(), static_cast<int>(job.setup->effect_state_count)};
  const int nz = plane.nz(), nu = model.nu();
  const std::size_t n = job.lq_states, params = job.param_count;
  Parameters<TableModel, double> p{};
  for (std::size_t k = 0; k < job.horizon; ++k)
    for (std::size_t j = 0; j < job.scenarios; ++j) {
      const std::size_t at = k * job.scenarios + j;
      load_params(model, *job.setup, job.params + j * params, params, k, p);
      Point t{};
      Step::Input u{};
      plane.load(job.state + at * nz, t);
      for (int i = 0; i < nu; ++i) u[i] = job.control[k * nu + i];
      for (int c = 0; job.a && c < nz + nu; ++c) {
        const bool of_input = c >= nz;
        const double width = difference_width(of_input ? u[c - nz] : plane.of(t, c));
        Point more = t, less = t;
        Step::Input u_more = u, u_less = u;
        (of_input ? u_more[c - nz] : plane.of(more, c)) += width;
        (of_input ? u_less[c - nz] : plane.of(less, c)) -= width;
        step.advance(more, u_more, p);
        step.advance(less, u_less, p);
        for (int r = 0; r < nz; ++r) {
          const double slope = (plane.of(more, r) - plane.of(less, r)) / (2.0 * width);
          if (of_input)
            job.b[(at * n + r) * nu + c - nz] = slope;
          else
            job.a[(at * n + r) * n + c] = slope;
        }
      }
      step.advance(t, u, p);
      for (int i = 0; i < nz; ++i) job.next[at * nz + i] = plane.of(t, i);
    }
}

/// The input of one candidate: as in GradientKernel::feedback_lanes.
double feedback_input(const FeedbackJob& job, const Plane& plane, Point* t, const double* before, std::size_t k,
                      std::size_t lane, int i, int nu) {
  const std::size_t row = k * nu + i, count = job.scenarios, n = job.lq_states;
  const int nz = plane.nz();
  double wish = job.control[row] + job.alpha[lane] * job.step[row];
  const double* gain = job.gain + row * count * n;
  const double* last = k > 0 ? job.control + (k - 1) * nu : job.previous_input;
  double sum = 0.0;
  for (std::size_t j = 0; j < count; ++j) {
    for (int c = 0; c < nz; ++c) sum += gain[j * n + c] * (plane.of(t[j], c) - job.state[(k * count + j) * nz + c]);
    for (int c = 0; n > static_cast<std::size_t>(nz) && c < nu; ++c)
      sum += gain[j * n + nz + c] * (before[c] - last[c]);
  }
  wish += job.beta[lane] * sum;
  const double low = std::fmax(job.low[i], before[i] - job.most_change[i]);
  const double high = std::fmin(job.high[i], before[i] + job.most_change[i]);
  return wish < low ? low : wish > high ? high : wish;  // a NaN comes through
}

/// Cost of a state without the inputs' own terms; u is null at the end of the horizon.
double own_cost(const FeedbackJob& job, std::uint64_t row, const double* x, const double* u, const double* p) {
  const CostTerms<double>& cost = *job.cost;
  if (!cost.has(kCostOwnFunction)) return 0.0;
  const double time_s = static_cast<double>(row) * job.setup->period_s;
  if (u) return cost.own_weight * cost.own->stage(x, u, p, time_s, cost.own->context);
  return cost.own->terminal ? cost.own_weight * cost.own->terminal(x, p, time_s, cost.own->context) : 0.0;
}

void feedback(const tiller_model_t& table, const FeedbackJob& job) {
  const TableModel model(table);
  const Step step(model, *job.setup, job.period_s > 0.0 ? job.period_s : job.setup->period_s);
  const Plane plane = {model.nx(), static_cast<int>(job.setup->effect_state_count)};
  const int nz = plane.nz(), nu = model.nu();
  const std::size_t count = job.scenarios, params = job.param_count;
  for (std::size_t lane = 0; lane < kCandidates; ++lane) {
    Point t[TILLER_MAX_SCENARIOS] = {};
    Step::Input before{};
    double cost[TILLER_MAX_SCENARIOS] = {};
    for (std::size_t j = 0; j < count; ++j) plane.load(job.start + j * nz, t[j]);
    for (int i = 0; i < nu; ++i) before[i] = job.previous_input[i];
    const auto keep = [&](std::size_t k, std::size_t j) {
      for (int i = 0; i < nz; ++i) job.state_out[((k * count + j) * nz + i) * kCandidates + lane] = plane.of(t[j], i);
    };
    for (std::size_t k = 0; k < job.horizon; ++k) {
      const std::uint64_t row = job.task_step + k;
      Step::Input u{};
      for (int i = 0; i < nu; ++i) u[i] = feedback_input(job, plane, t, before.v, k, lane, i, nu);
      if (job.cones) keep_cones(*job.cones, static_cast<std::uint32_t>(nu), before.v, job.most_change, u.v);
      for (int i = 0; i < nu; ++i) job.control_out[(k * nu + i) * kCandidates + lane] = u[i];
      const double inputs = input_cost<TableModel, double>(model, *job.cost, u, before);
      for (std::size_t j = 0; j < count; ++j) {
        Parameters<TableModel, double> p{};
        load_params(model, *job.setup, job.params + j * params, params, k, p);
        keep(k, j);
        cost[j] += inputs + every_state_cost<TableModel, double>(model, *job.cost, job.cost->state, row, t[j].x) +
                   output_cost<TableModel, double>(model, *job.cost, false, row, t[j].x, p.model) +
                   own_cost(job, row, t[j].x.v, u.v, p.model.v);
        step.advance(t[j], u, p);
      }
      before = u;
    }
    for (std::size_t j = 0; j < count; ++j) {
      const std::uint64_t row = job.task_step + job.horizon;
      keep(job.horizon, j);
      Parameters<TableModel, double> p{};
      load_params(model, *job.setup, job.params + j * params, params, job.horizon, p);
      job.cost_out[j * kCandidates + lane] =
          cost[j] + every_terminal_cost<TableModel, double>(model, *job.cost, row, t[j].x) +
          output_cost<TableModel, double>(model, *job.cost, true, row, t[j].x, p.model) +
          own_cost(job, row, t[j].x.v, nullptr, p.model.v);
    }
  }
}

constexpr PathKernel kTablePath = {&linearise, &feedback};

}  // namespace

const PathKernel& select_path(const RolloutTable& table) { return table.path ? *table.path : kTablePath; }

}  // namespace tiller
