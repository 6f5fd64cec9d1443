// The hopper on its ground: derivatives through touchdown, slip and lift-off, lanes, the largest stable steps, and what
// a contact may not do (pull, leave the friction cone, sink or creep under load).

#include <gtest/gtest.h>

#include "batch.hpp"
#include "models/hopper.hpp"
#include "scalar/dual.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

constexpr int kStates = 10, kInputs = 2;
constexpr double kSettle_s = Hopper<double>::kSettle_s;
const double kParams[] = {4.0, 0.1, 0.4, 0.5, 1500.0, 15.0, 0.6};  // the last: ground_friction

/// x' of ten states and two inputs, in any scalar.
template <class S>
std::vector<S> derivative(const std::vector<S>& z, const double* parameters = kParams) {
  typename Hopper<S>::State x;
  typename Hopper<S>::Params p;
  S* const at = &x.x_m;
  S* const of = &p.body_mass_kg;
  for (int i = 0; i < kStates; ++i) at[i] = z[static_cast<std::size_t>(i)];
  for (int i = 0; i < 7; ++i) of[i] = S(parameters[i]);
  const S none(0.0);
  const Body<S> level = {none, S(-9.81), none, none};
  const auto dx = Hopper<S>::dynamics(x, {z[10], z[11]}, {none, none, none, none, none}, level, p);
  return {&dx.x_m, &dx.x_m + kStates};
}

std::vector<double> change(const std::vector<double>& z, const double* parameters = kParams) {
  return derivative<double>(z, parameters);
}

/// What the ground does to the foot: its mass times its acceleration, less what leg and gravity do.
struct Push {
  double x_N, z_N;
};
Push ground_push(const std::vector<double>& z, const double* p = kParams) {
  const auto dx = change(z, p);
  // all of the robot's momentum that does not come from gravity comes from the ground
  const double q = z[2] + z[3], w = z[7] + z[8], l = z[4], s = std::sin(q), c = std::cos(q);
  const double turn = dx[7] + dx[8];
  const double foot_x = dx[5] + (dx[9] - l * w * w) * s + (l * turn + 2 * z[9] * w) * c;
  const double foot_z = dx[6] - (dx[9] - l * w * w) * c + (l * turn + 2 * z[9] * w) * s;
  return {p[0] * dx[5] + p[2] * foot_x, p[0] * (dx[6] + 9.81) + p[2] * (foot_z + 9.81)};
}

/// A hop with a landing at an angle, a slip and a take-off: RK4 in steps of 0.1 ms.
std::vector<std::vector<double>> hop() {
  std::vector<std::vector<double>> path;
  std::vector<double> z = {0, 0.56, 0.02, 0.25, 0.5, 0.8, 0, 0, 0, 0, 1.0, 20.0};
  for (int k = 0; k < 4000; ++k) {
    path.push_back(z);
    const double h = 1e-4, share[] = {0.0, 0.5, 0.5, 1.0};
    std::vector<double> slope[4];
    for (int i = 0; i < 4; ++i) {
      auto at = z;
      for (int j = 0; j < kStates && i > 0; ++j) at[j] += share[i] * h * slope[i - 1][j];
      slope[i] = change(at);
    }
    for (int j = 0; j < kStates; ++j) z[j] += h / 6 * (slope[0][j] + 2 * slope[1][j] + 2 * slope[2][j] + slope[3][j]);
  }
  return path;
}

TEST(HopperContact, ADualsSlopeIsThatOfDifferencesThroughAHop) {
  using D = Dual<double, kStates + kInputs>;
  double worst = 0;
  int aloft = 0, stuck = 0, slipping = 0, between = 0;
  for (const auto& z : hop()) {
    const Push r = ground_push(z);
    (r.z_N < 0.1 ? aloft : r.z_N < 5.0 ? between : std::fabs(r.x_N) > 0.58 * r.z_N ? slipping : stuck)++;
    std::vector<D> seeded;
    for (int i = 0; i < kStates + kInputs; ++i) seeded.push_back(D::seed(z[i], i));
    const auto dual = derivative<D>(seeded);
    for (int i = 0; i < kStates + kInputs; ++i) {
      // an input of 1 N and a height of 1 m are 4e4 apart in what they do: a width for each, 0.005 N or less
      const double width = i >= kStates ? 1e-3 : i < 5 ? 1e-7 : 1e-6;
      auto more = z, less = z;
      more[i] += width, less[i] -= width;
      const auto up = change(more), down = change(less);
      for (int j = 0; j < kStates; ++j) {
        const double slope = (up[j] - down[j]) / (2 * width);
        worst = std::max(worst, std::fabs(dual[j].d[i] - slope) / (1.0 + std::fabs(slope)));
      }
    }
  }
  // differences: (width in N over kSmooth_N)^2 / 6 at the corners, rounding 1e-13 / width where nothing is near
  EXPECT_LT(worst, 1e-5);
  EXPECT_GT(aloft, 500);
  EXPECT_GT(stuck, 500);
  EXPECT_GT(slipping, 20);
  EXPECT_GT(between, 5);
}

