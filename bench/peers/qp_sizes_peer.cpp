// The peers' side of ./dev bench qp, the table of sizes, each through its C or C++ interface: HPIPM (as acados ships
// it, BLASFEO for Haswell), DAQP, qpOASES, OSQP, PIQP, ProxQP. Of a program that repeats the start alone changes, and
// every solver is told no more than that; `cold` is all of it anew, condensing and set-up included.
//
//   qp_sizes_peer FILE CASE

#include <blasfeo_common.h>
#include <blasfeo_target.h>
#include <hpipm_d_ocp_qp.h>
#include <hpipm_d_ocp_qp_dim.h>
#include <hpipm_d_ocp_qp_ipm.h>
#include <hpipm_d_ocp_qp_sol.h>

#include <osqp/osqp.h>
#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <memory>
#include <piqp/piqp.hpp>
#include <proxsuite/proxqp/sparse/sparse.hpp>
#include <qpOASES.hpp>

#include "api.h"
#include "bench/problems/mpc_programs.hpp"
#include "bench/table/rounds.hpp"
#include "utils.h"

namespace {

using namespace tiller::bench;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::VectorXd;
using Sparse = Eigen::SparseMatrix<double>;
using Eigen::Map;

constexpr double kTolerance = 1e-8;
constexpr double kMostSeconds = 1.0;                     // for a case: beyond, a solver is left out
constexpr int kMostDenseCold = 400, kMostQpOases = 400;  // inputs over the horizon: beyond, a solve takes seconds

enum class Outcome { solved, infeasible, failed };

struct Peer {
  const MpcPrograms& p;
  int n, m, N;
  RowMajor a, b, q, r, qf;
  std::vector<int> bounded;  // states with bounds

  explicit Peer(const MpcPrograms& programs) : p(programs), n(p.n), m(p.m), N(p.horizon) {
    a = Map<const RowMajor>(p.a.data(), n, n), b = Map<const RowMajor>(p.b.data(), n, m);
    q = Map<const RowMajor>(p.q.data(), n, n), r = Map<const RowMajor>(p.r.data(), m, m);
    qf = Map<const RowMajor>(p.qf.data(), n, n);
    for (int i = 0; i < n; ++i)
      if (std::isfinite(p.x_max[static_cast<std::size_t>(i)])) bounded.push_back(i);
  }
  virtual ~Peer() = default;
  double x_max(int i) const { return p.x_max[static_cast<std::size_t>(i)]; }
  virtual void set_up() = 0;                       // the matrices
  virtual Outcome solve(const double* start) = 0;  // from this start, warm where it can
  virtual void first_input(double* u) const = 0;
};

// ---- HPIPM: x_0 eliminated -------------------------------------------------------------------------

struct Hpipm final : Peer {
  std::vector<std::unique_ptr<char[]>> memory;
  d_ocp_qp_dim dim;
  d_ocp_qp qp;
  d_ocp_qp_sol sol;
  d_ocp_qp_ipm_arg arg;
  d_ocp_qp_ipm_ws ws;

