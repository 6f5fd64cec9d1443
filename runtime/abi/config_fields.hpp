#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "tiller/tiller.h"

// The lines of config.def as data: tiller_config_default and tiller_config_check walk over it, and so do the
// robot file's reader, its manual and `tiller export`.

namespace tiller {

/// Which values a setting may have. A NaN is in no range.
struct FieldRange {
  double low, high;
  double least = 0.0;      ///< magnitudes below are refused, but for 0 itself where the range holds it
  bool low_open = false;   ///< `low` itself is refused
  bool unlimited = false;  ///< infinite values are good too, as no limit: above 0 where `low` is

  constexpr bool holds(double v) const {
    if (unlimited && (v == HUGE_VAL || (v == -HUGE_VAL && low < 0.0))) return true;
    const bool above = low_open ? v > low : v >= low;
    return above && v <= high && (v == 0.0 || v >= least || v <= -least);
  }
};

/// The ranges that config.def names. tiller.h states the limits.
namespace ranges {
constexpr FieldRange between(double low, double high) { return {low, high}; }
constexpr FieldRange above(double low, double high) { return {low, high, 0.0, true}; }
constexpr FieldRange any_value() { return {-TILLER_LARGEST_VALUE, TILLER_LARGEST_VALUE}; }
constexpr FieldRange value_or_none() { return {-TILLER_LARGEST_VALUE, TILLER_LARGEST_VALUE, 0.0, false, true}; }
constexpr FieldRange scale() { return {TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE}; }
constexpr FieldRange scale_or_zero() { return {0.0, TILLER_LARGEST_SCALE, TILLER_SMALLEST_SCALE}; }
constexpr FieldRange scale_or_none() { return {TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE, 0.0, false, true}; }
constexpr FieldRange weight() { return {0.0, TILLER_LARGEST_WEIGHT, TILLER_SMALLEST_WEIGHT}; }
constexpr FieldRange share() { return {TILLER_SMALLEST_SHARE, 1.0}; }
}  // namespace ranges

enum class FieldKind : std::uint8_t { count, number, flag, choice, states, inputs };

/// A part of the configuration whose settings config.def lists, called as in the robot file.
enum class FieldGroup : std::uint8_t { model, body, recorder, noise, start, posterior, planner, probe, cost, safety };

struct ConfigField {
  FieldGroup group;
  FieldKind kind;
  std::uint16_t offset;     ///< bytes into tiller_config_t
  std::uint16_t multiple;   ///< of a count
  double fallback;          ///< default; of an array, of each element
  FieldRange range;         ///< of an array, of each element
  const char* names;        ///< of the first element: "posterior.window"; of an array "cost.target[0]"
  std::size_t name_stride;  ///< bytes from one element's name to the next

  /// Of an array the element's; lives for ever.
  const char* name(std::uint32_t element = 0) const { return names + element * name_stride; }
};

/// Every line of config.def, in order.
struct ConfigFields {
  const ConfigField* begin_;
  const ConfigField* end_;
  const ConfigField* begin() const { return begin_; }
  const ConfigField* end() const { return end_; }
};
ConfigFields config_fields();

/// The value of a setting as a number; `index` of an array's element.
double config_value(const tiller_config_t& config, const ConfigField& field, std::uint32_t index);
void set_config_value(tiller_config_t& config, const ConfigField& field, std::uint32_t index, double value);

/// Every setting of config.def at its default.
void set_defaults(tiller_config_t& config);

/// The first setting of a group that is out of its range (a literal, the field's path), arrays as far as the model's
/// states and inputs go; null: none. Needs config.model.
const char* out_of_range(const tiller_config_t& config, FieldGroup group);

}  // namespace tiller
