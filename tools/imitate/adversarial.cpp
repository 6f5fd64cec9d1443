#include "tools/imitate/adversarial.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools::imitate {
namespace {

using nets::Adam;
using nets::Mlp;

constexpr int kHidden = 24;

/// All demonstrated pairs of state and input, a column each.
struct Pairs {
  Matrix state, input;
  explicit Pairs(const std::vector<Motion>& motions) {
    Eigen::Index count = 0, at = 0;
    for (const Motion& m : motions) count += m.steps();
    state.resize(motions[0].state.rows(), count);
    input.resize(motions[0].input.rows(), count);
    for (const Motion& m : motions) {
      state.middleCols(at, m.steps()) = m.state.leftCols(m.steps());
      input.middleCols(at, m.steps()) = m.input;
      at += m.steps();
    }
  }
};

Matrix stack(const Matrix& above, const Matrix& below) {
  Matrix both(above.rows() + below.rows(), above.cols());
  both << above, below;
  return both;
}

SmallPolicy make_policy(const Scene& scene, const Observer& observer, const Pairs& pairs, std::uint64_t seed) {
  SmallPolicy policy;
  policy.mlp = Mlp({static_cast<int>(observer.rows), kHidden, kHidden, static_cast<int>(scene.nu())});
  policy.mlp.randomise(seed, 0.1);
  policy.scale = nets::Standardiser::of(observer.of(pairs.state));
  policy.centre = policy.reach = Vector(scene.nu());
  for (std::uint32_t i = 0; i < scene.nu(); ++i) {
    const double low = scene.config.safety.input_low[i], high = scene.config.safety.input_high[i];
    policy.centre(i) = 0.5 * (low + high);
    policy.reach(i) = 0.5 * (high - low);
  }
  return policy;
}

/// Forward pass of the policy that remembers what its backward pass needs.
struct PolicyTape {
  Mlp::Tape tape;
  Matrix input;
  PolicyTape(const SmallPolicy& policy, const Observer& observer, const Matrix& state) {
    policy.mlp.forward(policy.scale.apply(observer.of(state)), tape);
    const auto v = tape.output().array();
    const Matrix share = (9 * v.sin() + (3 * v).sin()) / 8;
    input = (policy.reach.asDiagonal() * share).colwise() + policy.centre;
  }
  /// Adds to the weights' gradient; returns the derivatives by the state (nx x columns).
  Matrix back(const SmallPolicy& policy, const Observer& observer, const Matrix& state, const Matrix& by_input,
              Vector& gradient) const {
    const Matrix scaled = policy.reach.asDiagonal() * by_input;
    const auto v = tape.output().array();
    const Matrix by_output = scaled.array() * (9 * v.cos() + 3 * (3 * v).cos()) / 8;
    Matrix by_observed;
    policy.mlp.backward(tape, by_output, gradient, &by_observed);
    by_observed.array().colwise() /= policy.scale.sd.array();
    return observer.back(state, by_observed);
  }
};

class Adversary {
 public:
  Adversary(const Scene& scene, const std::vector<Motion>& motions, const AdversarialOptions& options)
      : scene_(scene),
        motions_(motions),
        options_(options),
        observer_(scene),
        pairs_(motions),
        rng_(options.seed, kRngRollouts, 11) {
    for (const Motion& m : motions) options_.steps = std::min(options_.steps, static_cast<int>(m.steps()));
    fit_.policy = options.clone_first ? clone_behaviour(scene, motions, options.seed)
                                      : make_policy(scene, observer_, pairs_, options.seed);
    const Matrix all = stack(observer_.of(pairs_.state), pairs_.input);
    fit_.critic_scale = nets::Standardiser::of(all);
    for (const Motion& m : motions) {
      const Matrix seen = stack(observer_.of(m.state.leftCols(m.steps())), m.input);
      demonstrated_.push_back(fit_.critic_scale.apply(seen));
    }
    fit_.critic = Mlp({static_cast<int>(all.rows()), kHidden, kHidden, 1});
    fit_.critic.randomise(options.seed + 1, 0.1);
    policy_adam_.rate = options.policy_rate;
    policy_adam_.beta1 = 0.8;
    critic_adam_.rate = options.critic_rate;
    critic_adam_.beta1 = 0.5;
  }

  AdversarialFit run() {
    average_ = fit_.policy.mlp.weights;
    for (int i = 0; i < options_.iterations; ++i) {
      const double left = 1 - static_cast<double>(i) / options_.iterations;
      policy_adam_.rate = options_.policy_rate * (0.05 + 0.95 * left);
      roll();
      const int critic_steps = (options_.wasserstein ? 2 : 1) * options_.critic_steps;
      for (int c = 0; c < critic_steps; ++c) improve_critic();
      improve_policy();
      average_ += 0.02 * (fit_.policy.mlp.weights - average_);
    }
    fit_.policy.mlp.weights = average_;  // the two sides circle around the equilibrium
    return fit_;
  }

