// What a force at a joint would do to a window, to first order: for scans that look at hundreds of shapes of it.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "tools/gap/fit/shooting.hpp"

namespace tiller::tools::gap {
namespace {
constexpr std::uint32_t kLanes = WindowRollout::kLanes;
}

// Steps of a period from sixteen points of a window's base path: without and with a small force, and linearised.
struct Shooting::PushedSteps {
  const tiller_model_t& model;
  const Hypothesis &base, &pushed;
  double period_s, push;
  std::vector<double> params;
  std::vector<double> x, u, effect, history, next[2], unused, a;

  PushedSteps(const tiller_model_t& of, const Hypothesis& base_, const Hypothesis& pushed_, const Fit& fit,
              double period, double force)
      : model(of),
        base(base_),
        pushed(pushed_),
        period_s(period),
        push(force),
        params(fit.params),
        x(std::size_t{of.state_count} * kLanes),
        u(std::size_t{of.input_count} * kLanes),
        effect(std::size_t{TILLER_MAX_EFFECT_STATES + 1} * kLanes, 0.0),
        history(std::size_t{TILLER_MAX_DELAY_STEPS + 2} * TILLER_MAX_INPUTS, 0.0),
        unused(x.size()),
        a(x.size() * of.state_count) {
    params.resize(base.config.param_count);
    params.push_back(0);
    next[0].resize(x.size());
    next[1].resize(x.size());
  }

  void take() {
    const RolloutTable& table = select_rollout(model);
    for (int side = 0; side < 2; ++side) {
      params.back() = side * push;
      RolloutJob<double> job;
      job.setup = &pushed.setup;
      job.lanes = kLanes;
      job.horizon = 1;
      job.period_s = period_s;
      job.state = {x.data(), kLanes};
      job.params.data = params.data();
      job.effect_state = {effect.data(), kLanes};
      job.controls = {u.data(), kLanes};
      job.history = history.data();
      job.final_state = next[side].data();
      table.rollout_f64(model, job);
    }
    LineariseJob job;
    job.setup = &base.setup;
    job.lanes = kLanes;
    job.period_s = period_s;
    job.state = {x.data(), kLanes};
    job.params.data = params.data();
    job.effect_state = {effect.data(), kLanes};
    job.control = {u.data(), kLanes};
    job.history = history.data();
    job.next_state = unused.data();
    job.a = a.data();
    table.linearise(model, job);
  }
};

bool Shooting::open_response(const Hypothesis& h, const Fit& fit, std::size_t index, std::uint32_t joint) {
  const Window& w = windows_[index];
  const std::uint32_t nu = model_.input_count;

  // the force is a constant offset for one period
  std::vector<EffectAt> effects = h.added;
  effects.push_back({tiller_effect_constant_offset, joint});
  Hypothesis pushed;
  if (!make_hypothesis(config_, effects, &scales_, pushed)) return false;
  WindowRollout& rollout = scratch_[0].rollout;
  rollout.use(h);
  stride_ = starts_of(h) + 1;
  differentiate(scratch_[0], h, index, fit, false);
  if (!std::isfinite(gram_[index * kMostColumns * kMostColumns + stride_ * stride_ - 1])) return false;
  const std::vector<double> path(rollout.trajectory(), rollout.trajectory() + std::size_t{w.points} * nx_ * kLanes);

  PushedSteps steps(model_, h, pushed, fit, data_.grids[w.grid].period_s, 0.01 * scales_.joint[joint].force);
  for (std::size_t first = 0; first + 1 < w.points; first += kLanes) {
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      const std::size_t k = std::min<std::size_t>(first + l, w.points - 2);
      for (std::uint32_t i = 0; i < nx_; ++i) steps.x[i * kLanes + l] = path[(k * nx_ + i) * kLanes];
      for (std::uint32_t i = 0; i < nu; ++i) steps.u[i * kLanes + l] = data_.controls[w.grid][(w.start + k) * nu + i];
    }
    steps.take();
    for (std::uint32_t l = 0; l < kLanes && first + l + 1 < w.points; ++l) {
      keep_step(steps, first + l, l);
      response_position_[first + l] = position_between(w, path, joint, first + l);
    }
  }
  const std::size_t gauges = rows_ - ny_;
  for (std::size_t k = 0; k < w.points && gauges > 0; ++k) {
    double state[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < nx_; ++i) state[i] = path[(k * nx_ + i) * kLanes];
    for (std::size_t g = 0; g < gauges; ++g)
      data_.gauges.slope(g, state, fit.params.data(), &response_c_[(k * gauges + g) * nx_]);
  }
  return true;
}

void Shooting::keep_step(const PushedSteps& steps, std::size_t k, std::uint32_t lane) {
  for (std::uint32_t i = 0; i < nx_; ++i)
    response_b_[k * nx_ + i] = (steps.next[1][i * kLanes + lane] - steps.next[0][i * kLanes + lane]) / steps.push;
  for (std::uint32_t i = 0; i < nx_ * nx_; ++i) response_a_[k * nx_ * nx_ + i] = steps.a[i * kLanes + lane];
}

