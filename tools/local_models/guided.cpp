#include "tools/local_models/guided.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "core/rng.hpp"
#include "tools/nets/adam.hpp"
#include "tools/nets/standardise.hpp"

namespace tiller::tools::local {
namespace {

using policy::Trial;

constexpr std::uint32_t kRngGuided = 98;  // purpose of random numbers (core/rng.hpp)

/// A condition's laws and what they were last seen to do.
struct Local {
  LawSequence laws;
  std::vector<Trial> trials;
  std::vector<Vector> mean;  ///< (nx) of the samples at each step
};

class Guided {
 public:
  Guided(const policy::SearchTask& task, const std::vector<Condition>& conditions, const GuidedOptions& options)
      : task_(task), conditions_(conditions), options_(options), nx_(task.states), nu_(task.commands()) {}

  bool run(const GuidedProgress& after, const volatile std::sig_atomic_t& stop, GuidedResult& result,
           std::string& error) {
    begin(result);
    for (int i = 0; i < options_.iterations; ++i) {
      GuidedStep step;
      for (std::size_t c = 0; c < conditions_.size(); ++c) {
        if (stop) {
          result.interrupted = true;
          return true;
        }
        if (!sample(c, i, step, error) || !improve(c, i, result, step, error)) return false;
      }
      learn(result, i);
      for (std::size_t c = 0; c < conditions_.size(); ++c)
        if (!judge(c, i, result.policy, step, error)) return false;
      result.steps.push_back(step);
      if (after) after(step, i);
    }
    return true;
  }

 private:
  void begin(GuidedResult& result) {
    const Vector sd = options_.first_noise * (task_.high - task_.low);
    result = {};
    result.noise = sd.cwiseAbs2().asDiagonal();
    policy::Policy& p = result.policy;
    p.kind = "tanh";
    p.sine = false;
    p.low = task_.low;
    p.high = task_.high;
    const auto all = policy::all_features(task_.states, task_.angles);
    for (const int i : task_.policy_inputs) p.features.push_back(all[static_cast<std::size_t>(i)]);
    locals_.assign(conditions_.size(), {});
    const LinearLaw first{Matrix::Zero(nu_, nx_), Vector::Zero(nu_), result.noise};
    for (Local& local : locals_) local.laws.assign(static_cast<std::size_t>(task_.horizon), first);
  }

  double cost_of(const Trial& trial) const {
    double sum = 0;
    for (Eigen::Index k = 0; k <= trial.command.cols(); ++k) {
      const bool last = k == trial.command.cols();
      const Vector d = trial.truth.col(k) - options_.target;
      sum += 0.5 * d.dot((last ? options_.terminal_weight : options_.state_weight) * d);
      if (!last) sum += 0.5 * trial.command.col(k).dot(options_.input_weight * trial.command.col(k));
    }
    return sum;
  }

  /// Runs a condition under its laws.
  bool sample(std::size_t c, int iteration, GuidedStep& step, std::string& error) {
    Local& local = locals_[c];
    local.trials.assign(static_cast<std::size_t>(options_.samples), {});
    for (int s = 0; s < options_.samples; ++s) {
      const int index = iteration * options_.samples + s;
      Rng rng(options_.seed, kRngGuided, c * 1000000 + static_cast<std::uint64_t>(index));
      const policy::Controller controller = [&](const Vector& x, int k) {
        const LinearLaw& law = local.laws[static_cast<std::size_t>(k)];
        Vector z(nu_);
        for (Eigen::Index i = 0; i < nu_; ++i) z(i) = rng.normal();
        const Vector u = law.mean(x) + Eigen::LLT<Matrix>(law.noise).matrixL() * z;
        return Vector(u.cwiseMax(task_.low).cwiseMin(task_.high));
      };
      Trial& trial = local.trials[static_cast<std::size_t>(s)];
      if (!conditions_[c].run(controller, index, trial, error)) return false;
      step.local_cost += cost_of(trial) / static_cast<double>(options_.samples * static_cast<int>(conditions_.size()));
    }
    local.mean.assign(static_cast<std::size_t>(task_.horizon) + 1, Vector::Zero(nx_));
    for (int k = 0; k <= task_.horizon; ++k)
      for (const Trial& trial : local.trials)
        local.mean[static_cast<std::size_t>(k)] += trial.measured.col(k) / static_cast<double>(options_.samples);
    return true;
  }

