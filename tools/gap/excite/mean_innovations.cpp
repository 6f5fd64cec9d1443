#include "tools/gap/excite/mean_innovations.hpp"

#include <algorithm>
#include <cmath>
namespace tiller::tools::gap {
namespace {

std::uint32_t padded(std::size_t lanes) {
  return static_cast<std::uint32_t>((lanes + kLanePadding - 1) / kLanePadding * kLanePadding);
}

/// Commands before period k, newest first; at rest before the sequence begins.
void fill_history(const InputSequence& s, std::size_t k, std::uint32_t rows, std::vector<double>& history) {
  history.assign(std::max<std::size_t>(1, std::size_t{rows} * s.inputs), 0.0);
  for (std::uint32_t row = 0; row < rows && row < k; ++row)
    std::copy_n(&s.value[(k - 1 - row) * s.inputs], s.inputs, &history[std::size_t{row} * s.inputs]);
}

}  // namespace

RivalRollout::RivalRollout(const Rival& rival) : rival_(rival) { (void)make_step_setup(rival.config, setup_); }

bool RivalRollout::run(const InputSequence& sequence, const std::vector<std::vector<double>>& params,
                       std::vector<double>& states) {
  const tiller_config_t& c = rival_.config;
  const tiller_model_t& model = *c.model;
  const std::uint32_t lanes = padded(params.size()), nx = model.state_count, np = c.param_count;
  const std::size_t points = sequence.points(), vectors = params.size();
  std::vector<double> p(std::size_t{std::max(np, 1u)} * lanes), x(std::size_t{nx} * lanes), history;
  std::vector<double> effect(std::size_t{setup_.effect_state_count + 1} * lanes, 0.0);
  std::vector<double> trajectory((points + 1) * nx * lanes);
  for (std::uint32_t l = 0; l < lanes; ++l) {
    for (std::uint32_t i = 0; i < np; ++i) p[i * lanes + l] = params[std::min<std::size_t>(l, vectors - 1)][i];
    for (std::uint32_t i = 0; i < nx; ++i) x[i * lanes + l] = c.initial_state[i];
  }
  fill_history(sequence, 0, setup_.delay_steps + 1, history);
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = lanes;
  job.horizon = static_cast<std::uint32_t>(points);
  job.state = {x.data(), lanes};
  job.params = {p.data(), lanes};
  job.effect_state = {effect.data(), lanes};
  job.controls = {sequence.value.data(), 0};
  job.history = history.data();
  job.trajectory = trajectory.data();
  select_rollout(model).rollout_f64(model, job);
  states.resize(points * nx * vectors);
  bool finite = true;
  for (std::size_t r = 0; r < points * nx; ++r)
    for (std::size_t v = 0; v < vectors; ++v) {
      states[r * vectors + v] = trajectory[r * lanes + v];
      finite = finite && std::isfinite(states[r * vectors + v]);
    }
  return finite;
}

Outputs RivalRollout::outputs(const InputSequence& sequence, const std::vector<double>& params) {
  Outputs out;
  std::vector<double> states;
  out.finite = run(sequence, {params}, states);
  const std::uint32_t ny = rival_.config.measurement_count;
  for (std::size_t k = 0; k < sequence.points(); ++k)
    for (std::uint32_t m = 0; m < ny; ++m)
      out.value.push_back(reading_on_path(rival_.config, params.data(), m, states.data(), k, rival_.config.period_s));
  return out;
}

MeanInnovations::MeanInnovations(const Rival& rival)
    : rival_(rival), config_(rival.config), model_(*rival.config.model), table_(select_rollout(model_)) {
  (void)make_step_setup(config_, setup_);
}

void MeanInnovations::start(const std::vector<std::vector<double>>& params) {
  const std::uint32_t nx = model_.state_count, np = config_.param_count;
  vectors_ = static_cast<std::uint32_t>(params.size());
  lanes_ = padded(vectors_ + nx);
  state_.assign(std::size_t{nx} * lanes_, 0.0);
  params_.assign(std::size_t{std::max(np, 1u)} * lanes_, 0.0);
  effect_.assign(std::size_t{setup_.effect_state_count + 1} * lanes_, 0.0);
  next_effect_ = effect_;
  step_.assign(nx, 0.0);
  for (std::uint32_t l = 0; l < lanes_; ++l) {
    for (std::uint32_t i = 0; i < np; ++i) params_[i * lanes_ + l] = params[l < vectors_ ? l : 0][i];
    for (std::uint32_t i = 0; i < nx; ++i) state_[i * lanes_ + l] = config_.initial_state[i];
  }
  next_ = state_;  // it has stood there
  // nothing is believed of the start, as `tiller gap` believes nothing: where a robot rests is what a bias changes
  constexpr double kUnknown = 1.0;
  p_ = Eigen::MatrixXd::Zero(nx, nx);
  for (std::uint32_t i = 0; i < nx; ++i) p_(i, i) = std::pow(std::max(config_.initial_state_sd[i], kUnknown), 2);
}

/// One channel after the other: their noises are independent. How the sensors read is taken where the prediction is.
void MeanInnovations::correct(const double* measured, Eigen::MatrixXd& innovations, std::size_t row) {
  const std::uint32_t nx = model_.state_count, ny = config_.measurement_count;
  foreseen_.assign(state_.begin(), state_.end());
  std::vector<MeasurementMap> maps;
  for (std::uint32_t m = 0; m < ny; ++m)
    for (std::uint32_t v = 0; v < vectors_; ++v) {
      const std::uint32_t state = config_.measured_state[m];
      // next_: the states of a period before
      const SensorSight<double> at = sight_of(model_, state, &state_[v], lanes_, &next_[v], lanes_, config_.period_s);
      maps.push_back(measurement_map(config_, state, at, params_.data() + v, lanes_));
    }
  for (std::uint32_t m = 0; m < ny; ++m) {
    const std::uint32_t state = config_.measured_state[m], rate = velocity_of(model_, state);
    const MeasurementMap* map = &maps[std::size_t{m} * vectors_];
    const double sd = config_.measurement_sd[m];
    Eigen::VectorXd slope = Eigen::VectorXd::Zero(nx);
    slope(state) = map[0].gain;
    if (rate < nx) slope(rate) += map[0].rate_gain;
    const Eigen::VectorXd spread = p_ * slope;
    const double s = slope.dot(spread) + sd * sd;
    const Eigen::VectorXd gain = spread / s;
    for (std::uint32_t v = 0; v < vectors_; ++v) {
      double reading = map[v].of(state_[state * lanes_ + v]);
      if (rate < nx) reading += map[v].rate_gain * (state_[rate * lanes_ + v] - foreseen_[rate * lanes_ + v]);
      const double off = state_difference(model_, state, measured[m], reading);
      innovations(static_cast<Eigen::Index>(row + m), v) = off / std::sqrt(s);
      for (std::uint32_t i = 0; i < nx; ++i) state_[i * lanes_ + v] += gain[i] * off;
    }
    p_ -= gain * gain.transpose() * s;
  }
}

bool MeanInnovations::predict(const InputSequence& sequence, std::size_t k) {
  const std::uint32_t nx = model_.state_count, ns = setup_.effect_state_count;
  for (std::uint32_t i = 0; i < nx; ++i) {
    step_[i] = std::max(std::sqrt(std::max(p_(i, i), 0.0)), 1e-7);
    for (std::uint32_t l = vectors_; l < lanes_; ++l)
      state_[i * lanes_ + l] = state_[i * lanes_] + (l - vectors_ == i ? step_[i] : 0.0);
  }
  for (std::uint32_t i = 0; i < ns; ++i)
    for (std::uint32_t l = vectors_; l < lanes_; ++l) effect_[i * lanes_ + l] = effect_[i * lanes_];
  fill_history(sequence, k, setup_.delay_steps + 1, history_);
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = lanes_;
  job.horizon = 1;
  job.state = {state_.data(), lanes_};
  job.params = {params_.data(), lanes_};
  job.effect_state = {effect_.data(), lanes_};
  job.controls = {&sequence.value[k * sequence.inputs], 0};
  job.history = history_.data();
  job.final_state = next_.data();
  job.final_effect_state = next_effect_.data();
  table_.rollout_f64(model_, job);
  Eigen::MatrixXd a(nx, nx);
  for (std::uint32_t r = 0; r < nx; ++r)
    for (std::uint32_t c = 0; c < nx; ++c) a(r, c) = (next_[r * lanes_ + vectors_ + c] - next_[r * lanes_]) / step_[c];
  const double fade = std::exp(config_.period_s / kMemory_s);
  p_ = fade * fade * (a * p_ * a.transpose());
  for (std::uint32_t i = 0; i < nx; ++i) p_(i, i) += config_.process_sd[i] * config_.process_sd[i] * config_.period_s;
  state_.swap(next_);
  effect_.swap(next_effect_);
  return a.allFinite();
}

Eigen::MatrixXd MeanInnovations::run(const InputSequence& sequence, const Outputs& outputs,
                                     const std::vector<std::vector<double>>& params) {
  const std::uint32_t ny = config_.measurement_count;
  Eigen::MatrixXd innovations(static_cast<Eigen::Index>(sequence.points() * ny),
                              static_cast<Eigen::Index>(params.size()));
  start(params);
  bool finite = outputs.finite;
  for (std::size_t k = 0; k < sequence.points() && finite; ++k) {
    correct(&outputs.value[k * ny], innovations, k * ny);
    finite = predict(sequence, k);
  }
  if (!finite || !innovations.allFinite()) innovations.setConstant(std::nan(""));
  return innovations;
}

namespace {

constexpr double kUsual = 3.0;   // spreads that a refit may move at the cost of one nat or so
constexpr double kStiffer = 20;  // times its stiffness, what a spring holds is rigid

/// What a refit may move parameter i by, in its spreads.
double usual(const Rival& rival, std::size_t i) { return rival.stiff[i] ? kUsual * kStiffer : kUsual; }

double penalty(const Rival& rival, const std::vector<double>& params) {
  double sum = 0;
  for (std::size_t i = 0; i < params.size(); ++i)
    if (rival.spread[i] > 0) sum += std::pow((params[i] - rival.value[i]) / (usual(rival, i) * rival.spread[i]), 2);
  return sum;
}

/// A point of the fit, expanded to first order in the free parameters over their spreads.
struct Expansion {
  std::vector<double> params;
  double squares = INFINITY, total = INFINITY;  // D, and with the penalty
  Eigen::VectorXd gradient;                     // of half the total
  Eigen::MatrixXd hessian;                      // Gauss-Newton
};

class Fit {
 public:
  Fit(const Rival& rival, MeanInnovations& filter, const InputSequence& sequence, const Outputs& outputs)
      : rival_(rival), filter_(filter), sequence_(sequence), outputs_(outputs) {
    for (std::size_t i = 0; i < rival.spread.size(); ++i)
      if (rival.spread[i] > 0) free_.push_back(i);
  }

