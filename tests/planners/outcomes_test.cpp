// mcts over hypotheses that a move tells apart. The optimum over all policies that react to what is seen, and the best
// sequence that does not, are found here by dynamic programming and by going through all sequences, in double and
// without a line of the planner.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <random>

#include "planners/mcts_outcomes.hpp"
#include "planners/mcts_tree.hpp"
#include "problem.hpp"
#include "thread_pool.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPeriod = 0.1;

using Point = std::array<double, 2>;

/// A world of moves by a tenth of a metre: rates are constant over a period, so any integrator is exact.
struct World {
  tiller_model_t model;
  tiller_own_cost_t cost;
  std::vector<double> hidden;  // the parameter's value in each hypothesis
  std::uint32_t periods;       // beyond, nothing costs
  double bound_m = kInfinity;  // of x, and what its violation costs
  double bound_weight = 0.0;

  Point next(const Point& x, const double* u, double p) const {
    const double state[2] = {x[0], x[1]}, force[TILLER_MAX_JOINTS] = {};
    double rate[2] = {};
    model.dynamics(state, u, force, nullptr, &p, rate);
    Point to = x;
    for (std::uint32_t i = 0; i < model.state_count; ++i) to[i] += kPeriod * rate[i];
    return to;
  }
  double stage(const Point& x, std::uint32_t step) const {
    const double u[2] = {}, p = 0.0;
    const double beyond = std::max(0.0, x[0] - bound_m);
    const double value = cost.stage(x.data(), u, &p, step * kPeriod, nullptr) + bound_weight * beyond * beyond;
    return std::isfinite(value) ? value : kInfinity;
  }
};

tiller_model_t model_of(const char* name, std::uint32_t dimension) {
  static const char* const states[] = {"x_m", "y_m"};
  static const char* const inputs[] = {"x_m_s", "y_m_s"};
  static const char* const params[] = {"hidden"};
  tiller_model_t m{};
  m.size = sizeof m;
  m.version = TILLER_MODEL_VERSION;
  m.name = name;
  m.state_count = m.input_count = dimension;
  m.param_count = 1;
  m.state_names = states;
  m.input_names = inputs;
  m.param_names = params;
  return m;
}

tiller_own_cost_t cost_of(double (*stage)(const double*, const double*, const double*, double, void*)) {
  tiller_own_cost_t c{};
  c.size = sizeof c;
  c.version = TILLER_CONFIG_VERSION;
  c.stage = stage;
  return c;
}

constexpr std::uint32_t kLinePeriods = 6, kBridgePeriods = 7;

/// A cart whose motor may be wired the wrong way round, its goal 0.3 m ahead and the table's edge 0.15 m behind it.
/// Beyond the edge nothing is a number. No sequence is good for both wirings.
const World& line_world() {
  static const World world = [] {
    World w{model_of("cart", 1), {}, {1.0, -1.0}, kLinePeriods};
    w.model.dynamics = [](const double*, const double* u, const double*, const tiller_body_t*, const double* p,
                          double* rate) { rate[0] = p[0] * u[0]; };
    w.cost = cost_of([](const double* x, const double*, const double*, double time_s, void*) {
      if (time_s > (kLinePeriods - 0.5) * kPeriod) return 0.0;
      if (x[0] < -0.15) return kNaN;
      return (x[0] - 0.3) * (x[0] - 0.3);
    });
    return w;
  }();
  return world;
}

/// A base on a plane that drifts to one side or the other as it goes forward, or does not. A bridge 0.1 m wide leads to
/// the goal at x = 0.3 m, over a pit. The drift shows when the base first goes forward.
const World& bridge_world() {
  static const World world = [] {
    World w{model_of("base", 2), {}, {1.0, 0.0, -1.0}, kBridgePeriods};
    w.model.dynamics = [](const double*, const double* u, const double*, const tiller_body_t*, const double* p,
                          double* rate) {
      rate[0] = u[0];
      rate[1] = u[1] + p[0] * u[0];
    };
    w.cost = cost_of([](const double* x, const double*, const double*, double time_s, void*) {
      if (time_s > (kBridgePeriods - 0.5) * kPeriod || x[0] > 0.25) return 0.0;
      const bool in_pit = x[0] > 0.15 && std::fabs(x[1]) > 0.05;
      return in_pit ? 4.0 : 1.0;
    });
    return w;
  }();
  return world;
}

