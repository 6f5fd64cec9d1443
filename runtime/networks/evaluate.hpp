#pragma once

// A network's text for any scalar: numbers, lanes, duals over either. Weights are the same for all lanes; which member
// a lane takes may differ.

#include <cstdint>
#include <type_traits>

#include "scalar/dual.hpp"
#include "scalar/inline.hpp"
#include "tiller/scalar.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// sum + weight x, without derivatives of the weight, which has none.
template <class S>
TILLER_INLINE S add_weighted(const S& sum, float weight, const S& x) {
  return sum + S(static_cast<double>(weight)) * x;
}
template <class V, int N>
TILLER_INLINE Dual<V, N> add_weighted(const Dual<V, N>& sum, float weight, const Dual<V, N>& x) {
  Dual<V, N> r;
  r.v = add_weighted(sum.v, weight, x.v);
  for (int i = 0; i < N; ++i) r.d[i] = add_weighted(sum.d[i], weight, x.d[i]);
  return r;
}

/// tanh of each of x (n), in place: x P(x^2) / Q(x^2), whose coefficients are a minimax fit on [-7.5, 7.5], at most
/// 2e-6 off anywhere. Four share one division; arithmetic alone, so the bits are the same on every target.
template <class S>
TILLER_INLINE void tanh_parts(const S& x, S& numerator, S& denominator) {
  const S a = max(min(x, S(7.5)), S(-7.5)), s = a * a;
  numerator = a * (S(0.9999929344299462) +
                   s * (S(0.12235934345095105) + s * (S(0.0022187473102229433) + s * S(3.663042641605701e-06))));
  denominator = S(1.0) + s * (S(0.4556693312104527) + s * (S(0.020798025996771875) + s * S(0.00013610644038519612)));
}
template <class S>
TILLER_INLINE void tanh_all(S* x, int n) {
  int i = 0;
  for (; i + 4 <= n; i += 4) {
    S p[4], q[4];
    for (int k = 0; k < 4; ++k) tanh_parts(x[i + k], p[k], q[k]);
    const S first = q[0] * q[1], second = q[2] * q[3], inverse = S(1.0) / (first * second);
    const S by_first = inverse * second, by_second = inverse * first;
    x[i] = p[0] * q[1] * by_first;
    x[i + 1] = p[1] * q[0] * by_first;
    x[i + 2] = p[2] * q[3] * by_second;
    x[i + 3] = p[3] * q[2] * by_second;
  }
  for (; i < n; ++i) {
    S p, q;
    tanh_parts(x[i], p, q);
    x[i] = p / q;
  }
}
template <class V, int N>
TILLER_INLINE void tanh_all(Dual<V, N>* x, int n) {
  V value[TILLER_MAX_NETWORK_WIDTH];
  for (int i = 0; i < n; ++i) value[i] = x[i].v;
  tanh_all(value, n);
  for (int i = 0; i < n; ++i) x[i] = Dual<V, N>::chain(value[i], V(1.0) - value[i] * value[i], x[i]);
}

/// out (rows) = bias + W in (columns); weights row by row, bias first. Four rows at a time, whose sums do not wait for
/// each other.
template <class S>
TILLER_INLINE void affine(const float* weights, const S* in, int columns, S* out, int rows) {
  const int stride = columns + 1;
  int r = 0;
  for (; r + 4 <= rows; r += 4, weights += 4 * stride) {
    S sum[4];
    for (int k = 0; k < 4; ++k) sum[k] = S(static_cast<double>(weights[k * stride]));
    for (int c = 0; c < columns; ++c)
      for (int k = 0; k < 4; ++k) sum[k] = add_weighted(sum[k], weights[k * stride + 1 + c], in[c]);
    for (int k = 0; k < 4; ++k) out[r + k] = sum[k];
  }
  for (; r < rows; ++r, weights += stride) {
    S sum = S(static_cast<double>(weights[0]));
    for (int c = 0; c < columns; ++c) sum = add_weighted(sum, weights[1 + c], in[c]);
    out[r] = sum;
  }
}

