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

/// The commands nearest to `wish`, as core/input_cone.hpp has it, that are within limits, steps and cones; in place of
/// `last`, which is within limits and cones.
void limit_commands(const InputLimit* limits, const InputCones& cones, std::uint32_t inputs, const double* wish,
                    double* last);

/// A whole command in force, brought into limits and cones; null, and what is not a number, becomes the fallback.
void admit_commands(const InputLimit* limits, const InputCones& cones, std::uint32_t inputs, const double* last,
                    const double* fallback, double* out);

/// Knots slide with time: they stay where they are on the clock while the horizon moves over them, so that shifting a
/// plan by a period is exact whatever their spacing. (Knots fixed to the horizon would have to be read off again at
/// every tick, and a sequence that is interpolated again and again is a different one: after 8 ticks its kinks are off
/// by a third, and a cart-pole swings up at 8 % more cost.) Knot j stands j * steps / spans - phase / spans periods
/// after now, steps = horizon - 1 and spans = knots - 1; behind the last knot, for at most one knot spacing, its
/// value holds.
struct KnotClock {
  std::uint32_t horizon = 2, knots = 2;
  std::uint32_t phase = 0;  // 0..steps - 1; whole numbers, so that nothing drifts
  std::uint32_t hold = 0;   // knots are this many periods apart; 0: spread evenly over the horizon
  std::uint32_t steps() const { return hold > 0 ? hold : horizon - 1; }
  std::uint32_t spans() const { return hold > 0 ? 1 : knots - 1; }
};

/// Fills the grid's arrays, first_step (knots) and fraction (horizon); behind the last knot its value holds.
void fill_grid(const KnotClock& clock, std::uint32_t* first_step, float* fraction);

/// Lets `periods` go by: the clock's new phase, and by how many knots every row has to move up.
std::uint32_t advance_clock(KnotClock& clock, std::uint32_t periods);

/// Drops the first `gone` of one input's knots; the last is repeated in the free places.
void shift_knots(double* knots, std::uint32_t count, std::uint32_t gone);

/// Fills `sequence` (horizon x inputs) from `knots` (inputs * knots, input-major) under limits and cones, step by step
/// from `start` (inputs), and `command` (inputs) with its first step in full precision; command may be null. Cubic
/// where `before` (inputs), the values a knot ahead of the first, is given: the curve through a plan's remaining knots
/// is then the same after one has fallen off its front. With `hold` each knot's value until the next. Else linear.
void expand_sequence(const KnotGrid& grid, const InputLimit* limits, const InputCones& cones, const double* knots,
                     const double* start, float* sequence, double* command, const double* before = nullptr,
                     bool hold = false);

}  // namespace tiller
