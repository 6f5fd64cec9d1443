// The extended Kalman filter's algebra with one particle per lane. Compiled once per instruction set.
//
// A particle's 4 x 4 algebra is too small for a matrix library and too short for SIMD inside one matrix; across
// particles every operation is the same, so each matrix element becomes a register of lanes.

#include "posterior/coordinates.hpp"
#include "posterior/filter_lanes.hpp"
#include "posterior/lane_forms.hpp"
#include "scalar/pack.hpp"
#include "tiller/model.h"
#include "tiller/rotation.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace {

using P = Pack<double>;

/// Matrices of larger filters stay in the block: copies in registers' width would take 200 kB of stack at the most
/// states.
constexpr std::uint32_t kMostOnStack = 8;

/// The number of states as a constant where it is common (the compiler then keeps the loops in registers), else
/// as a variable.
template <std::uint32_t N>
struct Count {
  constexpr explicit Count(std::uint32_t) {}
  constexpr operator std::uint32_t() const { return N; }
};
template <>
struct Count<0> {
  std::uint32_t n;
  explicit Count(std::uint32_t count) : n(count) {}
  operator std::uint32_t() const { return n; }
};

template <std::uint32_t N>
void predict_lanes(const PredictJob& job) {
  const Count<N> nx(job.nx);
  constexpr std::uint32_t max = N ? N : kMostOnStack;
  for (std::uint32_t lane = 0; lane < job.lanes; lane += P::width) {
    P p[max * max], a[max * max];
    for (std::uint32_t r = 0; r < nx; ++r)
      for (std::uint32_t c = r; c < nx; ++c)
        p[r * nx + c] = p[c * nx + r] = P::load(job.covariance + triangle_row(nx, r, c) * job.covariance_stride + lane);
    for (std::uint32_t i = 0; i < nx * nx; ++i) a[i] = P::load(job.a + i * job.a_stride + lane);
    const P scale = job.process_scale ? P::load(job.process_scale + lane) : P(1.0);
    for (std::uint32_t r = 0; r < nx; ++r) {
      P ap[max];  // row r of A P
      for (std::uint32_t c = 0; c < nx; ++c) {
        P sum = a[r * nx] * p[c];
        for (std::uint32_t k = 1; k < nx; ++k) sum = fma(a[r * nx + k], p[k * nx + c], sum);
        ap[c] = sum;
      }
      for (std::uint32_t c = r; c < nx; ++c) {
        P sum = P(job.process[triangle_row(nx, r, c)]) * scale;
        for (std::uint32_t k = 0; k < nx; ++k) sum = fma(ap[k], a[c * nx + k], sum);
        sum.store(job.predicted + triangle_row(nx, r, c) * job.predicted_stride + lane);
      }
    }
  }
}

/// The same sums in the same order, read from the block.
void predict_large(const PredictJob& job) {
  const std::uint32_t nx = job.nx;
  for (std::uint32_t lane = 0; lane < job.lanes; lane += P::width) {
    const auto a = [&](std::uint32_t r, std::uint32_t c) {
      return P::load(job.a + (r * nx + c) * job.a_stride + lane);
    };
    const double* covariance = job.covariance + lane;
    for (std::uint32_t r = 0; r < nx; ++r) {
      P ap[kMaxFilterStates];  // row r of A P
      for (std::uint32_t k = 0; k < nx; ++k) {
        const P factor = a(r, k);
        std::uint32_t row = k;  // of element (0, k), then (1, k) ..
        for (std::uint32_t c = 0; c < nx; ++c) {
          const P element = P::load(covariance + row * job.covariance_stride);
          ap[c] = k > 0 ? fma(factor, element, ap[c]) : factor * element;
          row += c < k ? nx - c - 1 : 1;  // down the column, then along the row
        }
      }
      for (std::uint32_t c = r; c < nx; ++c) {
        P sum =
            P(job.process[triangle_row(nx, r, c)]) * (job.process_scale ? P::load(job.process_scale + lane) : P(1.0));
        for (std::uint32_t k = 0; k < nx; ++k) sum = fma(ap[k], a(c, k), sum);
        sum.store(job.predicted + triangle_row(nx, r, c) * job.predicted_stride + lane);
      }
    }
  }
}