  explicit Hpipm(const MpcPrograms& programs, hpipm_mode mode) : Peer(programs) {
    const auto take = [&](std::size_t size) {
      memory.emplace_back(new char[size + 64]);
      return memory.back().get();
    };
    d_ocp_qp_dim_create(N, &dim, take(d_ocp_qp_dim_memsize(N)));
    for (int k = 0; k <= N; ++k) {
      d_ocp_qp_dim_set_nx(k, k == 0 ? 0 : n, &dim);
      d_ocp_qp_dim_set_nu(k, k == N ? 0 : m, &dim);
      d_ocp_qp_dim_set_nbx(k, k == 0 ? 0 : static_cast<int>(bounded.size()), &dim);
      d_ocp_qp_dim_set_nbu(k, k == N ? 0 : m, &dim);
    }
    d_ocp_qp_create(&dim, &qp, take(d_ocp_qp_memsize(&dim)));
    d_ocp_qp_sol_create(&dim, &sol, take(d_ocp_qp_sol_memsize(&dim)));
    d_ocp_qp_ipm_arg_create(&dim, &arg, take(d_ocp_qp_ipm_arg_memsize(&dim)));
    d_ocp_qp_ipm_arg_set_default(mode, &arg);
    double tolerance = kTolerance;
    int most = 200;
    d_ocp_qp_ipm_arg_set_tol_stat(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_eq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_ineq(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_tol_comp(&tolerance, &arg);
    d_ocp_qp_ipm_arg_set_iter_max(&most, &arg);
    d_ocp_qp_ipm_ws_create(&dim, &arg, &ws, take(d_ocp_qp_ipm_ws_memsize(&dim, &arg)));
    inputs.resize(static_cast<std::size_t>(m));
    for (int i = 0; i < m; ++i) inputs[static_cast<std::size_t>(i)] = i;
  }
  std::vector<int> inputs;
  void set_up() override {
    Eigen::MatrixXd ac = a, bc = b, qc = q, rc = r, fc = qf;  // column-major
    Vector zero_x = Vector::Zero(n), zero_u = Vector::Zero(m), u = Vector::Constant(m, p.u_max), ul = -u;
    Vector x(bounded.size());
    for (std::size_t i = 0; i < bounded.size(); ++i) x[static_cast<long>(i)] = x_max(bounded[i]);
    Vector xl = -x;
    for (int k = 0; k < N; ++k) {
      if (k > 0) d_ocp_qp_set_A(k, ac.data(), &qp);
      d_ocp_qp_set_B(k, bc.data(), &qp);
      d_ocp_qp_set_b(k, zero_x.data(), &qp);
      d_ocp_qp_set_R(k, rc.data(), &qp);
      d_ocp_qp_set_r(k, zero_u.data(), &qp);
      d_ocp_qp_set_idxbu(k, inputs.data(), &qp);
      d_ocp_qp_set_lbu(k, ul.data(), &qp);
      d_ocp_qp_set_ubu(k, u.data(), &qp);
    }
    for (int k = 1; k <= N; ++k) {
      d_ocp_qp_set_Q(k, k < N ? qc.data() : fc.data(), &qp);
      d_ocp_qp_set_q(k, zero_x.data(), &qp);
      d_ocp_qp_set_idxbx(k, bounded.data(), &qp);
      d_ocp_qp_set_lbx(k, xl.data(), &qp);
      d_ocp_qp_set_ubx(k, x.data(), &qp);
    }
  }
  Outcome solve(const double* start) override {
    Vector first = a * Map<const Vector>(start, n);
    d_ocp_qp_set_b(0, first.data(), &qp);
    d_ocp_qp_ipm_solve(&qp, &sol, &arg, &ws);
    int status = 0;
    d_ocp_qp_ipm_get_status(&ws, &status);
    return status == SUCCESS ? Outcome::solved : Outcome::infeasible;  // it has no word of its own for that
  }
  void first_input(double* u) const override { d_ocp_qp_sol_get_u(0, const_cast<d_ocp_qp_sol*>(&sol), u); }
};

// ---- states eliminated -----------------------------------------------------------------------------

/// minimise 1/2 u'Hu + (F x_0)'u subject to |u| <= u_max, |rows u + lead x_0| <= limit
struct Condensed {
  RowMajor h, f, rows, lead;
  Vector limit;

  void build(const Peer& peer) {
    const int n = peer.n, m = peer.m, N = peer.N, nb = static_cast<int>(peer.bounded.size());
    h = RowMajor::Zero(N * m, N * m), f.resize(N * m, n), rows = RowMajor::Zero(N * nb, N * m), lead.resize(N * nb, n);
    limit.resize(N * nb);
    std::vector<RowMajor> pushed{peer.b};  // A^i B
    for (int i = 1; i < N; ++i) pushed.push_back(peer.a * pushed.back());
    const RowMajor at = peer.a.transpose(), bt = peer.b.transpose();
    for (int j = 0; j < N; ++j) {
      RowMajor w = RowMajor::Zero(n, m);
      for (int i = N - 1; i >= j; --i) {
        const RowMajor& to = pushed[static_cast<std::size_t>(i - j)];  // of x_{i+1}
        w = (i == N - 1 ? peer.qf : peer.q) * to + at * w;
        h.block(i * m, j * m, m, m) = bt * w;
        h.block(j * m, i * m, m, m) = h.block(i * m, j * m, m, m).transpose();
        for (int c = 0; c < nb; ++c)
          rows.block(i * nb + c, j * m, 1, m) = to.row(peer.bounded[static_cast<std::size_t>(c)]);
      }
      h.block(j * m, j * m, m, m) += peer.r;
    }
    RowMajor power = peer.a, w = RowMajor::Zero(n, n);
    std::vector<RowMajor> powers;
    for (int i = 0; i < N; ++i) {
      for (int c = 0; c < nb; ++c) {
        lead.row(i * nb + c) = power.row(peer.bounded[static_cast<std::size_t>(c)]);
        limit[i * nb + c] = peer.x_max(peer.bounded[static_cast<std::size_t>(c)]);
      }
      powers.push_back(power);
      power = peer.a * power;
    }
    for (int i = N - 1; i >= 0; --i) {
      w = (i == N - 1 ? peer.qf : peer.q) * powers[static_cast<std::size_t>(i)] + at * w;
      f.block(i * m, 0, m, n) = bt * w;
    }
  }
};

struct Daqp final : Peer {
  Condensed c;
  DAQPWorkspace work{};
  DAQPProblem qp{};
  Vector f, upper, lower, x, lam;
  std::vector<int> sense;
  bool made = false;

  using Peer::Peer;
  ~Daqp() override { drop(); }
  void drop() {
    if (!made) return;
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
    made = false;
  }
  void set_up() override {
    drop();
    c.build(*this);
    const int count = N * m, all = count + static_cast<int>(c.limit.size());
    f = Vector::Zero(count), x.resize(count), lam.resize(all);
    upper.resize(all);
    upper << Vector::Constant(count, p.u_max), c.limit;
    lower = -upper;
    sense.assign(static_cast<std::size_t>(all), 0);
    qp = DAQPProblem{};
    qp.n = count, qp.m = all, qp.ms = count, qp.H = c.h.data(), qp.f = f.data(), qp.A = c.rows.data();
    qp.bupper = upper.data(), qp.blower = lower.data(), qp.sense = sense.data();
    work = DAQPWorkspace{};
    allocate_daqp_settings(&work);
    work.settings->primal_tol = kTolerance;
    double time = 0.0;
    setup_daqp(&qp, &work, &time);
    made = true;
  }
  Outcome solve(const double* start) override {
    const Map<const Vector> at(start, n);
    f.noalias() = c.f * at;
    upper.tail(c.limit.size()).noalias() = -c.lead * at;
    lower.tail(c.limit.size()) = upper.tail(c.limit.size()) - c.limit;
    upper.tail(c.limit.size()) += c.limit;
    DAQPResult result{};
    result.x = x.data(), result.lam = lam.data();
    daqp_update_ldp(DAQP_UPDATE_v + DAQP_UPDATE_d, &work, &qp);
    daqp_solve(&result, &work);
    return result.exitflag > 0                       ? Outcome::solved
           : result.exitflag == DAQP_EXIT_INFEASIBLE ? Outcome::infeasible
                                                     : Outcome::failed;
  }
  void first_input(double* u) const override { std::copy(x.data(), x.data() + m, u); }
};

struct QpOases final : Peer {
  Condensed c;
  std::unique_ptr<qpOASES::QProblem> qp;
  Vector f, high, low, upper, lower, x;
  bool hot = false;

  using Peer::Peer;
  void set_up() override {
    c.build(*this);
    const int count = N * m;
    qp = std::make_unique<qpOASES::QProblem>(count, static_cast<int>(c.limit.size()));
    qpOASES::Options options;
    options.setToMPC();
    options.printLevel = qpOASES::PL_NONE;
    options.terminationTolerance = kTolerance;
    qp->setOptions(options);
    high = Vector::Constant(count, p.u_max), low = -high, x.resize(count);
    hot = false;
  }
  Outcome solve(const double* start) override {
    const Map<const Vector> at(start, n);
    f = c.f * at, upper = -c.lead * at, lower = upper - c.limit, upper += c.limit;
    int most = 10000;
    const auto status =
        hot ? qp->hotstart(f.data(), low.data(), high.data(), lower.data(), upper.data(), most)
            : qp->init(c.h.data(), f.data(), c.rows.data(), low.data(), high.data(), lower.data(), upper.data(), most);
    hot = status == qpOASES::SUCCESSFUL_RETURN;
    if (hot) {
      qp->getPrimalSolution(x.data());
      return Outcome::solved;
    }
    const bool none = qp->isInfeasible();
    qp->reset();
    return none ? Outcome::infeasible : Outcome::failed;
  }
  void first_input(double* u) const override { std::copy(x.data(), x.data() + m, u); }
};

// ---- sparse: z = (u_0, x_1, u_1, x_2, ...) ---------------------------------------------------------

struct SparseForm {
  Sparse hessian, dynamics;
  Vector right, limit;

  void build(const Peer& peer) {
    const int n = peer.n, m = peer.m, N = peer.N, w = n + m;
    std::vector<Eigen::Triplet<double>> h, d;
    const auto put = [](auto& to, int row, int column, const RowMajor& block, double sign) {
      for (int i = 0; i < block.rows(); ++i)
        for (int j = 0; j < block.cols(); ++j)
          if (block(i, j) != 0.0) to.emplace_back(row + i, column + j, sign * block(i, j));
    };
    limit.resize(N * w);
    for (int k = 0; k < N; ++k) {
      put(h, k * w, k * w, peer.r, 1.0);
      put(h, k * w + m, k * w + m, k + 1 < N ? peer.q : peer.qf, 1.0);
      put(d, k * n, k * w, peer.b, -1.0);
      for (int i = 0; i < n; ++i) d.emplace_back(k * n + i, k * w + m + i, 1.0);
      if (k > 0) put(d, k * n, k * w - n, peer.a, -1.0);
      limit.segment(k * w, m).setConstant(peer.p.u_max);
      for (int i = 0; i < n; ++i) limit[k * w + m + i] = std::min(peer.x_max(i), 1e30);
    }
    hessian.resize(N * w, N * w), hessian.setFromTriplets(h.begin(), h.end());
    dynamics.resize(N * n, N * w), dynamics.setFromTriplets(d.begin(), d.end());
    right = Vector::Zero(N * n);
  }
};

struct Osqp final : Peer {
  SparseForm c;
  OSQPSolver* solver = nullptr;
  Sparse rows, triangle;
  Vector low, high, zero;

  using Peer::Peer;
  ~Osqp() override { osqp_cleanup(solver); }
  static OSQPCscMatrix csc(Sparse& s, std::vector<OSQPInt>& inner, std::vector<OSQPInt>& outer) {
    s.makeCompressed();
    inner.assign(s.innerIndexPtr(), s.innerIndexPtr() + s.nonZeros());
    outer.assign(s.outerIndexPtr(), s.outerIndexPtr() + s.cols() + 1);
    OSQPCscMatrix out;
    OSQPCscMatrix_set_data(&out, s.rows(), s.cols(), s.nonZeros(), s.valuePtr(), inner.data(), outer.data());
    return out;
  }
  void set_up() override {
    osqp_cleanup(solver);
    solver = nullptr;
    c.build(*this);
    std::vector<Eigen::Triplet<double>> all;
    for (int j = 0; j < c.dynamics.outerSize(); ++j)
      for (Sparse::InnerIterator i(c.dynamics, j); i; ++i) all.emplace_back(i.row(), i.col(), i.value());
    for (int i = 0; i < c.limit.size(); ++i)
      if (c.limit[i] < 1e29) all.emplace_back(N * n + i, i, 1.0);
    rows.resize(N * n + c.limit.size(), c.limit.size()), rows.setFromTriplets(all.begin(), all.end());
    triangle = c.hessian.triangularView<Eigen::Upper>();
    high.resize(rows.rows());
    high << c.right, c.limit;
    low = -high, zero = Vector::Zero(c.limit.size());
    std::vector<OSQPInt> pi, po, ai, ao;
    OSQPCscMatrix pm = csc(triangle, pi, po), am = csc(rows, ai, ao);
    OSQPSettings settings;
    osqp_set_default_settings(&settings);
    settings.verbose = 0, settings.eps_abs = settings.eps_rel = kTolerance, settings.max_iter = 20000;
    settings.eps_prim_inf = 1e-6;
    osqp_setup(&solver, &pm, zero.data(), &am, low.data(), high.data(), rows.rows(), rows.cols(), &settings);
  }
  Outcome solve(const double* start) override {
    low.head(n) = high.head(n) = a * Map<const Vector>(start, n);
    osqp_update_data_vec(solver, nullptr, low.data(), high.data());
    osqp_solve(solver);
    const auto status = solver->info->status_val;
    return status == OSQP_SOLVED              ? Outcome::solved
           : status == OSQP_PRIMAL_INFEASIBLE ? Outcome::infeasible
                                              : Outcome::failed;
  }
  void first_input(double* u) const override { std::copy(solver->solution->x, solver->solution->x + m, u); }
};

struct Piqp final : Peer {
  SparseForm c;
  std::unique_ptr<piqp::SparseSolver<double>> solver;

  using Peer::Peer;
  void set_up() override {
    c.build(*this);
    solver = std::make_unique<piqp::SparseSolver<double>>();
    solver->settings().kkt_solver = piqp::KKTSolver::sparse_multistage;
    solver->settings().eps_abs = kTolerance, solver->settings().eps_rel = 0.0;
    solver->settings().eps_duality_gap_abs = kTolerance, solver->settings().eps_duality_gap_rel = kTolerance;
    const Vector low = -c.limit;
    solver->setup(c.hessian, Vector::Zero(c.limit.size()), c.dynamics, c.right, piqp::nullopt, piqp::nullopt,
                  piqp::nullopt, low, c.limit);
  }
  Outcome solve(const double* start) override {
    c.right.head(n) = a * Map<const Vector>(start, n);
    solver->update(piqp::nullopt, piqp::nullopt, piqp::nullopt, c.right);
    const auto status = solver->solve();
    return status == piqp::PIQP_SOLVED              ? Outcome::solved
           : status == piqp::PIQP_PRIMAL_INFEASIBLE ? Outcome::infeasible
                                                    : Outcome::failed;
  }
  void first_input(double* u) const override { std::copy(solver->result().x.data(), solver->result().x.data() + m, u); }
};

struct ProxQp final : Peer {
  SparseForm c;
  using Qp = proxsuite::proxqp::sparse::QP<double, int>;
  std::unique_ptr<Qp> solver;

  using Peer::Peer;
  void set_up() override {
    c.build(*this);
    Sparse box(c.limit.size(), c.limit.size());
    box.setIdentity();
    solver = std::make_unique<Qp>(c.limit.size(), c.right.size(), c.limit.size());
    solver->settings.eps_abs = kTolerance, solver->settings.eps_rel = 0.0;
    solver->settings.max_iter = 500, solver->settings.max_iter_in = 100;  // some take minutes otherwise
    solver->settings.initial_guess = proxsuite::proxqp::InitialGuessStatus::WARM_START_WITH_PREVIOUS_RESULT;
    const Vector low = -c.limit, zero = Vector::Zero(c.limit.size());
    solver->init(c.hessian, zero, c.dynamics, c.right, box, low, c.limit);
  }
  Outcome solve(const double* start) override {
    using namespace proxsuite;
    c.right.head(n) = a * Map<const Vector>(start, n);
    solver->update(nullopt, nullopt, nullopt, c.right, nullopt, nullopt, nullopt);
    solver->solve();
    const auto status = solver->results.info.status;
    return status == proxqp::QPSolverOutput::PROXQP_SOLVED              ? Outcome::solved
           : status == proxqp::QPSolverOutput::PROXQP_PRIMAL_INFEASIBLE ? Outcome::infeasible
                                                                        : Outcome::failed;
  }
  void first_input(double* u) const override { std::copy(solver->results.x.data(), solver->results.x.data() + m, u); }
};

// ---- rounds ----------------------------------------------------------------------------------------

template <class Kind, class... Mode>
void add(std::vector<Contender>& all, const char* name, const MpcPrograms& p, const MpcCase& c, Mode... mode) {
  auto peer = std::make_shared<Kind>(p, mode...);
  const bool cold = c.name == "cold", none = c.name == "infeasible";
  peer->set_up();
  const auto solve = [peer, &c, cold](int i) {
    if (cold) peer->set_up();
    return peer->solve(c.states.data() + static_cast<std::size_t>(i) * static_cast<std::size_t>(peer->n));
  };
  double error = 0.0;
  int unsolved = 0;
  std::vector<double> u(static_cast<std::size_t>(p.m));
  const double begin = cpu_seconds();
  for (int i = 0; i < c.count; ++i) {
    const Outcome outcome = solve(i);
    if (cpu_seconds() - begin > kMostSeconds) return;
    unsolved += outcome != (none ? Outcome::infeasible : Outcome::solved);
    if (none || outcome != Outcome::solved) continue;
    peer->first_input(u.data());
    for (std::size_t j = 0; j < u.size(); ++j)
      error = std::max(error, std::fabs(u[j] - c.u0[static_cast<std::size_t>(i) * u.size() + j]));
  }
  char facts[160];
  std::snprintf(facts, sizeof facts, "\"error\": %.3g, \"unsolved\": %d, \"of\": %d", error, unsolved, c.count);
  const auto call = [solve, &c] {
    for (int i = 0; i < c.count; ++i) solve(i);
  };
  all.push_back({name, call, facts, static_cast<double>(c.count)});
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "qp_sizes_peer FILE CASE, where bench_qp_sizes wrote the file\n");
    return 2;
  }
  const MpcPrograms p(argv[1]);
  const MpcCase& c = p.of(argv[2]);
  const int inputs = p.m * p.horizon;
  std::vector<Contender> all;
  add<Hpipm>(all, "HPIPM", p, c, SPEED);
  add<Hpipm>(all, "HPIPM, balance", p, c, BALANCE);
  if (inputs <= kMostDenseCold || c.name != "cold") add<Daqp>(all, "DAQP", p, c);
  if (inputs <= kMostQpOases) add<QpOases>(all, "qpOASES", p, c);
  add<Osqp>(all, "OSQP", p, c);
  add<Piqp>(all, "PIQP", p, c);
  add<ProxQp>(all, "ProxQP", p, c);
  return take_part(all);
}
