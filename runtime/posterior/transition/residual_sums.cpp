#include "posterior/transition/residual_sums.hpp"

#include <algorithm>
#include <cstring>

#include "core/bits.hpp"
#include "posterior/tasks.hpp"
#include "posterior/transition/transition_lanes.hpp"

namespace tiller {

ResidualSums ResidualSums::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                   const RolloutTable& table, const tiller_hooks_t* hooks, const Evidence& evidence,
                                   std::uint32_t lanes) {
  ResidualSums s;
  s.config_ = &config;
  s.setup_ = setup;
  s.table_ = &table;
  s.hooks_ = hooks;
  s.nx_ = config.model->state_count;
  s.lanes_ = lanes;
  s.steps_of_one_ = evidence.columns() > 0 ? 2 : 1;
  // all particles at one transition, or the moves at a block of them
  const std::uint32_t at_one = round_up(config.posterior.particles, kChunk) * s.steps_of_one_;
  const std::uint32_t at_block = round_up(lanes, kChunk) * (kBlock + s.steps_of_one_ - 1);
  s.residual_ = arena.take<float>(std::size_t{std::max(at_one, at_block)} * s.nx_);
  return s;
}

void ResidualSums::sum(Lanes<float> params, std::uint32_t lanes, std::uint64_t begin, std::uint64_t end, double* sums,
                       std::uint32_t stride) {
  const std::uint32_t first = ring_->slot(begin), count = static_cast<std::uint32_t>(end - begin);
  const std::uint32_t head = std::min(count, ring_->capacity() - first);
  sum_slots({params, lanes, first, head, sums, stride});
  if (head < count) sum_slots({params, lanes, 0, count - head, sums, stride});
}

void ResidualSums::sum_slots(const Job& job) {
  for_each_chunk(hooks_, (job.lanes + kChunk - 1) / kChunk, job.lanes * job.count >= 8192,
                 [this, &job](std::uint32_t c) { sum_chunk(job, c); });
  work_ += std::uint64_t{job.lanes} * (job.count + steps_of_one_ - 1);
}

void ResidualSums::sum_chunk(const Job& job, std::uint32_t chunk) const {
  const std::uint32_t first = chunk * kChunk;
  ResidualJob steps;
  steps.setup = &setup_;
  steps.lanes = std::min(job.lanes - first, kChunk);
  steps.params = {job.params.data + first, job.params.stride};
  if (evidence_->columns() == 0)
    sum_squares(job, first, steps);
  else
    sum_projections(job, chunk, steps);
}

/// Without a discrepancy the kernel sums by itself.
void ResidualSums::sum_squares(const Job& job, std::uint32_t first, ResidualJob& steps) const {
  double squared[TILLER_MAX_STATES * kChunk];
  std::memset(squared, 0, sizeof(double) * nx_ * steps.lanes);
  steps.count = job.count;
  steps.steps = ring_->steps(job.slot);
  steps.squared = squared;
  // the newest transition's own are what the adequacy test looks at
  if (config_->posterior.adequacy && job.count == 1) steps.residual = residual_ + std::size_t{first} * nx_;
  table_->residual(*config_->model, steps);
  for (std::uint32_t r = 0; r < nx_; ++r)
    transition_table().add_scaled(steps.lanes, 1.0, squared + r * steps.lanes, job.sums + r * job.stride + first);
}

/// Each joint has regressors of its own, which the kernel's shared ones cannot be.
void ResidualSums::sum_projections(const Job& job, std::uint32_t chunk, ResidualJob& steps) const {
  // there is room for one transition of all particles, or a block of the moves'
  const std::uint32_t longest = job.lanes > lanes_ ? 1 : kBlock, block = std::min(job.count, longest);
  const std::uint32_t step_size = nx_ * steps.lanes, before = ring_->slot_before(job.slot);
  float* lead_in = residual_ + std::size_t{chunk} * kChunk * (block + 1) * nx_;
  float* residual = lead_in + step_size;
  if (ring_->any_linked(job.slot)) {
    steps.residual = lead_in;
    steps.count = 1;
    steps.steps = ring_->steps(before);
    table_->residual(*config_->model, steps);
  }
  steps.residual = residual;
  ResidualSumJob sums;
  sums.nx = nx_;
  sums.regressors = evidence_->regressors();
  sums.pushed_count = evidence_->pushed_count();
  for (std::uint32_t b = 0; b < sums.pushed_count; ++b) sums.pushed[b] = evidence_->pushed(b);
  sums.lanes = steps.lanes;
  sums.residual = residual;
  sums.sums = job.sums + chunk * kChunk;
  sums.stride = job.stride;
  for (std::uint32_t done = 0; done < job.count; done += block) {
    const std::uint32_t slot = job.slot + done;
    steps.count = sums.steps = std::min(job.count - done, block);
    steps.steps = ring_->steps(slot);
    sums.weight = ring_->weight(slot);
    sums.basis = ring_->basis(slot);
    sums.basis_before = ring_->basis(done > 0 ? slot - 1 : before);
    sums.linked = ring_->linked(slot);
    if (done > 0) std::memcpy(lead_in, residual + (block - 1) * step_size, sizeof(float) * step_size);
    table_->residual(*config_->model, steps);
    transition_table().sum_residuals(sums);
  }
}

void ResidualSums::residuals(Lanes<float> params, std::uint32_t lanes, std::uint32_t slot, float* residual) {
  ResidualJob job;
  job.setup = &setup_;
  job.lanes = lanes;
  job.count = 1;
  job.steps = ring_->steps(slot);
  job.params = params;
  job.residual = residual;
  table_->residual(*config_->model, job);
  work_ += lanes;
}

double ResidualSums::newest(std::uint32_t n, std::uint32_t particle, std::uint32_t row) const {
  const std::uint32_t chunk = particle / kChunk, first = chunk * kChunk, lanes = std::min(n - first, kChunk);
  const std::uint32_t at = row * lanes + (particle - first);
  const float* from = residual_ + std::size_t{chunk} * kChunk * nx_ * steps_of_one_;
  const double now = static_cast<double>(from[(steps_of_one_ - 1) * nx_ * lanes + at]);
  const std::uint32_t place = evidence_->place_of(row);
  if (place >= evidence_->pushed_count() || !(ring_->linked(ring_->newest())[place] > 0.0f)) return now;
  return now - evidence_->colour(row) * static_cast<double>(from[at]);
}

}  // namespace tiller