/// The same sums without what is zero where the last rows have their diagonal and its neighbours alone.
void predict_banded(const PredictJob& job) {
  const std::uint32_t nx = job.nx, dense = job.dense;
  for (std::uint32_t lane = 0; lane < job.lanes; lane += P::width) {
    const auto a = [&](std::uint32_t r, std::uint32_t c) {
      return P::load(job.a + (r * nx + c) * job.a_stride + lane);
    };
    const auto covariance = [&](std::uint32_t r, std::uint32_t c) {
      const std::uint32_t row = r <= c ? triangle_row(nx, r, c) : triangle_row(nx, c, r);
      return P::load(job.covariance + row * job.covariance_stride + lane);
    };
    const auto first = [&](std::uint32_t r) { return r < dense ? 0 : r > dense ? r - 1 : r; };
    const auto end = [&](std::uint32_t r) { return r < dense || r + 2 > nx ? nx : r + 2; };
    const P scale = job.process_scale ? P::load(job.process_scale + lane) : P(1.0);
    for (std::uint32_t r = 0; r < nx; ++r) {
      P ap[kMaxFilterStates];  // row r of A P, from the first element that is read
      for (std::uint32_t c = first(r); c < nx; ++c) ap[c] = P(0.0);
      for (std::uint32_t k = first(r); k < end(r); ++k) {
        const P factor = a(r, k);
        for (std::uint32_t c = first(r); c < nx; ++c) ap[c] = fma(factor, covariance(k, c), ap[c]);
      }
      for (std::uint32_t c = r; c < nx; ++c) {
        P sum = P(job.process[triangle_row(nx, r, c)]) * scale;
        for (std::uint32_t k = first(c); k < end(c); ++k) sum = fma(ap[k], a(c, k), sum);
        sum.store(job.predicted + triangle_row(nx, r, c) * job.predicted_stride + lane);
      }
    }
  }
}

P wrap_to_pi(const P& angle) {
  constexpr double kTurn = 6.283185307179586476925;
  return angle - P(kTurn) * nearest(angle * P(1.0 / kTurn));
}

/// Rounding may take a variance that the data have made tiny below zero; a zero is harmless, a negative one is not.
/// (NaN stays NaN: max gives its second argument then.)
P not_negative(const P& variance) { return max(P(0.0), variance); }

/// The quaternions of a register of filters while measurements correct them: x holds the correction so far, a
/// difference from what was predicted, and `seen` what was measured, likewise.
struct Turns {
  const std::uint32_t mask;
  std::uint32_t states = 0;  // bits of all that they take
  Quaternion<P> predicted[kMaxFilterStates / 4];
  P seen[kMaxFilterStates];

  explicit Turns(std::uint32_t quaternions) : mask(quaternions) {}

  __attribute__((noinline)) void begin(const CorrectJob& job, P* x) {
    for (std::uint32_t i = 0, n = 0; mask >> i; ++i) {
      if (!((mask >> i) & 1u)) continue;
      states |= 15u << i;
      Quaternion<P>& q = predicted[n++];
      q = {x[i], x[i + 1], x[i + 2], x[i + 3]};
      Vector3<P> z = {P(0.0), P(0.0), P(0.0)};
      for (std::uint32_t k = 0; k < job.ny; ++k) {
        if (job.measured_state[k] == i + 1) z.x = P(job.measured[k]);
        if (job.measured_state[k] == i + 2) z.y = P(job.measured[k]);
        if (job.measured_state[k] == i + 3) z.z = P(job.measured[k]);
      }
      const Quaternion<P> none = {P(1.0), P(0.0), P(0.0), P(0.0)};
      const Vector3<P> off = attitude_difference(attitude_sum(none, z), q);
      seen[i] = P(0.0);
      seen[i + 1] = off.x;
      seen[i + 2] = off.y;
      seen[i + 3] = off.z;
      for (std::uint32_t k = i; k < i + 4; ++k) x[k] = P(0.0);
    }
  }
  __attribute__((noinline)) void end(P* x) const {
    for (std::uint32_t i = 0, n = 0; mask >> i; ++i) {
      if (!((mask >> i) & 1u)) continue;
      const Quaternion<P> q = normalised(attitude_sum(predicted[n++], {x[i + 1], x[i + 2], x[i + 3]}));
      x[i] = q.w;
      x[i + 1] = q.x;
      x[i + 2] = q.y;
      x[i + 3] = q.z;
    }
  }
};

