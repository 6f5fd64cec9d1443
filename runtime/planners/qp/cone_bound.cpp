#include "planners/qp/cone_bound.hpp"

#include <cmath>

namespace tiller {
namespace {

using Vector = ConeBound::Vector;

double tail_product(const Vector& a, const Vector& b, std::uint32_t n) {
  double sum = 0.0;
  for (std::uint32_t i = 1; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/// a_0^2 - |a_1|^2, without the cancellation of the squares.
double determinant(const Vector& a, std::uint32_t n) {
  const double tail = std::sqrt(tail_product(a, a, n));
  return (a[0] - tail) * (a[0] + tail);
}

/// (a'b; a_0 b_1 + b_0 a_1)
void jordan_product(const Vector& a, const Vector& b, std::uint32_t n, Vector& out) {
  out[0] = a[0] * b[0] + tail_product(a, b, n);
  for (std::uint32_t i = 1; i < n; ++i) out[i] = a[0] * b[i] + b[0] * a[i];
}

/// x with a o x = d.
void jordan_divide(const Vector& a, const Vector& d, std::uint32_t n, Vector& x) {
  x[0] = (a[0] * d[0] - tail_product(a, d, n)) / determinant(a, n);
  for (std::uint32_t i = 1; i < n; ++i) x[i] = (d[i] - x[0] * a[i]) / a[0];
}

/// W v, or W^-1 v with sign -1.
void apply(const ConeBound& b, const Vector& v, double sign, Vector& out) {
  const double along = tail_product(b.axis, v, b.size);
  const double factor = sign > 0.0 ? b.length : 1.0 / b.length;
  const double head = factor * (b.axis[0] * v[0] + sign * along);
  const double tail = sign * v[0] + along / (1.0 + b.axis[0]);
  for (std::uint32_t i = 1; i < b.size; ++i) out[i] = factor * (v[i] + tail * b.axis[i]);
  out[0] = head;
}

/// The longest alpha <= most with v + alpha dv in the cone: 1 / alpha is the larger root of c t^2 + 2 b t + a.
double longest(const Vector& v, const Vector& dv, std::uint32_t n, double most) {
  const double a = dv[0] * dv[0] - tail_product(dv, dv, n), b = v[0] * dv[0] - tail_product(v, dv, n);
  const double c = determinant(v, n), square = b * b - a * c;
  if (!(square >= 0.0)) return most;
  const double root = std::sqrt(square);
  const double inverse = b > 0.0 ? -a / (b + root) : (root - b) / c;
  return inverse * most > 1.0 ? 1.0 / inverse : most;
}

}  // namespace

void ConeBound::value(const double* u, Vector& out) const {
  out[0] = cone->limit;
  if (cone->slope > 0.0) out[0] += cone->slope * u[cone->axis];
  for (std::uint32_t r = 1; r < size; ++r) out[r] = u[input[r]];
}

void ConeBound::change(const double* du, Vector& out) const {
  out[0] = cone->slope > 0.0 ? cone->slope * du[cone->axis] : 0.0;
  for (std::uint32_t r = 1; r < size; ++r) out[r] = du[input[r]];
}

void ConeBound::add_transposed(double factor, const Vector& v, double* out) const {
  if (cone->slope > 0.0) out[cone->axis] += factor * cone->slope * v[0];
  for (std::uint32_t r = 1; r < size; ++r) out[input[r]] += factor * v[r];
}

void ConeBound::begin(const double* u, double slack, double complementarity) {
  value(u, s);
  s[0] = std::fmax(s[0], std::sqrt(tail_product(s, s, size)) + slack);
  const double factor = complementarity / determinant(s, size);
  z[0] = factor * s[0];
  for (std::uint32_t r = 1; r < size; ++r) z[r] = -factor * s[r];
}

double ConeBound::complementarity(double alpha) const {
  double sum = 0.0;
  for (std::uint32_t r = 0; r < size; ++r) sum += (s[r] + alpha * ds[r]) * (z[r] + alpha * dz[r]);
  return sum;
}

void ConeBound::scale() {
  const double of_s = std::sqrt(determinant(s, size)), of_z = std::sqrt(determinant(z, size));
  double product = 0.0;
  for (std::uint32_t r = 0; r < size; ++r) product += s[r] * z[r];
  const double gamma = std::sqrt(0.5 * (1.0 + product / (of_s * of_z)));
  length = std::sqrt(of_s / of_z);
  axis[0] = (s[0] / of_s + z[0] / of_z) / (2.0 * gamma);
  for (std::uint32_t r = 1; r < size; ++r) axis[r] = (s[r] / of_s - z[r] / of_z) / (2.0 * gamma);
  apply(*this, z, 1.0, lambda);
  for (std::uint32_t r = 0; r < size; ++r) target[r] = -lambda[r];
}

void ConeBound::aim(double centre, double second) {
  Vector wished, square, scaled_s, scaled_z;
  jordan_product(lambda, lambda, size, square);
  apply(*this, ds, -1.0, scaled_s);
  apply(*this, dz, 1.0, scaled_z);
  jordan_product(scaled_s, scaled_z, size, wished);
  for (std::uint32_t r = 0; r < size; ++r) wished[r] = (r == 0 ? centre : 0.0) - square[r] - second * wished[r];
  jordan_divide(lambda, wished, size, target);
}

/// W^-2 = (2 J a a' J - J) / length^2 with a the axis of W and J = diag(1, -1, ...).
void ConeBound::add_curvature(double* block, std::size_t stride) const {
  const double factor = 1.0 / (length * length);
  double gradient[kMost];
  std::uint32_t at[kMost];
  std::uint32_t count = 0;
  if (cone->slope > 0.0) {
    at[count] = cone->axis;
    gradient[count++] = cone->slope * axis[0];
    block[cone->axis * stride + cone->axis] -= factor * cone->slope * cone->slope;
  }
  for (std::uint32_t r = 1; r < size; ++r) {
    at[count] = input[r];
    gradient[count++] = -axis[r];
    block[input[r] * stride + input[r]] += factor;
  }
  for (std::uint32_t i = 0; i < count; ++i)
    for (std::uint32_t j = 0; j < count; ++j) block[at[i] * stride + at[j]] += 2.0 * factor * gradient[i] * gradient[j];
}

void ConeBound::compute_push() {
  Vector inner, once;
  apply(*this, gap, -1.0, once);
  for (std::uint32_t r = 0; r < size; ++r) inner[r] = target[r] - once[r];
  apply(*this, inner, -1.0, push);
}

void ConeBound::recover(const double* du) {
  Vector moved, once, twice;
  change(du, moved);
  apply(*this, moved, -1.0, once);
  apply(*this, once, -1.0, twice);
  for (std::uint32_t r = 0; r < size; ++r) {
    ds[r] = moved[r] + gap[r];
    dz[r] = push[r] - twice[r];
  }
}

double ConeBound::longest_step(double most) const { return longest(z, dz, size, longest(s, ds, size, most)); }

void ConeBound::move(double alpha) {
  for (std::uint32_t r = 0; r < size; ++r) {
    s[r] += alpha * ds[r];
    z[r] += alpha * dz[r];
  }
}

}  // namespace tiller
