// Derivatives that an import has in closed form: of the joints' forces by the recursion on composite bodies, and of a
// period with effects by these slopes.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "rollout/step.hpp"
#include "scalar/dual.hpp"
#include "stiff_arm.hpp"
#include "tools/import/force_slopes.hpp"
#include "tools/import/inverse_dynamics.hpp"

namespace tiller_test {
namespace {

using namespace tiller::tools;
using tiller::Dual;

// ---- the recursion ----

/// A tree of revolute and prismatic joints whose bodies have an inertia of some sort; the recursion does not ask
/// whether a body can have it.
struct Tree {
  Mechanism mechanism;
  std::vector<BodyInertia<double>> inertia;
  std::vector<double> q, v, a;
};
Tree random_tree(std::mt19937& random, int bodies, bool chain) {
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  const auto sometimes = [&](double size) { return random() % 2 == 0 ? 0.0 : size * unit(random); };
  Tree t;
  for (int i = 0; i < bodies; ++i) {
    MovingBody body;
    body.parent = chain ? i - 1 : static_cast<int>(random() % static_cast<unsigned>(i + 1)) - 1;
    body.prismatic = random() % 3 == 0;
    body.frame = {sometimes(1.0), sometimes(3.0), sometimes(3.0), sometimes(1.0), sometimes(1.0), sometimes(1.0)};
    body.armature = random() % 2 == 0 ? 0.1 : 0.0;
    t.mechanism.bodies.push_back(body);
    BodyInertia<double> b;
    b.mass = 1.5 + unit(random);
    for (double& h : b.moment) h = unit(random);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c <= r; ++c) b.inertia(r, c) = b.inertia(c, r) = r == c ? 2.0 + unit(random) : 0.2 * unit(random);
    t.inertia.push_back(b);
    t.q.push_back(3.0 * unit(random));
    t.v.push_back(3.0 * unit(random));
    t.a.push_back(3.0 * unit(random));
  }
  return t;
}

TEST(ForceSlopes, AreThoseOfNewtonsAndEulersRecursion) {
  using D = Dual<double, 1>;
  std::mt19937 random(3);
  const Vec3<double> base{0.7, 0.0, 9.81};
  for (int trial = 0; trial < 200; ++trial) {
    const int n = 1 + trial % 9;
    const Tree t = random_tree(random, n, trial % 2 == 0);
    const ForceSlopes<double> slopes = SlopeRecursion<double>(t.mechanism, t.inertia).slopes(t.q, t.v, t.a, base);
    std::vector<BodyInertia<D>> inertia;
    for (const BodyInertia<double>& b : t.inertia) {
      BodyInertia<D> d;
      d.mass = b.mass;
      for (std::size_t k = 0; k < 3; ++k) d.moment[k] = b.moment[k];
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) d.inertia(r, c) = b.inertia(r, c);
      inertia.push_back(d);
    }
    const ForceSlopes<double>::Matrix* const matrices[] = {&slopes.by_position, &slopes.by_speed, &slopes.inertia};
    for (int which = 0; which < 3; ++which)
      for (std::size_t c = 0; c < static_cast<std::size_t>(n); ++c) {
        std::vector<D> values[3] = {{t.q.begin(), t.q.end()}, {t.v.begin(), t.v.end()}, {t.a.begin(), t.a.end()}};
        values[which][c].d[0] = 1.0;
        const std::vector<D> force = joint_forces<D>(t.mechanism, inertia, values[0], values[1], values[2],
                                                     {D(base[0]), D(base[1]), D(base[2])});
        for (std::size_t i = 0; i < force.size(); ++i) {
          const double slope = force[i].d[0];
          EXPECT_NEAR((*matrices[which])[i][c], slope, 1e-11 * (1.0 + std::fabs(slope)))
              << "trial " << trial << ", force " << i << " by " << c << " of " << which;
        }
      }
  }
}

// ---- a period with effects ------------------------------------------------------------------------------------------

using Model = tiller::StaticModel<StiffArm>;
constexpr int kEffectStates = 5, kAll = Model::kStates + kEffectStates + Model::kInputs, kFew = 6;
static_assert(tiller::Stepper<Model, Dual<double, kAll>>::kSloped, "the wide numbers go by the effects' arguments");
static_assert(!tiller::Stepper<Model, Dual<double, kFew>>::kSloped, "the narrow ones through the effects' texts");

struct Given {
  tiller_effect_kind_t kind;
  std::uint16_t port;
  std::vector<double> params;
};
/// One of every sort that acts at a joint, an input or the body, those with states too.
const Given kGiven[] = {{tiller_effect_payload, 0, {0.4}},
                        {tiller_effect_actuator_lag, 0, {0.02}},
                        {tiller_effect_viscous_friction, 0, {0.8}},
                        {tiller_effect_coulomb_friction, 1, {1.5}},
                        {tiller_effect_coulomb_friction, 1, {0.7}},
                        {tiller_effect_lugre_friction, 3, {0.4, 0.2, 0.05, 200.0}},
                        {tiller_effect_linear_spring, 2, {30.0}},
                        {tiller_effect_joint_inertia, 1, {0.3}},
                        {tiller_effect_quadratic_drag, 2, {0.5}},
                        {tiller_effect_position_servo, 1, {40.0, 2.0, 0.0}},
                        {tiller_effect_elastic_joint, 2, {500.0, 0.2, 1.0}}};

