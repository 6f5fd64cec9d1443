// Rotations against Eigen, over random ones and at the limits; derivatives against central differences.

#include "tiller/rotation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

#include "scalar/dual.hpp"

namespace tiller {
namespace {

using Q = Quaternion<double>;
using V = Vector3<double>;
using D = Dual<double, 3>;
constexpr double kRounding = 1e-14;  // a few dozen operations on numbers of size one

std::mt19937_64 generator(5);
double normal() {
  static std::normal_distribution<double> n;
  return n(generator);
}
Q random_attitude() { return normalised(Q{normal(), normal(), normal(), normal()}); }
V random_vector() { return {normal(), normal(), normal()}; }
Eigen::Quaterniond eigen(const Q& q) { return {q.w, q.x, q.y, q.z}; }
Eigen::Vector3d eigen(const V& v) { return {v.x, v.y, v.z}; }
double apart(const Q& a, const Eigen::Quaterniond& b) { return (eigen(a).coeffs() - b.coeffs()).norm(); }
double apart(const V& a, const Eigen::Vector3d& b) { return (eigen(a) - b).norm(); }
double length(const V& v) { return std::sqrt(dot(v, v)); }

TEST(Rotation, AgreesWithEigen) {
  for (int i = 0; i < 1000; ++i) {
    const Q a = random_attitude(), b = random_attitude();
    const V v = random_vector(), w = random_vector();
    EXPECT_LT(apart(a * b, eigen(a) * eigen(b)), kRounding);
    EXPECT_LT(apart(conjugate(a), eigen(a).conjugate()), kRounding);
    EXPECT_LT(apart(rotate(a, v), eigen(a) * eigen(v)), 8 * kRounding);
    EXPECT_LT(apart(to_matrix(a) * v, eigen(a).toRotationMatrix() * eigen(v)), 8 * kRounding);
    EXPECT_LT(apart(cross(v, w), eigen(v).cross(eigen(w))), 8 * kRounding);
    EXPECT_LT(apart(skew(v) * w, eigen(v).cross(eigen(w))), 8 * kRounding);
    EXPECT_NEAR(dot(v, w), eigen(v).dot(eigen(w)), 8 * kRounding);
  }
}

TEST(Rotation, RollPitchAndYawAreTurnsAboutZThenYThenX) {
  for (int i = 0; i < 1000; ++i) {
    const double roll = 3.1 * std::tanh(normal()), pitch = 1.5 * std::tanh(normal()), yaw = 3.1 * std::tanh(normal());
    const Q q = from_roll_pitch_yaw(roll, pitch, yaw);
    const Eigen::Quaterniond expected = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                        Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                                        Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
    EXPECT_LT(apart(q, expected), kRounding);
    const V back = to_roll_pitch_yaw(q);
    // near a pitch of 90 degrees the arc tangents lose half of the digits
    EXPECT_NEAR(back.x, roll, 1e-7);
    EXPECT_NEAR(back.y, pitch, 1e-7);
    EXPECT_NEAR(back.z, yaw, 1e-7);
  }
}

TEST(Rotation, ExpAgreesWithEigenAtEveryAngle) {
  for (const double angle : {0.0, 1e-300, 1e-12, 1e-6, 9.99e-3, 1.01e-2, 0.5, 3.0, 6.0}) {
    const V axis = random_vector();
    const V v = (angle / length(axis)) * axis;
    const Eigen::Quaterniond expected(Eigen::AngleAxisd(angle, eigen(axis).normalized()));
    EXPECT_LT(apart(exp(v), expected), kRounding) << angle;
  }
}

TEST(Rotation, LogIsTheInverseOfExpTheShortWayRound) {
  for (const double angle : {0.0, 1e-12, 1e-6, 9.99e-3, 1.01e-2, 0.5, 3.0, 3.1415926}) {
    const V axis = random_vector();
    const V v = (angle / length(axis)) * axis;
    Q q = exp(v);
    EXPECT_LT(apart(log(q), eigen(v)), 1e-13) << angle;
    q = {-2 * q.w, -2 * q.x, -2 * q.y, -2 * q.z};  // the same attitude, and twice as long
    EXPECT_LT(apart(log(q), eigen(v)), 1e-13) << angle;
  }
  EXPECT_NEAR(length(log(Q{0, 0, 1, 0})), M_PI, kRounding);
}

TEST(Rotation, RateTurnsAsExpDoes) {
  for (int i = 0; i < 100; ++i) {
    const Q q = random_attitude();
    const V rate = random_vector();
    constexpr double h = 1e-5;
    const Q after = q * exp(h * rate), before = q * exp(-h * rate), slope = attitude_rate(q, rate);
    EXPECT_NEAR((after.w - before.w) / (2 * h), slope.w, 1e-9);
    EXPECT_NEAR((after.x - before.x) / (2 * h), slope.x, 1e-9);
    EXPECT_NEAR((after.y - before.y) / (2 * h), slope.y, 1e-9);
    EXPECT_NEAR((after.z - before.z) / (2 * h), slope.z, 1e-9);
  }
}

/// Largest difference of f's derivatives from central ones. f takes a vector of any scalar and returns four numbers.
template <class F>
double slope_error(const V& at, const F& f) {
  const Vector3<D> seeded = {D::seed(at.x, 0), D::seed(at.y, 1), D::seed(at.z, 2)};
  const Quaternion<D> y = f(seeded);
  const D rows[] = {y.w, y.x, y.y, y.z};
  double worst = 0;
  for (int c = 0; c < 3; ++c) {
    constexpr double h = 1e-6;
    V more = at, less = at;
    (c == 0 ? more.x : c == 1 ? more.y : more.z) += h;
    (c == 0 ? less.x : c == 1 ? less.y : less.z) -= h;
    const Q a = f(more), b = f(less);
    const double slope[] = {(a.w - b.w) / (2 * h), (a.x - b.x) / (2 * h), (a.y - b.y) / (2 * h), (a.z - b.z) / (2 * h)};
    for (int r = 0; r < 4; ++r) worst = std::fmax(worst, std::fabs(slope[r] - rows[r].d[c]));
  }
  return worst;
}

template <class S>
Quaternion<S> in_front(const Vector3<S>& v) {
  return {S(0.0), v.x, v.y, v.z};
}

// Central differences with h = 1e-6 are good to 1e-9 here.
TEST(Rotation, DerivativesHoldAtNoRotationToo) {
  for (const double angle : {0.0, 1e-9, 1e-3, 9.99e-3, 1.01e-2, 1.0, 2.9}) {
    const V axis = random_vector();
    const V v = (angle / length(axis)) * axis;
    EXPECT_LT(slope_error(v, [](const auto& x) { return exp(x); }), 1e-8) << angle;
    EXPECT_LT(slope_error(v, [](const auto& x) { return in_front(log(exp(x))); }), 1e-8) << angle;
    EXPECT_LT(slope_error(v,
                          [](const auto& x) {
                            using S = std::decay_t<decltype(x.x)>;
                            const Quaternion<S> b = {S(0.5), S(-0.5), S(0.5), S(0.5)};
                            return in_front(attitude_difference(b * exp(x), b));
                          }),
              1e-8)
        << angle;
    EXPECT_LT(slope_error(v,
                          [](const auto& x) {
                            using S = std::decay_t<decltype(x.x)>;
                            return attitude_sum(Quaternion<S>{S(0.5), S(-0.5), S(0.5), S(0.5)}, x);
                          }),
              1e-8)
        << angle;
  }
}

TEST(Difference, IsTwiceTheTangentOfAQuarterOfTheAngleAlongTheAxis) {
  for (const double angle : {1e-9, 0.1, 1.0, 3.0, 3.14}) {
    const Q b = random_attitude();
    V axis = random_vector();
    axis = (1 / length(axis)) * axis;
    const V d = attitude_difference(b * exp(angle * axis), b);
    EXPECT_LT(apart(d, 2 * std::tan(angle / 4) * eigen(axis)), 1e-14) << angle;
  }
}

TEST(Difference, KnowsNoSignAndNoLength) {
  for (int i = 0; i < 100; ++i) {
    const Q a = random_attitude(), b = random_attitude();
    const V d = attitude_difference(a, b);
    EXPECT_LT(apart(attitude_difference(Q{-a.w, -a.x, -a.y, -a.z}, b), eigen(d)), kRounding);
    EXPECT_LT(apart(attitude_difference(a, Q{-3 * b.w, -3 * b.x, -3 * b.y, -3 * b.z}), eigen(d)), kRounding);
    EXPECT_LE(length(d), 2 + kRounding);
    // and a = b + d, up to its sign
    EXPECT_NEAR(std::fabs(dot(attitude_sum(b, d), a)), 1, kRounding);
  }
}

TEST(Difference, WhatIsNotANumberComesThrough) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Q one = {1, 0, 0, 0};
  for (const Q& bad : {Q{nan, 0, 0, 0}, Q{1, nan, 0, 0}, Q{1, 0, nan, 0}, Q{1, 0, 0, nan}}) {
    EXPECT_TRUE(std::isnan(length(attitude_difference(bad, one))));
    EXPECT_TRUE(std::isnan(length(attitude_difference(one, bad))));
    const Q n = normalised(bad);
    EXPECT_TRUE(std::isnan(dot(n, n)));
  }
  const Q zero = normalised(Q{0, 0, 0, 0});
  EXPECT_EQ(dot(zero, zero), 0.0);
}

}  // namespace
}  // namespace tiller
