#include "planners/qp/interior_point.hpp"

#include <cmath>
#include <initializer_list>

#include "planners/qp/interior_part.hpp"

namespace tiller {
namespace {

constexpr double kToBoundary = 0.995;  // share of the way to the nearest bound that a step may go
constexpr double kJam = 0.1;           // a step shorter than this share is a jam
constexpr double kStall = 1.0;         // and so is a mean complementarity that grows
constexpr double kBalance = 0.8;       // of the mean complementarity: the target of a step that only balances

/// The parts of a tree as one program: what goes from part to part goes through here.
class Solve {
 public:
  Solve(InteriorPoint* const* work, const QpTree& tree) : tree_(tree), parts_(tree.parts()) {
    for (std::uint32_t i = 0; i < parts_; ++i) {
      const TreePlace place = parts_ == 1 ? TreePlace::alone : i == 0 ? TreePlace::trunk : TreePlace::branch;
      part_[i] = InteriorPart(*work[i], *tree.part[i], *tree.solution[i], place);
    }
  }

  /// Size of the cost's gradient at the first iterate.
  double begin(FirstIterate from) {
    each([&](InteriorPart& part) {
      part.first_iterate(from);
      part.collect_bounds();
      part.simulate();
    });
    return cost_gradient();
  }
  void first_multipliers(double size, FirstIterate from) {
    each([&](InteriorPart& part) { part.first_multipliers(size, from); });
  }
  double variables() const {
    std::size_t sum = 0;
    for (std::uint32_t i = 0; i < parts_; ++i) sum += part_[i].size();
    return static_cast<double>(sum);
  }
  std::size_t cones() const {
    std::size_t sum = 0;
    for (std::uint32_t i = 0; i < parts_; ++i) sum += part_[i].cones();
    return sum;
  }
  std::size_t bounds() const {
    std::size_t sum = 0;
    for (std::uint32_t i = 0; i < parts_; ++i) sum += part_[i].bounds();
    return sum;
  }

  double cost_gradient() {
    double size = 0.0;
    each([&](InteriorPart& part) { size += part.cost_gradient(); });
    return size;
  }
  /// Not std::fmax: a NaN has to come through.
  double residual() {
    double worst = 0.0;
    each_branch([&](InteriorPart& part, std::uint32_t j) {
      const double r = part.residual(nullptr);
      if (!(r <= worst)) worst = r;
      end_trunk(tree_, j, nullptr, part.first_gradient());
    });
    const double r = part_[0].residual(end());
    return r <= worst ? worst : r;
  }
  bool hopeless(double size) const {
    for (std::uint32_t i = 0; i < parts_; ++i)
      if (part_[i].hopeless(size)) return true;
    return false;
  }
  double mean_complementarity(double alpha) const {
    double sum = 0.0;
    std::size_t terms = 0;
    for (std::uint32_t i = 0; i < parts_; ++i) part_[i].complementarity(alpha, sum, terms);
    return terms ? sum / static_cast<double>(terms) : 0.0;
  }

  bool predict() {
    each([](InteriorPart& part) { part.aim_at_bounds(); });
    bool good = true;
    each_branch([&](InteriorPart& part, std::uint32_t j) {
      good = good && part.factorise(nullptr);
      end_trunk(tree_, j, part.value(), part.slope());
    });
    if (!good || !part_[0].factorise(end())) return false;
    roll_step();
    return true;
  }
  void correct(double centre, double second) {
    each([&](InteriorPart& part) { part.aim(centre, second); });
    each_branch([&](InteriorPart& part, std::uint32_t j) {
      part.resolve(nullptr);
      end_trunk(tree_, j, nullptr, part.slope());
    });
    part_[0].resolve(end());
    roll_step();
  }
  double longest_step() const {
    double alpha = 1.0;
    for (std::uint32_t i = 0; i < parts_; ++i) part_[i].shorten(alpha);
    return alpha;
  }
  void move(double alpha) {
    each([&](InteriorPart& part) { part.move(alpha); });
  }
  void clip_inputs() {
    each([](InteriorPart& part) { part.clip_inputs(); });
  }

