// Reruns of the window in lanes, and what happens at its start: transitions leave, a summary and a law for the
// filter's start stay.

#include <cmath>
#include <cstring>

#include "posterior/filter/filter_posterior.hpp"
#include "posterior/tasks.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

namespace {

/// Transitions that leave between two looks at whether the design still lies where the cloud is, which does not move
/// far within a few ticks.
constexpr std::uint32_t kLook = 8;

}  // namespace

void FilterPosterior::rerun(std::uint32_t lanes) {
  for_each_chunk(hooks_, (lanes + kChunk - 1) / kChunk, true, [this](std::uint32_t c) { rerun_chunk(c); });
}

/// The chunk's lanes over the whole window: their filters and their sums over it.
void FilterPosterior::rerun_chunk(std::uint32_t c) const {
  const Chunk& chunk = chunks_[c];
  map_sensors(chunk, chunk.params, kChunk);
  std::memset(chunk.sums, 0, sizeof(double) * rows_ * kChunk);
  if (window_exact_)
    begin_filters(chunk, chunk.filter, {chunk.law, kChunk});
  else
    read_summary(chunk);
  for (std::uint64_t index = window_begin_; index < window_.end(); ++index) step_chunk(chunk, index);
}

/// Filters from the polynomials, which do not keep a quaternion's length.
void FilterPosterior::read_summary(const Chunk& chunk) const {
  summary_.read_filters(kChunk, chunk.coordinate, kChunk, chunk.filter);
  for_quaternions(quaternions_, [&](std::uint32_t first) {
    for (std::uint32_t l = 0; l < kChunk; ++l) {
      double* q = chunk.filter.state + first * chunk.filter.stride + l;
      write_quaternion(normalised(read_quaternion(q, chunk.filter.stride)), q, chunk.filter.stride);
    }
  });
}

void FilterPosterior::step_chunk(const Chunk& chunk, std::uint64_t index) const {
  const Kept& kept = window_[index];
  Step step;
  step.period_s = kept.period_s;
  step.input = kept.input;
  step.from = chunk.filter;
  step.params = {chunk.params, kChunk};
  step.process_scale = chunk.process_scale;
  step.law = {chunk.law, kChunk};
  step.history = history_of(index);
  predict_lanes(chunk, step);
  CorrectJob correct = correct_job(kept.measured, chunk);
  correct.weight = kept.weight;
  correct.squared_error = chunk.sums + ScaleEvidence::kSquared * kChunk;
  correct.log_variance = chunk.sums + ScaleEvidence::kLogs * kChunk;
  filter_->correct(correct);
}

/// Lets the oldest transitions leave until `keep` are left.
void FilterPosterior::retire(std::uint32_t keep) {
  while (window_.end() - window_begin_ > keep) leave();
}

/// Lays the design around the cloud, with a filter at each point: as the polynomials have it, or exact while the window
/// begins at a start().
void FilterPosterior::lay_design() {
  summary_.centre_on(cloud_);
  leaves_ = 0;
  if (window_exact_) begin_points();
}

/// Points are worked on in the first chunk, kChunk at a time: visit(first point, chunk).
template <class Visit>
void FilterPosterior::for_each_point_chunk(const Visit& visit) const {
  const PolynomialDesign& design = summary_.design();
  const Chunk& chunk = chunks_[0];
  for (std::uint32_t at = 0; at < design.points(); at += kChunk) {
    for (std::uint32_t l = 0; l < kChunk; ++l) {
      double coordinate[kMaxCoordinates];
      for (std::uint32_t j = 0; j < d_; ++j) coordinate[j] = design.at()[j * design.points() + at + l];
      place_lane(chunk, l, coordinate);
    }
    map_sensors(chunk, chunk.params, kChunk);
    visit(at, chunk);
  }
}

FilterRows FilterPosterior::point_lanes(std::uint32_t at) const {
  const FilterRows& f = summary_.filters();
  return {f.state + at, f.covariance + at, f.effect_state + at, f.stride};
}

