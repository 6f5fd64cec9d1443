#pragma once

#include <cstdint>
#include <vector>

#include "planners/qp/osqp_qp.hpp"

namespace tiller::bench {

/// A quadrotor at hover, from random states: the matrices of OSQP's model predictive control example.
struct Hover {
  static constexpr int kStates = 12, kInputs = 4, kHorizon = 10, kStarts = 200;
  std::vector<double> a, b, qxx, quu, qx, qu, low, high, state_low, state_high, start;
  std::vector<std::vector<double>> starts;
  Qp qp;  // points into the vectors

  Hover();
  Hover(const Hover&) = delete;
  Hover& operator=(const Hover&) = delete;
  void set_start(int i) { start = starts[static_cast<std::size_t>(i)], qp.start = start.data(); }

 private:
  void fill();
  void draw_starts();
  void point();
};

/// Memory of a solver, for as long as the benchmark lives.
struct Block {
  std::vector<unsigned char> bytes;
  template <class LayOut>
  auto make(LayOut lay_out) {
    Arena measure;
    lay_out(measure);
    bytes.assign(measure.used() + 64, 0);
    const std::size_t off = 64 - reinterpret_cast<std::uintptr_t>(bytes.data()) % 64;
    Arena arena(bytes.data() + off % 64, measure.used());
    return lay_out(arena);
  }
};

/// OSQP with the pattern of the matrices' nonzero entries.
OsqpQp lay_out_sparse(const Hover& hover, Block& block);

}  // namespace tiller::bench
