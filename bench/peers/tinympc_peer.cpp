// TinyMPC on the hover QP: compiled from the sources that its Python package carries for generated code. A solve of
// the package says so on std::cout every time; the stream is switched off.
//
//   tinympc_peer hover.txt

#include <tinympc/tiny_api.hpp>

#include <memory>

#include "bench/problems/hover_qp.hpp"
#include "bench/table/rounds.hpp"

namespace {

using namespace tiller::bench;

// Of the first input; its terminal cost comes from a Riccati iteration stopped early, and nothing below is reached.
constexpr double kReached = 3e-4;

struct Tiny {
  const HoverQp& qp;
  TinySolver* solver = nullptr;
  std::vector<tinyVector> starts;
  double worst = 0.0;
  int unsolved = 0;

  Tiny(const HoverQp& q, double tolerance, int most) : qp(q) {
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const tinyMatrix a = Eigen::Map<const Rows>(qp.a.data(), 12, 12), b = Eigen::Map<const Rows>(qp.b.data(), 12, 4);
    // Its setup adds rho to the weights twice, its penalty takes it off once: less rho here, it solves the QP as given.
    const tinyMatrix cost = Eigen::Map<const Rows>(qp.q.data(), 12, 12) - HoverQp::kRho * tinyMatrix::Identity(12, 12);
    const tinyMatrix input = Eigen::Map<const Rows>(qp.r.data(), 4, 4) - HoverQp::kRho * tinyMatrix::Identity(4, 4);
    const int knots = qp.horizon + 1;
    tiny_setup(&solver, a, b, cost, input, HoverQp::kRho, 12, 4, knots, tinyMatrix::Constant(12, knots, -qp.x_max),
               tinyMatrix::Constant(12, knots, qp.x_max), tinyMatrix::Constant(4, knots - 1, -qp.u_max),
               tinyMatrix::Constant(4, knots - 1, qp.u_max), 0);
    tiny_update_settings(solver->settings, tolerance, tolerance, most, 1, 1, 1);
    for (int i = 0; i < qp.count; ++i) starts.push_back(Eigen::Map<const tinyVector>(qp.state(i), 12));
    for (int i = 0; i < qp.count; ++i) {
      solve(i);
      unsolved += !solver->solution->solved;
      for (int j = 0; j < 4; ++j)
        worst = std::max(worst, std::abs(solver->solution->u(j, 0) - qp.u0[static_cast<std::size_t>(4 * i + j)]));
    }
  }
  void solve(int i) {
    tiny_set_x0(solver, starts[static_cast<std::size_t>(i)]);
    tiny_solve(solver);
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  std::cout.setstate(std::ios::failbit);
  const HoverQp qp(argv[1]);
  std::vector<Contender> all;
  const auto add = [&](const char* name, const std::shared_ptr<Tiny>& tiny, double tolerance, int most) {
    char facts[160];
    std::snprintf(facts, sizeof facts, "\"error\": %.3g, \"unsolved\": %d, \"of\": %d, \"tolerance\": %g, \"cap\": %d",
                  tiny->worst, tiny->unsolved, qp.count, tolerance, most);
    all.push_back({name,
                   [tiny, &qp] {
                     for (int i = 0; i < qp.count; ++i) tiny->solve(i);
                   },
                   facts, static_cast<double>(qp.count)});
  };
  std::shared_ptr<Tiny> tiny;
  double tolerance = 1e-3;
  int most = 100;
  add("TinyMPC hover, 1e-3", std::make_shared<Tiny>(qp, tolerance, most), tolerance, most);
  for (; tolerance > 1e-8; tolerance *= 0.1) {
    most = 20000;
    tiny = std::make_shared<Tiny>(qp, tolerance, most);
    if (tiny->worst <= kReached && tiny->unsolved == 0) break;
  }
  add("TinyMPC hover", tiny, tolerance, most);
  return take_part(all);
}
