#include "tools/identify/coordinates.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools {

Coordinates::Coordinates(const tiller_config_t& config) : config_(config), law_(config) {
  constexpr std::uint32_t kDraws = 2048;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) inferred_.push_back(i);
  if (count() == 0) return;
  std::vector<double> v(std::size_t{kDraws} * count());
  std::vector<std::uint32_t> scratch(kDraws);
  law_.draw(config.seed, kDraws, v.data(), scratch.data());
  for (std::uint32_t j = 0; j < count(); ++j) survey({v.begin() + j * kDraws, v.begin() + (j + 1) * kDraws});
}

// From draws that lie in equal slices of the marginal.
void Coordinates::survey(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const double middle = values[values.size() / 2], n = static_cast<double>(values.size());
  double sum = 0, square = 0;
  for (const double value : values) {
    sum += value - middle;
    square += (value - middle) * (value - middle);
  }
  median_.push_back(middle);
  mean_.push_back(middle + sum / n);
  sd_.push_back(std::sqrt(square / n - sum / n * (sum / n)));
}

double Coordinates::low(std::uint32_t j) const { return coordinate_low(config_.priors[inferred_[j]]); }
double Coordinates::high(std::uint32_t j) const { return coordinate_high(config_.priors[inferred_[j]]); }

bool Coordinates::inside(const double* v) const {
  for (std::uint32_t j = 0; j < count(); ++j)
    if (!(v[j] >= low(j) && v[j] <= high(j))) return false;
  return true;
}

void Coordinates::to_params(const double* v, double* params) const {
  for (std::uint32_t i = 0; i < config_.param_count; ++i) params[i] = config_.priors[i].a;
  for (std::uint32_t j = 0; j < count(); ++j) params[inferred_[j]] = value(j, v[j]);
}

double Coordinates::value(std::uint32_t j, double v) const { return from_coordinate(config_.priors[inferred_[j]], v); }

double Coordinates::coordinate(std::uint32_t j, double value) const {
  return to_coordinate(config_.priors[inferred_[j]], value);
}

void Coordinates::draw(std::uint64_t index, double* v) const {
  Rng rng(config_.seed, kRngPrior, index);
  law_.draw_one(rng, v);
}

}  // namespace tiller::tools
