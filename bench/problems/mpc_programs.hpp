#pragma once

// Model predictive control of random linear systems, in sizes, as every QP solver gets it: read from the file that
// bench_qp_sizes writes.
//
//     minimise  1/2 sum_{k<N} (x'Qx + u'Ru) + 1/2 x_N' Qf x_N
//     subject to  x_{k+1} = A x_k + B u_k,  |u| <= u_max,  |x_i| <= x_max_i for k >= 1 (infinite for half of them)

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

namespace tiller::bench {

/// States to solve for, in their order, and the first inputs of tight solutions (none where there is no solution).
struct MpcCase {
  std::string name;
  int count = 0;
  std::vector<double> states, u0;  // (count x n), (count x m)
};

struct MpcPrograms {
  int n = 0, m = 0, horizon = 0;
  double u_max = 1.0;
  std::vector<double> a, b, q, r, qf, x_max;  // row-major
  std::vector<MpcCase> cases;

  MpcPrograms() = default;
  explicit MpcPrograms(const char* path) {
    std::ifstream file(path);
    if (!(file >> n >> m >> horizon >> u_max)) fail(path);
    const std::size_t s = size(n), i = size(m);
    a = read(file, s * s), b = read(file, s * i), q = read(file, s * s), r = read(file, i * i);
    qf = read(file, s * s), x_max = read(file, s);
    MpcCase c;
    while (file >> c.name >> c.count) {
      c.states = read(file, size(c.count) * s), c.u0 = read(file, size(c.count) * i);
      cases.push_back(c);
    }
    for (double& v : x_max)
      if (v >= 1e29) v = INFINITY;
  }
  void write(const char* path) const {
    std::FILE* out = std::fopen(path, "w");
    if (!out) fail(path);
    std::fprintf(out, "%d %d %d %.17g\n", n, m, horizon, u_max);
    for (const auto* v : {&a, &b, &q, &r, &qf, &x_max}) put(out, *v);
    for (const MpcCase& c : cases) {
      std::fprintf(out, "%s %d\n", c.name.c_str(), c.count);
      put(out, c.states);
      put(out, c.u0);
    }
    std::fclose(out);
  }
  const MpcCase& of(const char* name) const {
    for (const MpcCase& c : cases)
      if (c.name == name) return c;
    fail(name);
  }

 private:
  static std::size_t size(int v) { return static_cast<std::size_t>(v); }
  [[noreturn]] static void fail(const char* what) {
    std::fprintf(stderr, "%s: no MPC programs (bench_qp_sizes write N_STATES N_INPUTS HORIZON FILE makes them)\n",
                 what);
    std::exit(2);
  }
  static std::vector<double> read(std::ifstream& file, std::size_t count) {
    std::vector<double> v(count);
    for (double& x : v)
      if (!(file >> x)) std::exit(2);
    return v;
  }
  static void put(std::FILE* out, const std::vector<double>& v) {
    for (const double x : v) std::fprintf(out, "%.17g ", x < 1e30 ? x : 1e30);
    std::fprintf(out, "\n");
  }
};

}  // namespace tiller::bench