std::vector<std::array<double, 2>> moves_of(const World& w) {
  std::vector<std::array<double, 2>> moves;
  for (const double a : {-1.0, 0.0, 1.0})
    for (const double b : {-1.0, 0.0, 1.0})
      if (w.model.input_count == 2 || b == 0.0) moves.push_back({a, b});
  return moves;
}

// ---- the exact answers --------------------------------------------------------------------------

/// A state of knowledge: where the robot is under each hypothesis that is left.
using Knowledge = std::map<std::size_t, Point>;
enum class Over { mean, worst };

std::vector<int> key_of(const Knowledge& k, std::uint32_t step) {
  std::vector<int> key = {static_cast<int>(step)};
  for (const auto& [m, x] : k) {
    key.push_back(static_cast<int>(m));
    for (const double v : x) key.push_back(static_cast<int>(std::lround(v * 1000.0)));
  }
  return key;
}

/// Knowledge after a move, one for each thing that may then be seen.
std::vector<Knowledge> see(const World& w, const Knowledge& k, const double* u) {
  std::map<std::vector<int>, Knowledge> seen;
  for (const auto& [m, x] : k) {
    const Point to = w.next(x, u, w.hidden[m]);
    seen[key_of({{0, to}}, 0)][m] = to;
  }
  std::vector<Knowledge> all;
  for (const auto& [what, who] : seen) all.push_back(who);
  return all;
}

double combine(Over over, const std::vector<std::pair<double, double>>& weighted) {
  double value = 0.0;
  for (const auto& [weight, cost] : weighted)
    value = over == Over::worst ? std::max(value, cost) : value + weight * cost;
  return value;
}

/// Least cost of all policies, by dynamic programming over knowledge: mean, or for the unluckiest hypothesis. The worst
/// case adds along a path, so it is taken over sums from the start on.
struct ClosedLoop {
  const World& w;
  Over over;
  std::map<std::vector<int>, double> known;

  double operator()(const Knowledge& k, std::uint32_t step) {
    if (step == w.periods) return 0.0;
    const std::vector<int> key = key_of(k, step);
    const auto found = known.find(key);
    if (found != known.end()) return found->second;
    double best = kInfinity;
    for (const auto& u : moves_of(w)) {
      std::vector<std::pair<double, double>> outcomes;
      for (const Knowledge& after : see(w, k, u.data()))
        outcomes.push_back(
            {static_cast<double>(after.size()) / static_cast<double>(k.size()), (*this)(after, step + 1)});
      best = std::min(best, combine(over, outcomes));
    }
    // hypotheses that are not told apart are at one place: they cost the same now
    return known[key] = w.stage(k.begin()->second, step) + best;
  }
};

/// Least cost of all sequences: every one is tried.
double best_open_loop(const World& w, Over over, const std::vector<Point>& at, std::vector<double> cost,
                      std::uint32_t step) {
  for (std::size_t m = 0; m < at.size(); ++m) cost[m] += w.stage(at[m], step);
  if (step + 1 == w.periods) {  // the last move costs nothing
    std::vector<std::pair<double, double>> all;
    for (const double c : cost) all.push_back({1.0 / static_cast<double>(at.size()), c});
    return combine(over, all);
  }
  double best = kInfinity;
  for (const auto& u : moves_of(w)) {
    std::vector<Point> next;
    for (std::size_t m = 0; m < at.size(); ++m) next.push_back(w.next(at[m], u.data(), w.hidden[m]));
    best = std::min(best, best_open_loop(w, over, next, cost, step + 1));
  }
  return best;
}

// ---- the planner on them ------------------------------------------------------------------------

tiller::Config config_of(const World& w, std::uint32_t particles) {
  tiller::Config c = line_config(tiller_planner_mcts);
  c.model = &w.model;
  c.period_s = kPeriod;
  c.planner.horizon = w.periods;
  c.planner.hold_steps = 1;
  c.planner.levels = 3;
  c.planner.nodes = 8192;
  c.planner.iterations = 60;
  c.planner.particles = particles;
  std::fill(std::begin(c.cost.state_weight), std::end(c.cost.state_weight), 0.0);
  std::fill(std::begin(c.cost.terminal_weight), std::end(c.cost.terminal_weight), 0.0);
  std::fill(std::begin(c.cost.input_weight), std::end(c.cost.input_weight), 0.0);
  c.cost.own = &w.cost;
  c.cost.own_weight = 1.0;
  for (std::uint32_t i = 0; i < w.model.input_count; ++i) {
    c.safety.input_low[i] = -1.0;
    c.safety.input_high[i] = 1.0;
  }
  c.measurement_count = w.model.state_count;
  for (std::uint32_t i = 0; i < w.model.state_count; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = 0.01;  // a move of 0.1 m one way or the other is 20 standard deviations
  }
  return c;
}

