// Sums of residuals over transitions of the ring, of all particles or of the moves.

#include <cstring>

#include "posterior/tasks.hpp"
#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

void TransitionCloud::sum_ring(Lanes<float> params, std::uint32_t lanes, double* sums, std::uint32_t stride) {
  sum_run(params, lanes, begin_, end_, sums, stride);
}

/// Transitions first .. last - 1.
void TransitionCloud::sum_run(Lanes<float> params, std::uint32_t lanes, std::uint64_t begin, std::uint64_t end,
                              double* sums, std::uint32_t stride) {
  const auto first = static_cast<std::uint32_t>(begin % capacity_), count = static_cast<std::uint32_t>(end - begin);
  const std::uint32_t head = first + count <= capacity_ ? count : capacity_ - first;
  sum({params, lanes, first, head, sums, stride});
  if (head < count) sum({params, lanes, 0, count - head, sums, stride});
}

void TransitionCloud::sum(const SumsJob& job) {
  for_each_chunk(hooks_, (job.lanes + kChunk - 1) / kChunk, job.lanes * job.count >= 8192,
                 [this, &job](std::uint32_t c) { sum_chunk(job, c); });
  work_ += std::uint64_t{job.lanes} * (job.count + steps_of_one_ - 1);
}

void TransitionCloud::sum_chunk(const SumsJob& job, std::uint32_t chunk) const {
  const std::uint32_t first = chunk * kChunk, left = job.lanes - first;
  ResidualJob steps;
  steps.setup = &setup_;
  steps.lanes = left < kChunk ? left : kChunk;
  steps.params = {job.params.data + first, job.params.stride};
  if (columns_ == 0)
    sum_squares(job, first, steps);
  else
    sum_projections(job, chunk, steps);
}

/// Without a discrepancy the kernel sums by itself.
void TransitionCloud::sum_squares(const SumsJob& job, std::uint32_t first, ResidualJob& steps) const {
  double squared[TILLER_MAX_STATES * kChunk];
  std::memset(squared, 0, sizeof(double) * nx_ * steps.lanes);
  steps.count = job.count;
  steps.steps = steps_ + job.slot;
  steps.squared = squared;
  // the newest transition's own are what the adequacy test looks at
  if (config_->posterior.adequacy && job.count == 1) steps.residual = residual_ + std::size_t{first} * nx_;
  table_->residual(*config_->model, steps);
  for (std::uint32_t r = 0; r < nx_; ++r)
    transition_table().add_scaled(steps.lanes, 1.0, squared + r * steps.lanes, job.sums + r * job.stride + first);
}

/// Each joint has regressors of its own, which the kernel's shared ones cannot be.
void TransitionCloud::sum_projections(const SumsJob& job, std::uint32_t chunk, ResidualJob& steps) const {
  // there is room for one transition of all particles, or a block of the moves'
  const std::uint32_t longest = job.lanes > lanes_ ? 1 : kBlock, block = job.count < longest ? job.count : longest;
  const std::uint32_t step_size = nx_ * steps.lanes, before = slot_before(job.slot);
  float* lead_in = residual_ + std::size_t{chunk} * kChunk * (block + 1) * nx_;
  float* residual = lead_in + step_size;
  if (linked(job.slot)) {
    steps.residual = lead_in;
    steps.count = 1;
    steps.steps = steps_ + before;
    table_->residual(*config_->model, steps);
  }
  steps.residual = residual;
  ResidualSumJob sums;
  sums.nx = nx_;
  sums.regressors = evidence_.regressors();
  sums.pushed_count = evidence_.pushed_count();
  for (std::uint32_t b = 0; b < sums.pushed_count; ++b) sums.pushed[b] = evidence_.pushed(b);
  sums.lanes = steps.lanes;
  sums.residual = residual;
  sums.sums = job.sums + chunk * kChunk;
  sums.stride = job.stride;
  for (std::uint32_t done = 0; done < job.count; done += block) {
    const std::uint32_t slot = job.slot + done, rest = job.count - done;
    steps.count = sums.steps = rest < block ? rest : block;
    steps.steps = steps_ + slot;
    sums.weight = weight_ + slot * nx_;
    sums.basis = basis_ + slot * columns_;
    sums.basis_before = basis_ + (done > 0 ? slot - 1 : before) * columns_;
    sums.linked = linked_ + slot * sums.pushed_count;
    if (done > 0) std::memcpy(lead_in, residual + (block - 1) * step_size, sizeof(float) * step_size);
    table_->residual(*config_->model, steps);
    transition_table().sum_residuals(sums);
  }
}

/// As the sums of one transition left it, of all particles, whitened.
double TransitionCloud::newest_residual(std::uint32_t particle, std::uint32_t row) const {
  const std::uint32_t chunk = particle / kChunk, first = chunk * kChunk, left = n_ - first;
  const std::uint32_t lanes = left < kChunk ? left : kChunk, at = row * lanes + (particle - first);
  const float* from = residual_ + std::size_t{chunk} * kChunk * nx_ * steps_of_one_;
  const double now = static_cast<double>(from[(steps_of_one_ - 1) * nx_ * lanes + at]);
  const std::uint32_t place = evidence_.place_of(row), pushed_count = evidence_.pushed_count();
  const auto slot = static_cast<std::uint32_t>((end_ - 1) % capacity_);
  if (place >= pushed_count || !(linked_[slot * pushed_count + place] > 0.0f)) return now;
  return now - evidence_.colour(row) * static_cast<double>(from[at]);
}

}  // namespace tiller
