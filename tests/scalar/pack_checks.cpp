// Compiled once per instruction set: compares lanes with the C library.

#include "pack_checks.hpp"

#include <cmath>
#include <limits>

#include "scalar/dual.hpp"
#include "scalar/pack.hpp"

TILLER_ISA_NAMESPACE_BEGIN

PackReport check_pack();

namespace {

double relative(double got, double want) { return std::abs(got - want) / std::max(std::abs(want), 1e-30); }

template <class T, class Lane, class Plain>
double worst(double low, double high, int n, Lane lane, Plain plain) {
  double error = 0.0;
  for (int i = 0; i <= n; ++i) {
    const T x = static_cast<T>(low + (high - low) * i / n);
    const Pack<T> y = lane(Pack<T>(x));
    for (int l = 0; l < Pack<T>::width; ++l) error = std::max(error, relative(double(y.lane(l)), plain(double(x))));
  }
  return error;
}

template <class T>
double sincos_error(double range) {
  double error = 0.0;
  for (int i = -40000; i <= 40000; ++i) {
    const T x = static_cast<T>(range * i / 40000.0);
    Pack<T> s, c;
    sincos(Pack<T>(x), s, c);
    error = std::max(error, std::abs(double(s.lane(0)) - std::sin(double(x))));
    error = std::max(error, std::abs(double(c.lane(Pack<T>::width - 1)) - std::cos(double(x))));
  }
  return error;
}

template <class T>
void arithmetic(std::string& wrong) {
  constexpr int n = Pack<T>::width;
  const T nan = std::numeric_limits<T>::quiet_NaN(), inf = std::numeric_limits<T>::infinity();
  T a[n], b[n];
  for (int i = 0; i < n; ++i) {
    a[i] = T(0.75) * T(i + 1) - T(3);
    b[i] = T(2.5) - T(0.5) * T(i);
  }
  b[n > 1 ? 1 : 0] = T(1.25);
  const Pack<T> x = Pack<T>::load(a), y = Pack<T>::load(b);
  for (int i = 0; i < n; ++i) {
    if ((x + y).lane(i) != a[i] + b[i]) wrong += "add ";
    if ((x - y).lane(i) != a[i] - b[i]) wrong += "subtract ";
    if ((x * y).lane(i) != a[i] * b[i]) wrong += "multiply ";
    if (b[i] != 0 && (x / y).lane(i) != a[i] / b[i]) wrong += "divide ";
    if ((-x).lane(i) != -a[i]) wrong += "negate ";
    if (select(x < y, x, y).lane(i) != (a[i] < b[i] ? a[i] : b[i])) wrong += "select ";
    if (min(x, y).lane(i) != std::fmin(a[i], b[i])) wrong += "min ";
    if (max(x, y).lane(i) != std::fmax(a[i], b[i])) wrong += "max ";
    if (abs(x).lane(i) != std::abs(a[i])) wrong += "abs ";
    if (floor(x).lane(i) != std::floor(a[i])) wrong += "floor ";
    if (nearest(x).lane(i) != std::nearbyint(a[i])) wrong += "nearest ";
    if (copysign(x, y).lane(i) != std::copysign(a[i], b[i])) wrong += "copysign ";
    if (sqrt(abs(x)).lane(i) != std::sqrt(std::abs(a[i]))) wrong += "sqrt ";
  }
  T sum = a[0];
  for (int i = 1; i < n; ++i) sum += a[i];
  if (reduce_add(x) != sum) wrong += "reduce_add ";
  Pack<T> s, c;
  for (T bad : {nan, inf, -inf}) {
    sincos(Pack<T>(bad), s, c);
    if (!std::isnan(s.lane(0)) || !std::isnan(c.lane(0))) wrong += "sincos-of-not-finite ";
  }
  if (!std::isnan(exp(Pack<T>(nan)).lane(0))) wrong += "exp(nan) ";
  if (exp(Pack<T>(-inf)).lane(0) != T(0)) wrong += "exp(-inf) ";
  if (exp(Pack<T>(T(0))).lane(0) != T(1)) wrong += "exp(0) ";
  if (!std::isnan(tanh(Pack<T>(nan)).lane(0))) wrong += "tanh(nan) ";
  if (any(Pack<T>(nan) == Pack<T>(nan))) wrong += "nan==nan ";
  if (!all(Pack<T>(nan) != Pack<T>(nan))) wrong += "nan!=nan ";
  if (!any(x == x) || !all(x == x) || any(x != x)) wrong += "any/all ";
}

void integers(std::string& wrong) {
  const std::uint32_t a = 0x9E3779B9u, b = 0x85EBCA6Bu;
  const IntPack x(a), y(b);
  std::uint32_t out[IntPack::width];
  const auto first = [&](const IntPack& p) {
    p.store(out);
    return out[IntPack::width - 1];
  };
  if (first(x + y) != a + b) wrong += "int-add ";
  if (first(x * y) != a * b) wrong += "int-multiply ";
  if (first(x ^ y) != (a ^ b)) wrong += "int-xor ";
  if (first((x << 7) | (x >> 25)) != ((a << 7) | (a >> 25))) wrong += "int-rotate ";
  if (first(counting(5)) != 5u + IntPack::width - 1) wrong += "counting ";
  const float u = to_unit_float(IntPack(0xC0000000u)).lane(0);
  if (u != 0.75f) wrong += "unit-float ";
}

/// A function with every branch in lanes and in duals of lanes, against central differences in double.
void duals(std::string& wrong) {
  const auto f = [](auto x, auto y) {
    // the plain numbers' functions too: this namespace's own hide them
    using tiller::abs, tiller::atan2, tiller::copysign, tiller::cos, tiller::exp, tiller::log, tiller::max, tiller::min,
        tiller::select, tiller::sin, tiller::sqrt, tiller::tanh;
    auto z = x * sin(y) + exp(-x * x) / (y * y + 1.0) + sqrt(x * x + 0.5) * tanh(y) + atan2(y, x) + abs(x - y);
    return select(x > 0.3, z, z * 2.0) + log(x * x + 1.0) - copysign(y, x) + cos(x) * min(x, y) - max(x, y);
  };
  using D = Dual<Pack<double>, 2>;
  for (double x : {-1.3, 0.7, 2.1})
    for (double y : {-0.4, 0.9, 1.6}) {
      const D z = f(D::seed(x, 0), D::seed(y, 1));
      const double h = 1e-6;
      const double dx = (f(x + h, y) - f(x - h, y)) / (2 * h), dy = (f(x, y + h) - f(x, y - h)) / (2 * h);
      // rounding of the difference: 1e-16 / 1e-6, and its truncation 1e-12
      if (std::abs(z.v.lane(0) - f(x, y)) > 1e-13) wrong += "dual-value ";
      if (std::abs(z.d[0].lane(0) - dx) > 1e-8 || std::abs(z.d[1].lane(0) - dy) > 1e-8) wrong += "dual-derivative ";
    }
}

}  // namespace