 private:
  /// Rollouts from demonstrated states, and what was demonstrated over the same periods: an expert's rollouts are then
  /// the demonstrations, and no critic could tell them apart. Beside all that was demonstrated, rollouts that begin
  /// late would be told by their lacking beginnings.
  void roll() {
    Matrix start(scene_.nx(), options_.batch);
    shown_.resize(fit_.critic.inputs(), Eigen::Index{options_.steps} * options_.batch);
    for (Eigen::Index j = 0; j < start.cols(); ++j) {
      const std::size_t d = rng_.below(static_cast<std::uint32_t>(motions_.size()));
      const Eigen::Index last = motions_[d].steps() - options_.steps;
      const Eigen::Index first = rng_.below(static_cast<std::uint32_t>(last + 1));
      start.col(j) = motions_[d].state.col(first);
      shown_.middleCols(j * options_.steps, options_.steps) = demonstrated_[d].middleCols(first, options_.steps);
    }
    states_ = roll_policy(scene_, fit_.policy, start, options_.steps, &inputs_);
    made_.resize(shown_.rows(), shown_.cols());
    for (int k = 0; k < options_.steps; ++k)
      made_.middleCols(Eigen::Index{k} * options_.batch, options_.batch) = seen(k);
  }
  Matrix seen(int k) const {
    const auto at = static_cast<std::size_t>(k);
    const Matrix all = fit_.critic_scale.apply(stack(observer_.of(states_[at]), inputs_[at]));
    return all.cwiseMax(-20).cwiseMin(20);
  }

  Matrix draw(const Matrix& from, int count) {
    Matrix out(from.rows(), count);
    for (Eigen::Index j = 0; j < count; ++j) {
      out.col(j) = from.col(rng_.below(static_cast<std::uint32_t>(from.cols())));
      for (Eigen::Index i = 0; i < out.rows(); ++i) out(i, j) += options_.noise * rng_.normal();
    }
    return out;
  }

  void improve_critic() {
    constexpr int kCount = 128;
    const Matrix shown = draw(shown_, kCount), made = draw(made_, kCount);
    Mlp::Tape of_shown, of_made;
    Mlp& critic = fit_.critic;
    critic.forward(shown, of_shown);
    critic.forward(made, of_made);
    Vector gradient = Vector::Zero(critic.weights.size());
    Matrix up = Matrix::Constant(1, kCount, -1.0 / kCount), down = -up;
    if (!options_.wasserstein) {
      up.array() /= 1 + of_shown.output().array().exp();
      down.array() /= 1 + (-of_made.output().array()).exp();
    }
    critic.backward(of_shown, up, gradient);
    critic.backward(of_made, down, gradient);
    add_penalty(shown, made, gradient);
    critic_adam_.step(critic.weights, gradient);
    last_gap_ = of_shown.output().mean() - of_made.output().mean();
  }

  /// (|slope| - 1)^2 between the sides, or |slope|^2 for GAIL. Its gradient takes the derivative by the weights of the
  /// slope along a direction: the central difference of two backward passes, exact to 1e-8.
  void add_penalty(const Matrix& shown, const Matrix& made, Vector& gradient) {
    Matrix between = shown;
    for (Eigen::Index j = 0; j < between.cols(); ++j) between.col(j) += rng_.uniform() * (made.col(j) - shown.col(j));
    const Mlp& critic = fit_.critic;
    Mlp::Tape tape;
    critic.forward(between, tape);
    Matrix slope;
    Vector unused = Vector::Zero(gradient.size());
    critic.backward(tape, Matrix::Ones(1, between.cols()), unused, &slope);
    const double strength = options_.wasserstein ? options_.penalty : options_.penalty / 200;
    Matrix pull(1, between.cols());
    for (Eigen::Index j = 0; j < between.cols(); ++j) {
      const double length = std::max(slope.col(j).norm(), 1e-9);
      pull(0, j) = 2 * strength * (options_.wasserstein ? length - 1 : length) / static_cast<double>(between.cols());
      slope.col(j) /= length;
    }
    constexpr double kStep = 1e-4;
    for (const double side : {1.0, -1.0}) {
      critic.forward(between + side * kStep * slope, tape);
      critic.backward(tape, pull * (side / (2 * kStep)), gradient);
    }
  }

