#include "tools/description/linear.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace tiller::tools {

Mat3<double> rotation_about(const Vec3<double>& axis, double angle_rad) {
  const double s = std::sin(angle_rad), c = std::cos(angle_rad);
  Mat3<double> r;
  const Mat3<double> k = skew(axis);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      r(i, j) = (i == j ? c : 0.0) + s * k(i, j) +
                (1.0 - c) * axis[static_cast<std::size_t>(i)] * axis[static_cast<std::size_t>(j)];
  return r;
}

Mat3<double> rotation_rpy(const Vec3<double>& rpy_rad) {
  return rotation_about({0, 0, 1}, rpy_rad[2]) * rotation_about({0, 1, 0}, rpy_rad[1]) *
         rotation_about({1, 0, 0}, rpy_rad[0]);
}

Mat3<double> rotation_of_quaternion(const std::array<double, 4>& wxyz) {
  const double length = std::sqrt(wxyz[0] * wxyz[0] + wxyz[1] * wxyz[1] + wxyz[2] * wxyz[2] + wxyz[3] * wxyz[3]);
  const double w = wxyz[0] / length;
  const Mat3<double> half = skew(scaled(1.0 / length, Vec3<double>{wxyz[1], wxyz[2], wxyz[3]}));
  const Mat3<double> square = half * half;
  Mat3<double> r = Mat3<double>::identity();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) r(i, j) += 2.0 * (w * half(i, j) + square(i, j));
  return r;
}

RigidBody moved(const RigidBody& body, const Pose& pose) {
  return {body.mass_kg, pose.rotation * body.com_m + pose.position,
          pose.rotation * body.inertia_kgm2 * pose.rotation.transposed()};
}

namespace {

/// Inertia of a point mass about the origin (the parallel axes theorem's share).
Mat3<double> point_inertia(double mass_kg, const Vec3<double>& at) {
  Mat3<double> j;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      j(r, c) =
          mass_kg * ((r == c ? dot(at, at) : 0.0) - at[static_cast<std::size_t>(r)] * at[static_cast<std::size_t>(c)]);
  return j;
}

}  // namespace

RigidBody together(const RigidBody& a, const RigidBody& b) {
  const double mass = a.mass_kg + b.mass_kg;
  if (!(mass > 0.0)) return {mass, a.com_m, a.inertia_kgm2 + b.inertia_kgm2};
  RigidBody sum;
  sum.mass_kg = mass;
  for (std::size_t i = 0; i < 3; ++i) sum.com_m[i] = (a.mass_kg * a.com_m[i] + b.mass_kg * b.com_m[i]) / mass;
  sum.inertia_kgm2 = a.inertia_kgm2 + point_inertia(a.mass_kg, a.com_m - sum.com_m) + b.inertia_kgm2 +
                     point_inertia(b.mass_kg, b.com_m - sum.com_m);
  return sum;
}

Vec3<double> principal_moments(const Mat3<double>& inertia) {
  Eigen::Matrix3d m;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) m(r, c) = inertia(r, c);
  const Eigen::Vector3d values =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m, Eigen::EigenvaluesOnly).eigenvalues();
  return {values[0], values[1], values[2]};
}

}  // namespace tiller::tools
