// The cost to second order: value and gradient of every term against the plain formula and its differences, and a
// Hessian that is exact where it says so and positive semidefinite everywhere.

#include <gtest/gtest.h>

#include "cost_cases.hpp"
#include "own_cost_kernel.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kStages = 20, kLanes = 32;
constexpr std::uint64_t kTaskStep = 3;

/// A trajectory of random states and inputs with its expansion.
struct Expanded {
  std::uint32_t nx, nu;
  std::vector<double> state, control, before, params, value, lx, lu, lb, lxx, luu, lux;
  StepSetup setup;
  CostTerms<double> terms;
  QuadratiseJob job;

  Expanded(const tiller_model_t& m, const RolloutTable& table, const CostCase& c, std::uint64_t seed)
      : nx(m.state_count), nu(m.input_count), terms(terms_of<double>(c, m.state_count)) {
    const tiller::Config config = plain_config(&m);
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    Rng rng(seed, 97, 0);
    const auto fill = [&](std::vector<double>& v, std::size_t n, double size) {
      v.resize(n * kLanes);
      for (double& x : v) x = size * (2.0 * rng.uniform() - 1.0);
    };
    fill(state, nx, 1.5);
    fill(control, nu, 3.0);
    fill(before, nu, 3.0);
    params.assign(TILLER_MAX_PARAMS, 0.8);
    for (auto* rows : {&value, &lx, &lu, &lb, &lxx, &luu, &lux}) rows->assign(nx * (nx + nu) * kLanes, -7.0);
    job.setup = &setup;
    job.cost = &terms;
    job.lanes = kLanes;
    job.stages = kStages;
    job.terminal = true;
    job.task_step = kTaskStep;
    job.state = {state.data(), kLanes};
    job.control = {control.data(), kLanes};
    job.before = {before.data(), kLanes};
    job.params = {params.data(), 0};
    job.value = value.data();
    job.lx = lx.data();
    job.lu = lu.data();
    job.lb = lb.data();
    job.lxx = lxx.data();
    job.luu = luu.data();
    job.lux = lux.data();
    table.quadratise(m, job);
  }
  std::vector<double> column(const std::vector<double>& rows, std::uint32_t count, std::uint32_t lane) const {
    std::vector<double> v(count);
    for (std::uint32_t i = 0; i < count; ++i) v[i] = rows[i * kLanes + lane];
    return v;
  }
  /// Over (x, u).
  std::vector<double> hessian(std::uint32_t lane) const {
    const std::uint32_t n = nx + nu;
    std::vector<double> h(n * n);
    for (std::uint32_t r = 0; r < n; ++r)
      for (std::uint32_t c = 0; c < n; ++c) {
        double value_rc;
        if (r < nx && c < nx)
          value_rc = lxx[(r * nx + c) * kLanes + lane];
        else if (r >= nx && c >= nx)
          value_rc = luu[((r - nx) * nu + c - nx) * kLanes + lane];
        else
          value_rc = lux[((std::max(r, c) - nx) * nx + std::min(r, c)) * kLanes + lane];
        h[r * n + c] = value_rc;
      }
    return h;
  }
};

/// The plain cost of lane `lane` as a function of (x, u, before).
double plain(const tiller_model_t& m, const CostCase& c, const Expanded& e, std::uint32_t lane,
             const std::vector<double>& z) {
  const PlainCost cost{m, c, e.setup.period_s};
  const double* x = z.data();
  if (lane == kStages) return cost.terminal(kTaskStep + lane, x, e.params.data());
  return cost.stage(kTaskStep + lane, x, x + e.nx, x + e.nx + e.nu, e.params.data());
}
std::vector<double> point(const Expanded& e, std::uint32_t lane) {
  std::vector<double> z = e.column(e.state, e.nx, lane);
  for (const auto* rows : {&e.control, &e.before})
    for (double u : e.column(*rows, e.nu, lane)) z.push_back(u);
  return z;
}