  Matrix transitions(const Local& local, int k) const {
    Matrix z(2 * nx_ + nu_, static_cast<Eigen::Index>(local.trials.size()));
    for (std::size_t s = 0; s < local.trials.size(); ++s)
      z.col(static_cast<Eigen::Index>(s)) << local.trials[s].measured.col(k), local.trials[s].command.col(k),
          local.trials[s].measured.col(k + 1);
    return z;
  }

  std::vector<LinearStep> fit(const Local& local) const {
    std::vector<LinearStep> models;
    for (int k = 0; k < task_.horizon; ++k) {
      const TransitionMoments data = TransitionMoments::of(transitions(local, k));
      Matrix spread = data.covariance.topLeftCorner(nx_ + nu_, nx_ + nu_).diagonal().asDiagonal();
      spread.diagonal().array() += 1e-6;
      const TransitionPrior prior = prior_of_physics(task_.physics, static_cast<int>(nx_), data.mean.head(nx_ + nu_),
                                                     spread, 1e-4 * spread.topLeftCorner(nx_, nx_), options_.strength);
      models.push_back(fit_step(data, prior, static_cast<int>(nx_), 1e-9));
    }
    return models;
  }

  std::vector<QuadraticCost> costs() const {
    std::vector<QuadraticCost> all;
    for (int k = 0; k <= task_.horizon; ++k) {
      const bool last = k == task_.horizon;
      const Matrix& q = last ? options_.terminal_weight : options_.state_weight;
      QuadraticCost cost{Matrix::Zero(nx_ + (last ? 0 : nu_), nx_ + (last ? 0 : nu_)),
                         Vector::Zero(nx_ + (last ? 0 : nu_))};
      cost.hessian.topLeftCorner(nx_, nx_) = q;
      if (!last) cost.hessian.bottomRightCorner(nu_, nu_) = options_.input_weight;
      cost.slope.head(nx_) = -q * options_.target;
      all.push_back(cost);
    }
    return all;
  }

  /// The network about the samples' means; before there is one, the laws themselves.
  LawSequence policy_about(const Local& local, const GuidedResult& result) const {
    if (result.policy.net.widths().empty()) return local.laws;
    LawSequence laws;
    for (int k = 0; k < task_.horizon; ++k) {
      const Vector& x = local.mean[static_cast<std::size_t>(k)];
      Matrix gain(nu_, nx_);
      const double h = 1e-5;
      for (Eigen::Index i = 0; i < nx_; ++i) {
        Vector above = x, below = x;
        above(i) += h;
        below(i) -= h;
        gain.col(i) = (raw(result.policy, above) - raw(result.policy, below)) / (2.0 * h);
      }
      laws.push_back({gain, raw(result.policy, x) - gain * x, result.noise});
    }
    return laws;
  }
  /// The network's command, not cut.
  static Vector raw(const policy::Policy& p, const Vector& x) {
    const Vector out = p.net.evaluate(p.features_of(x));
    return 0.5 * (p.low + p.high + (p.high - p.low).cwiseProduct(out));
  }

  bool improve(std::size_t c, int, const GuidedResult& result, GuidedStep& step, std::string& error) {
    Local& local = locals_[c];
    const std::vector<LinearStep> models = fit(local);
    const LawSequence before = policy_about(local, result);
    Matrix start = 1e-4 * Matrix::Identity(nx_, nx_);
    for (const Trial& trial : local.trials) {
      const Vector away = trial.measured.col(0) - local.mean[0];
      start += away * away.transpose() / static_cast<double>(local.trials.size());
    }
    KlStep found;
    if (!kl_lqr(models, costs(), before, local.mean[0], start, options_.epsilon * task_.horizon, local.laws, found)) {
      error =
          "guided: condition " + std::to_string(c + 1) + ": no laws within epsilon of the policy; raise it (--epsilon)";
      return false;
    }
    step.divergence += found.divergence / task_.horizon / static_cast<double>(conditions_.size());
    return true;
  }