PackReport check_pack() {
  PackReport r{};
  r.width_f32 = Pack<float>::width;
  r.width_f64 = Pack<double>::width;
  r.sincos_f32 = sincos_error<float>(8192);
  r.sincos_f64 = sincos_error<double>(1e6);
  const auto exps = [](auto x) { return exp(x); };
  const auto logs = [](auto x) { return log(x); };
  const auto tanhs = [](auto x) { return tanh(x); };
  const auto angles = [](auto x) { return atan2(x, decltype(x)(-0.7)); };
  const auto plain_exp = [](double x) { return std::exp(x); };
  const auto plain_log = [](double x) { return std::log(x); };
  const auto plain_tanh = [](double x) { return std::tanh(x); };
  r.exp_f32 = worst<float>(-80, 80, 20000, exps, plain_exp);
  r.exp_f64 = worst<double>(-600, 600, 20000, exps, plain_exp);
  r.log_f32 = worst<float>(1.5, 1e6, 20000, logs, plain_log);
  r.log_f64 = worst<double>(1.5, 1e6, 20000, logs, plain_log);
  r.tanh_f32 = worst<float>(-9, 9, 20000, tanhs, plain_tanh);
  r.tanh_f64 = worst<double>(-9, 9, 20000, tanhs, plain_tanh);
  r.atan2_f32 = worst<float>(-5, 5, 20000, angles, [](double x) { return std::atan2(x, double(-0.7f)); });
  r.atan2_f64 = worst<double>(-5, 5, 20000, angles, [](double x) { return std::atan2(x, -0.7); });
  arithmetic<float>(r.wrong);
  arithmetic<double>(r.wrong);
  integers(r.wrong);
  duals(r.wrong);
  return r;
}

TILLER_ISA_NAMESPACE_END