/// The planner over the hypotheses of a world.
class Rig {
 public:
  explicit Rig(const World& w, const tiller_config_t& config, const tiller_hooks_t* hooks = nullptr)
      : bench(config, hooks, tiller::select_rollout(*config.model)), w_(w) {
    Knowledge all;
    for (std::size_t m = 0; m < w.hidden.size(); ++m) all[m] = {0.0, 0.0};
    know(all);
  }
  void know(const Knowledge& k) {
    params_.clear();
    state_.clear();
    for (const auto& [m, x] : k) params_.push_back(static_cast<float>(w_.hidden[m]));
    for (std::uint32_t i = 0; i < w_.model.state_count; ++i)
      for (const auto& [m, x] : k) state_.push_back(static_cast<float>(x[i]));
    bench.belief.count = static_cast<std::uint32_t>(k.size());
    bench.belief.params = params_.data();
    bench.belief.state = state_.data();
  }
  float& state(std::size_t i) { return state_[i]; }
  tiller::PlanResult plan(std::uint32_t step) {
    bench.request.task_step = step;
    return bench.plan();
  }

  Bench bench;

 private:
  const World& w_;
  std::vector<float> params_, state_;
};

Knowledge at_start(const World& w) {
  Knowledge k;
  for (std::size_t m = 0; m < w.hidden.size(); ++m) k[m] = {0.0, 0.0};
  return k;
}

/// What it costs to play the first input, see, keep the hypotheses that agree, and plan again, if `truth` is true.
double play(const World& w, const tiller_config_t& config, std::size_t truth) {
  Rig rig(w, config);
  Knowledge k = at_start(w);
  double cost = 0.0;
  for (std::uint32_t step = 0; step < w.periods; ++step) {
    cost += w.stage(k.at(truth), step);
    rig.know(k);
    rig.plan(step);
    for (const Knowledge& after : see(w, k, rig.bench.command))
      if (after.count(truth)) {
        k = after;
        break;
      }
  }
  return cost;
}

void expect_optimal(const World& w, std::uint32_t risk, Over over) {
  tiller::Config c = config_of(w, static_cast<std::uint32_t>(w.hidden.size()));
  c.planner.risk = risk;
  ClosedLoop closed{w, over, {}};
  const double optimum = closed(at_start(w), 0);
  const std::size_t m = w.hidden.size();
  const double open = best_open_loop(w, over, std::vector<Point>(m, Point{}), std::vector<double>(m), 0);
  Rig rig(w, c);
  const double told = rig.plan(0).cost;
  std::vector<std::pair<double, double>> played;
  for (std::size_t truth = 0; truth < m; ++truth) played.push_back({1.0 / static_cast<double>(m), play(w, c, truth)});
  std::printf("%s, %s: optimum %.4f, told by the plan %.4f, played %.4f; best sequence %.4f\n", w.model.name,
              over == Over::mean ? "mean" : "worst", optimum, told, combine(over, played), open);
  EXPECT_GT(open, 1.1 * optimum) << "the world asks for no reaction";
  EXPECT_NEAR(told, optimum, 0.01 * optimum);
  EXPECT_NEAR(combine(over, played), optimum, 0.01 * optimum);
}

TEST(Outcomes, a_motor_of_unknown_sign_is_tried_and_then_known) {
  expect_optimal(line_world(), tiller_risk_mean, Over::mean);
  expect_optimal(line_world(), tiller_risk_worst, Over::worst);
}

TEST(Outcomes, a_bridge_is_crossed_after_the_drift_was_seen) {
  expect_optimal(bridge_world(), tiller_risk_mean, Over::mean);
  expect_optimal(bridge_world(), tiller_risk_worst, Over::worst);
}

