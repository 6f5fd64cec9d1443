// Every cost term against the same formula in plain double by hand: in f32 and f64, in lanes and in the lane loop.

#include <gtest/gtest.h>

#include "cost_cases.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kLanes = 48, kHorizon = 12;
constexpr std::uint64_t kTaskStep = 3;  // the first row that is due

class EveryModelsCost : public ::testing::TestWithParam<const tiller_model_t*> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryModelsCost, ::testing::ValuesIn(all_models()),
                         [](const auto& model) { return std::string(model.param->name); });

/// The plain cost of lane `l` along the states that the kernel itself stored.
template <class T>
double plain_cost(const Batch<T>& b, const tiller_model_t& model, const CostCase& c, std::uint32_t l,
                  const std::vector<double>& p) {
  const PlainCost plain{model, c, b.setup.period_s};
  std::vector<double> x(b.nx), u(b.nu), before(b.nu);
  double sum = 0.0;
  for (std::uint32_t k = 0; k <= b.horizon; ++k) {
    for (std::uint32_t i = 0; i < b.nx; ++i) x[i] = double(b.trajectory[(k * b.nx + i) * b.lanes + l]);
    if (k == b.horizon) return sum + plain.terminal(kTaskStep + k, x.data(), p.data());
    for (std::uint32_t i = 0; i < b.nu; ++i) u[i] = double(b.controls[(k * b.nu + i) * b.lanes + l]);
    if (k == 0) before = u;
    sum += plain.stage(kTaskStep + k, x.data(), u.data(), before.data(), p.data());
    before = u;
  }
  return sum;
}

/// Largest difference over the lanes, relative to 1 + the cost.
template <class T>
double cost_error(const tiller_model_t& model, const RolloutTable& table, const tiller_config_t& config,
                  const CostCase& c, bool splat_params) {
  Batch<T> b(config, kLanes, kHorizon);
  b.weights = terms_of<T>(c, b.nx);
  b.job.task_step = kTaskStep;
  std::vector<T> shared(TILLER_MAX_PARAMS, T(0.8));
  if (splat_params) b.job.params = {shared.data(), 0};
  b.run(model, table);
  double worst = 0.0;
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    std::vector<double> p(TILLER_MAX_PARAMS);
    for (std::uint32_t i = 0; i < b.np; ++i) p[i] = splat_params ? double(T(0.8)) : double(b.params[i * kLanes + l]);
    const double want = plain_cost(b, model, c, l, p);
    const double error = std::abs(double(b.cost[l]) - want) / (1.0 + std::abs(want));
    if (!(error <= worst)) worst = std::isfinite(error) ? error : INFINITY;
  }
  return worst;
}

TEST_P(EveryModelsCost, TermsAreTheirFormulas) {
  const tiller_model_t& m = *GetParam();
  const tiller_model_t as_c = as_c_model(m);
  for (const CostCase& c : cost_cases(m))
    for (int effects = 0; effects < 2; ++effects) {
      tiller::Config config = plain_config(&m);
      if (effects) add_some_effect(config);
      for (tiller_integrator_t way : {tiller_integrator_semi_implicit_euler, tiller_integrator_rk4}) {
        config.integrator = way;
        for (Isa isa : all_isas()) {
          const RolloutTable& table = select_rollout(m, isa);
          // double: a sum of 13 terms, each to 1e-15 of its size and of sizes that may cancel by 1e2
          EXPECT_LT(cost_error<double>(m, table, config, c, false), 1e-12) << c.name << isa_name(isa) << effects;
          // float: 6e-8 each; angles wrap at 2 pi in float, 5e-7 a difference of 1
          EXPECT_LT(cost_error<float>(m, table, config, c, false), 2e-5) << c.name << isa_name(isa) << effects;
          EXPECT_LT(cost_error<float>(m, table, config, c, true), 2e-5) << c.name << isa_name(isa) << effects;
        }
      }
      EXPECT_LT(cost_error<double>(as_c, select_rollout(as_c), config, c, false), 1e-12) << c.name << effects;
      EXPECT_LT(cost_error<float>(as_c, select_rollout(as_c), config, c, false), 2e-5) << c.name << effects;
    }
}