/// True if h + shift I has a Cholesky factor: every eigenvalue is above -shift.
bool above(std::vector<double> h, std::uint32_t n, double shift) {
  for (std::uint32_t k = 0; k < n; ++k) {
    double pivot = h[k * n + k] + shift;
    for (std::uint32_t j = 0; j < k; ++j) pivot -= h[k * n + j] * h[k * n + j];
    if (!(pivot > 0.0)) return false;
    pivot = std::sqrt(pivot);
    h[k * n + k] = pivot;
    for (std::uint32_t r = k + 1; r < n; ++r) {
      for (std::uint32_t j = 0; j < k; ++j) h[r * n + k] -= h[r * n + j] * h[k * n + j];
      h[r * n + k] /= pivot;
    }
  }
  return true;
}

class EveryExpansion : public ::testing::TestWithParam<const tiller_model_t*> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryExpansion, ::testing::ValuesIn(all_models()),
                         [](const auto& model) { return std::string(model.param->name); });

TEST_P(EveryExpansion, ValueAndGradientAreTheFormulas) {
  const tiller_model_t& m = *GetParam();
  const tiller_model_t as_c = as_c_model(m);
  std::vector<const RolloutTable*> tables = {&select_rollout(as_c)};
  for (Isa isa : all_isas()) tables.push_back(&select_rollout(m, isa));
  for (const CostCase& c : cost_cases(m))
    for (const RolloutTable* table : tables) {
      const Expanded e(table == tables[0] ? as_c : m, *table, c, 1);
      for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
        const std::vector<double> z = point(e, lane);
        const double want = plain(m, c, e, lane, z);
        EXPECT_NEAR(e.value[lane], want, 1e-12 * (1 + std::abs(want))) << c.name << " lane " << lane;
        std::vector<double> gradient = e.column(e.lx, e.nx, lane);
        for (const auto* rows : {&e.lu, &e.lb})
          for (double g : e.column(*rows, e.nu, lane)) gradient.push_back(g);
        for (std::uint32_t i = 0; i < gradient.size(); ++i) {
          auto more = z, less = z;
          more[i] += 1e-5;
          less[i] -= 1e-5;
          const double slope = (plain(m, c, e, lane, more) - plain(m, c, e, lane, less)) / 2e-5;
          // truncation: third derivatives of up to 1e2 by 1e-10, and a kink of the second may lie within the width;
          // rounding: 1e-16 of a cost of 1e2 over 1e-5
          EXPECT_NEAR(gradient[i], slope, 2e-5 * (1 + std::abs(slope))) << c.name << " lane " << lane << " z" << i;
        }
      }
    }
}

TEST_P(EveryExpansion, HessianIsExactWhereTheCostIsQuadratic) {
  const tiller_model_t& m = *GetParam();
  if (m.quaternion_mask != 0) GTEST_SKIP() << "an attitude's cost is nowhere quadratic: quaternion_test";
  for (const CostCase& c : cost_cases(m)) {
    if (c.name != "quadratic" && c.name != "reference" && c.name != "demonstration" && c.name != "cost_to_go") continue;
    const Expanded e(m, select_rollout(m), c, 2);
    const std::uint32_t n = e.nx + e.nu;
    for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
      const auto h = e.hessian(lane);
      const auto z = point(e, lane);
      for (std::uint32_t r = 0; r < n; ++r)
        for (std::uint32_t k = 0; k < n; ++k) {
          double second = 0.0;
          for (int corner = 0; corner < 4; ++corner) {
            auto moved = z;
            moved[r] += corner & 1 ? 1e-3 : -1e-3;
            moved[k] += corner & 2 ? 1e-3 : -1e-3;
            second +=
                ((corner & 1) != 0) == ((corner & 2) != 0) ? plain(m, c, e, lane, moved) : -plain(m, c, e, lane, moved);
          }
          // exact for a quadratic but for rounding: 4 costs of 1e2 to 1e-16, over 4e-6
          EXPECT_NEAR(h[r * n + k], second / 4e-6, 1e-6) << c.name << " lane " << lane << " " << r << k;
        }
    }
  }
}