/// A bound that no plan can keep. The planner takes off what all simulations of a hypothesis pay for it, which changes
/// from batch to batch, and the costs that outcomes keep have to follow. The optimum has a period more than the
/// horizon, because bounds count in the last state too.
TEST(Outcomes, cost_what_they_cost_beyond_a_bound) {
  for (const double weight : {1.0, 1e3, 1e6}) {
    World w = line_world();
    w.periods = kLinePeriods + 1;
    w.bound_m = -0.12;
    w.bound_weight = weight;
    for (const auto& [risk, over] :
         {std::pair(tiller_risk_mean, Over::mean), std::pair(tiller_risk_worst, Over::worst)}) {
      const double high[] = {w.bound_m}, low[] = {-kInfinity};
      tiller::Config c = config_of(w, 2);
      c.planner.horizon = kLinePeriods;
      c.planner.risk = risk;
      c.cost.bound_weight = &w.bound_weight;
      c.cost.state_low = low;
      c.cost.state_high = high;
      ClosedLoop closed{w, over, {}};
      const double optimum = closed(at_start(w), 0);
      Rig rig(w, c);
      const double told = rig.plan(0).cost;
      std::printf("bound of weight %.0e: optimum %.6f, told by the plan %.6f\n", weight, optimum, told);
      EXPECT_NEAR(told, optimum, 1e-6 * optimum);  // some ten roundings of 6e-8; plans differ by 0.1 and more
    }
  }
}

/// A sensor that tells nothing apart leaves the sequence that is best for all, and its plan is that of a robot without
/// any sensor, to the last bit.
TEST(Outcomes, that_look_alike_leave_the_open_loop_plan) {
  for (const World* w : {&line_world(), &bridge_world()}) {
    tiller::Config blurred = config_of(*w, static_cast<std::uint32_t>(w->hidden.size()));
    tiller::Config blind = blurred;
    for (double& sd : blurred.measurement_sd) sd = 10.0;
    blind.measurement_count = 0;
    Rig a(*w, blurred), b(*w, blind);
    const std::size_t m = w->hidden.size();
    const double open = best_open_loop(*w, Over::mean, std::vector<Point>(m, Point{}), std::vector<double>(m), 0);
    for (std::uint32_t step = 0; step < w->periods; ++step) {
      const tiller::PlanResult one = a.plan(step), other = b.plan(step);
      EXPECT_EQ(one.cost, other.cost) << step;
      EXPECT_EQ(std::vector<float>(a.bench.sequence(), a.bench.sequence() + w->periods),
                std::vector<float>(b.bench.sequence(), b.bench.sequence() + w->periods));
      if (step == 0) {
        EXPECT_NEAR(one.cost, open, 0.01 * open);
      }
    }
  }
}

/// Process noise blurs like a sensor's: 0.1 m of it after a period hide a difference of 0.2 m.
TEST(Outcomes, drown_in_process_noise) {
  tiller::Config c = config_of(line_world(), 2);
  Rig seen(line_world(), c);
  c.process_sd[0] = 0.1 / std::sqrt(kPeriod);
  Rig hidden(line_world(), c);
  c.measurement_count = 0;
  Rig blind(line_world(), c);
  const double cost = hidden.plan(0).cost;
  EXPECT_GT(cost, 1.1 * seen.plan(0).cost);
  EXPECT_LE(cost, blind.plan(0).cost);  // more than one move apart they may still be told
}

TEST(Outcomes, are_the_same_on_any_number_of_threads) {
  const World& w = bridge_world();
  tiller::Config c = config_of(w, 3);
  c.planner.iterations = 5;
  c.planner.rollouts = 1040;  // the last chunk is not full
  const auto run = [&](const tiller_hooks_t* hooks) {
    Rig rig(w, c, hooks);
    std::vector<double> all;
    for (std::uint32_t step = 0; step < 5; ++step) {
      all.push_back(rig.plan(step).cost);
      all.insert(all.end(), rig.bench.sequence(), rig.bench.sequence() + 2 * w.periods);
    }
    return all;
  };
  const std::vector<double> reference = run(nullptr);
  for (const std::uint32_t threads : {1u, 2u, 4u}) {
    ThreadPool pool(threads);
    const tiller_hooks_t hooks = pool.hooks();
    EXPECT_EQ(run(&hooks), reference) << threads;
  }
  EXPECT_EQ(run(nullptr), reference);
}

std::int64_t reads = 0;

