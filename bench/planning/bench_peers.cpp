// tiller's side of ./dev bench planning: takes part in the rounds of table/rounds.hpp, on the same problems as the
// peers.
//
//   bench_peers hover.txt

#include "bench/problems/hover_qp.hpp"
#include "bench/problems/planning_problem.hpp"
#include "bench/table/rounds.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "planners/qp/riccati_qp.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr std::uint32_t kMostIterations = 100;

/// Solves from a cold start to within 1e-3 of the optimum, with the fewest iterations that reach it.
void add_solve(std::vector<Contender>& all, const std::string& name, const tiller_config_t& given, double optimum) {
  std::shared_ptr<Planning> planning;
  double figure = INFINITY;
  std::uint32_t n = 1;
  const auto within = [&] { return std::abs(figure - optimum) <= 1e-3 * optimum; };
  for (; n <= kMostIterations && !within(); ++n) {
    tiller::Config config = given;
    config.planner.iterations = n;
    planning = std::make_shared<Planning>(config);
    planning->plan_cold();
    figure = sequence_cost(planning->planner->sequence(planning->self), 50);
  }
  --n;
  char facts[200];
  std::snprintf(facts, sizeof facts, "\"figure\": %.6g, \"optimum\": %.6g, \"iterations\": %u",
                std::isfinite(figure) ? figure : -1.0, optimum, n);
  all.push_back({name, [planning] { planning->plan_cold(); }, facts, 1.0});
  all.push_back({name + "/iteration", all.back().call, facts, static_cast<double>(n)});
}

void add_gradient(std::vector<Contender>& all) {
  for (const bool limited : {false, true}) {
    const double optimum = limited ? kOptimumBox50 : kOptimumFree50;
    const char* task = limited ? " box" : " free";
    if (const std::uint32_t kind = planner_kind("ilqr"); kind != tiller_planner_kind_count)
      for (const tiller_shooting_t shooting : {tiller_shooting_single, tiller_shooting_multiple}) {
        tiller::Config config = cart_pole_config(kind, 50, limited);
        config.planner.shooting = shooting;
        add_solve(all, std::string(shooting ? "tiller ilqr multiple" : "tiller ilqr single") + task, config, optimum);
      }
    if (const std::uint32_t kind = planner_kind("sqp"); kind != tiller_planner_kind_count)
      add_solve(all, std::string("tiller sqp") + task, cart_pole_config(kind, 50, limited), optimum);
  }
}

void add_mppi(std::vector<Contender>& all) {
  tiller::Config config = cart_pole_config(tiller_planner_mppi);
  config.planner.rollouts = 1536;
  const double swinging[4] = {0.0, 3.0, 0.1, 0.5};
  std::copy(swinging, swinging + 4, config.initial_state);
  auto planning = std::make_shared<Planning>(config);
  all.push_back({"tiller mppi", [planning] { planning->plan(); }, "\"knots\": 6", 1.0});
}

/// Rollouts as the planners make them: 1536 lanes, 50 steps, stage cost, single precision.
void add_rollout(std::vector<Contender>& all) {
  constexpr std::uint32_t kLanes = 1536, kSteps = 50;
  struct Work {
    tiller::Config config = cart_pole_config(tiller_planner_mppi);
    StepSetup setup;
    std::vector<float> state, params, controls, cost, final_state;
    RolloutJob<float> job;
  };
  auto w = std::make_shared<Work>();
  if (make_step_setup(w->config, w->setup) != tiller_status_ok) std::abort();
  for (const double x : CartPoleProblem::kStart) w->state.push_back(static_cast<float>(x));
  for (const float p : {1.0f, 0.1f, 0.5f}) w->params.push_back(p);
  for (std::uint32_t i = 0; i < kLanes * kSteps; ++i)
    w->controls.push_back(static_cast<float>(10.0 * std::sin(0.37 * (i % 7919))));
  w->final_state.resize(4 * kLanes);
  w->job.setup = &w->setup;
  w->job.lanes = kLanes;
  w->job.horizon = kSteps;
  w->job.state = {w->state.data(), 0};
  w->job.params = {w->params.data(), 0};
  w->job.controls = {w->controls.data(), kLanes};
  w->job.final_state = w->final_state.data();
  const auto run = [w] { select_rollout(*w->config.model).rollout_f32(*w->config.model, w->job); };
  run();
  double error = 0.0;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    double x[4], next[4];
    std::copy(CartPoleProblem::kStart, CartPoleProblem::kStart + 4, x);
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      CartPoleProblem{}.step(x, static_cast<double>(w->controls[k * kLanes + lane]), next);
      std::copy(next, next + 4, x);
    }
    for (std::uint32_t i = 0; i < 4; ++i)
      error = std::max(error, std::abs(x[i] - static_cast<double>(w->final_state[i * kLanes + lane])));
  }
  char facts[64];
  std::snprintf(facts, sizeof facts, "\"error\": %.3g", error);
  all.push_back({"tiller rollout", run, facts, double{kLanes} * kSteps});
}

// ---- the hover QP ----------------------------------------------------------------------------------

