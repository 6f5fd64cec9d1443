#pragma once

// Products of small matrices whose sizes only run time knows, in tiles that stay in registers: four rows by two pieces
// of columns. A row's last piece and a matrix's last rows reach back over those before instead of being cut smaller.
// What is reached twice is computed twice, to the same bits: results never lie where summands are read.

#include "rollout/lq_row.hpp"

TILLER_ISA_NAMESPACE_BEGIN

namespace lq {

/// sum_k s[r down + k along] rows[k pitch + c], of row r and column c.
struct Product {
  const double* s;
  std::size_t down, along;
  const double* rows;
  std::size_t pitch;
  int terms;
};

constexpr int kTileRows = 4;

/// out = start + the products' sum, rows r to r + kRows, columns from column[0] and column[1]. start: null for zeros.
template <int kRows, int kPieces, int w>
TILLER_INLINE void tile(const Product* products, int count, int r, const int* column, const double* start,
                        std::size_t start_pitch, double* out, std::size_t out_pitch) {
  Row<w> sum[kRows][kPieces];
#pragma GCC unroll 4
  for (int i = 0; i < kRows; ++i)
#pragma GCC unroll 2
    for (int c = 0; c < kPieces; ++c)
      sum[i][c] =
          start ? Row<w>::load(start + static_cast<std::size_t>(r + i) * start_pitch + column[c]) : Row<w>::zero();
  for (int p = 0; p < count; ++p) {
    const Product& of = products[p];
    const double *s = of.s + static_cast<std::size_t>(r) * of.down, *rows = of.rows;
    for (int k = 0; k < of.terms; ++k, s += of.along, rows += of.pitch) {
      Row<w> row[kPieces];
#pragma GCC unroll 2
      for (int c = 0; c < kPieces; ++c) row[c] = Row<w>::load(rows + column[c]);
#pragma GCC unroll 4
      for (int i = 0; i < kRows; ++i)
#pragma GCC unroll 2
        for (int c = 0; c < kPieces; ++c) sum[i][c].add(s[static_cast<std::size_t>(i) * of.down], row[c]);
    }
  }
#pragma GCC unroll 4
  for (int i = 0; i < kRows; ++i)
#pragma GCC unroll 2
    for (int c = 0; c < kPieces; ++c) sum[i][c].store(out + static_cast<std::size_t>(r + i) * out_pitch + column[c]);
}

/// visit(pieces, columns) for the columns from..width, which are w at least.
template <int w, class Visit>
TILLER_INLINE void for_columns(int from, int width, const Visit& visit) {
  for (int at = from; at < width; at += 2 * w) {
    const int last = width - w;
    const int column[2] = {at < last ? at : last, at + w < last ? at + w : last};
    if (at + w < width)
      visit(Index<2>{}, column);
    else
      visit(Index<1>{}, column);
  }
}

/// Rows first..last of the products' sum, columns from..width.
template <int w>
__attribute__((noinline)) void tiles(const Product* products, int count, int first, int last, int from, int width,
                                     const double* start, std::size_t start_pitch, double* out, std::size_t out_pitch) {
  for_columns<w>(from, width, [&](auto pieces, const int* column) {
    constexpr int kPieces = decltype(pieces)::value;
    if (last - first < kTileRows) {
      for (int r = first; r < last; ++r)
        tile<1, kPieces, w>(products, count, r, column, start, start_pitch, out, out_pitch);
      return;
    }
    for (int r = first; r < last; r += kTileRows)
      tile<kTileRows, kPieces, w>(products, count, r + kTileRows < last ? r : last - kTileRows, column, start,
                                  start_pitch, out, out_pitch);
  });
}

/// The same for any width, from column 0 where it is narrow.
TILLER_INLINE void multiply(const Product* products, int count, int first, int last, int from, int width,
                            const double* start, std::size_t start_pitch, double* out, std::size_t out_pitch) {
  constexpr int w = kWidestPiece;
  if (width >= w) return tiles<w>(products, count, first, last, from, width, start, start_pitch, out, out_pitch);
  if constexpr (w > 4)
    if (width >= 4) return tiles<4>(products, count, first, last, 0, width, start, start_pitch, out, out_pitch);
  tiles<1>(products, count, first, last, 0, width, start, start_pitch, out, out_pitch);
}

/// Columns of out (m rows) = -(L L')^-1 in, but zero in rows that are held; L's diagonal is inverted.
template <int kPieces, int w>
TILLER_INLINE void solve_tile(int m, const std::int8_t* held, const double* l, const int* column, std::size_t pitch,
                              const double* in, double* out) {
  const auto pass = [&](int i, const double* from, int k, int end, const double* factor, std::size_t stride,
                        double sign) TILLER_INLINED {
    Row<w> sum[kPieces];
#pragma GCC unroll 2
    for (int c = 0; c < kPieces; ++c)
      sum[c] = from ? Row<w>::load(from + static_cast<std::size_t>(i) * pitch + column[c]) : Row<w>::zero();
    for (; k < end; ++k)
#pragma GCC unroll 2
      for (int c = 0; c < kPieces; ++c)
        sum[c].add(sign * factor[static_cast<std::size_t>(k) * stride],
                   Row<w>::load(out + static_cast<std::size_t>(k) * pitch + column[c]));
#pragma GCC unroll 2
    for (int c = 0; c < kPieces; ++c) {
      Row<w> scaled = Row<w>::zero();
      scaled.add(-sign * l[i * m + i], sum[c]);
      scaled.store(out + static_cast<std::size_t>(i) * pitch + column[c]);
    }
  };
  for (int i = 0; i < m; ++i) pass(i, held && held[i] ? nullptr : in, 0, i, l + i * m, 1, -1.0);
  // what is stored now has the other sign
  for (int i = m - 1; i >= 0; --i) pass(i, out, i + 1, m, l + i, static_cast<std::size_t>(m), 1.0);
}
template <int w>
__attribute__((noinline)) void solve_tiles(int m, int width, const std::int8_t* held, const double* l, const double* in,
                                           double* out) {
  for_columns<w>(0, width, [&](auto pieces, const int* column) {
    solve_tile<decltype(pieces)::value, w>(m, held, l, column, static_cast<std::size_t>(width), in, out);
  });
}

}  // namespace lq

TILLER_ISA_NAMESPACE_END