TEST(HopperContact, NeitherPullsNorLeavesItsCone) {
  Rng rng(3, 41, 0);
  for (int k = 0; k < 20000; ++k) {
    const auto random = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
    std::vector<double> z = {0, 0, random(-0.5, 0.5), random(-0.5, 0.5), random(0.25, 0.6)};
    for (int i = 5; i < kStates; ++i) z.push_back(random(-3, 3));
    z.push_back(random(-20, 20)), z.push_back(random(-150, 150));
    z[1] = z[4] * std::cos(z[2] + z[3]) + random(-0.01, 0.03);
    const Push r = ground_push(z);
    EXPECT_GT(r.z_N, -1e-9);
    EXPECT_LE(std::fabs(r.x_N), kParams[6] * r.z_N + 1e-9);
  }
}

TEST(HopperContact, WorksAgainstTheFoot) {
  Rng rng(4, 41, 0);
  for (int k = 0; k < 20000; ++k) {
    const auto random = [&](double low, double high) { return low + (high - low) * rng.uniform(); };
    std::vector<double> z = {0, 0, 0, 0, 0.5, random(-2, 2), 0, 0, 0, 0, 0, 0};  // no load but the foot's weight
    z[1] = 0.5 + random(-0.005, 0.03);
    const double slip_m_s = z[5];
    const Push r = ground_push(z);
    EXPECT_LE(r.x_N * slip_m_s, 1e-9);  // friction takes energy
  }
}

// A second on the spot: 30 N along the leg and a hip torque within the cone; the foot stays where it is.
TEST(HopperContact, AFootUnderLoadNeitherSinksNorCreeps) {
  double p[7];
  std::copy(kParams, kParams + 7, p);
  p[1] = 1e6;  // a body that a hip torque does not turn
  p[5] = 60.0;
  std::vector<double> z = {0, 0.48, 0, 0, 0.48, 0, 0, 0, 0, 0, 0.0, 0.0};
  const auto x_of = [](const std::vector<double>& s) { return s[0] + s[4] * std::sin(s[2] + s[3]); };
  const auto z_of = [](const std::vector<double>& s) { return s[1] - s[4] * std::cos(s[2] + s[3]); };
  double deepest = 0, furthest = 0;
  for (int k = 0; k < 1000; ++k) {
    z[10] = 4.0 * std::sin(0.02 * k);  // 8 N across at most, of 0.6 * 43 N
    const auto dx = change(z, p);
    // the body is held: a leg and a foot on the ground are all that moves, by semi-implicit steps of 1 ms
    for (int i = 5; i < 10; ++i) z[i] += 1e-3 * dx[i];
    z[5] = z[7] = 0;
    for (int i = 0; i < 5; ++i) z[i] += 1e-3 * z[5 + i];
    if (k > 300) deepest = std::max(deepest, std::fabs(z_of(z))), furthest = std::max(furthest, std::fabs(x_of(z)));
  }
  EXPECT_LT(deepest, 1e-3);
  EXPECT_LT(furthest, 2e-3);
}

// The kernel's own steps: dropped from a hand's breadth with a speed of 0.5 m/s; a stable foot comes to rest.
TEST(HopperContact, IsStableUpToTheStepsThatItTells) {
  struct Bound {
    tiller_integrator_t integrator;
    double settles;
  };
  for (const Bound bound : {Bound{tiller_integrator_semi_implicit_euler, 1.236}, Bound{tiller_integrator_midpoint, 2.0},
                            Bound{tiller_integrator_rk4, 2.622}}) {
    const auto shake = [&](double step_s) {
      const tiller_model_t& m = *tiller_find_model("hopper");
      tiller::Config config = plain_config(&m);
      config.integrator = bound.integrator;
      config.period_s = step_s;
      Batch<double> b(config, 16, 1000);
      std::fill(b.controls.begin(), b.controls.end(), 0.0);
      const double start[] = {0, 0.48, 0, 0, 0.48, 0, 0, 0, 0, 0};
      for (int i = 0; i < kStates; ++i)
        for (int l = 0; l < 16; ++l) b.state[i * 16 + l] = start[i] + (i == 6 ? -0.01 * l : 0.0);
      for (std::uint32_t i = 0; i < 7; ++i) b.set_param(i, kParams[i]);
      b.set_param(1, 1e6);  // keeps level, so that nothing but the contact can be unstable
      b.set_param(5, 60.0);
      b.run(m, select_rollout(m));
      double fastest = 0;  // of the foot over the ground, late
      for (std::uint32_t k = 900; k <= 1000; ++k)
        for (int l = 0; l < 16; ++l) {
          const auto at = [&](int i) { return b.trajectory[(k * kStates + i) * 16 + l]; };
          const double v = std::fabs(at(6) - at(9));
          fastest = std::isfinite(v) ? std::max(fastest, v) : INFINITY;
        }
      return fastest;
    };
    EXPECT_LT(shake(0.95 * bound.settles * kSettle_s), 1e-3) << bound.settles;
    EXPECT_GT(shake(1.1 * bound.settles * kSettle_s), 1e-2) << bound.settles;
  }
}

