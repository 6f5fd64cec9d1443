#pragma once

// A row of n doubles in registers, n known: the arithmetic of small matrices, row by row. Cut into pieces of
// 8, 4, 2 and 1, no wider than the registers.

#include <cstring>

#include "rollout/model_adapter.hpp"
#include "scalar/isa.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace lq {

/// Wider than its registers GCC takes a vector through the stack, entry by entry.
#if defined(__AVX512F__)
constexpr int kWidestPiece = 8;
#elif defined(__AVX__)
constexpr int kWidestPiece = 4;
#else
constexpr int kWidestPiece = 2;
#endif
constexpr int piece_of(int n) {
  int piece = kWidestPiece;
  while (piece > n) piece /= 2;
  return piece;
}

template <int n, bool kOnePiece = piece_of(n) == n>
struct Row;

template <>
struct Row<1, true> {
  double v;
  static TILLER_INLINE Row load(const double* p) { return {*p}; }
  TILLER_INLINE void store(double* p) const { *p = v; }
  static TILLER_INLINE Row zero() { return {0.0}; }
  TILLER_INLINE void add(double s, const Row& r) { v += s * r.v; }
  TILLER_INLINE void add(const Row& r) { v += r.v; }
};

template <int n>
struct Row<n, true> {
  typedef double Vector __attribute__((vector_size(n * sizeof(double))));
  Vector v;
  static TILLER_INLINE Row load(const double* p) {
    Row r;
    std::memcpy(&r.v, p, sizeof r.v);
    return r;
  }
  TILLER_INLINE void store(double* p) const { std::memcpy(p, &v, sizeof v); }
  static TILLER_INLINE Row zero() {
    Row r;
    r.v = Vector{};
    return r;
  }
  /// this += s r
  TILLER_INLINE void add(double s, const Row& r) { v += s * r.v; }
  TILLER_INLINE void add(const Row& r) { v += r.v; }
};

template <int n>
struct Row<n, false> {
  static constexpr int kFirst = piece_of(n);
  Row<kFirst> first;
  Row<n - kFirst> rest;
  static TILLER_INLINE Row load(const double* p) { return {Row<kFirst>::load(p), Row<n - kFirst>::load(p + kFirst)}; }
  TILLER_INLINE void store(double* p) const {
    first.store(p);
    rest.store(p + kFirst);
  }
  static TILLER_INLINE Row zero() { return {Row<kFirst>::zero(), Row<n - kFirst>::zero()}; }
  TILLER_INLINE void add(double s, const Row& r) {
    first.add(s, r.first);
    rest.add(s, r.rest);
  }
  TILLER_INLINE void add(const Row& r) {
    first.add(r.first);
    rest.add(r.rest);
  }
};

/// sum_k s[k * stride] rows[k], n terms, two chains: half the latency.
template <int n, int w>
TILLER_INLINE Row<w> combine(const double* s, int stride, const Row<w>* rows) {
  Row<w> even = Row<w>::zero(), odd = Row<w>::zero();
#pragma GCC unroll 16
  for (int k = 0; k < n; ++k) (k % 2 ? odd : even).add(s[k * stride], rows[k]);
  if (n > 1) even.add(odd);
  return even;
}

}  // namespace lq

TILLER_ISA_NAMESPACE_END