// Terms that change nothing would pass the test above if the plain side forgot them too: each must matter.
TEST_P(EveryModelsCost, EveryTermMatters) {
  const tiller_model_t& m = *GetParam();
  const tiller::Config config = plain_config(&m);
  std::vector<double> quadratic;
  for (const CostCase& c : cost_cases(m)) {
    Batch<double> b(config, kLanes, kHorizon);
    b.weights = terms_of<double>(c, b.nx);
    b.job.task_step = kTaskStep;
    b.run(m, select_rollout(m));
    if (c.name == "quadratic") {
      quadratic = b.cost;
      continue;
    }
    std::uint32_t changed = 0;
    for (std::uint32_t l = 0; l < kLanes; ++l) changed += std::abs(b.cost[l] - quadratic[l]) > 1e-3;
    EXPECT_GT(changed, kLanes / 4) << c.name;  // bounds and obstacles lie in a part of the space
  }
}

// Penalties by themselves and the cost without them are the cost with them.
template <class T>
void expect_penalties_apart(const tiller_model_t& m, const RolloutTable& table, bool effects, double tolerance) {
  tiller::Config config = plain_config(&m);
  if (effects) add_some_effect(config);
  std::vector<T> shared(TILLER_MAX_PARAMS, T(0.8));
  for (const CostCase& c : cost_cases(m)) {
    Batch<T> whole(config, kLanes, kHorizon), apart(config, kLanes, kHorizon);
    for (Batch<T>* b : {&whole, &apart}) {
      b->weights = terms_of<T>(c, b->nx);
      b->job.task_step = kTaskStep;
      b->job.params = {shared.data(), 0};
    }
    std::vector<T> penalty(kLanes, T(-1));
    apart.weights.extra &= ~(kCostBounds | kCostPenaltyTerms | kCostOutputBounds);
    apart.job.penalty_out = penalty.data();
    whole.run(m, table);
    apart.run(m, table);
    const bool has =
        whole.weights.has(kCostBounds) || whole.weights.has(kCostPenaltyTerms) || whole.weights.has(kCostOutputBounds);
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const double want = double(whole.cost[l]);
      EXPECT_NEAR(double(apart.cost[l]) + double(penalty[l]), want, tolerance * (1.0 + std::abs(want))) << c.name;
      if (!has) {
        EXPECT_EQ(penalty[l], T(0)) << c.name;
      }
    }
  }
}

TEST_P(EveryModelsCost, PenaltiesAreToldApart) {
  const tiller_model_t& m = *GetParam();
  const tiller_model_t as_c = as_c_model(m);
  for (const bool effects : {false, true}) {
    // sums of the same terms in another order
    for (Isa isa : all_isas()) {
      expect_penalties_apart<float>(m, select_rollout(m, isa), effects, 2e-5);
      expect_penalties_apart<double>(m, select_rollout(m, isa), effects, 1e-12);
    }
    expect_penalties_apart<float>(as_c, select_rollout(as_c), effects, 2e-5);
  }
}

// Whole turns of an angle in a table make no difference, though single precision could not even hold them.
TEST_P(EveryModelsCost, RowsMayCountTurns) {
  const tiller_model_t& m = *GetParam();
  const tiller::Config config = plain_config(&m);
  for (const CostCase& near : cost_cases(m)) {
    if (near.reference.empty() && near.mean.empty()) continue;
    CostCase far = near;
    for (std::vector<double>* rows : {&far.reference, &far.mean})
      for (std::size_t i = 0; i < rows->size(); ++i)
        if ((m.angle_mask >> (i % m.state_count)) & 1u) (*rows)[i] += 3e4 * 6.283185307179586;
    Batch<float> a(config, kLanes, kHorizon), b(config, kLanes, kHorizon);
    a.weights = terms_of<float>(near, a.nx);
    b.weights = terms_of<float>(far, b.nx);
    a.run(m, select_rollout(m));
    b.run(m, select_rollout(m));
    for (std::uint32_t l = 0; l < kLanes; ++l)
      EXPECT_NEAR(a.cost[l], b.cost[l], 2e-5f * (1.0f + std::abs(a.cost[l]))) << near.name;
  }
}

// A term whose weight is zero is off whatever its other settings say, to the last bit.
TEST_P(EveryModelsCost, WeightZeroIsOff) {
  const tiller_model_t& m = *GetParam();
  CostCase c = cost_cases(m).back();
  c.cost.saturating_weight = c.cost.demonstration_weight = c.cost.own_weight = 0.0;
  for (double& weight : c.bound_weight) weight = 0.0;
  for (tiller_cost_term_t& term : c.terms) term.weight = 0.0;
  for (tiller_output_cost_t& o : c.outputs) o.weight = o.terminal_weight = o.bound_weight = 0.0;
  c.reference.clear();
  c.lqr = false;
  EXPECT_TRUE(terms_of<float>(c, m.state_count).only_quadratic());
}