/// several: friction at three joints, which are swept until they agree, and not at one.
tiller::StepSetup setup_of(tiller_integrator_t integrator, std::uint32_t substeps, bool several,
                           std::vector<double>& params) {
  tiller::StepSetup setup;
  setup.integrator = integrator;
  setup.substeps = substeps;
  for (const Given& g : kGiven) {
    if (!several && (g.kind == tiller_effect_viscous_friction || g.kind == tiller_effect_quadratic_drag)) continue;
    setup.effects[setup.effect_count++] = {static_cast<std::uint16_t>(g.kind), g.port,
                                           static_cast<std::uint16_t>(Model::kParams + params.size()),
                                           static_cast<std::uint16_t>(setup.effect_state_count)};
    EXPECT_EQ(g.params.size(), static_cast<std::size_t>(tiller::effect_info(g.kind).param_count));
    setup.effect_state_count += static_cast<std::uint32_t>(tiller::effect_info(g.kind).state_count);
    params.insert(params.end(), g.params.begin(), g.params.end());
  }
  return setup;
}

struct Start {
  double x[Model::kStates], effect_state[kEffectStates], u[Model::kInputs];
};
/// The period's end with its derivatives along N of the directions: states, effects' states, inputs.
template <int N>
tiller::Trajectory<Model, Dual<double, N>> end_of(const tiller::StepSetup& setup, const Start& start,
                                                  const std::vector<double>& params, int first) {
  using D = Dual<double, N>;
  const auto seeded = [&](double value, int direction) {
    D d(value);
    if (direction >= first && direction < first + N) d.d[direction - first] = 1.0;
    return d;
  };
  tiller::Trajectory<Model, D> t;
  tiller::Parameters<Model, D> p;
  Model::Input<D> u;
  tiller::each(Model::nx(), [&](auto i) { t.x[i] = seeded(start.x[i], i); });
  for (int s = 0; s < kEffectStates; ++s) t.effect_state[s] = seeded(start.effect_state[s], Model::kStates + s);
  tiller::each(Model::nu(), [&](auto i) { u[i] = seeded(start.u[i], Model::kStates + kEffectStates + i); });
  tiller::each(Model::np(), [&](auto i) { p.model[i] = D(0.9); });
  for (std::size_t i = 0; i < params.size(); ++i) p.effect[i] = D(params[i]);
  const tiller::Stepper<Model, D> stepper({}, setup, setup.period_s);
  stepper.advance(t, u, p);
  return t;
}

TEST(SlopedEffects, HaveTheDerivativesOfTheirTexts) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  int swept = 0, far = 0;
  for (const tiller_integrator_t integrator :
       {tiller_integrator_semi_implicit_euler, tiller_integrator_midpoint, tiller_integrator_rk4})
    for (int trial = 0; trial < 80; ++trial) {
      std::vector<double> params;
      const bool several = trial % 4 < 2;
      // of several joints' friction the wide numbers have the derivatives that the sweeps lead to; five come near
      const double tolerance = several ? 1e-3 : 1e-10;
      double worst = 0.0;
      const tiller::StepSetup setup = setup_of(integrator, 1 + static_cast<std::uint32_t>(trial % 2), several, params);
      ASSERT_EQ(setup.effect_state_count, static_cast<std::uint32_t>(kEffectStates));
      Start start{};
      for (double& x : start.x) x = (trial % 3 == 0 ? 0.01 : 1.0) * unit(random);  // slow joints stick
      for (double& s : start.effect_state) s = 0.001 * unit(random);
      for (double& u : start.u) u = 3.0 * unit(random);
      const auto wide = end_of<kAll>(setup, start, params, 0);
      for (int first = 0; first < kAll; first += kFew) {
        const auto narrow = end_of<kFew>(setup, start, params, first);
        const auto expect = [&](const Dual<double, kAll>& got, const Dual<double, kFew>& wanted, const char* what,
                                int i) {
          EXPECT_NEAR(got.v, wanted.v, 1e-13 * (1.0 + std::fabs(wanted.v))) << what << " " << i;
          for (int k = 0; k < kFew && first + k < kAll; ++k) {
            worst = std::fmax(worst, std::fabs(got.d[first + k] - wanted.d[k]) / (1.0 + std::fabs(wanted.d[k])));
            EXPECT_NEAR(got.d[first + k], wanted.d[k], tolerance * (1.0 + std::fabs(wanted.d[k])))
                << what << " " << i << " by " << first + k << ", integrator " << integrator << ", trial " << trial;
          }
        };
        tiller::each(Model::nx(), [&](auto i) { expect(wide.x[i], narrow.x[i], "state", i); });
        for (int s = 0; s < kEffectStates; ++s) expect(wide.effect_state[s], narrow.effect_state[s], "effect state", s);
      }
      swept += several;
      far += several && worst > 1e-6;
    }
  EXPECT_LE(far, swept / 10) << "in most trials five sweeps are all that is felt";
}

}  // namespace
}  // namespace tiller_test
