// One-step residuals of the lanes against one step of rollout_f64, for every model, integrator, effect and instruction
// set, and for the same models as C tables.

#include <gtest/gtest.h>

#include "batch.hpp"
#include "rollout/residual.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kLanes = 48, kSteps = 70;  // more than one block of steps
constexpr std::uint32_t kBasisCount = 3;

struct Case {
  std::string name;
  const tiller_model_t* model;
  tiller::Config config;
};

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (const tiller_model_t* m : all_models())
    for (int integrator = 0; integrator < 3; ++integrator)
      for (std::uint32_t substeps : {1u, 3u})
        for (int effects = 0; effects < 6; ++effects) {
          tiller::Config c = plain_config(m);
          c.integrator = static_cast<std::uint32_t>(integrator);
          c.substeps = substeps;
          c.body = {0.3, -9.81, 0.1, 0.01};
          const char* names[] = {"none", "friction", "offset", "delay", "all", "body"};
          if (effects == 1 || effects == 4)
            for (std::uint32_t j = 0; j < m->joint_count; ++j) {
              add_effect(c, tiller_effect_viscous_friction, j);
              if (j == 0) add_effect(c, tiller_effect_coulomb_friction, j);
            }
          if (effects == 2 || effects == 4) add_effect_if_it_fits(c, tiller_effect_constant_offset, m->joint_count - 1);
          if (effects == 3 || effects == 4) add_effect(c, tiller_effect_input_delay, 0);
          if (effects == 5) {  // what a lane does to the body and with its own functions must not meet the shared tape
            add_effect(c, tiller_effect_payload, 0);
            add_effect(c, tiller_effect_tilt, 0);
            add_effect(c, tiller_effect_dead_zone, 0);
            add_effect_if_it_fits(c, tiller_effect_joint_inertia, 0);
            add_effect_if_it_fits(c, tiller_effect_stribeck_friction, m->joint_count - 1);
            add_effect_if_it_fits(c, tiller_effect_quadratic_drag, 0);
          }
          cases.push_back({std::string(m->name) + "_" + std::to_string(integrator) + "_" + std::to_string(substeps) +
                               "_" + names[effects],
                           m, c});
        }
  return cases;
}

/// Steps and parameters with random but reproducible content.
struct Problem {
  const tiller_model_t& model;
  StepSetup setup;
  std::uint32_t nx, nu, np;
  std::vector<MeasuredStep> steps;
  std::vector<double> history;
  std::vector<float> params;

  explicit Problem(const tiller_config_t& config)
      : model(*config.model), nx(model.state_count), nu(model.input_count), np(config.param_count), steps(kSteps) {
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    Rng rng(7, 3, 0);
    const auto draw = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
    history.resize(kSteps * (setup.delay_steps + 1) * nu);
    for (double& h : history) h = draw(-3, 3);
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      MeasuredStep& s = steps[k];
      for (std::uint32_t i = 0; i < nx; ++i) {
        // a few turns: what an angle that is counted on gives
        s.state[i] = state_centre(model, i) + draw(-1.5, 1.5) +
                     ((model.angle_mask >> i) & 1u ? 6.283185307179586 * (int(k % 9) - 4) : 0.0);
        s.change[i] = draw(-0.2, 0.2);
      }
      for (std::uint32_t i = 0; i < nu; ++i) s.input[i] = draw(-3, 3);
      s.period_s = k % 5 == 0 ? 0.0 : draw(0.015, 0.025);
      s.weight = k % 7 == 0 ? 0.0 : draw(0.2, 1.0);
      for (std::uint32_t j = 0; j < kBasisCount; ++j) s.basis[j] = draw(-1, 1);
      s.history = &history[k * (setup.delay_steps + 1) * nu];
    }
    params.resize(np * kLanes);
    for (std::uint32_t i = 0; i < np; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l)
        params[i * kLanes + l] = static_cast<float>(i < model.param_count ? draw(0.4, 1.2) : draw(0.0, 0.1));
  }

  ResidualJob job() const {
    ResidualJob j;
    j.setup = &setup;
    j.lanes = kLanes;
    j.count = kSteps;
    j.steps = steps.data();
    j.params = {params.data(), kLanes};
    return j;
  }
  /// (kSteps * nx x kLanes) changes of the state by one step of rollout_f64.
  std::vector<double> changes() const {
    std::vector<double> wide(params.begin(), params.end()), next(nx * kLanes), all(kSteps * nx * kLanes);
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      RolloutJob<double> j;
      j.setup = &setup;
      j.lanes = kLanes;
      j.horizon = 1;
      j.period_s = steps[k].period_s;
      j.state = {steps[k].state, 0};
      j.params = {wide.data(), kLanes};
      j.controls = {steps[k].input, 0};
      j.history = steps[k].history;
      j.final_state = next.data();
      select_rollout(model).rollout_f64(model, j);
      for (std::uint32_t i = 0; i < nx; ++i)
        for (std::uint32_t l = 0; l < kLanes; ++l)
          all[(k * nx + i) * kLanes + l] = next[i * kLanes + l] - steps[k].state[i];
    }
    return all;
  }
};