TEST(Outcomes, keep_deadlines) {
  tiller_hooks_t hooks{};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.now_ns = [](void*) { return ++reads; };
  const World& w = bridge_world();
  Rig rig(w, config_of(w, 3), &hooks);
  std::mt19937 random(7);
  int cut = 0, later = 0;
  for (int k = 0; k < 300; ++k) {
    reads = 0;
    rig.bench.request.deadline.deadline_ns = 1 + static_cast<std::int64_t>(random() % 200);
    rig.bench.request.tick = static_cast<std::uint64_t>(k);
    const tiller::PlanResult result = rig.plan(0);
    for (int i = 0; i < 2; ++i) {
      const double u = rig.bench.command[i];
      ASSERT_TRUE(u == -1.0 || u == 0.0 || u == 1.0) << u;
    }
    // the clock is read by the loop around the batches once more, and by no rollout
    ASSERT_LE(reads - rig.bench.request.deadline.deadline_ns, 1) << k;
    ASSERT_TRUE(result.iterations == 0 || std::isfinite(result.cost));
    cut += result.status == tiller_status_iteration_capped;
    later += result.iterations > 3;
  }
  EXPECT_EQ(cut, 300);
  EXPECT_GT(later, 100) << "cut before anything was told apart";
}

TEST(Outcomes, of_hypotheses_that_are_no_numbers_are_no_plan) {
  const World& w = bridge_world();
  Rig rig(w, config_of(w, 3));
  ASSERT_EQ(rig.plan(0).status, tiller_status_ok);
  for (std::size_t i = 0; i < 6; ++i) {
    Rig sick(w, config_of(w, 3));
    const double cost = sick.plan(0).cost;
    const float kept = sick.state(i);
    sick.state(i) = std::numeric_limits<float>::quiet_NaN();
    const tiller::PlanResult result = sick.plan(0);
    EXPECT_EQ(result.status, tiller_status_plan_not_finite);
    for (int k = 0; k < 2; ++k) EXPECT_LE(std::fabs(sick.bench.command[k]), 1.0);
    sick.state(i) = kept;
    EXPECT_NEAR(sick.plan(0).cost, cost, 0.01 * cost) << "the next belief is planned over as ever";
  }
}

/// Nothing is written outside of the block that was measured, and one byte less is refused.
TEST(Outcomes, keep_to_their_memory) {
  const World& w = bridge_world();
  const tiller::Config c = config_of(w, 3);
  const tiller::PlannerTable* planner = tiller::find_planner(tiller_planner_mcts);
  tiller::StepSetup setup;
  setup.period_s = kPeriod;
  const tiller::RolloutTable& table = tiller::select_rollout(w.model);
  tiller::Arena measure;
  planner->lay_out(measure, c, setup, table, nullptr);
  const std::size_t bytes = measure.used(), margin = 4096;
  std::vector<unsigned char> block(bytes + 2 * margin + 64, 0xa5);
  unsigned char* const begin =
      block.data() + margin + (64 - reinterpret_cast<std::uintptr_t>(block.data() + margin) % 64) % 64;
  tiller::Arena less(begin, bytes - 1);
  EXPECT_EQ(planner->lay_out(less, c, setup, table, nullptr), nullptr);
  tiller::Arena exact(begin, bytes);
  void* const self = planner->lay_out(exact, c, setup, table, nullptr);
  ASSERT_NE(self, nullptr);
  EXPECT_EQ(exact.used(), bytes);
  Rig rig(w, c);
  double command[2];
  for (std::uint64_t tick = 0; tick < 20; ++tick) {
    rig.bench.request.tick = tick;
    planner->plan(self, rig.bench.request, command);
  }
  EXPECT_TRUE(std::all_of(block.data(), begin, [](unsigned char b) { return b == 0xa5; }));
  EXPECT_TRUE(std::all_of(begin + bytes, block.data() + block.size(), [](unsigned char b) { return b == 0xa5; }));
  // a planner of one hypothesis pays for none of it
  tiller::Config one = c, blind = c;
  one.planner.particles = 1;
  blind.planner.particles = 1;
  blind.measurement_count = 0;
  tiller::Arena a, b;
  planner->lay_out(a, one, setup, table, nullptr);
  planner->lay_out(b, blind, setup, table, nullptr);
  EXPECT_EQ(a.used(), b.used());
}

// ---- the rule by which hypotheses are told apart ------------------------------------------------