void FilterPosterior::begin_points() {
  for_each_point_chunk([this](std::uint32_t at, const Chunk& chunk) {
    begin_filters(chunk, point_lanes(at), {chunk.law, kChunk});
  });
  summary_.fit_filters();
}

/// The oldest transition leaves: its innovations at the design's points go into the summary, the window's start moves
/// on.
void FilterPosterior::leave() {
  const bool look = ++leaves_ >= kLook;
  if (look) leaves_ = 0;
  if (!summary_.design().laid() || (look && !summary_.design().covers(cloud_)))
    lay_design();
  else if (window_exact_)
    begin_points();
  const Kept& kept = window_[window_begin_];
  step_points(window_begin_);
  const std::uint32_t points = summary_.design().points();
  const double* logs = point_innovation_ + std::size_t{ny_} * points;
  if (mend_points()) {
    if (kept.weight > 0.0) summary_.add(kept.weight, ny_, point_innovation_, logs);
    summary_.fit_filters();
  } else {
    ++lost_;
  }
  window_exact_ = false;
  ++window_begin_;
}

/// One transition at all points. Points that have no finite step keep their filters and are marked by a log variance
/// that is not a number.
void FilterPosterior::step_points(std::uint64_t index) {
  const Kept& kept = window_[index];
  const std::uint32_t points = summary_.design().points();
  for_each_point_chunk([&](std::uint32_t at, const Chunk& chunk) {
    const FilterRows lanes = point_lanes(at);
    Step step;
    step.period_s = kept.period_s;
    step.input = kept.input;
    step.from = lanes;
    step.params = {chunk.params, kChunk};
    step.process_scale = chunk.process_scale;
    step.law = {chunk.law, kChunk};
    step.history = history_of(index);
    predict_lanes(chunk, step);
    double *squared = chunk.sums, *logs = chunk.sums + kChunk;
    std::memset(squared, 0, sizeof(double) * 2 * kChunk);
    CorrectJob correct = correct_job(kept.measured, chunk);
    correct.to = lanes;
    correct.squared_error = squared;
    correct.log_variance = logs;
    filter_->correct(correct);
    for (std::uint32_t k = 0; k < ny_; ++k)
      std::memcpy(point_innovation_ + k * points + at, chunk.normalised + k * kChunk, sizeof(double) * kChunk);
    for (std::uint32_t l = 0; l < kChunk; ++l)
      point_innovation_[ny_ * points + at + l] = std::isfinite(squared[l]) ? logs[l] : NAN;
  });
}

/// Points without a finite step get what the innermost one has that took it. False where there is none: then the
/// transition leaves no trace.
bool FilterPosterior::mend_points() {
  const std::uint32_t points = summary_.design().points();
  const double* logs = point_innovation_ + std::size_t{ny_} * points;
  std::uint32_t inner = 0;
  while (inner < points && std::isnan(logs[inner])) ++inner;
  if (inner == points) return false;
  const FilterRows& f = summary_.filters();
  const auto copy = [&](double* data, std::uint32_t rows, std::uint32_t to) {
    for (std::uint32_t i = 0; i < rows; ++i) data[i * points + to] = data[i * points + inner];
  };
  for (std::uint32_t k = 0; k < points; ++k) {
    if (!std::isnan(logs[k])) continue;
    copy(f.state, nf_, k);
    copy(f.covariance, triangle_, k);
    copy(f.effect_state, ns_, k);
    copy(point_innovation_, ny_ + 1, k);
  }
  return true;
}

/// Moves the whole window into the summary, because a start() breaks the filters' history. Costs about as much as the
/// moves of one tick.
void FilterPosterior::close_window() {
  retire(0);
  std::memcpy(carried_.base, carried_.sums, sizeof(double) * rows_ * n_);
  window_exact_ = true;
}

}  // namespace tiller