  Expansion expand(const std::vector<double>& params) {
    constexpr double kDifference = 0.02;  // of a spread: far above rounding, below what friction's kinks let pass
    const auto d = static_cast<Eigen::Index>(free_.size());
    std::vector<std::vector<double>> vectors = {params};
    std::vector<double> change;
    for (const std::size_t i : free_) {
      const double size = kDifference * rival_.spread[i];
      change.push_back(params[i] + size <= rival_.high[i] ? size : -size);
      vectors.push_back(params);
      vectors.back()[i] += change.back();
    }
    const Eigen::MatrixXd e = filter_.run(sequence_, outputs_, vectors);
    Expansion at;
    at.params = params;
    at.squares = e.col(0).squaredNorm();
    at.total = at.squares + penalty(rival_, params);
    if (!std::isfinite(at.total)) return {params, INFINITY, INFINITY, {}, {}};
    Eigen::MatrixXd j(e.rows(), d);
    Eigen::VectorXd pull(d), prior(d);
    for (Eigen::Index c = 0; c < d; ++c) {
      const std::size_t i = free_[static_cast<std::size_t>(c)];
      j.col(c) = (e.col(c + 1) - e.col(0)) / (change[static_cast<std::size_t>(c)] / rival_.spread[i]);
      prior[c] = 1 / (usual(rival_, i) * usual(rival_, i));
      pull[c] = prior[c] * (params[i] - rival_.value[i]) / rival_.spread[i];
    }
    at.gradient = j.transpose() * e.col(0) + pull;
    at.hessian = j.transpose() * j;
    at.hessian.diagonal() += prior;
    return at;
  }