struct Sums {
  std::vector<double> squared, projected;
  std::vector<float> residual;
  Sums(const Problem& p, const RolloutTable& table, const tiller_model_t& model, std::uint32_t basis_rows,
       const std::vector<MeasuredStep>& steps)
      : squared(p.nx * kLanes), projected(p.nx * kBasisCount * kLanes), residual(steps.size() * p.nx * kLanes) {
    ResidualJob job = p.job();
    job.steps = steps.data();
    job.count = static_cast<std::uint32_t>(steps.size());
    job.basis_count = kBasisCount;
    job.basis_rows = basis_rows;
    job.squared = squared.data();
    job.projected = projected.data();
    job.residual = residual.data();
    table.residual(model, job);
  }
};

class Residual : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Cases, Residual, ::testing::ValuesIn(all_cases()), [](const auto& c) { return c.param.name; });

// Increments in single precision: thirty roundings of 6e-8 relative to the change itself, and the state's own rounding
// (6e-8 of up to pi), which the dynamics of one period make no larger. A difference of two states would miss this by an
// order of magnitude where angles have turned (ChangesAreNotLostInTheState asks for more).
// But a finger deep in a box, as random states have it, is taken out at 20/s of its depth, and turns the box by that
// over the limit length of 0.4 m: four roundings for one.
double tolerance(const tiller_model_t& model, double change) {
  return (std::string(model.name) == "pusher_slider" ? 4.0 : 1.0) * (2e-6 * change + 3e-7);
}

TEST_P(Residual, IsOneStepInDouble) {
  const Problem p(GetParam().config);
  const std::vector<double> change = p.changes();
  const tiller_model_t plain = as_c_model(p.model);
  const auto check = [&](const RolloutTable& table, const tiller_model_t& model, const char* name) {
    const Sums got(p, table, model, 0u, p.steps);
    double worst = 0.0;
    for (std::uint32_t k = 0; k < kSteps; ++k)
      for (std::uint32_t i = 0; i < p.nx; ++i)
        for (std::uint32_t l = 0; l < kLanes; ++l) {
          const std::size_t at = (k * p.nx + i) * kLanes + l;
          const double want = p.steps[k].change[i] - change[at];
          worst = std::max(worst, std::abs(double(got.residual[at]) - want) / tolerance(p.model, std::abs(change[at])));
        }
    EXPECT_LT(worst, 1.0) << name;
  };
  for (Isa isa : all_isas()) check(select_rollout(p.model, isa), p.model, isa_name(isa));
  check(select_rollout(plain), plain, "C table");
}

TEST_P(Residual, SumsAreThoseOfTheResiduals) {
  Problem p(GetParam().config);
  for (std::uint32_t k = 0; k < kSteps; k += 3) p.steps[k].change[k % p.nx] = NAN;
  const std::uint32_t rows = p.nx == 2 ? 2u : 5u;
  const tiller_model_t plain = as_c_model(p.model);
  const auto check = [&](const RolloutTable& table, const tiller_model_t& model) {
    const Sums got(p, table, model, rows, p.steps);
    for (std::uint32_t i = 0; i < p.nx; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l) {
        double squared = 0.0, projected[kBasisCount] = {}, size[kBasisCount] = {};
        for (std::uint32_t k = 0; k < kSteps; ++k) {
          const double e = double(got.residual[(k * p.nx + i) * kLanes + l]);
          EXPECT_EQ(std::isnan(e), std::isnan(p.steps[k].change[i]));
          if (std::isnan(e)) continue;
          squared += p.steps[k].weight * e * e;
          for (std::uint32_t j = 0; j < kBasisCount; ++j) {
            const double term = p.steps[k].weight * p.steps[k].basis[j] * e;
            projected[j] += term;
            size[j] += std::abs(term);
          }
        }
        // 64 sums in single precision
        EXPECT_NEAR(got.squared[i * kLanes + l], squared, 4e-6 * squared);
        for (std::uint32_t j = 0; j < kBasisCount; ++j)
          EXPECT_NEAR(got.projected[(i * kBasisCount + j) * kLanes + l], (rows >> i) & 1u ? projected[j] : 0.0,
                      4e-6 * size[j]);
      }
  };
  for (Isa isa : all_isas()) check(select_rollout(p.model, isa), p.model);
  check(select_rollout(plain), plain);
}