 private:
  /// The trunk first.
  template <class F>
  void each(F&& f) {
    for (std::uint32_t i = 0; i < parts_; ++i) f(part_[i]);
  }
  template <class F>
  void each_branch(F&& f) {
    for (std::uint32_t j = 0; j + 1 < parts_; ++j) f(part_[1 + j], j);
  }
  const double* end() const { return parts_ > 1 ? tree_.end_gradient : nullptr; }
  void roll_step() {
    part_[0].roll_step(nullptr);
    each_branch([&](InteriorPart& part, std::uint32_t j) {
      part.roll_step(part_[0].end_step() + j * tree_.part[0]->lq.states);
    });
  }

  const QpTree& tree_;
  std::uint32_t parts_;
  InteriorPart part_[1 + TILLER_MAX_SCENARIOS];
};

}  // namespace

InteriorPoint lay_out_interior_point(Arena& arena, const LqProblem& sizes, const LqKernel& kernel,
                                     const QpCones& cones) {
  InteriorPoint w;
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, nx = (sizes.horizon + 1) * s,
                    nu = std::size_t{sizes.horizon} * sizes.inputs;
  w.kernel = &kernel;
  w.factor = lay_out_lq_factor(arena, sizes, true);
  w.most_bounds = static_cast<std::uint32_t>(2 * (nx - s + nu));
  w.bound = arena.take<InteriorPoint::Bound>(w.most_bounds);
  for (double** rows : {&w.dx, &w.pi, &w.gx, &w.hx, &w.px}) *rows = arena.take<double>(nx);
  for (double** rows : {&w.du, &w.gu, &w.hu, &w.pu, &w.fixed_low}) *rows = arena.take<double>(nu);
  if (cones.count() == 0) return w;
  w.most_cones = cones.count() * sizes.horizon;
  w.cone = arena.take<ConeBound>(w.most_cones);
  w.cone_curvature = arena.take<double>(nu * sizes.inputs);
  w.cone_hessian = arena.take<double>(cones.of_state ? nx * sizes.states : nu * sizes.inputs);
  return w;
}

QpReport solve_interior_point(InteriorPoint& work, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  InteriorPoint* const alone = &work;
  return solve_interior_point(&alone, tree_of(qp, solution), limits);
}

QpReport solve_interior_point(InteriorPoint* const* work, const QpTree& tree, const QpLimits& limits) {
  Solve solve(work, tree);
  QpReport report;
  const double size = solve.begin(FirstIterate::given);
  report.residual = size;
  if (!std::isfinite(size)) return report;
  const double first = std::fmax(1e-3, size / solve.variables());
  solve.first_multipliers(first, FirstIterate::given);
  // Where a step was short, or the pairs came no nearer to zero, they are far from balanced and a bold correction runs
  // into the same bounds again, round and round: the next step only balances them (Colombo and Gondzio 2008 tell of
  // this failure of Mehrotra's corrector).
  double before = INFINITY;
  bool jammed = false, balanced = false;  // never twice in a row
  bool central = false;                   // begun anew
  for (;; ++report.iterations) {
    solve.cost_gradient();
    report.residual = solve.residual();
    if (!std::isfinite(report.residual)) break;
    report.status = report.residual <= limits.tolerance ? QpStatus::solved : QpStatus::capped;
    if (report.status == QpStatus::solved || report.iterations >= limits.iterations || limits.deadline.passed()) break;
    if (solve.hopeless(first)) {
      report.status = QpStatus::infeasible;
      break;
    }
    if (!solve.predict()) {
      report.status = QpStatus::broken;
      break;
    }
    const double now = solve.mean_complementarity(0.0);
    const double then = solve.mean_complementarity(solve.longest_step());
    balanced = !balanced && (jammed || now > kStall * before);
    before = now;
    if (solve.bounds() > 0) {
      const double share = then / now;
      const double centring = balanced ? kBalance : share * share * share;
      solve.correct(std::fmax(centring * now, 0.1 * limits.tolerance), balanced ? 0.0 : 1.0);
    }
    const double longest = solve.longest_step();
    jammed = longest < kJam;
    // Inputs that stand at the wrong bounds are not led away from them: an active set that circles leaves such ones.
    // The middle of the limits may be outside of a cone, and what is left of one there is no good beginning.
    if (jammed && balanced && !central && solve.cones() == 0) {
      central = true;
      solve.begin(FirstIterate::central);
      solve.first_multipliers(first, FirstIterate::central);
      before = INFINITY;
      continue;
    }
    solve.move(longest < 1.0 ? kToBoundary * longest : 1.0);
  }
  solve.clip_inputs();
  return report;
}

}  // namespace tiller
