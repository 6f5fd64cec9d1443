#pragma once

// The hover QP of the comparisons, read from the file that hover_problem.py writes.

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

namespace tiller::bench {

struct HoverQp {
  static constexpr double kRho = 5.0;  // TinyMPC's penalty, which its terminal cost depends on: hover_problem.RHO
  int horizon = 0, count = 0, with_input_bound = 0, with_state_bound = 0;
  double u_max = 0.0, x_max = 0.0;
  std::vector<double> a, b, q, r, qf, states, u0;  // row-major; (count x 12), (count x 4)

  explicit HoverQp(const char* path) {
    std::ifstream file(path);
    if (!(file >> horizon >> u_max >> x_max >> count >> with_input_bound >> with_state_bound)) {
      std::fprintf(stderr, "%s: not a hover QP\n", path);
      std::exit(2);
    }
    const std::size_t n = static_cast<std::size_t>(count);
    a = read(file, 144), b = read(file, 48), q = read(file, 144), r = read(file, 16), qf = read(file, 144);
    states = read(file, 12 * n), u0 = read(file, 4 * n);
  }
  const double* state(int i) const { return states.data() + 12 * i; }

 private:
  static std::vector<double> read(std::ifstream& file, std::size_t n) {
    std::vector<double> v(n);
    for (double& x : v)
      if (!(file >> x)) std::exit(2);
    return v;
  }
};

}  // namespace tiller::bench
