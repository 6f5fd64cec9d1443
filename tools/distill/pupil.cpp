#include "tools/distill/pupil.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/rng.hpp"
#include "tools/base/text.hpp"
#include "tools/nets/adam.hpp"
#include "tools/nets/standardise.hpp"

namespace tiller::tools::distill {
namespace {

using nets::Matrix;
using nets::Vector;

constexpr std::uint32_t kPurpose = 0x646f, kHeldOutOf = 10;
constexpr Eigen::Index kBatch = 256;
constexpr double kCorner = 0.2, kLastRate = 0.05;

std::vector<int> widths_of(std::size_t inputs, const std::vector<int>& hidden, std::size_t outputs) {
  std::vector<int> widths = {static_cast<int>(inputs)};
  widths.insert(widths.end(), hidden.begin(), hidden.end());
  widths.push_back(static_cast<int>(outputs));
  return widths;
}

/// The error of an answer that is cut to [-1, 1], with the sign of what would mend it: none where both are beyond.
double error_of(double answer, double wanted) {
  const bool same_limit = (wanted >= 1.0 && answer > 1.0) || (wanted <= -1.0 && answer < -1.0);
  return same_limit ? 0.0 : answer - wanted;
}

/// Derivative of Huber's loss by each answer, over the batch's size.
Matrix slopes(const Matrix& answers, const Matrix& wanted) {
  Matrix slope(answers.rows(), answers.cols());
  for (Eigen::Index i = 0; i < answers.size(); ++i)
    slope(i) = std::clamp(error_of(answers(i), wanted(i)), -kCorner, kCorner) / static_cast<double>(answers.cols());
  return slope;
}

double rms(const Matrix& answers, const Matrix& wanted) {
  if (answers.size() == 0) return NAN;
  double sum = 0.0;
  for (Eigen::Index i = 0; i < answers.size(); ++i) {
    const double off = std::clamp(answers(i), -1.0, 1.0) - wanted(i);
    sum += off * off;
  }
  return std::sqrt(sum / static_cast<double>(answers.size()));
}

Matrix columns(const Matrix& x, const Eigen::Index* first, Eigen::Index count) {
  Matrix part(x.rows(), count);
  for (Eigen::Index i = 0; i < count; ++i) part.col(i) = x.col(first[i]);
  return part;
}

void shuffle(std::vector<Eigen::Index>& order, Rng& rng) {
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1], order[rng.below(static_cast<std::uint32_t>(i))]);
}

double rate_at(const StudyOptions& options, std::uint32_t epoch) {
  const double done = static_cast<double>(epoch) / std::max(options.epochs, 1u);
  return options.rate * (kLastRate + (1.0 - kLastRate) * 0.5 * (1.0 + std::cos(3.141592653589793 * done)));
}

}  // namespace

std::string error_text(const StudyError& error) {
  return std::isfinite(error.held_out) ? format("%.3f", error.held_out) : "-";
}

Pupil::Pupil(const RobotFile& robot, std::uint32_t reads, std::vector<int> hidden, std::uint64_t seed) {
  shape_.reads = reads;
  shape_.network.inputs = policy_inputs(robot, reads);
  shape_.network.outputs = robot.inputs;
  for (std::size_t l = 0; l < hidden.size() && l < 2; ++l)
    shape_.network.hidden[l] = static_cast<std::uint32_t>(hidden[l]);
  mlp_ = nets::Mlp(widths_of(shape_.network.inputs.size(), hidden, robot.inputs.size()));
  mlp_.randomise(seed, 0.1);
}

StudyError Pupil::errors(const Matrix& x, const Matrix& y, const std::vector<Eigen::Index>& trained,
                         const std::vector<Eigen::Index>& held_out) const {
  const auto error = [&](const std::vector<Eigen::Index>& rows) {
    const auto n = static_cast<Eigen::Index>(rows.size());
    return rms(mlp_.evaluate(columns(x, rows.data(), n)), columns(y, rows.data(), n));
  };
  return {error(trained), error(held_out), 0};
}

StudyError Pupil::study(const Examples& examples, const StudyOptions& options) {
  const auto n = static_cast<Eigen::Index>(examples.count());
  const Matrix raw = Eigen::Map<const Matrix>(examples.in.data(), mlp_.inputs(), n);
  const Matrix y = Eigen::Map<const Matrix>(examples.share.data(), mlp_.outputs(), n);
  if (mean_.size() == 0) {  // kept from then on: the weights go on from where they are
    const nets::Standardiser scale = nets::Standardiser::of(raw);
    mean_ = scale.mean;
    sd_ = scale.sd;
  }
  const Matrix x = nets::Standardiser{mean_, sd_}.apply(raw);
  const Vector low = raw.rowwise().minCoeff(), high = raw.rowwise().maxCoeff();
  low_.assign(low.data(), low.data() + low.size());
  high_.assign(high.data(), high.data() + high.size());
  // a posterior may know better than any that was shown
  for (std::size_t i = 0; i < low_.size(); ++i)
    if (shape_.network.inputs[i].rfind("sd ", 0) == 0) low_[i] = 0.0f;
  std::vector<Eigen::Index> trained, held_out;
  for (Eigen::Index i = 0; i < n; ++i)
    (examples.of[static_cast<std::size_t>(i)] % kHeldOutOf == kHeldOutOf - 1 ? held_out : trained).push_back(i);

  Rng rng(options.seed, kPurpose, 0);
  nets::Adam adam;
  Vector best = mlp_.weights, gradient(mlp_.weights.size());
  StudyError least{0, std::numeric_limits<double>::infinity(), 0};
  nets::Mlp::Tape tape;
  for (std::uint32_t epoch = 1; epoch <= options.epochs; ++epoch) {
    adam.rate = rate_at(options, epoch - 1);
    shuffle(trained, rng);
    for (Eigen::Index from = 0; from < static_cast<Eigen::Index>(trained.size()); from += kBatch) {
      const Eigen::Index size = std::min(kBatch, static_cast<Eigen::Index>(trained.size()) - from);
      mlp_.forward(columns(x, trained.data() + from, size), tape);
      gradient.setZero();
      mlp_.backward(tape, slopes(tape.output(), columns(y, trained.data() + from, size)), gradient);
      adam.step(mlp_.weights, gradient);
    }
    const StudyError now = errors(x, y, {}, held_out);
    if (now.held_out < least.held_out || held_out.empty()) {
      least.held_out = now.held_out;
      least.epochs = epoch;
      best = mlp_.weights;
    }
    if (epoch - least.epochs >= options.patience) break;
  }
  mlp_.weights = best;
  const std::uint32_t epochs = least.epochs;
  least = errors(x, y, trained, held_out);
  least.epochs = epochs;
  return least;
}

StoredPolicy Pupil::stored() const {
  nets::Mlp folded = mlp_;
  if (mean_.size() > 0) nets::absorb_input_scale(folded, mean_, sd_);
  StoredPolicy policy = shape_;
  policy.network.weights.assign(folded.weights.data(), folded.weights.data() + folded.weights.size());
  policy.low = low_;
  policy.high = high_;
  return policy;
}

}  // namespace tiller::tools::distill
