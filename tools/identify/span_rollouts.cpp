#include "tools/identify/span_rollouts.hpp"

#include <algorithm>

namespace tiller::tools {

SpanRollouts::SpanRollouts(const tiller_config_t& config, const std::vector<Episode>& episodes, std::size_t steps)
    : config_(config), rollout_(config, kLanes), spans_(make_spans(episodes, steps)) {
  for (const RolloutSpan& span : spans_) rows_ += span.steps;
}

std::uint64_t SpanRollouts::known_rows() const {
  std::uint64_t known = 0;
  for (const RolloutSpan& span : spans_)
    for (std::size_t k = 1; k <= span.steps; ++k) known += span.episode->known(span.start + k) ? 1 : 0;
  return known;
}

std::vector<double> SpanRollouts::table() const {
  const std::uint32_t nx = config_.model->state_count, nu = config_.model->input_count;
  std::vector<double> all;
  all.reserve(rows_ * (2 + nu + 4 * nx));
  for (std::size_t s = 0; s < spans_.size(); ++s) {
    const RolloutSpan& span = spans_[s];
    const Episode& episode = *span.episode;
    for (std::size_t k = 1; k <= span.steps; ++k) {
      all.push_back(static_cast<double>(s));
      all.push_back(static_cast<double>(k));
      for (std::uint32_t i = 0; i < nu; ++i) all.push_back(episode.grid->input[i][span.start + k - 1]);
      for (const double* row : {episode.at(span.start), episode.sd_at(span.start), episode.at(span.start + k),
                                episode.sd_at(span.start + k)})
        all.insert(all.end(), row, row + nx);
    }
  }
  return all;
}

const std::vector<double>& SpanRollouts::run(const double* params, std::size_t count) {
  const std::uint32_t np = config_.param_count;
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      rollout_.params()[i * kLanes + lane] = params[std::min(lane, count - 1) * np + i];
  const std::size_t width = std::size_t{config_.model->state_count} * kLanes;
  states_.resize(rows_ * width);
  double* to = states_.data();
  for (const RolloutSpan& span : spans_) {
    const double* way = rollout_.run(*span.episode->grid, span.start, span.steps, span.episode->at(span.start));
    to = std::copy_n(way + width, span.steps * width, to);
  }
  return states_;
}

}  // namespace tiller::tools