TEST_P(EveryModelsCost, RowsFollowTheTasksClock) {
  const tiller_model_t& m = *GetParam();
  const tiller::Config config = plain_config(&m);
  const std::uint32_t nx = m.state_count;
  CostCase c = quadratic_case(m);
  c.cost.reference_steps = 40;
  for (std::uint32_t k = 0; k < 40; ++k)
    for (std::uint32_t i = 0; i < nx; ++i) c.reference.push_back(0.01 * k);
  CostCase later = c;  // the same rows, five fewer in front
  later.cost.reference_steps = 35;
  later.reference.erase(later.reference.begin(), later.reference.begin() + 5 * nx);
  Batch<double> a(config, 16, kHorizon), b(config, 16, kHorizon);
  a.weights = terms_of<double>(c, nx);
  a.job.task_step = 9;
  b.weights = terms_of<double>(later, nx);
  b.job.task_step = 4;
  a.run(m, select_rollout(m));
  b.run(m, select_rollout(m));
  EXPECT_EQ(a.cost, b.cost);
  a.job.task_step = std::uint64_t{1} << 40;  // long past the end: the last row, for ever
  a.run(m, select_rollout(m));
  CostCase last = quadratic_case(m);
  for (std::uint32_t i = 0; i < nx; ++i) last.cost.target[i] = c.reference[39 * nx + i];
  b.weights = terms_of<double>(last, nx);
  b.run(m, select_rollout(m));
  for (std::uint32_t l = 0; l < 16; ++l) EXPECT_NEAR(a.cost[l], b.cost[l], 1e-12 * (1 + b.cost[l]));
}

double not_a_number_beyond(const double* x, const double*, const double*, double, void*) {
  return x[0] > 0.0 ? NAN : 1.0;
}

TEST_P(EveryModelsCost, NotANumberFailsItsTrajectoryAlone) {
  const tiller_model_t& m = *GetParam();
  CostCase c = quadratic_case(m);
  c.own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, not_a_number_beyond, nullptr, nullptr};
  c.cost.own_weight = 1.0;
  for (Isa isa : all_isas()) {
    Batch<float> b(plain_config(&m), 16, 1);
    b.weights = terms_of<float>(c, b.nx);
    b.run(m, select_rollout(m, isa));
    std::uint32_t failed = 0;
    for (std::uint32_t l = 0; l < 16; ++l) {
      EXPECT_EQ(std::isfinite(b.cost[l]), !(b.state[l] > 0.0f)) << isa_name(isa);
      failed += !std::isfinite(b.cost[l]);
    }
    EXPECT_GT(failed, 0u);
    EXPECT_LT(failed, 16u);
  }
}

// ---- the LQR's cost-to-go --------------------------------------------------------------------------

tiller::Config upright_cart_pole() {
  tiller::Config config = plain_config(tiller_find_model("cart_pole"));
  const double value[] = {1.0, 0.1, 0.5}, weight[] = {1.0, 1.0, 0.1, 0.1};
  for (int i = 0; i < 3; ++i) config.priors[i] = {tiller_prior_fixed, 0, value[i], 0, 0, 0};
  for (int i = 0; i < 4; ++i) config.cost.state_weight[i] = weight[i];
  config.cost.input_weight[0] = 0.1;
  config.cost.terminal = tiller_terminal_lqr;
  return config;
}

/// Terms with room for their cost-to-go.
struct Terms : CostTerms<double> {
  Terms() { cost_to_go = matrix_; }
  Terms(const Terms&) = delete;
  Terms& operator=(const Terms&) = delete;

 private:
  double matrix_[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};
};

tiller_status_t lay_out(const tiller_config_t& config, CostTerms<double>& terms) {
  StepSetup setup;
  if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
  return lay_out_cost(config, setup, select_rollout(*config.model), &terms, nullptr);
}