  /// Damped Gauss-Newton; what would leave its bounds stays at them, and the others are solved for again.
  std::vector<double> step(const Expansion& at, double damping) const {
    const auto d = static_cast<Eigen::Index>(free_.size());
    std::vector<double> next = at.params;
    std::vector<bool> held(free_.size(), false);
    for (std::size_t pass = 0; pass <= free_.size(); ++pass) {
      Eigen::MatrixXd h = at.hessian;
      h.diagonal() *= 1 + damping;
      Eigen::VectorXd g = at.gradient;
      for (Eigen::Index c = 0; c < d; ++c) {
        if (!held[static_cast<std::size_t>(c)]) continue;
        // its move is known: up to the bound
        const std::size_t i = free_[static_cast<std::size_t>(c)];
        const double move = (next[i] - at.params[i]) / rival_.spread[i];
        g += h.col(c) * move;
        h.row(c).setZero();
        h.col(c).setZero();
        h(c, c) = 1;
        g[c] = 0;
      }
      const Eigen::VectorXd move = h.ldlt().solve(-g);
      bool settled = true;
      for (Eigen::Index c = 0; c < d; ++c) {
        const auto s = static_cast<std::size_t>(c);
        const std::size_t i = free_[s];
        if (held[s]) continue;
        const double wanted = at.params[i] + move[c] * rival_.spread[i];
        next[i] = std::clamp(wanted, rival_.low[i], rival_.high[i]);
        if (next[i] != wanted) held[s] = true, settled = false;
      }
      if (settled) break;
    }
    return next;
  }