double Shooting::position_between(const Window& w, const std::vector<double>& path, std::uint32_t joint,
                                  std::size_t k) const {
  const std::uint32_t q = model_.joints[joint].position;
  if (q == TILLER_NO_POSITION) return 0.0;
  // where it was, not where the base thinks it was: half a tooth apart is the opposite force
  const std::vector<double>& position = data_.grids[w.grid].state[q];
  const std::size_t at = w.start + k, last = position.size() - 1;
  const double seen = 0.25 * (position[at > 0 ? at - 1 : 0] + position[at] + position[std::min(at + 1, last)] +
                              position[std::min(at + 2, last)]);
  if (std::isfinite(seen)) return seen;
  return 0.5 * (path[(k * nx_ + q) * kLanes] + path[((k + 1) * nx_ + q) * kLanes]);
}

void Shooting::begin_response() {
  std::fill(deviation_.begin(), deviation_.end(), 0.0);
  // the first point's, which no force has moved; those of gauges stand elsewhere
  std::fill_n(scratch_[0].rows.begin(), rows_ > ny_ ? scratch_[0].rows.size() : std::size_t{ny_} * kLanes, 0.0);
}

void Shooting::step_response(std::size_t index, std::size_t k, const double* force) {
  const Window& w = windows_[index];
  const double *a = response_a_.data() + k * nx_ * nx_, *b = response_b_.data() + k * nx_;
  double next[TILLER_MAX_STATES][kLanes];
  for (std::uint32_t r = 0; r < nx_; ++r) {
    for (std::uint32_t l = 0; l < kLanes; ++l) next[r][l] = b[r] * force[l];
    for (std::uint32_t c = 0; c < nx_; ++c)
      for (std::uint32_t l = 0; l < kLanes; ++l) next[r][l] += a[r * nx_ + c] * deviation_[c * kLanes + l];
  }
  const std::size_t gauges = rows_ - ny_;
  for (std::size_t g = 0; g < gauges; ++g) {
    double* row = scratch_[0].rows.data() + (w.points * ny_ + (k + 1) * gauges + g) * kLanes;
    const double *now = &response_c_[((k + 1) * gauges + g) * nx_], *last = &response_c_[(k * gauges + g) * nx_];
    const bool change = data_.gauges.before(g) > 0;
    const double per = change ? 1 / data_.grids[w.grid].period_s : 1;
    for (std::uint32_t l = 0; l < kLanes; ++l) {
      row[l] = 0;
      for (std::uint32_t i = 0; i < nx_; ++i)
        row[l] += per * (now[i] * next[i][l] - (change ? last[i] * deviation_[i * kLanes + l] : 0));
    }
  }
  for (std::uint32_t r = 0; r < nx_; ++r) std::copy_n(next[r], kLanes, deviation_.begin() + r * kLanes);
  for (std::uint32_t i = 0; i < ny_; ++i)
    std::copy_n(next[measured_[i]], kLanes,
                scratch_[0].rows.begin() + static_cast<std::ptrdiff_t>(((k + 1) * ny_ + i) * kLanes));
}

// The scratch's columns hold the start's derivatives and the residual, as differentiate() left them.
void Shooting::end_response(std::size_t index) {
  const Window& w = windows_[index];
  double* rows = scratch_[0].rows.data();
  const double* columns = scratch_[0].columns.data();
  whitening_.apply(index, w, data_.grids[w.grid].period_s, rows);
  const std::uint32_t nc = stride_, starts = nc - 1;
  double along[(TILLER_MAX_STATES + kMostUnseen + 1) * kLanes] = {};
  std::fill(products_.begin(), products_.end(), 0.0);
  for (std::size_t r = 0; r < w.points * rows_; ++r) {
    const double *row = rows + r * kLanes, *column = columns + r * nc;
    for (std::uint32_t c = 0; c < nc; ++c)
      for (std::uint32_t l = 0; l < kLanes; ++l) along[c * kLanes + l] += column[c] * row[l];
    for (std::uint32_t i = 0; i < kLanes; ++i)
      for (std::uint32_t l = 0; l < kLanes; ++l) products_[i * kLanes + l] += row[i] * row[l];
  }
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const Rows> gram(gram_.data() + index * kMostColumns * kMostColumns, nc, nc);
  const Eigen::Map<const Rows> c(along, nc, kLanes);
  Eigen::MatrixXd j = gram.topLeftCorner(starts, starts);
  j.diagonal().array() += 1e-9 * std::max(1e-12, j.diagonal().maxCoeff());
  const Eigen::LDLT<Eigen::MatrixXd> factor(j);
  const Eigen::MatrixXd solved = factor.solve(Eigen::MatrixXd(c.topRows(starts)));
  Eigen::Map<Rows> products(products_.data(), kLanes, kLanes);
  products -= c.topRows(starts).transpose() * solved;
  Eigen::Map<Eigen::VectorXd> cross(products_.data() + kLanes * kLanes, kLanes);
  cross = c.row(starts).transpose() - solved.transpose() * gram.block(0, starts, starts, 1);
}

}  // namespace tiller::tools::gap