// Independent of the doubling: the plain Riccati recursion over 5000 periods on a Jacobian by central differences.
TEST(CostToGo, IsTheRiccatiRecursionsLimit) {
  const tiller::Config config = upright_cart_pole();
  Terms terms;
  ASSERT_EQ(lay_out(config, terms), tiller_status_ok);
  ASSERT_TRUE(terms.has(kCostToGo));
  const tiller_model_t& m = *config.model;
  const auto step = [&](std::vector<double> x, double u) {
    Batch<double> b(config, 16, 1);
    std::vector<double> p = {1.0, 0.1, 0.5}, control = {u};
    b.job.state = {x.data(), 0};
    b.job.params = {p.data(), 0};
    b.job.controls = {control.data(), 0};
    b.run(m, select_rollout(m));
    std::vector<double> next(4);
    for (std::uint32_t i = 0; i < 4; ++i) next[i] = b.final_state[i * 16];
    return next;
  };
  double a[4][4] = {}, in[4] = {};
  const double width = 1e-5;
  for (std::uint32_t c = 0; c <= 4; ++c) {
    std::vector<double> more(4, 0.0), less(4, 0.0);
    if (c < 4) more[c] = width, less[c] = -width;
    const auto high = step(more, c < 4 ? 0.0 : width), low = step(less, c < 4 ? 0.0 : -width);
    for (int r = 0; r < 4; ++r) (c < 4 ? a[r][c] : in[r]) = (high[r] - low[r]) / (2 * width);
  }
  double p[4][4] = {};
  for (int k = 0; k < 5000; ++k) {
    double pa[4][4] = {}, pb[4] = {}, bpa[4] = {}, s = 0.1, next[4][4] = {};
    for (int r = 0; r < 4; ++r)
      for (int j = 0; j < 4; ++j) {
        pb[r] += p[r][j] * in[j];
        for (int c = 0; c < 4; ++c) pa[r][c] += p[r][j] * a[j][c];
      }
    for (int r = 0; r < 4; ++r) {
      s += in[r] * pb[r];
      for (int c = 0; c < 4; ++c) bpa[c] += in[r] * pa[r][c];
    }
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) {
        next[r][c] = (r == c ? config.cost.state_weight[r] : 0.0) - bpa[r] * bpa[c] / s;
        for (int j = 0; j < 4; ++j) next[r][c] += a[j][r] * pa[j][c];
      }
    for (int r = 0; r < 4; ++r)  // without this, rounding grows an antisymmetric part
      for (int c = 0; c < 4; ++c) p[r][c] = 0.5 * (next[r][c] + next[c][r]);
  }
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c)
      // a Jacobian to 1e-10, in a limit whose slowest closed-loop motion lasts some 100 periods
      EXPECT_NEAR(terms.cost_to_go[r * 4 + c], p[r][c], 1e-6 * p[0][0]) << r << c;
}

// The quadrotor moves sideways only by tilting its thrust: around zero input it could not. The matrix takes the input
// that holds the target.
TEST(CostToGo, LinearisesWhereTheTargetIsHeld) {
  tiller::Config config = plain_config(tiller_find_model("planar_quadrotor"));
  const double value[] = {0.5, 0.2, 0.01, 0.0};
  for (int i = 0; i < 4; ++i) config.priors[i] = {tiller_prior_fixed, 0, value[i], 0, 0, 0};
  for (int i = 0; i < 6; ++i) config.cost.state_weight[i] = 1.0;
  config.cost.input_weight[0] = config.cost.input_weight[1] = 0.1;
  config.cost.terminal = tiller_terminal_lqr;
  Terms terms;
  ASSERT_EQ(lay_out(config, terms), tiller_status_ok);
  for (int i = 0; i < 6; ++i) {
    EXPECT_GT(terms.cost_to_go[i * 6 + i], 1.0);
    EXPECT_LT(terms.cost_to_go[i * 6 + i], 1e5);
  }
  EXPECT_LT(terms.cost_to_go[0 * 6 + 2], -1e-3);  // right of the target, a tilt to the left costs less
}

/// The centre of every kind of prior, and the mean of a joint one: parameters fixed there give the same matrix.
TEST(CostToGo, TakesParametersAtTheirPriorsCentres) {
  tiller::Config config = upright_cart_pole();
  Terms fixed, free, joint;
  ASSERT_EQ(lay_out(config, fixed), tiller_status_ok);
  config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.5, 1.5};
  config.priors[1] = {tiller_prior_normal, 0, 0.05, 0.1, 0.1, 1.0};  // the centre is beyond its bound
  config.priors[2] = {tiller_prior_log_normal, 0, 0.5, 0.3, 0.1, 2.0};
  ASSERT_EQ(lay_out(config, free), tiller_status_ok);
  for (int i = 0; i < 16; ++i) EXPECT_EQ(free.cost_to_go[i], fixed.cost_to_go[i]) << i;
  // of two components; the fixed parameter is none of its coordinates, and the last one's is a logarithm
  config.priors[1] = {tiller_prior_fixed, 0, 0.1, 0, 0, 0};
  const double weight[2] = {0.25, 0.75}, mean[4] = {0.7, std::log(0.5) + 0.3, 1.1, std::log(0.5) - 0.1};
  const double root[8] = {0.1, 0.0, 0.0, 0.1, 0.1, 0.0, 0.0, 0.1};
  const tiller_mixture_t mixture = {sizeof mixture, TILLER_CONFIG_VERSION, 2, 2, weight, mean, root};
  config.prior_mixture = &mixture;
  ASSERT_EQ(lay_out(config, joint), tiller_status_ok);
  for (int i = 0; i < 16; ++i) EXPECT_NEAR(joint.cost_to_go[i], fixed.cost_to_go[i], 1e-9 * fixed.cost_to_go[0]) << i;
}