// A lane's bits depend on nothing but its parameters and the steps.
TEST_P(Residual, BitsDoNotDependOnTheChunks) {
  const Problem p(GetParam().config);
  for (Isa isa : all_isas()) {
    const RolloutTable& table = select_rollout(p.model, isa);
    const Sums whole(p, table, p.model, 3u, p.steps);
    std::vector<double> squared(p.nx * kLanes), chunk(p.nx * 16);
    for (std::uint32_t first = 0; first < kLanes; first += 16) {
      std::fill(chunk.begin(), chunk.end(), 0.0);
      ResidualJob job = p.job();
      job.lanes = 16;
      job.params.data += first;
      job.squared = chunk.data();
      table.residual(p.model, job);
      for (std::uint32_t i = 0; i < p.nx; ++i)
        for (std::uint32_t l = 0; l < 16; ++l) squared[i * kLanes + first + l] = chunk[i * 16 + l];
    }
    EXPECT_EQ(squared, whole.squared) << isa_name(isa);
  }
}

class Model : public ::testing::TestWithParam<const tiller_model_t*> {};
INSTANTIATE_TEST_SUITE_P(Models, Model, ::testing::ValuesIn(all_models()),
                         [](const auto& model) { return std::string(model.param->name); });

// Far from the origin and at short periods a difference of two states would have lost the change: at x = 1000 m single
// precision is 6e-5 m fine, and a step of 1 ms at 1 m/s is 1e-3 m long.
TEST_P(Model, ChangesAreNotLostInTheState) {
  tiller::Config config = plain_config(GetParam());
  config.period_s = 0.001;
  Problem p(config);
  for (MeasuredStep& s : p.steps) {
    s.period_s = 0.001;
    for (std::uint32_t j = 0; j < p.model.joint_count; ++j)
      if (p.model.joints[j].position != TILLER_NO_POSITION &&
          !((p.model.angle_mask >> p.model.joints[j].position) & 1u) &&
          std::strcmp(p.model.joints[j].name, "leg") != 0)  // a spring's length is no place
        s.state[p.model.joints[j].position] += 1000.0;
  }
  const std::vector<double> change = p.changes();
  for (Isa isa : all_isas()) {
    const Sums got(p, select_rollout(p.model, isa), p.model, 0u, p.steps);
    for (std::uint32_t k = 0; k < kSteps; ++k)
      for (std::uint32_t i = 0; i < p.nx; ++i)
        for (std::uint32_t l = 0; l < kLanes; ++l) {
          const std::size_t at = (k * p.nx + i) * kLanes + l;
          const double want = p.steps[k].change[i] - change[at];
          // the measured change itself is rounded to 1e-8 (0.2 in single precision); doubles at 1000 m to 1e-13
          EXPECT_NEAR(double(got.residual[at]), want, 3e-8 + 3e-6 * std::abs(change[at]));
        }
  }
}

TEST_P(Model, NotANumberStaysInItsLane) {
  Problem p(plain_config(GetParam()));
  const Sums good(p, select_rollout(p.model), p.model, 3u, p.steps);
  p.params[5] = NAN;  // the first parameter of lane 5
  const Sums bad(p, select_rollout(p.model), p.model, 3u, p.steps);
  bool caught = false;
  for (std::uint32_t i = 0; i < p.nx; ++i)
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      if (l == 5)
        caught = caught || std::isnan(bad.squared[i * kLanes + l]);
      else
        EXPECT_EQ(bad.squared[i * kLanes + l], good.squared[i * kLanes + l]);
    }
  EXPECT_TRUE(caught);
}

TEST_P(Model, OutputsAreOptionalAndSplatsAreShorthand) {
  Problem p(plain_config(GetParam()));
  for (std::uint32_t i = 0; i < p.np; ++i)
    for (std::uint32_t l = 1; l < kLanes; ++l) p.params[i * kLanes + l] = p.params[i * kLanes];
  const Sums want(p, select_rollout(p.model), p.model, 0u, p.steps);
  std::vector<float> one;
  for (std::uint32_t i = 0; i < p.np; ++i) one.push_back(p.params[i * kLanes]);
  std::vector<double> squared(p.nx * kLanes);
  ResidualJob job = p.job();
  job.params = {one.data(), 0};
  select_rollout(p.model).residual(p.model, job);  // nothing to write
  job.squared = squared.data();
  select_rollout(p.model).residual(p.model, job);
  EXPECT_EQ(squared, want.squared);
  job.count = 0;
  select_rollout(p.model).residual(p.model, job);
  EXPECT_EQ(squared, want.squared);
}

}  // namespace
}  // namespace tiller