TEST(OutcomeGroups, are_six_standard_deviations_apart) {
  tiller::Config c = config_of(line_world(), 5);
  c.measurement_sd[0] = 0.3;
  c.process_sd[0] = 0.4;  // with one second ahead the deviation is 0.5
  std::unique_ptr<unsigned char[]> memory(new unsigned char[65536]);
  tiller::Arena arena(memory.get() + (64 - reinterpret_cast<std::uintptr_t>(memory.get()) % 64) % 64, 65000);
  tiller::Outcomes outcomes;
  outcomes.lay_out(arena, c, 4, 3);
  const auto groups = [&](std::vector<float> y, std::uint64_t hypotheses) {
    for (std::uint32_t m = 0; m < 5; ++m) outcomes.record(2, 1, m, &y[m], 1);
    std::uint64_t found[tiller::kMostHypotheses];
    const std::uint32_t count = outcomes.partition(2, 1, 1.0, hypotheses, found);
    return std::vector<std::uint64_t>(found, found + count);
  };
  using Groups = std::vector<std::uint64_t>;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(groups({0.0f, 2.99f, -2.99f, 1.0f, 2.0f}, 31), Groups({31}));
  EXPECT_EQ(groups({0.0f, 3.01f, -3.01f, 0.0f, 0.0f}, 31), Groups({25, 2, 4}));
  EXPECT_EQ(groups({0.0f, 4.0f, 1.9f, 2.1f, 9.0f}, 31), Groups({5, 10, 16})) << "to the nearest of two";
  EXPECT_EQ(groups({0.0f, 9.0f, 0.0f, 9.0f, 0.0f}, 10), Groups({10})) << "only those asked about";
  EXPECT_EQ(groups({0.0f, nan, 9.0f, nan, 9.0f}, 31), Groups({11, 20})) << "no number is told apart from nothing";
  EXPECT_EQ(groups({nan, 0.0f, 9.0f, 20.0f, 30.0f}, 31), Groups({31}));
}

// ---- the tree -----------------------------------------------------------------------------------

using tiller::MctsTree;

struct Tree {
  Tree() : memory(new unsigned char[1 << 20]) {
    tiller::Arena arena(memory.get() + (64 - reinterpret_cast<std::uintptr_t>(memory.get()) % 64) % 64, (1 << 20) - 64);
    tree.lay_out(arena, 1024, 4);
    EXPECT_TRUE(arena.fits());
    tree.clear(3);
    tree.begin_belief(4);
  }
  std::unique_ptr<unsigned char[]> memory;
  MctsTree tree;
};

constexpr std::uint32_t kNothing[4] = {MctsTree::kNone, MctsTree::kNone, MctsTree::kNone, MctsTree::kNone};

/// One batch of `count` walks, their words by `random`; every node on a path of choices that ends in 2 tells hypotheses
/// 0 and 1 from 2 and 3.
void batch(MctsTree& tree, std::uint32_t count, std::mt19937& random, bool cancelled) {
  std::vector<std::vector<std::uint32_t>> walks;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::uint32_t ends[8];
    const std::uint32_t n = tree.select_all({4, kNothing, static_cast<std::uint32_t>(random()), {0.0, 2.0}, 1.0}, ends);
    walks.emplace_back(ends, ends + n);
  }
  if (cancelled) {
    for (const auto& ends : walks)
      for (const std::uint32_t e : ends) tree.cancel(e);
    return tree.remove_uncommitted();
  }
  for (const auto& ends : walks)
    for (const std::uint32_t e : ends) {
      std::uint32_t choices[8];
      const std::uint32_t depth = tree.path(e, choices);
      if (!tree.splits(e) && !tree.is_outcome(e) && !tree.is_told(e) && depth == 1 && choices[0] == 2) {
        const std::uint64_t groups[] = {3, 12};
        tree.tell(e, groups, 2);
      }
      double cost = 0.0;
      for (std::uint32_t d = 0; d < depth; ++d) cost += choices[d] == 1 ? 0.0 : 0.3;
      tree.back_up(e, cost);
    }
  tree.commit();
}

TEST(OutcomeTree, walks_hold_each_hypothesis_once) {
  Tree t;
  std::mt19937 random(1);
  bool forked = false;
  for (int i = 0; i < 30; ++i) {
    batch(t.tree, 8, random, false);
    std::uint32_t ends[8];
    const std::uint32_t n =
        t.tree.select_all({4, kNothing, static_cast<std::uint32_t>(random()), {0.0, 2.0}, 1.0}, ends);
    std::uint64_t all = 0;
    for (std::uint32_t e = 0; e < n; ++e) {
      if (t.tree.splits(ends[e])) continue;
      EXPECT_EQ(all & t.tree.hypotheses(ends[e]), 0u);
      all |= t.tree.hypotheses(ends[e]);
    }
    EXPECT_EQ(all, 15u);
    forked = forked || n > 1;
    for (std::uint32_t e = 0; e < n; ++e) t.tree.cancel(ends[e]);
    t.tree.remove_uncommitted();
  }
  EXPECT_TRUE(forked);
}