/// Double precision, single, or both; each needs room for the matrix.
TEST(CostToGo, IsLaidOutInThePrecisionsAskedFor) {
  const tiller::Config config = upright_cart_pole();
  StepSetup setup;
  ASSERT_EQ(make_step_setup(config, setup), tiller_status_ok);
  const RolloutTable& table = select_rollout(*config.model);
  Terms exact;
  CostTerms<float> lanes{};
  EXPECT_EQ(lay_out_cost(config, setup, table, nullptr, &lanes), tiller_status_null_argument) << "no room";
  float matrix[16] = {};
  lanes.cost_to_go = matrix;
  ASSERT_EQ(lay_out_cost(config, setup, table, nullptr, &lanes), tiller_status_ok);
  EXPECT_TRUE(lanes.has(kCostToGo));
  ASSERT_EQ(lay_out_cost(config, setup, table, &exact, &lanes), tiller_status_ok);
  for (int i = 0; i < 16; ++i) EXPECT_EQ(matrix[i], static_cast<float>(exact.cost_to_go[i])) << i;
  CostTerms<double> roomless{};
  EXPECT_EQ(lay_out_cost(config, setup, table, &roomless, nullptr), tiller_status_null_argument);
}

TEST(CostToGo, RefusesWhatNobodyHolds) {
  Terms terms;
  tiller::Config config = upright_cart_pole();
  for (double& w : config.cost.state_weight) w = 1e16;
  EXPECT_EQ(lay_out(config, terms), tiller_status_bad_cost) << "larger than can be told from infinity";
  config = plain_config(tiller_find_model("linear_axis"));
  for (tiller_prior_t& prior : config.priors) prior = {tiller_prior_fixed, 0, 1.0, 0, 0, 0};
  config.priors[0].a = HUGE_VAL;  // what weighs without bound is moved by nothing
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) config.cost.state_weight[i] = 1.0;
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) config.cost.input_weight[i] = 0.1;
  config.cost.terminal = tiller_terminal_lqr;
  EXPECT_EQ(lay_out(config, terms), tiller_status_bad_cost);
  config.priors[0].a = 1.0;
  EXPECT_EQ(lay_out(config, terms), tiller_status_ok);
}

TEST(CostToGo, RefusesWhatHasNone) {
  Terms terms;
  tiller::Config config = upright_cart_pole();
  config.cost.input_weight[0] = 0.0;
  EXPECT_EQ(lay_out(config, terms), tiller_status_bad_cost);
  // an actuator without gravity in a model whose falling motion no input reaches: both rotors of no thrust
  config = plain_config(tiller_find_model("acrobot"));
  const double value[] = {1, 1, 1, 1, 0.5, 0.5, 0.1, 0.1};
  for (int i = 0; i < 8; ++i) config.priors[i] = {tiller_prior_fixed, 0, value[i], 0, 0, 0};
  config.priors[0].a = NAN;  // nothing finite follows
  for (int i = 0; i < 4; ++i) config.cost.state_weight[i] = 1.0;
  config.cost.input_weight[0] = 0.1;
  config.cost.terminal = tiller_terminal_lqr;
  EXPECT_EQ(lay_out(config, terms), tiller_status_bad_cost);
}

// Delay, lag and dry friction would hide the input from the state; they are left out, not fatal.
TEST(CostToGo, BearsEffectsWithMemory) {
  tiller::Config config = upright_cart_pole();
  Terms bare, with;
  ASSERT_EQ(lay_out(config, bare), tiller_status_ok);
  add_effect(config, tiller_effect_input_delay, 0);
  config.priors[3] = {tiller_prior_uniform, 0, 0, 0, 0.0, 0.05};
  add_effect(config, tiller_effect_actuator_lag, 0);
  config.priors[4] = {tiller_prior_uniform, 0, 0, 0, 0.0, 0.05};
  add_effect(config, tiller_effect_coulomb_friction, 0);
  config.priors[5] = {tiller_prior_uniform, 0, 0, 0, 0.0, 0.5};
  ASSERT_EQ(lay_out(config, with), tiller_status_ok);
  for (int i = 0; i < 16; ++i) EXPECT_NEAR(with.cost_to_go[i], bare.cost_to_go[i], 1e-9 * bare.cost_to_go[0]);
}

}  // namespace
}  // namespace tiller