  /// Adjoints backward through model and policy; each rollout's are cut to a multiple of all slopes that they are made
  /// of, since an unstable motion's grow without bound.
  void improve_policy() {
    constexpr double kLongest = 5;
    const SmallPolicy& policy = fit_.policy;
    Vector gradient = Vector::Zero(policy.mlp.weights.size());
    Matrix ahead = Matrix::Zero(scene_.nx(), options_.batch);
    Vector slopes = Vector::Zero(options_.batch);
    for (int k = options_.steps; k-- > 0;) {
      const Matrix& x = states_[static_cast<std::size_t>(k)];
      const PolicyTape tape(policy, observer_, x);
      Matrix by_seen = critic_slope(seen(k));
      by_seen.array().colwise() /= fit_.critic_scale.sd.array();
      Matrix a, b, by_input = by_seen.bottomRows(scene_.nu());
      Matrix by_state = observer_.back(x, by_seen.topRows(observer_.rows));
      slopes += by_seen.colwise().norm().transpose();
      (void)scene_.step(x, tape.input, &a, &b);
      for (Eigen::Index j = 0; j < x.cols(); ++j)
        for (std::uint32_t r = 0; r < scene_.nx(); ++r) {
          for (std::uint32_t c = 0; c < scene_.nx(); ++c) by_state(c, j) += a(r * scene_.nx() + c, j) * ahead(r, j);
          for (std::uint32_t i = 0; i < scene_.nu(); ++i) by_input(i, j) += b(r * scene_.nu() + i, j) * ahead(r, j);
        }
      ahead = by_state + tape.back(policy, observer_, x, by_input, gradient);
      for (Eigen::Index j = 0; j < ahead.cols(); ++j) {
        const double length = ahead.col(j).norm(), longest = kLongest * slopes(j);
        if (!(length <= longest)) ahead.col(j) *= std::isfinite(length) ? longest / length : 0;
      }
    }
    fit_.gap.push_back(last_gap_);
    if (!gradient.allFinite()) return;
    gradient /= options_.batch * options_.steps;
    policy_adam_.step(fit_.policy.mlp.weights, gradient);
  }

  /// Derivatives of the policy's cost, -log D or minus the potential, by what the critic sees.
  Matrix critic_slope(const Matrix& seen) const {
    Mlp::Tape tape;
    fit_.critic.forward(seen, tape);
    Matrix by_output = Matrix::Constant(1, seen.cols(), -1);
    if (!options_.wasserstein) by_output.array() /= 1 + tape.output().array().exp();
    Matrix by_input;
    Vector unused = Vector::Zero(fit_.critic.weights.size());
    fit_.critic.backward(tape, by_output, unused, &by_input);
    return by_input;
  }

  const Scene& scene_;
  const std::vector<Motion>& motions_;
  AdversarialOptions options_;
  Observer observer_;
  Pairs pairs_;
  Rng rng_;
  AdversarialFit fit_;
  Adam policy_adam_, critic_adam_;
  Vector average_;
  std::vector<Matrix> demonstrated_;  // scaled, a column each
  Matrix shown_, made_;               // of this iteration
  std::vector<Matrix> states_, inputs_;
  double last_gap_ = 0;
};

}  // namespace

Observer::Observer(const Scene& scene) : angles(scene.config.model->angle_mask), nx(scene.nx()) {
  for (Eigen::Index i = 0; i < nx; ++i) rows += angles >> i & 1u ? 2 : 1;
}

Matrix Observer::of(const Matrix& state) const {
  Matrix seen(rows, state.cols());
  for (Eigen::Index i = 0, r = 0; i < nx; ++i) {
    if (angles >> i & 1u) {
      seen.row(r++) = state.row(i).array().sin();
      seen.row(r++) = state.row(i).array().cos();
    } else {
      seen.row(r++) = state.row(i);
    }
  }
  return seen;
}

Matrix Observer::back(const Matrix& state, const Matrix& by_observed) const {
  Matrix by(nx, state.cols());
  for (Eigen::Index i = 0, r = 0; i < nx; ++i) {
    by.row(i) = by_observed.row(r++);
    if (!(angles >> i & 1u)) continue;
    by.row(i) =
        by.row(i).array() * state.row(i).array().cos() - by_observed.row(r++).array() * state.row(i).array().sin();
  }
  return by;
}

Matrix SmallPolicy::input(const Observer& observer, const Matrix& state) const {
  return PolicyTape(*this, observer, state).input;
}

SmallPolicy clone_behaviour(const Scene& scene, const std::vector<Motion>& motions, std::uint64_t seed) {
  const Observer observer(scene);
  const Pairs pairs(motions);
  SmallPolicy policy = make_policy(scene, observer, pairs, seed);
  Adam adam;
  adam.rate = 5e-3;
  for (int i = 0; i < 2000; ++i) {
    const PolicyTape tape(policy, observer, pairs.state);
    Vector gradient = Vector::Zero(policy.mlp.weights.size());
    const Vector squares = policy.reach.array().square() * static_cast<double>(pairs.input.cols());
    Matrix miss = tape.input - pairs.input;
    miss.array().colwise() /= squares.array();
    (void)tape.back(policy, observer, pairs.state, miss, gradient);
    adam.step(policy.mlp.weights, gradient);
  }
  return policy;
}

AdversarialFit fit_adversarial(const Scene& scene, const std::vector<Motion>& motions,
                               const AdversarialOptions& options) {
  return Adversary(scene, motions, options).run();
}

std::vector<Matrix> roll_policy(const Scene& scene, const SmallPolicy& policy, const Matrix& start, int steps,
                                std::vector<Matrix>* inputs) {
  const Observer observer(scene);
  std::vector<Matrix> states = {start};
  if (inputs) inputs->clear();
  for (int k = 0; k < steps; ++k) {
    const Matrix u = policy.input(observer, states.back());
    if (inputs) inputs->push_back(u);
    states.push_back(scene.step(states.back(), u));
  }
  return states;
}

}  // namespace tiller::tools::imitate