TEST_P(EveryExpansion, HessianIsPositiveSemidefinite) {
  const tiller_model_t& m = *GetParam();
  for (const CostCase& c : cost_cases(m))
    for (std::uint64_t seed = 1; seed <= 50; ++seed) {  // 50 x 21 points a term
      const Expanded e(m, select_rollout(m), c, seed);
      const std::uint32_t n = e.nx + e.nu;
      for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
        const auto h = e.hessian(lane);
        double size = 0.0;
        for (std::uint32_t r = 0; r < n; ++r)
          for (std::uint32_t k = 0; k < n; ++k) {
            size = std::max(size, std::abs(h[r * n + k]));
            // symmetric but for the rounding of the products that it is made from
            EXPECT_NEAR(h[r * n + k], h[k * n + r], 1e-13 * (1 + std::abs(h[r * n + k]))) << c.name;
          }
        EXPECT_TRUE(above(h, n, 1e-12 * (1 + size))) << c.name << " seed " << seed << " lane " << lane;
      }
    }
}

// The quadratic part of these cases is positive definite and might hide a negative one.
TEST_P(EveryExpansion, EachTermAloneIsPositiveSemidefinite) {
  const tiller_model_t& m = *GetParam();
  std::uint32_t curved = 0;
  for (CostCase c : cost_cases(m)) {
    for (double* weights : {c.cost.state_weight, c.cost.terminal_weight})
      for (int i = 0; i < TILLER_MAX_STATES; ++i) weights[i] = 0.0;
    for (int i = 0; i < TILLER_MAX_INPUTS; ++i) c.cost.input_weight[i] = c.cost.input_rate_weight[i] = 0.0;
    for (std::uint64_t seed = 1; seed <= 50; ++seed) {
      const Expanded e(m, select_rollout(m), c, seed);
      for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
        const auto h = e.hessian(lane);
        double size = 0.0;
        for (double x : h) size = std::max(size, std::abs(x));
        EXPECT_TRUE(above(h, e.nx + e.nu, 1e-12 * (1 + size))) << c.name << " seed " << seed << " lane " << lane;
        curved += size > 1e-3;
      }
    }
  }
  EXPECT_GT(curved, 1000u);
}

// Lanes and the plain loop are two programs from one text; what differs is exp and the order of sums.
TEST_P(EveryExpansion, LanesAgreeWithThePlainLoop) {
  const tiller_model_t& m = *GetParam();
  const tiller_model_t as_c = as_c_model(m);
  for (const CostCase& c : cost_cases(m)) {
    const Expanded want(as_c, select_rollout(as_c), c, 3);
    for (Isa isa : all_isas()) {
      const Expanded got(m, select_rollout(m, isa), c, 3);
      for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
        const auto a = want.hessian(lane), b = got.hessian(lane);
        // clipped eigenvalues of differences with a rounding error of 1e-8
        // and slopes of outputs by central differences, to 1e-10
        const double tolerance = c.own.stage ? 1e-6 : c.outputs.empty() ? 1e-12 : 1e-8;
        for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], tolerance * (1 + std::abs(a[i]))) << c.name;
      }
    }
  }
}

TEST_P(EveryExpansion, OutputsMayBeLeftOut) {
  const tiller_model_t& m = *GetParam();
  const CostCase c = cost_cases(m).back();
  Expanded e(m, select_rollout(m), c, 4);
  const auto value = e.value;
  std::fill(e.value.begin(), e.value.end(), 0.0);
  e.job.lx = e.job.lu = e.job.lb = e.job.lxx = e.job.luu = e.job.lux = nullptr;
  select_rollout(m).quadratise(m, e.job);
  for (std::uint32_t lane = 0; lane <= kStages; ++lane) EXPECT_EQ(e.value[lane], value[lane]);
}

// ---- an own cost -----------------------------------------------------------------------------------

double eigen_stage(const double* x, const double* u, const double*, double, void*) {
  return 0.5 * (3 * x[0] * x[0] + 8 * x[0] * x[1] - 2 * x[1] * x[1] + u[0] * u[0]) + x[0] * u[0];
}