/// Member `member` of a tanh network at in (inputs): out (outputs). Cost: the number of its weights, and a tanh for
/// each hidden unit.
template <class S>
void evaluate_tanh(const tiller_network_t& n, std::uint32_t member, const S* in, S* out) {
  const float* weights = n.weights + member * (n.weight_count / n.members);
  S first[TILLER_MAX_NETWORK_WIDTH], second[TILLER_MAX_NETWORK_WIDTH];
  const S* from = in;
  int columns = static_cast<int>(n.inputs);
  S* const layers[2] = {first, second};
  for (int l = 0; l < 2 && n.hidden[l] > 0; ++l) {
    const int rows = static_cast<int>(n.hidden[l]);
    affine(weights, from, columns, layers[l], rows);
    tanh_all(layers[l], rows);
    weights += rows * (columns + 1);
    from = layers[l];
    columns = rows;
  }
  affine(weights, from, columns, out, static_cast<int>(n.outputs));
}

/// The same of a gaussian network. Cost: an exponential for each centre, a cosine for each wave, and their weights.
template <class S>
void evaluate_gaussian(const tiller_network_t& n, std::uint32_t member, const S* in, S* out) {
  const std::uint32_t features = n.hidden[0] + n.hidden[1], stride = 1 + features;
  const float* const inverse_width = n.weights;
  const float* centre = inverse_width + n.inputs;
  const float* wave = centre + n.hidden[0] * n.inputs;
  const float* weights = wave + n.hidden[1] * (1 + n.inputs) + member * n.outputs * stride;
  for (std::uint32_t o = 0; o < n.outputs; ++o) out[o] = S(static_cast<double>(weights[o * stride]));
  for (std::uint32_t f = 0; f < features; ++f) {
    S feature;
    if (f < n.hidden[0]) {
      S square = S(0.0);
      for (std::uint32_t i = 0; i < n.inputs; ++i) {
        const S d = S(static_cast<double>(inverse_width[i])) * (in[i] - S(static_cast<double>(centre[i])));
        square = square + d * d;
      }
      feature = exp(S(-0.5) * min(square, S(120.0)));
      centre += n.inputs;
    } else {
      S phase = S(static_cast<double>(wave[0])), sine;
      for (std::uint32_t i = 0; i < n.inputs; ++i) phase = add_weighted(phase, wave[1 + i], in[i]);
      sincos(phase, sine, feature);
      wave += 1 + n.inputs;
    }
    for (std::uint32_t o = 0; o < n.outputs; ++o) out[o] = add_weighted(out[o], weights[o * stride + 1 + f], feature);
  }
}

template <class S>
TILLER_INLINE void evaluate_member(const tiller_network_t& n, std::uint32_t member, const S* in, S* out) {
  if (n.kind == tiller_network_tanh)
    evaluate_tanh(n, member, in, out);
  else
    evaluate_gaussian(n, member, in, out);
}

/// out (outputs) of the member that each lane asks for: the whole part of `member`, cut to those that there are.
/// Members that no lane asks for cost nothing, so a register whose lanes agree costs one.
template <class S>
void evaluate_network(const tiller_network_t& n, const S& member, const S* in, S* out) {
  const auto& wanted = value_of(member);
  using V = std::decay_t<decltype(wanted)>;
  for (std::uint32_t o = 0; o < n.outputs; ++o) out[o] = S(0.0);
  for (std::uint32_t m = 0; m < n.members; ++m) {
    // the first takes what is below it, the last what is beyond
    const auto not_before = m == 0 ? wanted == wanted : !(wanted < V(static_cast<double>(m)));
    const auto mine =
        m + 1 == n.members ? not_before & (wanted == wanted) : not_before & (wanted < V(static_cast<double>(m + 1)));
    if (!any(mine)) continue;
    S own[TILLER_MAX_NETWORK_OUTPUTS];
    evaluate_member(n, m, in, own);
    for (std::uint32_t o = 0; o < n.outputs; ++o) out[o] = select(mine, own[o], out[o]);
  }
}

}  // namespace tiller
