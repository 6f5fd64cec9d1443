// crocoddyl and mim_solvers on the cart-pole of the comparisons. The action model is written in C++ with analytic
// derivatives and compiled against the headers and libraries in their Python wheels: a model in Python would measure
// Python. Compiled by planning.py; not part of the CMake build.
//
//   crocoddyl_peer               takes part in rounds (rounds.hpp)
//   crocoddyl_peer closed-loop   400 steps under |u| <= 20 for a grid of solvers and iterations, one JSON line each

#include <algorithm>
#include <crocoddyl/core/action-base.hpp>
#include <crocoddyl/core/optctrl/shooting.hpp>
#include <crocoddyl/core/solvers/box-ddp.hpp>
#include <crocoddyl/core/solvers/box-fddp.hpp>
#include <crocoddyl/core/solvers/ddp.hpp>
#include <crocoddyl/core/solvers/fddp.hpp>
#include <crocoddyl/core/states/euclidean.hpp>
#include <memory>
#include <mim_solvers/csqp.hpp>
#include <mim_solvers/sqp.hpp>

#include "bench/problems/cart_pole_problem.hpp"
#include "bench/table/rounds.hpp"

namespace {

using namespace tiller::bench;
using P = CartPoleProblem;
using Data = crocoddyl::ActionDataAbstract;
using Vector = Eigen::VectorXd;
using In = Eigen::Ref<const Vector>;

class CartPoleAction : public crocoddyl::ActionModelAbstract {
 public:
  /// `constrained`: the limits as inequality constraints, which is where mim_solvers looks for them.
  CartPoleAction(bool terminal, bool limited, bool constrained)
      : crocoddyl::ActionModelAbstract(std::make_shared<crocoddyl::StateVector>(4), 1, 0, constrained ? 1 : 0),
        terminal_(terminal),
        constrained_(constrained) {
    if (limited) {
      set_u_lb(Vector::Constant(1, -P::kInputLimit));
      set_u_ub(Vector::Constant(1, P::kInputLimit));
    }
    if (constrained) {
      set_g_lb(Vector::Constant(1, -P::kInputLimit));
      set_g_ub(Vector::Constant(1, P::kInputLimit));
    }
  }
  std::shared_ptr<Data> createData() override {
    auto data = std::make_shared<Data>(this);
    for (int i = 0; i < 4; ++i) data->Lxx(i, i) = (terminal_ ? P::kTerminalWeight : P::kStateWeight)[i];
    data->Luu(0, 0) = P::kInputWeight;
    if (constrained_) data->Gu(0, 0) = 1.0;
    return data;
  }
  // Casts to other scalars are asked of every model; no solver here uses them.
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsDouble() const override {
    return std::make_shared<CartPoleAction>(*this);
  }
  std::shared_ptr<crocoddyl::ActionModelBase> cloneAsFloat() const override { return nullptr; }
  void calc(const std::shared_ptr<Data>& data, const In& x, const In& u) override {
    problem_.step(x.data(), u[0], data->xnext.data());
    data->cost = P::stage(x.data(), u[0]);
    if (constrained_) data->g[0] = u[0];
  }
  void calc(const std::shared_ptr<Data>& data, const In& x) override { data->cost = P::terminal(x.data()); }
  void calcDiff(const std::shared_ptr<Data>& data, const In& x, const In& u) override {
    double next[4], fx[16];
    problem_.step(x.data(), u[0], next, fx, data->Fu.data());
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) data->Fx(r, c) = fx[4 * r + c];
    for (int i = 0; i < 4; ++i) data->Lx[i] = P::kStateWeight[i] * x[i];
    data->Lu[0] = P::kInputWeight * u[0];
  }
  void calcDiff(const std::shared_ptr<Data>& data, const In& x) override {
    for (int i = 0; i < 4; ++i) data->Lx[i] = P::kTerminalWeight[i] * x[i];
  }

 private:
  P problem_;
  bool terminal_, constrained_;
};

std::shared_ptr<crocoddyl::ShootingProblem> make_problem(bool limited, bool constrained, int horizon = 50) {
  const Vector x0 = Eigen::Map<const Vector>(P::kStart, 4);
  std::vector<std::shared_ptr<crocoddyl::ActionModelAbstract>> running(
      static_cast<std::size_t>(horizon), std::make_shared<CartPoleAction>(false, limited, constrained));
  auto problem =
      std::make_shared<crocoddyl::ShootingProblem>(x0, running, std::make_shared<CartPoleAction>(true, false, false));
  problem->set_nthreads(1);
  return problem;
}

template <class Solver>
double reached(const Solver& solver) {
  std::vector<double> u;
  for (const Vector& v : solver.get_us()) {
    if (std::abs(v[0]) > 1e3 || !std::isfinite(v[0])) return INFINITY;
    u.push_back(v[0]);
  }
  return sequence_cost(u.data(), static_cast<int>(u.size()));
}
template <class Solver>
double largest(const Solver& solver) {
  double most = 0.0;
  for (const Vector& v : solver.get_us()) most = std::max(most, std::abs(v[0]));
  return most;
}

/// From a cold start: x0 all along, no inputs.
template <class Solver>
struct Cold {
  std::shared_ptr<crocoddyl::ShootingProblem> problem;
  std::shared_ptr<Solver> solver;
  std::vector<Vector> xs, us;
  std::size_t iterations = 0;