template <std::uint32_t N, std::uint32_t kMost = N>
void correct_lanes(const CorrectJob& job) {
  const Count<N> nx(job.nx);
  constexpr std::uint32_t max_states = kMost, max_triangle = triangle_rows(kMost);
  const std::uint32_t rows = triangle_rows(nx);
  const P weight(job.weight);
  for (std::uint32_t lane = 0; lane < job.lanes; lane += P::width) {
    P x[max_states], p[max_triangle];
    for (std::uint32_t i = 0; i < nx; ++i) x[i] = P::load(job.from.state + i * job.from.stride + lane);
    for (std::uint32_t i = 0; i < rows; ++i) p[i] = P::load(job.from.covariance + i * job.from.stride + lane);
    Turns turns(job.quaternion_mask);
    if (turns.mask != 0) turns.begin(job, x);
    P squared = P::load(job.squared_error + lane), logs = P::load(job.log_variance + lane);

    for (std::uint32_t k = 0; k < job.ny; ++k) {
      const bool missing = !(job.measured[k] == job.measured[k]);
      if (missing) {
        if (job.normalised) P(0.0).store(job.normalised + k * job.lanes + lane);
        continue;
      }
      const std::uint32_t m = job.measured_state[k];
      const bool mapped = job.gain != nullptr;
      const P slope = mapped ? P::load(job.gain + k * job.lanes + lane) : P(1.0);
      const P read = (turns.states >> m) & 1u ? turns.seen[m] : P(job.measured[k]);
      P innovation = read - (mapped ? fma(slope, x[m], P::load(job.offset + k * job.lanes + lane)) : x[m]);
      const std::uint32_t v = job.rate_gain ? job.rate_state[k] : TILLER_MAX_STATES;
      const P rate_slope = v < TILLER_MAX_STATES ? P::load(job.rate_gain + k * job.lanes + lane) : P(0.0);
      if (v < TILLER_MAX_STATES)
        innovation = innovation - rate_slope * (x[v] - P::load(job.from.state + v * job.from.stride + lane));
      if (job.angle_mask >> m & 1u) innovation = wrap_to_pi(innovation);
      P column[max_states];  // P h^T
      for (std::uint32_t i = 0; i < nx; ++i) column[i] = p[i < m ? triangle_row(nx, i, m) : triangle_row(nx, m, i)];
      if (mapped)
        for (std::uint32_t i = 0; i < nx; ++i) column[i] = slope * column[i];
      if (v < TILLER_MAX_STATES)
        for (std::uint32_t i = 0; i < nx; ++i)
          column[i] = fma(rate_slope, p[i < v ? triangle_row(nx, i, v) : triangle_row(nx, v, i)], column[i]);
      P spread = mapped ? slope * column[m] : column[m];
      if (v < TILLER_MAX_STATES) spread = fma(rate_slope, column[v], spread);
      const P variance = max(P(kVarianceFloor), spread + P(job.variance[k]));
      const P inverse = P(1.0) / variance;
      for (std::uint32_t r = 0; r < nx; ++r) {
        const P gain = column[r] * inverse;
        x[r] = fma(gain, innovation, x[r]);
        for (std::uint32_t c = r; c < nx; ++c) {
          P& element = p[triangle_row(nx, r, c)];
          element = element - gain * column[c];
          if (c == r) element = not_negative(element);
        }
      }
      squared = fma(weight * innovation, innovation * inverse, squared);
      logs = fma(weight, log(variance), logs);
      if (job.normalised) (innovation * sqrt(inverse)).store(job.normalised + k * job.lanes + lane);
    }

    if (turns.mask != 0) turns.end(x);

    // a sum is finite only if all of its terms are: one test for the lane
    P sum = squared + logs;
    for (std::uint32_t i = 0; i < nx; ++i) sum += x[i];
    for (std::uint32_t i = 0; i < rows; ++i) sum += p[i];
    P effect[TILLER_MAX_EFFECT_STATES];
    for (std::uint32_t i = 0; i < job.ns; ++i) {
      effect[i] = P::load(job.from.effect_state + i * job.from.stride + lane);
      sum += effect[i];
    }
    const auto finite = (sum - sum) == P(0.0);  // NOLINT(misc-redundant-expression): NaN where not finite
    auto keep = [&](double* to, const P& value) { select(finite, value, P::load(to)).store(to); };
    for (std::uint32_t i = 0; i < nx; ++i) keep(job.to.state + i * job.to.stride + lane, x[i]);
    for (std::uint32_t i = 0; i < rows; ++i) keep(job.to.covariance + i * job.to.stride + lane, p[i]);
    for (std::uint32_t i = 0; i < job.ns; ++i) keep(job.to.effect_state + i * job.to.stride + lane, effect[i]);
    select(finite, squared, P(__builtin_huge_val())).store(job.squared_error + lane);
    select(finite, logs, P(0.0)).store(job.log_variance + lane);
  }
}