TEST(HopperContact, LanesAgreeOnTheGround) {
  const tiller_model_t& m = *tiller_find_model("hopper");
  const tiller_model_t plain = as_c_model(m);
  tiller::Config config = plain_config(&m);
  config.period_s = 0.01;
  config.substeps = 5;
  const auto prepare = [&](auto& b) {
    Rng rng(6, 41, 0);
    for (std::uint32_t l = 0; l < 16; ++l) {
      const double start[] = {
          0, 0.52 + 0.04 * rng.uniform(), 0, 0.2 * (rng.uniform() - 0.5), 0.5, rng.uniform(), -1, 0, 0, 0};
      using Number = typename std::decay_t<decltype(b.state)>::value_type;
      for (std::uint32_t i = 0; i < kStates; ++i) b.state[i * 16 + l] = static_cast<Number>(start[i]);
    }
    for (std::uint32_t i = 0; i < 7; ++i) b.set_param(i, kParams[i]);
  };
  Batch<double> want(config, 16, 20);
  prepare(want);
  want.run(plain, select_rollout(plain));
  for (Isa isa : all_isas()) {
    Batch<double> got(config, 16, 20);
    prepare(got);
    got.run(m, select_rollout(m, isa));
    Batch<float> single(config, 16, 20);
    prepare(single);
    single.run(m, select_rollout(m, isa));
    for (std::size_t i = 0; i < want.final_state.size(); ++i) {
      // a touchdown, a stance and a take-off amplify rounding by about a hundred
      EXPECT_NEAR(got.final_state[i], want.final_state[i], 1e-11) << isa_name(isa) << " " << i;
      EXPECT_NEAR(double(single.final_state[i]), want.final_state[i], 2e-3) << isa_name(isa) << " " << i;
    }
  }
}

// High up, accelerations by MuJoCo 3 (mj_forward) of two bodies on slides and hinges. A state, inputs, forces of
// effects, gravity, payload, parameters; then what came out. At 1e7 m the ground's smooth corner is 1e-12 N.
TEST(Hopper, FliesAsMuJoCoSays) {
  struct Row {
    double in[28], out[5];
  };
  const Row rows[] = {
      {{-0.6599, 1e7 + 304.8, 2.8042,  1.4375, 0.3555,  -1.5483,   2.2569, 3.7959,  0.9157,   -1.9468,
        -2.0238, -68.4616,    -0.6579, 3.9041, -2.9732, -0.5827,   1.3224, -1.8951, -10.1286, 0,
        0,       2.9726,      0.2696,  0.641,  0.5635,  1687.9828, 6.4859, 0.3207},
       {85.6891332605891, -56.261044130356, -1.36016320474778, 16.8608434047816, 569.568613232889}},
      {{0.0298, 1e7 + 307.1, 2.9382, 0.8269, 0.246,   0.4685,    -0.9104, -2.5211, 2.5531,   1.7148,
        12.34,  22.0425,     1.9764, 1.8664, -2.4616, 0.5983,    3.7252,  -1.8731, -10.7839, 0.9333,
        0.0927, 7.6377,      0.1962, 0.4988, 0.5613,  1024.9311, 2.9714,  0.8659},
       {26.7623044216915, -39.5506983706361, -53.3052959501558, 507.709566891849, 729.394585141991}},
      {{0.4858,  1e7 + 304.3, 1.6592,  1.5522, 0.2328, -3.7863,   -2.4485, 3.59,   -0.9529, 2.5432,
        -5.4162, 29.9622,     -1.2674, 3.2103, 0.155,  4.4473,    3.1228,  1.3445, -8.9405, 0,
        0,       3.5888,      0.0667,  0.1198, 0.3316, 1419.4002, 0.5917,  0.7428},
       {3.17384125346609, -55.8861249731775, 16.8500749625189, -229.924370088292, 1482.77591094257}},
      {{0.0282,   1e7 + 301.2, -2.0959, 1.759,   0.446,   -2.2504,   3.2501,  -1.8617, 1.4863,   1.5657,
        -16.2079, -84.5158,    2.7285,  -3.6409, -3.0437, 3.7211,    0.5084,  -1.1619, -10.1455, 0.4981,
        0.0999,   7.8615,      0.1128,  0.3493,  0.5588,  2172.9717, 12.7808, 0.3212},
       {7.90456252083723, 4.24100760479505, 44.3963328631876, -229.99773552215, 420.568102781351}},
  };
  const tiller_model_t& m = *tiller_find_model("hopper");
  for (const Row& row : rows) {
    const tiller_body_t body = {row.in[17], row.in[18], row.in[19], row.in[20]};
    double dx[kStates], size = 0;
    m.dynamics(row.in, row.in + 10, row.in + 12, &body, row.in + 21, dx);
    for (const double value : row.out) size = std::max(size, std::fabs(value));
    for (int i = 0; i < 5; ++i) EXPECT_NEAR(dx[5 + i], row.out[i], 1e-11 * size);
  }
}

}  // namespace
}  // namespace tiller