  /// The network to all laws; its covariance to their precisions.
  void learn(GuidedResult& result, int iteration) {
    const auto count = static_cast<Eigen::Index>(conditions_.size() * static_cast<std::size_t>(options_.samples) *
                                                 static_cast<std::size_t>(task_.horizon));
    Matrix input(static_cast<Eigen::Index>(task_.policy_inputs.size()), count), wanted(nu_, count);
    std::vector<Matrix> precision;
    Matrix total = Matrix::Zero(nu_, nu_);
    Eigen::Index at = 0;
    for (const Local& local : locals_)
      for (int k = 0; k < task_.horizon; ++k) {
        const LinearLaw& law = local.laws[static_cast<std::size_t>(k)];
        const Matrix sharp = law.noise.llt().solve(Matrix::Identity(nu_, nu_));
        for (const Trial& trial : local.trials) {
          input.col(at) = result.policy.features_of(trial.measured.col(k));
          wanted.col(at++) = law.mean(trial.measured.col(k)).cwiseMax(task_.low).cwiseMin(task_.high);
          precision.push_back(sharp);
          total += sharp / static_cast<double>(count);
        }
      }
    result.noise = total.llt().solve(Matrix::Identity(nu_, nu_));
    regress(input, wanted, precision, iteration, result.policy.net);
  }

  void regress(const Matrix& input, const Matrix& wanted, const std::vector<Matrix>& precision, int iteration,
               nets::Mlp& net) {
    const nets::Standardiser in = nets::Standardiser::of(input);
    const Vector scale = 0.5 * (task_.high - task_.low);
    std::vector<int> widths = {static_cast<int>(input.rows())};
    widths.insert(widths.end(), options_.hidden.begin(), options_.hidden.end());
    widths.push_back(static_cast<int>(nu_));
    nets::Mlp fresh(widths);
    fresh.randomise(options_.seed + static_cast<std::uint64_t>(iteration), 0.1);
    const Matrix z = in.apply(input),
                 target = scale.cwiseInverse().asDiagonal() * (wanted.colwise() - 0.5 * (task_.low + task_.high));
    double mean_precision = 0;
    for (const Matrix& p : precision)
      mean_precision += (scale.asDiagonal() * p * scale.asDiagonal()).trace() / static_cast<double>(precision.size());
    nets::Adam adam;
    for (int s = 0; s < options_.steps; ++s) {
      adam.rate = 1e-2 * (1.0 - static_cast<double>(s) / options_.steps) + 1e-4;
      nets::Mlp::Tape tape;
      fresh.forward(z, tape);
      Matrix by = tape.output() - target;
      for (Eigen::Index i = 0; i < by.cols(); ++i)
        by.col(i) = scale.asDiagonal() * (precision[static_cast<std::size_t>(i)] * (scale.asDiagonal() * by.col(i))) /
                    (mean_precision * static_cast<double>(by.cols()));
      Vector gradient = Vector::Zero(fresh.weights.size());
      fresh.backward(tape, by, gradient);
      adam.step(fresh.weights, gradient);
    }
    nets::absorb_input_scale(fresh, in.mean, in.sd);
    net = fresh;
  }

  bool judge(std::size_t c, int iteration, const policy::Policy& p, GuidedStep& step, std::string& error) const {
    Trial trial;
    const policy::Controller controller = [&p](const Vector& x, int) { return p.command(x); };
    if (!conditions_[c].run(controller, 900000 + iteration, trial, error)) return false;
    step.policy_cost += cost_of(trial) / static_cast<double>(conditions_.size());
    return true;
  }

  const policy::SearchTask& task_;
  const std::vector<Condition>& conditions_;
  const GuidedOptions& options_;
  Eigen::Index nx_, nu_;
  std::vector<Local> locals_;
};

}  // namespace

bool guided_search(const policy::SearchTask& task, const std::vector<Condition>& conditions,
                   const GuidedOptions& options, const GuidedProgress& after, const volatile std::sig_atomic_t& stop,
                   GuidedResult& result, std::string& error) {
  if (!task.physics || conditions.empty()) {
    error = "guided: needs a model for the priors and at least one start";
    return false;
  }
  return Guided(task, conditions, options).run(after, stop, result, error);
}

}  // namespace tiller::tools::local
