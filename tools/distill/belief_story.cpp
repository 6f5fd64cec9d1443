#include "tools/distill/belief_story.hpp"

#include <algorithm>
#include <cmath>

#include "tools/links/plant_setup.hpp"

namespace tiller::tools::distill {
namespace {

constexpr std::uint32_t kDraws = 512;  // for a prior's moments
constexpr double kShortest_s = 1e-3, kLongest_s = 30.0;
constexpr std::uint32_t kPurpose = 0x646d;  // streams that nobody else of a robot's seed draws from

double next_uniform(void* rng) { return static_cast<Rng*>(rng)->uniform(); }

/// Within the prior's bounds, where it has any.
double bounded(const tiller_prior_t& prior, double value) {
  return prior.kind == tiller_prior_fixed ? prior.a : std::min(std::max(value, prior.low), prior.high);
}

}  // namespace

PriorMoments prior_moments(const tiller_config_t& config) {
  PriorMoments moments;
  for (std::uint32_t p = 0; p < config.param_count; ++p) {
    Rng rng(1, kPurpose, p);
    double sum = 0, squares = 0;
    for (std::uint32_t i = 0; i < kDraws; ++i) {
      const double value = draw_from_prior(config.priors[p], next_uniform, &rng);
      sum += value;
      squares += value * value;
    }
    const double mean = sum / kDraws;
    const bool fixed = config.priors[p].kind == tiller_prior_fixed;
    moments.mean.push_back(fixed ? config.priors[p].a : mean);
    moments.sd.push_back(fixed ? 0.0 : std::sqrt(std::max(squares / kDraws - mean * mean, 0.0)));
  }
  return moments;
}

BeliefStory::BeliefStory(const tiller_config_t& config, const PriorMoments& prior, Rng& rng)
    : config_(config), prior_(prior), particles_seed_(rng.next_u32()) {
  for (std::uint32_t p = 0; p < config.param_count; ++p) {
    truth_.push_back(draw_from_prior(config.priors[p], next_uniform, &rng));
    off_.push_back(rng.normal());
    tau_s_.push_back(kShortest_s * std::pow(kLongest_s / kShortest_s, rng.uniform()));
  }
  mean_ = prior.mean;
  sd_ = prior.sd;
}

void BeliefStory::tell(double time_s) {
  for (std::size_t p = 0; p < truth_.size(); ++p) {
    const double w = time_s / (time_s + tau_s_[p]), s0 = prior_.sd[p];
    const double mean = (1 - w) * prior_.mean[p] + w * truth_[p] + s0 * std::sqrt(w * (1 - w)) * off_[p];
    mean_[p] = bounded(config_.priors[p], mean);
    sd_[p] = s0 * std::sqrt(1 - w);
  }
}

void BeliefStory::draw(std::uint32_t count, std::vector<double>& hypotheses) const {
  const std::size_t np = truth_.size();
  hypotheses.resize(count * np);
  for (std::uint32_t j = 0; j < count; ++j) {
    Rng rng(particles_seed_, kPurpose, j);
    for (std::size_t p = 0; p < np; ++p)
      hypotheses[j * np + p] = bounded(config_.priors[p], mean_[p] + sd_[p] * rng.normal());
  }
}

}  // namespace tiller::tools::distill
