#include "tools/imitate/expansion.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

/// Everything that QuadratiseJob gives, a lane a point.
struct Expanded {
  LaneRows lx, lu, lb, lxx, luu, lux;
  Expanded(std::uint32_t nx, std::uint32_t nu, std::uint32_t points)
      : lx(nx, points),
        lu(nu, points),
        lb(nu, points),
        lxx(nx * nx, points),
        luu(nu * nu, points),
        lux(nu * nx, points) {}
};

void put(std::vector<SparseQuadratic::Entry>& list, Eigen::Index row, Eigen::Index column, double value) {
  if (value != 0) list.push_back({static_cast<std::uint16_t>(row), static_cast<std::uint16_t>(column), value});
}

/// One point of a motion with its features.
class Features {
 public:
  Features(const Scene& scene, const Motion& motion, Eigen::Index n)
      : scene_(scene), motion_(motion), n_(n), nx_(scene.nx()), nu_(scene.nu()) {
    const Eigen::Index points = motion.state.cols();
    input_ = Matrix::Zero(nu_, points);
    input_.leftCols(motion.steps()) = motion.input;
    before_ = Matrix(nu_, points);
    before_ << motion.input.col(0), motion.input;
  }

  std::vector<SparseQuadratic> stages(const tiller_config_t& cost) const {
    const auto steps = static_cast<std::uint32_t>(motion_.steps());
    const Expanded e = expand(cost, 0, steps, false);
    std::vector<SparseQuadratic> all(steps);
    for (std::uint32_t k = 0; k < steps; ++k) all[k] = stage(e, cost.cost.input_rate_weight, k);
    return all;
  }
  std::vector<SparseQuadratic> terminals(const tiller_config_t& cost, bool every) const {
    std::vector<SparseQuadratic> all(static_cast<std::size_t>(motion_.state.cols()));
    for (Eigen::Index p = every ? 0 : motion_.steps(); p <= motion_.steps(); ++p)
      all[static_cast<std::size_t>(p)] = states(expand(cost, p, 0, true), 0);
    return all;
  }

 private:
  /// Stages `first` and on, or that point as the end of a horizon.
  Expanded expand(const tiller_config_t& cost, Eigen::Index first, std::uint32_t stages, bool terminal) const {
    const std::uint32_t columns = terminal ? 1 : stages;
    Expanded e(nx_, nu_, columns);
    const CostTerms<double> terms = make_cost_terms<double>(cost.cost, nx_);
    const LaneRows x(motion_.state.middleCols(first, columns)), u(input_.middleCols(first, columns)),
        before(before_.middleCols(first, columns));
    QuadratiseJob job;
    job.setup = &scene_.setup;
    job.cost = &terms;
    job.lanes = e.lx.lanes;
    job.stages = terminal ? 0 : stages;
    job.terminal = terminal;
    job.task_step = static_cast<std::uint64_t>(first);
    job.state = x.get();
    job.control = u.get();
    job.before = before.get();
    job.params = {scene_.params.data(), 0};
    job.lx = e.lx.data.data();
    job.lu = e.lu.data.data();
    job.lb = e.lb.data.data();
    job.lxx = e.lxx.data.data();
    job.luu = e.luu.data.data();
    job.lux = e.lux.data.data();
    scene_.table->quadratise(*scene_.config.model, job);
    return e;
  }

  SparseQuadratic states(const Expanded& e, std::uint32_t lane) const {
    SparseQuadratic q;
    for (std::uint32_t r = 0; r < nx_; ++r) {
      put(q.gradient, r, 0, e.lx.data[r * e.lx.lanes + lane]);
      for (std::uint32_t c = 0; c < nx_; ++c) put(q.hessian, r, c, e.lxx.data[(r * nx_ + c) * e.lxx.lanes + lane]);
    }
    return q;
  }

  SparseQuadratic stage(const Expanded& e, const double* rate, std::uint32_t k) const {
    SparseQuadratic q = states(e, k);
    for (std::uint32_t i = 0; i < nu_; ++i) {
      put(q.gradient, n_ + i, 0, e.lu.data[i * e.lu.lanes + k]);
      for (std::uint32_t j = 0; j < nu_; ++j)
        put(q.hessian, n_ + i, n_ + j, e.luu.data[(i * nu_ + j) * e.luu.lanes + k]);
      for (std::uint32_t c = 0; c < nx_; ++c) {
        const double cross = e.lux.data[(i * nx_ + c) * e.lux.lanes + k];
        put(q.hessian, n_ + i, c, cross);
        put(q.hessian, c, n_ + i, cross);
      }
      if (rate[i] > 0) couple(q, e.lb.data[i * e.lb.lanes + k], rate[i], i);
    }
    return q;
  }
  void couple(SparseQuadratic& q, double slope, double rate, std::uint32_t i) const {
    put(q.gradient, nx_ + i, 0, slope);
    put(q.hessian, nx_ + i, nx_ + i, 2 * rate);
    put(q.hessian, nx_ + i, n_ + i, -2 * rate);
    put(q.hessian, n_ + i, nx_ + i, -2 * rate);
  }

