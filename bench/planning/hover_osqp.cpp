#include <set>

#include "bench/planning/hover_programs.hpp"
#include "planners/qp/osqp_pattern.hpp"

namespace tiller::bench {
namespace {

/// Order of least degree for the pattern, as a sparse solver would choose it.
std::vector<std::int32_t> least_degree_order(const OsqpShape& shape) {
  const OsqpColumns columns(shape);
  const int n = columns.variables(), m = columns.rows();
  std::vector<std::set<int>> near(static_cast<std::size_t>(n + m));
  const auto join = [&](int i, int j) {
    if (i == j) return;
    near[static_cast<std::size_t>(i)].insert(j);
    near[static_cast<std::size_t>(j)].insert(i);
  };
  int column = 0;
  columns.objective(
      nullptr, [&](int row, double) { join(row, column); }, [&] { ++column; });
  column = 0;
  columns.constraints(
      nullptr, [&](int row, double) { join(n + row, column); }, [&] { ++column; });
  std::vector<std::int32_t> order;
  std::vector<bool> gone(near.size());
  for (int step = 0; step < n + m; ++step) {
    int best = -1;
    for (int i = 0; i < n + m; ++i)
      if (!gone[static_cast<std::size_t>(i)] &&
          (best < 0 || near[static_cast<std::size_t>(i)].size() < near[static_cast<std::size_t>(best)].size()))
        best = i;
    const std::set<int> left = near[static_cast<std::size_t>(best)];
    for (const int i : left) {
      near[static_cast<std::size_t>(i)].erase(best);
      for (const int j : left) join(i, j);
    }
    gone[static_cast<std::size_t>(best)] = true;
    order.push_back(best);
  }
  return order;
}

}  // namespace

OsqpQp lay_out_sparse(const Hover& hover, Block& block) {
  const auto nonzero = [](const std::vector<double>& values, int count) {
    std::vector<std::uint8_t> mask;
    for (int i = 0; i < count; ++i) mask.push_back(values[static_cast<std::size_t>(i)] != 0.0);
    return mask;
  };
  const std::vector<std::uint8_t> bounded(Hover::kStates, 1), pa = nonzero(hover.a, Hover::kStates * Hover::kStates),
                                                              pb = nonzero(hover.b, Hover::kStates * Hover::kInputs),
                                                              pq = nonzero(hover.qxx, Hover::kStates * Hover::kStates),
                                                              pu = nonzero(hover.quu, Hover::kInputs * Hover::kInputs);
  OsqpShape shape;
  shape.sizes = hover.qp.lq;
  shape.bounded = bounded.data();
  shape.a = pa.data();
  shape.b = pb.data();
  shape.qxx = pq.data();
  shape.quu = pu.data();
  shape.tolerance = 1e-5;
  const std::vector<std::int32_t> order = least_degree_order(shape);
  shape.order = order.data();
  return block.make([&](Arena& arena) { return lay_out_osqp(arena, shape); });
}

}  // namespace tiller::bench
