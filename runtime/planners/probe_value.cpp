#include "planners/probe_value.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

void RegretTable::fill(std::uint32_t hypotheses, const double* cost) {
  count = hypotheses;
  hedged = mistaken = 0.0;
  ignorance = INFINITY;
  double least[kMostProbeHypotheses];
  for (std::uint32_t i = 0; i < count; ++i) {
    least[i] = cost[i];
    for (std::uint32_t plan = 1; plan <= count; ++plan) least[i] = std::fmin(least[i], cost[plan * count + i]);
    hedged += (cost[i] - least[i]) / count;
  }
  for (std::uint32_t plan = 0; plan <= count; ++plan) {
    double mean = 0.0;
    for (std::uint32_t i = 0; i < count; ++i) mean += (cost[plan * count + i] - least[i]) / count;
    ignorance = std::fmin(ignorance, mean);
  }
  const auto regret = [&](std::uint32_t i, std::uint32_t taken_for) {
    return cost[(1 + taken_for) * count + i] - least[i];
  };
  for (std::uint32_t i = 0; i < count; ++i)
    for (std::uint32_t j = i + 1; j < count; ++j) {
      pair[i * count + j] = regret(i, j) + regret(j, i);
      mistaken += pair[i * count + j];
    }
}

double confusion(double apart) {
  constexpr double kPiSquared = 9.869604401089358;
  const double spread = 1.0 + apart * (1.0 + apart / kPiSquared);
  return math::exp(-0.25 * apart) / std::sqrt(std::sqrt(spread));
}

double told_share(const RegretTable& regrets, const double* apart) {
  if (!(regrets.mistaken > 0.0)) return 0.0;
  double left = 0.0;
  for (std::uint32_t i = 0; i < regrets.count; ++i)
    for (std::uint32_t j = i + 1; j < regrets.count; ++j) {
      const std::uint32_t at = i * regrets.count + j;
      if (regrets.pair[at] > 0.0) left += regrets.pair[at] * confusion(apart[at]);
    }
  return 1.0 - left / regrets.mistaken;
}

double gaussian_information(std::uint32_t count, double* gram) {
  double log_det = 0.0;
  for (std::uint32_t c = 0; c < count; ++c) {
    for (std::uint32_t r = 0; r <= c; ++r) gram[c * count + r] /= count - 1.0;
    gram[c * count + c] += 1.0;
  }
  for (std::uint32_t c = 0; c < count; ++c) {
    double diagonal = gram[c * count + c];
    for (std::uint32_t k = 0; k < c; ++k) diagonal -= gram[c * count + k] * gram[c * count + k];
    diagonal = std::sqrt(std::fmax(diagonal, 1.0));  // I and what is semidefinite
    gram[c * count + c] = diagonal;
    log_det += 2.0 * math::log(diagonal);
    for (std::uint32_t r = c + 1; r < count; ++r) {
      double sum = gram[r * count + c];
      for (std::uint32_t k = 0; k < c; ++k) sum -= gram[r * count + k] * gram[c * count + k];
      gram[r * count + c] = sum / diagonal;
    }
  }
  return 0.5 * log_det;
}

InformationBounds mixture_information(std::uint32_t count, const double* apart) {
  InformationBounds bounds{0.0, 0.0};
  for (std::uint32_t i = 0; i < count; ++i) {
    double near = 0.0, far = 0.0;
    for (std::uint32_t j = 0; j < count; ++j) {
      const double d = i == j ? 0.0 : apart[i < j ? i * count + j : j * count + i];
      near += math::exp(-0.25 * d);
      far += math::exp(-d);
    }
    bounds.low -= math::log(near / count) / count;
    bounds.high -= math::log(far / count) / count;
  }
  return bounds;
}

}  // namespace tiller