TEST(OutcomeTree, cancelled_batches_leave_no_trace) {
  Tree a, b;
  std::mt19937 random(3), lost(4);
  for (int i = 0; i < 40; ++i) {
    std::mt19937 same = random;
    batch(a.tree, 8, random, false);
    batch(b.tree, 8, lost, true);
    batch(b.tree, 8, same, false);
    ASSERT_EQ(a.tree.used(), b.tree.used());
    for (std::uint32_t n = 0; n < a.tree.used(); ++n) ASSERT_EQ(a.tree.visits(n), b.tree.visits(n)) << n;
  }
}

TEST(OutcomeTree, keeps_the_cheapest_sequence_of_each_outcome) {
  Tree t;
  std::mt19937 random(5);
  for (int i = 0; i < 10; ++i) batch(t.tree, 8, random, false);
  ASSERT_TRUE(t.tree.has_outcomes());
  const tiller::SubsetRisk mean;
  const std::uint8_t first[] = {2, 0, 0, 0}, second[] = {2, 1, 1, 1}, other[] = {0, 1, 1, 1};
  const double first_cost[tiller::kMostHypotheses] = {1.0, 2.0, 9.0, 9.0};
  const double second_cost[tiller::kMostHypotheses] = {5.0, 5.0, 3.0, 4.0};
  const double other_cost[tiller::kMostHypotheses] = {};
  t.tree.credit(MctsTree::kRoot, first, first_cost, mean);
  t.tree.credit(MctsTree::kRoot, second, second_cost, mean);
  t.tree.credit(MctsTree::kRoot, other, other_cost, mean);  // it does not pass the outcomes
  EXPECT_EQ(t.tree.evaluate(2.0, mean), 2.0);
  EXPECT_EQ(t.tree.best_sequence(0), nullptr) << "one sequence for all is cheaper";
  EXPECT_EQ(t.tree.evaluate(4.0, mean), 2.5);
  for (const std::uint32_t m : {0u, 1u}) EXPECT_EQ(std::memcmp(t.tree.best_sequence(m), first, 4), 0);
  for (const std::uint32_t m : {2u, 3u}) EXPECT_EQ(std::memcmp(t.tree.best_sequence(m), second, 4), 0);
  t.tree.begin_belief(4);
  EXPECT_FALSE(t.tree.has_outcomes());
  EXPECT_EQ(t.tree.evaluate(4.0, mean), 4.0);
}

/// Against the definition: the mean of the costliest share, each hypothesis an atom of equal weight.
TEST(OutcomeRisk, is_that_of_the_hypotheses_one_by_one) {
  std::mt19937 random(9);
  for (int i = 0; i < 200; ++i) {
    tiller_planner_config_t p{};
    p.risk = std::array<std::uint32_t, 3>{tiller_risk_mean, tiller_risk_cvar, tiller_risk_worst}[i % 3];
    p.cvar_alpha = 0.9 * static_cast<double>(random() % 1000) / 1000.0;
    double cost[4];
    double count[4];
    std::vector<double> each;
    for (int j = 0; j < 4; ++j) {
      cost[j] = static_cast<double>(random() % 100);
      const std::size_t copies = 1 + random() % 5;
      count[j] = static_cast<double>(copies);
      each.insert(each.end(), copies, cost[j]);
    }
    std::sort(each.begin(), each.end(), std::greater<double>());
    const double n = static_cast<double>(each.size());
    const double tail = p.risk == tiller_risk_worst ? 1.0 : p.risk == tiller_risk_cvar ? (1.0 - p.cvar_alpha) * n : n;
    double sum = 0.0;
    for (std::size_t j = 0; j < each.size(); ++j)
      sum += each[j] * std::min(1.0, std::max(0.0, tail - static_cast<double>(j)));
    EXPECT_NEAR(tiller::SubsetRisk(p).value(cost, count, 4), sum / tail, 1e-12 * (1.0 + sum / tail));
  }
}

}  // namespace
}  // namespace tiller_test
