// Once per instruction set.

#include "planners/qp/dual_rows.hpp"

#include <cmath>

#include "rollout/lq_row.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace {

template <int w>
TILLER_INLINE void combine_piece(const double* base, const double* const* column, const double* share,
                                 std::size_t count, std::size_t at, double* out) {
  lq::Row<w> even = base ? lq::Row<w>::load(base + at) : lq::Row<w>::zero(), odd = lq::Row<w>::zero();
  std::size_t j = 0;
  for (; j + 1 < count; j += 2) {
    even.add(share[j], lq::Row<w>::load(column[j] + at));
    odd.add(share[j + 1], lq::Row<w>::load(column[j + 1] + at));
  }
  if (j < count) even.add(share[j], lq::Row<w>::load(column[j] + at));
  even.add(odd);
  even.store(out + at);
}

void combine(const double* base, const double* const* column, const double* share, std::size_t count,
             std::size_t length, double* out) {
  std::size_t at = 0;
  for (; at + 32 <= length; at += 32) combine_piece<32>(base, column, share, count, at, out);
  for (; at + 8 <= length; at += 8) combine_piece<8>(base, column, share, count, at, out);
  for (; at < length; ++at) combine_piece<1>(base, column, share, count, at, out);
}

double excess(double v, double low, double high) { return v - high > low - v ? v - high : low - v; }

double worst(const double* v, const double* low, const double* high, std::size_t length, std::size_t* at) {
  constexpr int kWide = lq::kWidestPiece;
  using Pack = lq::Row<kWide>;
  Pack most = Pack::zero(), broken = Pack::zero();
  std::size_t i = 0;
  for (; i + kWide <= length; i += kWide) {
    const Pack x = Pack::load(v + i), l = Pack::load(low + i), h = Pack::load(high + i);
    const Pack::Vector over = x.v - h.v, under = l.v - x.v, larger = over > under ? over : under;
    most.v = larger > most.v ? larger : most.v;
    broken.v += 0.0 * x.v;
  }
  double lane[kWide], wrong[kWide], largest = 0.0, sum = 0.0;
  most.store(lane);
  broken.store(wrong);
  for (int j = 0; j < kWide; ++j) {
    largest = lane[j] > largest ? lane[j] : largest;
    sum += wrong[j];
  }
  for (std::size_t rest = i; rest < length; ++rest) {
    const double e = excess(v[rest], low[rest], high[rest]);
    largest = e > largest ? e : largest;
    sum += 0.0 * v[rest];
  }
  if (sum != 0.0) return NAN;
  *at = 0;
  if (!(largest > 0.0)) return 0.0;
  while (!(excess(v[*at], low[*at], high[*at]) >= largest)) ++*at;
  return largest;
}

}  // namespace

extern const DualRows kDualRows;
const DualRows kDualRows = {&combine, &worst};

TILLER_ISA_NAMESPACE_END