  const Scene& scene_;
  const Motion& motion_;
  Eigen::Index n_;
  std::uint32_t nx_, nu_;
  Matrix input_, before_;
};

bool has_rates(const tiller_config_t& config) {
  return std::any_of(config.cost.input_rate_weight, config.cost.input_rate_weight + config.model->input_count,
                     [](double w) { return w > 0; });
}

void expand_model(const Scene& scene, const Motion& motion, Expansion& e) {
  const std::uint32_t nx = scene.nx(), nu = scene.nu();
  Matrix a, b;
  const Matrix next = scene.step(motion.state.leftCols(e.steps), motion.input, &a, &b);
  e.defect = Matrix::Zero(e.n, e.steps);
  for (Eigen::Index k = 0; k < e.steps; ++k) {
    Matrix f = Matrix::Zero(e.n, e.n + e.nu);
    for (std::uint32_t r = 0; r < nx; ++r) {
      for (std::uint32_t c = 0; c < nx; ++c) f(r, c) = a(r * nx + c, k);
      for (std::uint32_t i = 0; i < nu; ++i) f(r, e.n + i) = b(r * nu + i, k);
    }
    for (Eigen::Index i = nx; i < e.n; ++i) f(i, e.n + i - nx) = 1;
    e.f.push_back(f);
    e.defect.col(k).head(nx) = scene.difference(next.col(k), motion.state.col(k + 1));
  }
}

/// What a unit of a target's move adds at weight one: minus the state's curvature, as a slope.
std::vector<SparseQuadratic> moved(const std::vector<SparseQuadratic>& of, std::uint32_t state) {
  std::vector<SparseQuadratic> out(of.size());
  for (std::size_t k = 0; k < of.size(); ++k)
    for (const SparseQuadratic::Entry& e : of[k].hessian)
      if (e.row == state && e.column == state) put(out[k].gradient, state, 0, -e.value);
  return out;
}

/// Limits of the inputs, and of their change in a period.
std::vector<std::int8_t> limits_met(const tiller_config_t& config, const Vector& u, const Vector& before,
                                    double share) {
  std::vector<std::int8_t> met(static_cast<std::size_t>(u.size()), 0);
  for (Eigen::Index i = 0; i < u.size(); ++i) {
    const double most = config.safety.input_rate_per_s[i] * config.period_s;
    double low = config.safety.input_low[i], high = config.safety.input_high[i];
    const double near = share * (high - low);
    if (std::isfinite(most)) low = std::max(low, before(i) - most), high = std::min(high, before(i) + most);
    if (u(i) >= high - near) met[static_cast<std::size_t>(i)] = 1;
    if (u(i) <= low + near) met[static_cast<std::size_t>(i)] = -1;
  }
  return met;
}

}  // namespace

void SparseQuadratic::add(double w, Vector& g, Matrix& h) const {
  for (const Entry& e : gradient) g(e.row) += w * e.value;
  for (const Entry& e : hessian) h(e.row, e.column) += w * e.value;
}

bool Expansion::varies(std::size_t group) const {
  const auto sloped = [](const SparseQuadratic& q) { return !q.gradient.empty(); };
  return std::any_of(stage[group].begin(), stage[group].end(), sloped) ||
         std::any_of(terminal[group].begin(), terminal[group].end(), sloped);
}

Expansion expand(const Scene& scene, const Motion& motion, const tiller_config_t& cost,
                 const std::vector<CostTerm>& learnt, const ExpandOptions& options,
                 const std::vector<std::uint32_t>& targets) {
  Expansion e;
  e.steps = motion.steps();
  e.nu = scene.nu();
  e.n = scene.nx() + (has_rates(cost) ? scene.nu() : 0);
  expand_model(scene, motion, e);
  const Features features(scene, motion, e.n);
  const auto add_group = [&](const tiller_config_t& of) {
    e.stage.push_back(features.stages(of));
    e.terminal.push_back(features.terminals(of, options.every_end));
  };
  const auto add_target = [&](const tiller_config_t& of, std::uint32_t state) {
    std::vector<SparseQuadratic> stages = moved(features.stages(of), state);
    std::vector<SparseQuadratic> ends = moved(features.terminals(of, options.every_end), state);
    e.stage.push_back(stages);
    e.stage.emplace_back(stages.size());
    e.terminal.emplace_back(ends.size());
    e.terminal.push_back(ends);
  };
  CostEdit kept(cost);
  for (const CostTerm& term : learnt) kept.set(term, 0);
  add_group(kept.get());
  for (const CostTerm& term : learnt) {
    CostEdit one(cost);
    one.clear();
    one.set(term, 1);
    add_group(one.get());
  }
  for (const std::uint32_t state : targets) {
    CostEdit one(cost);
    one.clear();
    one.set({CostTerm::state, state, "", 0}, 1);
    one.set({CostTerm::terminal, state, "", 0}, 1);
    add_target(one.get(), state);
  }
  for (Eigen::Index k = 0; k < e.steps; ++k)
    e.at_limit.push_back(
        limits_met(cost, motion.input.col(k), motion.input.col(std::max<Eigen::Index>(k - 1, 0)), options.limit_share));
  return e;
}

}  // namespace tiller::tools::imitate
