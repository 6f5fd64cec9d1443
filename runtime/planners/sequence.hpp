#pragma once

#include <cstdint>

#include "planners/lane_table.hpp"

namespace tiller {

/// Limits of one input, as a command sees them.
struct InputLimit {
  double low = 0.0, high = 0.0;
  double step = 0.0;  // largest change in one period; infinity for none
};

/// The command nearest to `wish` that is within the limits and within a step of `last` (which must be within the
/// limits). Holds in doubles as they are: |result - last| <= step by the same subtraction that a gate makes.
double limit_command(const InputLimit& limit, double wish, double last);

/// `last`, brought into the limits; `fallback` in its place if it is not a number.
double admit_command(const InputLimit& limit, double last, double fallback);

/// Fills the grid's arrays: knots stand evenly from the first step to the last.
void fill_grid(std::uint32_t horizon, std::uint32_t knots, std::uint32_t* first_step, float* fraction);

/// Moves one input's knots by `periods` into the past: the piecewise linear sequence is read at the shifted knot
/// times (exact there; in between it is again linear, so a kink is rounded off); behind its end the last value holds.
void shift_knots(double* knots, std::uint32_t count, std::uint32_t horizon, std::uint32_t periods);

/// Fills `sequence` (horizon x inputs) from `knots` (inputs * knots, input-major) under the limits, step by step from
/// `start` (inputs), and `command` (inputs) with its first step in full precision; command may be null.
void expand_sequence(const KnotGrid& grid, const InputLimit* limits, const double* knots, const double* start,
                     float* sequence, double* command);

}  // namespace tiller