// The nearest semidefinite matrix H+ to H is told by three properties: H+ and H+ - H are semidefinite, and their
// product has no trace.
TEST(OwnCost, KeepsWhatIsConvexOfItsHessian) {
  const tiller_model_t& m = *tiller_find_model("cart_pole");
  CostCase c;
  c.own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, eigen_stage, nullptr, nullptr};
  c.cost.own_weight = 1.0;
  const Expanded e(m, select_rollout(m), c, 1);
  double h[25] = {};
  h[0] = 3, h[1] = h[5] = 4, h[6] = -2, h[24] = 1, h[4] = h[20] = 1;
  for (std::uint32_t lane = 0; lane < kStages; ++lane) {
    const auto got = e.hessian(lane);
    std::vector<double> rest(25);
    double trace = 0.0;
    for (int i = 0; i < 25; ++i) rest[i] = got[i] - h[i];
    for (int r = 0; r < 5; ++r)
      for (int k = 0; k < 5; ++k) trace += got[r * 5 + k] * rest[k * 5 + r];
    // second differences of width 1.2e-4: rounding 1e-16 * 10 / 1.4e-8
    EXPECT_TRUE(above(got, 5, 1e-6));
    EXPECT_TRUE(above(rest, 5, 1e-6));
    EXPECT_NEAR(trace, 0.0, 1e-5);
    EXPECT_GT(rest[6], 1.0);  // and something was clipped
  }
}

TEST(OwnCost, TemplateIsTheFunction) {
  const tiller_model_t& m = *tiller_find_model("cart_pole");
  CostCase function;
  for (const CostCase& c : cost_cases(m))
    if (c.name == "all") function = c;
  CostCase beside = function;
  beside.own = {};  // own_weight stays: the kernel's template
  for (const RolloutTable* table : own_cost_tables()) {
    EXPECT_TRUE(table->own_cost);
    for (int single = 0; single < 2; ++single) {
      Batch<double> want(plain_config(&m), 48, 12), got(plain_config(&m), 48, 12);
      want.weights = terms_of<double>(function, 4);
      got.weights = terms_of<double>(beside, 4);
      want.job.task_step = got.job.task_step = 5;
      want.run(m, *table);
      got.run(m, *table);
      for (std::uint32_t l = 0; l < 48; ++l)
        EXPECT_NEAR(got.cost[l], want.cost[l], 1e-12 * (1 + std::abs(want.cost[l]))) << isa_name(table->isa);
    }
    Batch<float> lanes(plain_config(&m), 48, 12), from_function(plain_config(&m), 48, 12);
    lanes.weights = terms_of<float>(beside, 4);
    from_function.weights = terms_of<float>(function, 4);
    lanes.run(m, *table);
    from_function.run(m, *table);
    for (std::uint32_t l = 0; l < 48; ++l)
      EXPECT_NEAR(lanes.cost[l], from_function.cost[l], 1e-5 * (1 + std::abs(from_function.cost[l])));
    const Expanded a(m, *table, function, 6), b(m, *table, beside, 6);
    for (std::uint32_t lane = 0; lane <= kStages; ++lane) {
      EXPECT_NEAR(a.value[lane], b.value[lane], 1e-12 * (1 + std::abs(a.value[lane])));
      const auto ga = a.column(a.lx, 4, lane), gb = b.column(b.lx, 4, lane);
      for (int i = 0; i < 4; ++i) EXPECT_NEAR(ga[i], gb[i], 1e-8 * (1 + std::abs(ga[i])));
      const auto ha = a.hessian(lane), hb = b.hessian(lane);
      for (int i = 0; i < 25; ++i) EXPECT_NEAR(ha[i], hb[i], 1e-6 * (1 + std::abs(ha[i]))) << lane;  // differences
    }
  }
}

TEST(OwnCost, WeightWithoutACostIsRefused) {
  tiller::Config config = plain_config(tiller_find_model("cart_pole"));
  config.cost.own_weight = 1.0;
  StepSetup setup;
  ASSERT_EQ(make_step_setup(config, setup), tiller_status_ok);
  EXPECT_FALSE(select_rollout(*config.model).own_cost);
  EXPECT_EQ(lay_out_cost(config, setup, select_rollout(*config.model), nullptr, nullptr), tiller_status_bad_cost);
  EXPECT_EQ(lay_out_cost(config, setup, *own_cost_tables().front(), nullptr, nullptr), tiller_status_ok);
  const CostCase function = cost_cases(*config.model).back();
  config.cost.own = &function.own;
  EXPECT_EQ(lay_out_cost(config, setup, select_rollout(*config.model), nullptr, nullptr), tiller_status_ok);
}

}  // namespace
}  // namespace tiller
