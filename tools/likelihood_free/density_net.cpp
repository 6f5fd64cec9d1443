#include "tools/likelihood_free/density_net.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/rng.hpp"
#include "tools/nets/adam.hpp"

namespace tiller::tools {
namespace {

using nets::Matrix;
using nets::Vector;
using Index = std::vector<Eigen::Index>;

constexpr std::uint32_t kRngShuffle = 82;  // purpose (core/rng.hpp)

void shuffle(Index& index, Rng& rng) {
  for (std::size_t k = index.size(); k > 1; --k)
    std::swap(index[k - 1], index[rng.below(static_cast<std::uint32_t>(k))]);
}

/// Weights of the least loss so far, and when to go slower.
struct Best {
  Vector weights;
  double loss = std::numeric_limits<double>::infinity();
  int since = 0, slowed = 0;
};

}  // namespace

Features Features::at(const Index& index) const {
  Features out;
  if (fixed.rows() > 0) out.fixed = fixed(Eigen::all, index);
  for (const Matrix& step : sequence) out.sequence.push_back(step(Eigen::all, index));
  return out;
}

Vector DensityNet::weights() const {
  Vector all(gru_.weights.size() + mlp_.weights.size());
  all << gru_.weights, mlp_.weights;
  return all;
}

void DensityNet::set_weights(const Vector& all) {
  gru_.weights = all.head(gru_.weights.size());
  mlp_.weights = all.tail(mlp_.weights.size());
}

/// Loss over standardised targets; `gradient`, if not null, gets its derivatives by weights().
double DensityNet::step(const Features& features, const Matrix& target, Vector* gradient) const {
  const bool recurrent = !features.sequence.empty();
  nets::Gru::Tape time;
  if (recurrent) gru_.forward(features.sequence, time);
  const Eigen::Index fixed = features.fixed.rows();
  Matrix x(mlp_.inputs(), features.count());
  if (fixed > 0) x.topRows(fixed) = in_.apply(features.fixed);
  if (recurrent) x.bottomRows(time.output.rows()) = time.output;
  nets::Mlp::Tape tape;
  mlp_.forward(x, tape);
  Matrix by_output, by_x;
  const double loss = head_.loss(tape.output(), target, gradient ? &by_output : nullptr);
  if (!gradient) return loss;
  Vector by_mlp = Vector::Zero(mlp_.weights.size()), by_gru = Vector::Zero(gru_.weights.size());
  mlp_.backward(tape, by_output, by_mlp, recurrent ? &by_x : nullptr);
  if (recurrent) gru_.backward(time, by_x.bottomRows(time.output.rows()), by_gru);
  gradient->resize(by_gru.size() + by_mlp.size());
  *gradient << by_gru, by_mlp;
  return loss;
}

double DensityNet::train(const Features& features, const Matrix& v, const DensityNetOptions& o) {
  Rng rng(o.seed, kRngShuffle, 0);
  Index order(static_cast<std::size_t>(v.cols()));
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = static_cast<Eigen::Index>(k);
  shuffle(order, rng);
  const auto kept = static_cast<std::ptrdiff_t>(std::max<std::size_t>(1, order.size() / 10));
  const Index back(order.begin(), order.begin() + kept);
  Index used(order.begin() + kept, order.end());
  out_ = nets::Standardiser::of(v(Eigen::all, used));
  if (features.fixed.rows() > 0) in_ = nets::Standardiser::of(features.fixed(Eigen::all, used));
  head_ = {static_cast<int>(v.rows()), o.components};
  const bool recurrent = !features.sequence.empty();
  gru_ = recurrent ? nets::Gru(static_cast<int>(features.sequence[0].rows()), o.states) : nets::Gru();
  if (recurrent) gru_.randomise(o.seed + 1);
  mlp_ = nets::Mlp({static_cast<int>(features.fixed.rows()) + gru_.outputs(), o.hidden, o.hidden, head_.outputs()});
  mlp_.randomise(o.seed, 0.3);
  const Matrix target = out_.apply(v);
  const Features kept_back = features.at(back);
  const Matrix kept_target = target(Eigen::all, back);
  nets::Adam adam;
  adam.rate = o.rate;
  Best best;
  for (int epoch = 0; epoch < o.epochs && best.slowed < 3; ++epoch) {
    shuffle(used, rng);
    for (std::size_t from = 0; from < used.size(); from += static_cast<std::size_t>(o.batch)) {
      const std::size_t to = std::min(used.size(), from + static_cast<std::size_t>(o.batch));
      const Index batch(used.begin() + static_cast<std::ptrdiff_t>(from),
                        used.begin() + static_cast<std::ptrdiff_t>(to));
      Vector gradient, all = weights();
      step(features.at(batch), target(Eigen::all, batch), &gradient);
      gradient *= std::min(1.0, 5.0 / (gradient.norm() + 1e-300));  // one draw in a tail must not undo an epoch
      adam.step(all, gradient);
      set_weights(all);
    }
    const double loss = step(kept_back, kept_target, nullptr);
    if (loss < best.loss)
      best.weights = weights(), best.loss = loss, best.since = 0;
    else if (++best.since >= o.patience)
      adam.rate /= 3.0, best.since = 0, ++best.slowed, set_weights(best.weights);
  }
  set_weights(best.weights);
  return best.loss + out_.sd.array().log().sum();
}

double DensityNet::loss(const Features& features, const Matrix& v) const {
  return step(features, out_.apply(v), nullptr) + out_.sd.array().log().sum();
}

nets::NormalMixture DensityNet::at(const Features& one) const {
  const bool recurrent = !one.sequence.empty();
  Matrix x(mlp_.inputs(), 1);
  if (one.fixed.rows() > 0) x.topRows(one.fixed.rows()) = in_.apply(one.fixed);
  if (recurrent) {
    nets::Gru::Tape time;
    gru_.forward(one.sequence, time);
    x.bottomRows(time.output.rows()) = time.output;
  }
  nets::NormalMixture mixture = head_.mixture(mlp_.evaluate(x).col(0));
  mixture.mean = out_.revert(mixture.mean);
  for (Matrix& c : mixture.covariance) c = out_.sd.asDiagonal() * c * out_.sd.asDiagonal();
  return mixture;
}

}  // namespace tiller::tools