 private:
  const Rival& rival_;
  MeanInnovations& filter_;
  const InputSequence& sequence_;
  const Outputs& outputs_;
  std::vector<std::size_t> free_;
};

Expansion descend(Fit& fit, const std::vector<double>& start, int steps) {
  Expansion best = fit.expand(start);
  double damping = 1e-3;
  for (int step = 0; step < steps && std::isfinite(best.total); ++step) {
    Expansion next = fit.expand(fit.step(best, damping));
    if (next.total < best.total) {
      const bool done = best.total - next.total < 1e-3 * next.total || best.total < 1e-3;
      best = std::move(next);
      damping *= 0.1;
      if (done) break;
    } else {
      damping *= 30;
    }
  }
  return best;
}

}  // namespace

Refit refit(const Rival& rival, MeanInnovations& filter, const InputSequence& sequence, const Outputs& outputs,
            const std::vector<double>& start, int steps) {
  Fit fit(rival, filter, sequence, outputs);
  Expansion best = descend(fit, start, steps);
  std::vector<double> rigid = start;
  for (std::size_t i = 0; i < rigid.size(); ++i)
    if (rival.stiff[i]) rigid[i] = std::clamp(kStiffer * rival.value[i], rival.low[i], rival.high[i]);
  if (rigid != start) {  // a slope does not lead there: a spring's falls with the square of its stiffness
    const Expansion other = descend(fit, rigid, steps);
    if (other.total < best.total || !std::isfinite(best.total)) best = other;
  }
  return {best.params, best.squares};
}

}  // namespace tiller::tools::gap