void predict(const PredictJob& job) {
  if (job.dense > 0) return predict_banded(job);
  switch (job.nx) {
    case 2: return predict_lanes<2>(job);
    case 4: return predict_lanes<4>(job);
    default: return job.nx <= kMostOnStack ? predict_lanes<0>(job) : predict_large(job);
  }
}

void correct(const CorrectJob& job) {
  switch (job.nx) {
    case 2: return correct_lanes<2>(job);
    case 4: return correct_lanes<4>(job);
    default: break;
  }
  // by size, so that small filters take little stack
  if (job.nx <= kMostOnStack) return correct_lanes<0, kMostOnStack>(job);
  if (job.nx <= 2 * kMostOnStack) return correct_lanes<0, 2 * kMostOnStack>(job);
  correct_lanes<0, kMaxFilterStates>(job);
}

void polynomial(const PolynomialJob& job) {
  const std::uint32_t triangle = job.terms * (job.terms + 1) / 2;
  const P factor(job.factor);
  for (std::uint32_t lane = 0; lane < job.lanes; lane += static_cast<std::uint32_t>(P::width)) {
    P off[kMaxCoordinates], z[kMaxCoordinates], phi[kMaxPolynomialTerms], square(0.0);
    for (std::uint32_t r = 0; r < job.d; ++r) {
      off[r] = P::load(job.coordinate + r * job.coordinate_stride + lane) - P(job.centre[r]);
      z[r] = P(0.0);
      for (std::uint32_t c = 0; c <= r; ++c) z[r] = fma(P(job.inverse_root[r * job.d + c]), off[c], z[r]);
      square = fma(z[r], z[r], square);
    }
    std::uint32_t term = 0;
    phi[term++] = select(square > P(job.trusted_square), P(__builtin_nan("")), P(1.0));
    for (std::uint32_t r = 0; r < job.d; ++r) phi[term++] = z[r];
    for (std::uint32_t r = 0; r < job.curved; ++r)
      for (std::uint32_t c = r; c < job.curved; ++c) phi[term++] = z[r] * z[c];
    for (std::uint32_t r = 0; r < job.squares; ++r) {
      double* to = job.sums + r * job.stride + lane;
      fma(factor, quadratic_form(job.gram + r * triangle, phi, job.terms), P::load(to)).store(to);
    }
    for (std::uint32_t j = 0; j < job.linear; ++j) {
      P sum(0.0);
      for (std::uint32_t i = 0; i < job.terms; ++i) sum = fma(P(job.tilt[j * job.terms + i]), phi[i], sum);
      double* to = job.sums + (job.squares + j) * job.stride + lane;
      fma(factor, sum, P::load(to)).store(to);
    }
  }
}

WeighResult weigh(std::uint32_t n, const double* base, const double* gain, double exponent, double* weight) {
  const P power(exponent);
  P top(-__builtin_huge_val());
  for (std::uint32_t i = 0; i < n; i += P::width) top = max(fma(power, P::load(gain + i), P::load(base + i)), top);
  WeighResult result;
  result.largest = top.lane(0);
  for (int i = 1; i < P::width; ++i)
    if (top.lane(i) > result.largest) result.largest = top.lane(i);
  if (!(result.largest > -__builtin_huge_val() && result.largest < __builtin_huge_val())) return result;

  const P largest(result.largest), lowest(-700.0);  // exp of less underflows to denormals, which are slow
  P sum(0.0), squares(0.0);
  for (std::uint32_t i = 0; i < n; i += P::width) {
    const P logit = fma(power, P::load(gain + i), P::load(base + i)) - largest;
    const P w = select(logit > lowest, exp(max(logit, lowest)), P(0.0));
    sum += w;
    squares = fma(w, w, squares);
    if (weight) w.store(weight + i);
  }
  result.sum = reduce_add(sum);
  result.effective_samples = result.sum * result.sum / reduce_add(squares);
  return result;
}

}  // namespace

extern const FilterTable kFilterLanes;
const FilterTable kFilterLanes = {Isa::TILLER_COMPILE_ISA, predict, correct, polynomial, weigh};

TILLER_ISA_NAMESPACE_END