  explicit Cold(const std::shared_ptr<crocoddyl::ShootingProblem>& p)
      : problem(p),
        solver(std::make_shared<Solver>(p)),
        xs(p->get_T() + 1, p->get_x0()),
        us(p->get_T(), Vector::Zero(1)) {}
  void solve(std::size_t most) { solver->solve(xs, us, most, false); }
};

constexpr std::size_t kMostIterations = 200;

/// Adds the solve to within 1e-3 of the optimum, with the fewest iterations that reach it, and its share an iteration.
template <class Solver>
void add(std::vector<Contender>& all, const std::string& name, bool limited, bool constrained, double optimum,
         const std::function<void(Solver&)>& configure = nullptr) {
  auto cold = std::make_shared<Cold<Solver>>(make_problem(limited, constrained));
  if (configure) configure(*cold->solver);
  double figure = INFINITY;
  for (std::size_t n = 1; n <= kMostIterations; ++n) {
    cold->solve(n);
    figure = reached(*cold->solver);
    cold->iterations = n;
    const bool within = optimum != kOptimumBox50 || largest(*cold->solver) <= P::kInputLimit * 1.0001;
    if (std::abs(figure - optimum) <= 1e-3 * optimum && within) break;
    if (cold->solver->get_iter() + 2 < n) break;  // it has stopped on its own account
  }
  char facts[200];
  std::snprintf(facts, sizeof facts,
                "\"figure\": %.6g, \"optimum\": %.6g, \"iterations\": %zu, \"largest_input\": %.4f",
                std::isfinite(figure) ? figure : -1.0, optimum, cold->iterations, largest(*cold->solver));
  all.push_back({name, [cold] { cold->solve(cold->iterations); }, facts, 1.0});
  all.push_back({name + "/iteration", all.back().call, facts, static_cast<double>(cold->iterations)});
}

/// 400 steps with the exact model in the loop: the plan shifted by one step warms every solve.
template <class Solver>
void closed_loop(const char* name, bool constrained, std::size_t iterations,
                 const std::function<void(Solver&)>& configure = nullptr) {
  auto problem = make_problem(true, constrained);
  Solver solver(problem);
  if (configure) configure(solver);
  std::vector<Vector> xs(51, problem->get_x0()), us(50, Vector::Zero(1));
  double x[4], next[4];
  Motion motion;
  std::copy(P::kStart, P::kStart + 4, x);
  std::vector<double> spent;
  for (int k = 0; k < 400; ++k) {
    const double begin = cpu_seconds();
    problem->set_x0(Eigen::Map<const Vector>(x, 4));
    xs[0] = problem->get_x0();
    solver.solve(xs, us, iterations, false);
    const double u = std::clamp(solver.get_us()[0][0], -P::kInputLimit, P::kInputLimit);
    std::rotate_copy(solver.get_us().begin(), solver.get_us().begin() + 1, solver.get_us().end(), us.begin());
    std::rotate_copy(solver.get_xs().begin(), solver.get_xs().begin() + 1, solver.get_xs().end(), xs.begin());
    us.back() = us[us.size() - 2];
    xs.back() = xs[xs.size() - 2];
    spent.push_back(cpu_seconds() - begin);
    motion.add(x, u);
    P{}.step(x, u, next);
    std::copy(next, next + 4, x);
  }
  std::nth_element(spent.begin(), spent.begin() + 200, spent.end());
  std::printf("{\"planner\": \"%s\", \"settings\": \"%zu it\", \"cost\": %.6g, \"us\": %.4g}\n", name, iterations,
              motion.cost(), 1e6 * spent[200]);
  std::fflush(stdout);
}

void quiet_sqp(mim_solvers::SolverSQP& s) { s.set_termination_tolerance(1e-9); }
void quiet_csqp(mim_solvers::SolverCSQP& s) {
  s.set_termination_tolerance(1e-9);
  s.set_max_qp_iters(200);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && !std::strcmp(argv[1], "closed-loop")) {
    for (int repeat = 0; repeat < 3; ++repeat)
      for (const std::size_t n : {1, 2, 3, 5, 10, 20}) {
        closed_loop<crocoddyl::SolverBoxDDP>("crocoddyl BoxDDP", false, n);
        closed_loop<crocoddyl::SolverBoxFDDP>("crocoddyl BoxFDDP", false, n);
        if (n <= 5) closed_loop<mim_solvers::SolverCSQP>("mim_solvers CSQP", true, n, quiet_csqp);
      }
    return 0;
  }
  std::vector<Contender> all;
  add<crocoddyl::SolverDDP>(all, "crocoddyl DDP free", false, false, kOptimumFree50);
  add<crocoddyl::SolverFDDP>(all, "crocoddyl FDDP free", false, false, kOptimumFree50);
  add<mim_solvers::SolverSQP>(all, "mim_solvers SQP free", false, false, kOptimumFree50, quiet_sqp);
  add<crocoddyl::SolverBoxDDP>(all, "crocoddyl BoxDDP box", true, false, kOptimumBox50);
  add<crocoddyl::SolverBoxFDDP>(all, "crocoddyl BoxFDDP box", true, false, kOptimumBox50);
  add<mim_solvers::SolverCSQP>(all, "mim_solvers CSQP box", true, true, kOptimumBox50, quiet_csqp);
  return take_part(all);
}
