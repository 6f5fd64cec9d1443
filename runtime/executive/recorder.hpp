#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The last ticks with every input and output, and the caller's calls between them: what a replay needs. A tick takes
/// the room of its robot's own counts, however many states a model may have.
class Recorder {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config) {
    ny_ = config.measurement_count;
    nu_ = config.model->input_count;
    nx_ = config.model->state_count;
    np_ = config.param_count;
    capacity_ = config.record_ticks;
    if (capacity_ == 0) return;
    head_ = arena.take<Head>(capacity_);
    value_ = arena.take<double>(std::size_t{capacity_} * row());
  }

  void note_call(tiller_call_t call) {
    const std::uint32_t shift = 4 * call_count_;
    if (call_count_ < kMostCalls) calls_ |= static_cast<std::uint32_t>(call) << shift;
    // the marker takes the place of the last call: a replay must not believe that it knows all
    if (call_count_ >= kMostCalls) calls_ |= std::uint32_t{tiller_call_lost} << (4 * (kMostCalls - 1));
    ++call_count_;
  }

  void push(const tiller_record_t& record) {
    if (capacity_ > 0) {
      const std::size_t slot = end_++ % capacity_;
      head_[slot] = head_of(record);
      head_[slot].calls = calls_;
      Values{value_ + slot * row()}
          .from(record.measurement.value, ny_)
          .from(record.command.value, nu_)
          .from(record.state_mean, nx_)
          .from(record.param_mean, np_)
          .from(record.param_sd, np_);
    }
    calls_ = 0;
    call_count_ = 0;
  }

  /// The record of a tick as it was pushed, the calls before it added; false, and `record` is as it was, where the ring
  /// does not hold it.
  bool read(std::uint64_t tick, tiller_record_t& record) const {
    if (tick >= end_ || overwritten(tick)) return false;
    const std::size_t slot = tick % capacity_;
    record = record_of(head_[slot]);
    Values{value_ + slot * row()}
        .into(record.measurement.value, ny_)
        .into(record.command.value, nu_)
        .into(record.state_mean, nx_)
        .into(record.param_mean, np_)
        .into(record.param_sd, np_);
    return true;
  }
  bool overwritten(std::uint64_t tick) const { return tick + capacity_ < end_; }

 private:
  static constexpr std::uint32_t kMostCalls = 8;

  /// A tick without its arrays.
  struct Head {
    std::uint64_t tick;
    std::int64_t now_us, measurement_stamp_us, command_stamp_us, tick_ns;
    std::uint32_t measurement_sequence, command_latency_us, command_sequence, command_state, plan_sequence;
    std::int32_t status;
    std::uint32_t has_measurement, planner_iterations, calls;
    double plan_cost, effective_samples, noise_scale;
  };

  /// A place in a tick's row of values.
  struct Values {
    double* at;
    Values from(const double* value, std::uint32_t count) const { return {std::copy(value, value + count, at)}; }
    Values into(double* value, std::uint32_t count) const {
      std::copy(at, at + count, value);
      return {at + count};
    }
  };

  std::size_t row() const { return std::size_t{ny_} + nu_ + nx_ + 2 * np_; }

  static Head head_of(const tiller_record_t& r) {
    return {r.tick,
            r.now_us,
            r.measurement.stamp_us,
            r.command.stamp_us,
            r.tick_ns,
            r.measurement.sequence,
            r.measurement.command_latency_us,
            r.command.sequence,
            r.command.state,
            r.command.plan_sequence,
            r.status,
            r.has_measurement,
            r.planner_iterations,
            r.calls,
            r.plan_cost,
            r.effective_samples,
            r.noise_scale};
  }

  static tiller_record_t record_of(const Head& head) {
    tiller_record_t r{};
    r.tick = head.tick;
    r.now_us = head.now_us;
    r.measurement.stamp_us = head.measurement_stamp_us;
    r.measurement.sequence = head.measurement_sequence;
    r.measurement.command_latency_us = head.command_latency_us;
    r.command.stamp_us = head.command_stamp_us;
    r.command.sequence = head.command_sequence;
    r.command.state = head.command_state;
    r.command.plan_sequence = head.plan_sequence;
    r.status = head.status;
    r.has_measurement = head.has_measurement;
    r.planner_iterations = head.planner_iterations;
    r.calls = head.calls;
    r.plan_cost = head.plan_cost;
    r.effective_samples = head.effective_samples;
    r.noise_scale = head.noise_scale;
    r.tick_ns = head.tick_ns;
    return r;
  }

  std::uint32_t ny_ = 0, nu_ = 0, nx_ = 0, np_ = 0;
  std::uint32_t capacity_ = 0;
  Head* head_ = nullptr;     // (capacity)
  double* value_ = nullptr;  // (capacity x row): measurement, command, state, parameters' means and deviations
  std::uint64_t end_ = 0;    // ticks pushed
  std::uint32_t calls_ = 0;
  std::uint32_t call_count_ = 0;
};

}  // namespace tiller