/// A block that a solver is laid out in.
struct Block {
  std::vector<unsigned char> bytes;
  template <class LayOut>
  void operator()(const LayOut& lay_out) {
    Arena measure;
    lay_out(measure);
    bytes.resize(measure.used() + Arena::kAlignment);
    void* base = bytes.data();
    std::size_t space = bytes.size();
    std::align(Arena::kAlignment, measure.used(), base, space);
    Arena arena(base, measure.used());
    lay_out(arena);
  }
};

struct Hover {
  const HoverQp& given;
  std::vector<double> a, b, qxx, quu, qx, qu, low, high, state_low, state_high;
  Qp qp;
  Block block;
  RiccatiQp riccati;
  OsqpQp osqp;
  QpSolution solution;
  QpLimits limits;
  bool use_osqp;
  double worst = 0.0;
  int unsolved = 0;

  Hover(const HoverQp& file, bool with_osqp, double tolerance) : given(file), use_osqp(with_osqp) {
    const std::size_t n = static_cast<std::size_t>(file.horizon);
    const auto repeat = [](std::vector<double>& to, const std::vector<double>& one) {
      to.insert(to.end(), one.begin(), one.end());
    };
    for (std::size_t k = 0; k < n; ++k) repeat(a, file.a), repeat(b, file.b), repeat(qxx, file.q), repeat(quu, file.r);
    repeat(qxx, file.qf);
    qx.assign(12 * (n + 1), 0.0);
    qu.assign(4 * n, 0.0);
    low.assign(4 * n, -file.u_max);
    high.assign(4 * n, file.u_max);
    state_low.assign(12 * (n + 1), -file.x_max);
    state_high.assign(12 * (n + 1), file.x_max);
    qp.lq.states = 12;
    qp.lq.inputs = 4;
    qp.lq.horizon = static_cast<std::uint32_t>(file.horizon);
    qp.lq.a = a.data(), qp.lq.b = b.data(), qp.lq.qxx = qxx.data(), qp.lq.quu = quu.data();
    qp.lq.qx = qx.data(), qp.lq.qu = qu.data(), qp.lq.low = low.data(), qp.lq.high = high.data();
    qp.state_low = state_low.data(), qp.state_high = state_high.data();
    limits.tolerance = tolerance;
    limits.iterations = use_osqp ? 4000 : 50;
    const std::vector<std::uint8_t> bounded(12, 1);
    // what is never anything but zero, as the Python package's sparse matrices leave it out
    const auto pattern = [&](const std::vector<double>& dense, std::size_t entries) {
      std::vector<std::uint8_t> nonzero(entries);
      for (std::size_t i = 0; i < dense.size(); ++i) nonzero[i % entries] |= dense[i] != 0.0;
      return nonzero;
    };
    const auto pa = pattern(a, 144), pb = pattern(b, 48), pq = pattern(qxx, 144), pr = pattern(quu, 16);
    block([&](Arena& arena) {
      solution = lay_out_qp_solution(arena, qp.lq);
      if (!use_osqp) {
        riccati = lay_out_riccati_qp(arena, qp.lq, select_lq(best_isa(), 12, 4));
        return;
      }
      OsqpShape shape;
      shape.sizes = qp.lq;
      shape.bounded = bounded.data();
      shape.a = pa.data(), shape.b = pb.data(), shape.qxx = pq.data(), shape.quu = pr.data();
      shape.tolerance = tolerance;
      osqp = lay_out_osqp(arena, shape);
    });
    for (int i = 0; i < file.count; ++i) {
      unsolved += solve(i) != QpStatus::solved;
      for (std::size_t j = 0; j < 4; ++j)
        worst = std::max(worst, std::abs(solution.u[j] - file.u0[4 * static_cast<std::size_t>(i) + j]));
    }
  }
  Hover(const Hover&) = delete;
  Hover& operator=(const Hover&) = delete;
  QpStatus solve(int i) {
    qp.start = given.state(i);
    const QpStatus status = use_osqp ? solve_osqp(osqp, qp, limits, true, solution).status
                                     : solve_riccati_qp(riccati, qp, limits, solution).status;
    qp.repeats = true;  // the peers are told too that vectors alone change
    return status;
  }
};

void add_hover(std::vector<Contender>& all, const HoverQp& file, bool with_osqp) {
  std::shared_ptr<Hover> hover;
  double tolerance = 1e-3;
  while (tolerance > 1e-9) {
    hover = std::make_shared<Hover>(file, with_osqp, tolerance);
    if (hover->worst <= 1e-4 && hover->unsolved == 0) break;
    tolerance *= 0.1;
  }
  char facts[160];
  std::snprintf(facts, sizeof facts, "\"error\": %.3g, \"unsolved\": %d, \"of\": %d, \"tolerance\": %g", hover->worst,
                hover->unsolved, file.count, tolerance);
  const auto call = [hover, &file] {
    for (int i = 0; i < file.count; ++i) hover->solve(i);
  };
  all.push_back(
      {with_osqp ? "tiller qp osqp hover" : "tiller qp riccati hover", call, facts, static_cast<double>(file.count)});
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "bench_peers: which hover QP? (peers/hover_problem.py writes it)\n");
    return 2;
  }
  const HoverQp hover(argv[1]);
  std::vector<Contender> all;
  add_gradient(all);
  add_mppi(all);
  add_rollout(all);
  add_hover(all, hover, false);
  if (has_osqp()) add_hover(all, hover, true);
  return take_part(all);
}
