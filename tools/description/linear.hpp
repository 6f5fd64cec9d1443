#pragma once

#include <array>

namespace tiller::tools {

/// Vectors and matrices of three rows over any number, plain or symbolic. Rotations map from a frame to the one above.

template <class T>
using Vec3 = std::array<T, 3>;

template <class T>
struct Mat3 {
  std::array<std::array<T, 3>, 3> m{};
  T& operator()(int r, int c) { return m[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)]; }
  const T& operator()(int r, int c) const { return m[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)]; }

  static Mat3 identity() {
    Mat3 one;
    for (int i = 0; i < 3; ++i) one(i, i) = T(1.0);
    return one;
  }
  Mat3 transposed() const {
    Mat3 t;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) t(c, r) = (*this)(r, c);
    return t;
  }
};

template <class T>
Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
template <class T>
Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
template <class T>
Vec3<T> scaled(const T& s, const Vec3<T>& a) {
  return {s * a[0], s * a[1], s * a[2]};
}
template <class T>
T dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
template <class T>
Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <class T>
Vec3<T> operator*(const Mat3<T>& a, const Vec3<T>& v) {
  return {dot(a.m[0], v), dot(a.m[1], v), dot(a.m[2], v)};
}
template <class T>
Mat3<T> operator*(const Mat3<T>& a, const Mat3<T>& b) {
  Mat3<T> p;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) p(r, c) = a(r, 0) * b(0, c) + a(r, 1) * b(1, c) + a(r, 2) * b(2, c);
  return p;
}
template <class T>
Mat3<T> operator+(const Mat3<T>& a, const Mat3<T>& b) {
  Mat3<T> s;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) s(r, c) = a(r, c) + b(r, c);
  return s;
}
template <class T>
Mat3<T> operator-(const Mat3<T>& a, const Mat3<T>& b) {
  Mat3<T> s;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) s(r, c) = a(r, c) - b(r, c);
  return s;
}
/// v x as a matrix.
template <class T>
Mat3<T> skew(const Vec3<T>& v) {
  Mat3<T> s;
  s(0, 1) = -v[2], s(0, 2) = v[1];
  s(1, 0) = v[2], s(1, 2) = -v[0];
  s(2, 0) = -v[1], s(2, 1) = v[0];
  return s;
}

/// Where a frame stands in the one above: x_above = rotation x + position.
struct Pose {
  Mat3<double> rotation = Mat3<double>::identity();
  Vec3<double> position{};
};
inline Pose operator*(const Pose& a, const Pose& b) {
  return {a.rotation * b.rotation, a.rotation * b.position + a.position};
}
inline Pose inverse(const Pose& p) {
  const Mat3<double> back = p.rotation.transposed();
  const Vec3<double> at = back * p.position;
  return {back, {-at[0], -at[1], -at[2]}};
}

/// Rotation by `angle` about a unit axis (Rodrigues).
Mat3<double> rotation_about(const Vec3<double>& axis, double angle_rad);
/// Of a quaternion w, x, y, z of any length above 0.
Mat3<double> rotation_of_quaternion(const std::array<double, 4>& wxyz);
/// URDF's roll, pitch, yaw: about the fixed x, then y, then z.
Mat3<double> rotation_rpy(const Vec3<double>& rpy_rad);

/// Mass, its centre and its inertia about that centre, in the axes of one frame.
struct RigidBody {
  double mass_kg = 0.0;
  Vec3<double> com_m{};
  Mat3<double> inertia_kgm2;  ///< about the centre of mass, symmetric
};
/// The same body seen from the frame above.
RigidBody moved(const RigidBody& body, const Pose& pose);
/// Two bodies that are screwed together.
RigidBody together(const RigidBody& a, const RigidBody& b);

/// Principal moments in ascending order.
Vec3<double> principal_moments(const Mat3<double>& inertia);

}  // namespace tiller::tools
