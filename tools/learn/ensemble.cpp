#include "tools/learn/ensemble.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/rng.hpp"
#include "tools/nets/adam.hpp"

namespace tiller::tools::learn {
namespace {

using nets::Matrix;
using nets::Mlp;
using nets::Vector;

constexpr double kHeldOut = 0.2;  // of the blocks
constexpr int kEvery = 100;       // steps between looks at what is held out
constexpr int kPatience = 10;     // looks without a better one
constexpr double kFirstRate = 1e-2, kLastRate = 3e-4;

struct Split {
  std::vector<Eigen::Index> train, stop;
};

std::size_t draw(Rng& rng, std::size_t count) {
  return std::min(count - 1, static_cast<std::size_t>(rng.uniform() * static_cast<double>(count)));
}

/// Blocks that stop, and draws with replacement from the others.
Split split_blocks(const DynamicsData& data, double drawn_share, Rng& rng) {
  const int blocks = data.block.empty() ? 0 : data.block.back() + 1;
  std::vector<std::vector<Eigen::Index>> of(static_cast<std::size_t>(blocks));
  for (std::size_t k = 0; k < data.block.size(); ++k)
    if (data.weight.col(static_cast<Eigen::Index>(k)).sum() > 0.0)
      of[static_cast<std::size_t>(data.block[k])].push_back(static_cast<Eigen::Index>(k));
  std::vector<std::size_t> rest;
  Split s;
  for (std::size_t b = 0; b < of.size(); ++b) {
    if (rng.uniform() < kHeldOut)
      s.stop.insert(s.stop.end(), of[b].begin(), of[b].end());
    else
      rest.push_back(b);
  }
  const auto draws = static_cast<std::size_t>(std::ceil(drawn_share * static_cast<double>(rest.size())));
  for (std::size_t d = 0; d < draws && !rest.empty(); ++d) {
    const std::vector<Eigen::Index>& block = of[rest[draw(rng, rest.size())]];
    s.train.insert(s.train.end(), block.begin(), block.end());
  }
  return s;
}

Matrix columns(const Matrix& m, const std::vector<Eigen::Index>& at) {
  Matrix some(m.rows(), static_cast<Eigen::Index>(at.size()));
  for (std::size_t k = 0; k < at.size(); ++k) some.col(static_cast<Eigen::Index>(k)) = m.col(at[k]);
  return some;
}

double weighted_error(const Mlp& mlp, const Matrix& x, const Matrix& y, const Matrix& weight) {
  if (x.cols() == 0) return 0.0;
  return ((mlp.evaluate(x) - y).array().square() * weight.array()).mean();
}

/// The inverse variances of the weights' prior: of each the square of one over its layer's reach.
Vector prior_precision(const std::vector<int>& widths, double anchor_sd) {
  Vector precision(Mlp::count(widths));
  Eigen::Index at = 0;
  for (std::size_t l = 1; l < widths.size(); ++l) {
    const double reach = anchor_sd * std::sqrt(2.0 / (widths[l] + widths[l - 1]));
    const Eigen::Index count = Eigen::Index{widths[l]} * (widths[l - 1] + 1);
    precision.segment(at, count).setConstant(1.0 / (reach * reach));
    at += count;
  }
  return precision;
}

Member train(const DynamicsData& data, const EnsembleOptions& options, std::uint64_t seed,
             const std::function<bool(double)>& progress) {
  Rng rng(seed, 4711, 0);
  const Split split = split_blocks(data, options.drawn_share, rng);
  std::vector<int> widths = {static_cast<int>(data.x.rows())};
  widths.insert(widths.end(), options.hidden.begin(), options.hidden.end());
  widths.push_back(static_cast<int>(data.y.rows()));
  Member best;
  best.mlp = Mlp(widths);
  best.mlp.randomise(seed);
  if (split.train.empty()) return best;
  const Vector anchor = best.mlp.weights, precision = prior_precision(widths, options.anchor_sd);
  const Matrix stop_x = columns(data.x, split.stop), stop_y = columns(data.y, split.stop),
               stop_w = columns(data.weight, split.stop);
  Mlp mlp = best.mlp;
  best.held_out = HUGE_VAL;
  nets::Adam adam;
  int worse = 0;
  Vector gradient(anchor.size());
  std::vector<Eigen::Index> taken(static_cast<std::size_t>(options.batch));
  Mlp::Tape tape;
  for (int step = 1; step <= options.steps && worse < kPatience; ++step) {
    for (Eigen::Index& k : taken) k = split.train[draw(rng, split.train.size())];
    const Matrix x = columns(data.x, taken), y = columns(data.y, taken), w = columns(data.weight, taken);
    mlp.forward(x, tape);
    // the prior counts as a hundredth of a squared standard error for each of the data's samples
    gradient = 1e-2 / static_cast<double>(split.train.size()) * precision.cwiseProduct(mlp.weights - anchor);
    mlp.backward(tape, ((tape.output() - y).array() * w.array() / options.batch).matrix(), gradient);
    const double share = static_cast<double>(step) / options.steps;
    adam.rate = kLastRate + 0.5 * (kFirstRate - kLastRate) * (1.0 + std::cos(3.14159265358979 * share));
    adam.step(mlp.weights, gradient);
    if (step % kEvery != 0) continue;
    const double error = split.stop.empty() ? -step : weighted_error(mlp, stop_x, stop_y, stop_w);
    ++worse;
    if (error < best.held_out) {
      best = {mlp, error, step};
      worse = 0;
    }
    if (progress && !progress(share)) break;
  }
  return best;
}

}  // namespace

std::vector<Member> train_ensemble(const DynamicsData& data, const EnsembleOptions& options) {
  std::vector<Member> members;
  bool go_on = true;
  for (int m = 0; m < options.members && go_on; ++m) {
    const auto progress = [&](double share) {
      go_on = !options.progress || options.progress((m + share) / options.members);
      return go_on;
    };
    members.push_back(train(data, options, options.seed * 1000 + static_cast<std::uint64_t>(m), progress));
  }
  return members;
}

nets::Mlp in_units(const nets::Mlp& mlp, const DynamicsData& data) {
  Mlp plain = mlp;
  nets::absorb_input_scale(plain, data.in.mean, data.in.sd);
  nets::absorb_output_scale(plain, data.out.mean, data.out.sd);
  return plain;
}

}  // namespace tiller::tools::learn
