// Reruns of the window in lanes, and what happens at its start: transitions leave, a summary and a law for the
// filter's start stay.

#include <cmath>
#include <cstring>

#include "posterior/filter/filter_posterior.hpp"
#include "posterior/tasks.hpp"

namespace tiller {

void FilterPosterior::rerun(const Rerun& job) {
  job_ = job;
  for_each_chunk(hooks_, (job.lanes + kChunk - 1) / kChunk, true, [this](std::uint32_t c) { rerun_chunk(c); });
}

void FilterPosterior::rerun_chunk(std::uint32_t c) const {
  const Chunk& chunk = chunks_[c];
  map_sensors(chunk, chunk.params, kChunk);
  if (job_.anew) begin_chunk(chunk);
  for (std::uint64_t index = job_.begin; index < job_.end; ++index) {
    double before[kChunk];
    std::memcpy(before, chunk.log_variance, sizeof before);
    step_chunk(chunk, index);
    if (job_.keep_first && index == job_.begin) keep_leaving(chunk, before);
  }
}

void FilterPosterior::begin_chunk(const Chunk& chunk) const {
  if (window_exact_) {
    begin_filters(chunk, chunk.filter, chunk.squared_error, chunk.log_variance);
    return;
  }
  auto linear = [&](double* row, double value, const double* slope) {
    for (std::uint32_t l = 0; l < kChunk; ++l) {
      row[l] = value;
      for (std::uint32_t j = 0; j < d_; ++j)
        row[l] += slope[j] * (chunk.coordinate[j * kChunk + l] - start_law_.centre[j]);
    }
  };
  for (std::uint32_t i = 0; i < nx_; ++i)
    linear(chunk.filter.state + i * kChunk, start_law_.state[i], start_law_.state_slope + i * TILLER_MAX_PARAMS);
  for (std::uint32_t i = 0; i < ns_; ++i)
    linear(chunk.filter.effect_state + i * kChunk, start_law_.effect[i],
           start_law_.effect_slope + i * TILLER_MAX_PARAMS);
  for (std::uint32_t i = 0; i < triangle_; ++i)
    for (std::uint32_t l = 0; l < kChunk; ++l) chunk.filter.covariance[i * kChunk + l] = start_law_.covariance[i];
  for (std::uint32_t l = 0; l < kChunk; ++l) chunk.squared_error[l] = chunk.log_variance[l] = 0.0;
}

const double* FilterPosterior::history_of(std::uint64_t index) const {
  return window_history_ + (index % window_.capacity()) * setup_.delay_steps * nu_;
}

void FilterPosterior::step_chunk(const Chunk& chunk, std::uint64_t index) const {
  const Transition& t = window_[index];
  LineariseJob job;
  job.setup = &setup_;
  job.lanes = kChunk;
  job.period_s = t.period_s;
  job.state = {chunk.filter.state, kChunk};
  job.params = {chunk.params, kChunk};
  job.effect_state = {chunk.filter.effect_state, kChunk};
  job.control = {t.input, 0};
  job.history = history_of(index);
  job.next_state = chunk.predicted.state;
  job.next_effect_state = chunk.predicted.effect_state;
  job.a = chunk.jacobian;
  table_->linearise(*config_->model, job);
  predict_covariance(chunk, t.period_s, chunk.filter.covariance, kChunk);
  CorrectJob correct = correct_job(t.measured, chunk);
  correct.from = chunk.predicted;
  correct.to = chunk.filter;
  correct.squared_error = chunk.squared_error;
  correct.log_variance = chunk.log_variance;
  correct.normalised = chunk.normalised;
  filter_->correct(correct);
}

/// Sets aside what the window's new start and the summary need: rows of normalised innovations, the transition's
/// log variance, and the filter after it.
void FilterPosterior::keep_leaving(const Chunk& chunk, const double* log_variance_before) const {
  double* to = chunk.leaving;
  auto keep = [&](const double* from, std::uint32_t rows) {
    std::memcpy(to, from, sizeof(double) * rows * kChunk);
    to += rows * kChunk;
  };
  keep(chunk.normalised, ny_);
  for (std::uint32_t l = 0; l < kChunk; ++l) *to++ = chunk.log_variance[l] - log_variance_before[l];
  keep(chunk.filter.state, nx_);
  keep(chunk.filter.effect_state, ns_);
  keep(chunk.filter.covariance, triangle_);
}

/// Fits what keep_leaving set aside: the innovations into the summary, the filter into the new start law. If fewer
/// than two lanes are finite there is nothing to fit, and the old law stays.
void FilterPosterior::summarise(std::uint32_t lanes) {
  double* y = scratch_row(0);
  for (std::uint32_t l = 0; l < lanes; ++l) {
    const Chunk& chunk = chunks_[l / kChunk];
    use_lane_[l] = std::isfinite(chunk.squared_error[l % kChunk]) ? 1 : 0;
    for (std::uint32_t j = 0; j < d_; ++j) gathered_[j * n_ + l] = chunk.coordinate[j * kChunk + l % kChunk];
  }
  Regression fit;
  if (!fit.design(d_, lanes, gathered_, n_, use_lane_)) return;

  std::uint32_t row = 0;
  double intercept, slope[TILLER_MAX_PARAMS];
  auto next = [&](double* to_slope) {
    for (std::uint32_t l = 0; l < lanes; ++l) y[l] = chunks_[l / kChunk].leaving[row * kChunk + l % kChunk];
    ++row;
    fit.fit(y, &intercept, to_slope);
  };
  for (std::uint32_t k = 0; k < ny_; ++k) {
    next(slope);
    past_.add_innovation(d_, fit.centre(), intercept, slope);
  }
  next(slope);
  past_.add_log_variance(d_, slope);

  std::memcpy(start_law_.centre, fit.centre(), sizeof(double) * d_);
  for (std::uint32_t i = 0; i < nx_; ++i) {
    next(start_law_.state_slope + i * TILLER_MAX_PARAMS);
    start_law_.state[i] = intercept;
  }
  for (std::uint32_t i = 0; i < ns_; ++i) {
    next(start_law_.effect_slope + i * TILLER_MAX_PARAMS);
    start_law_.effect[i] = intercept;
  }
  // the covariance hardly depends on the parameters, and a mean of covariances is a covariance
  for (std::uint32_t i = 0; i < triangle_; ++i) {
    next(slope);
    start_law_.covariance[i] = intercept;
  }
}

/// Moves the whole window into the summary, because a start() breaks the filters' history. Costs as much as the
/// moves of one tick.
void FilterPosterior::close_window() {
  const std::uint64_t end = window_.end();
  if (window_begin_ < end) {
    const std::uint32_t wanted = 2 * config_->posterior.moves_per_tick;
    const std::uint32_t lanes = wanted < n_ ? wanted : n_;
    for (std::uint32_t l = 0; l < lanes; ++l) set_lane(l, (cursor_ + l) % n_);
    Rerun job;
    job.anew = true;
    job.lanes = lanes;
    for (; window_begin_ < end; ++window_begin_) {
      job.begin = window_begin_;
      job.end = window_begin_ + 1;
      job.keep_first = true;
      rerun(job);
      summarise(lanes);
      job.anew = false;
    }
  }
  std::memcpy(carried_.base_squared_error, carried_.squared_error, n_ * sizeof(double));
  std::memcpy(carried_.base_log_variance, carried_.log_variance, n_ * sizeof(double));
  window_exact_ = true;
}

}  // namespace tiller
