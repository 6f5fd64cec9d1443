#include "abi/controller.hpp"

#include <cstdint>

#include "abi/check_parts.hpp"

using tiller::Arena;
using tiller::Executive;

static_assert(Arena::kAlignment == TILLER_ALIGNMENT, "the caller aligns the block as the arena needs it");

namespace {

/// The one layout: tiller_size runs it to measure, tiller_init to place.
tiller_controller* lay_out(Arena& arena, const tiller_config_t& config, const tiller_hooks_t* hooks) {
  tiller_controller* controller = arena.take<tiller_controller>(1);
  Executive* executive = Executive::lay_out(arena, config, hooks);
  if (arena.measuring() || executive == nullptr) return nullptr;
  controller->executive = executive;
  return controller;
}

std::size_t measure(const tiller_config_t& config) {
  Arena arena;
  (void)lay_out(arena, config, nullptr);
  return arena.used();
}

bool hooks_match(const tiller_hooks_t* hooks) {
  return hooks == nullptr || (hooks->size == sizeof(tiller_hooks_t) && hooks->version == TILLER_CONFIG_VERSION);
}

/// An interval that is not empty, with `low` and `high` where the box says nothing; infinite ends are none.
bool take_interval(const double* lows, const double* highs, std::uint32_t i, double& low, double& high) {
  if (lows) low = lows[i];
  if (highs) high = highs[i];
  return low < high;  // false for a NaN
}

/// False where the box is empty, or its inputs are beyond the limits.
bool take_box(const tiller_config_t& config, const tiller_box_t& box, tiller::ProbeBox& own) {
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) {
    own.state_low[i] = config.cost.state_low[i];
    own.state_high[i] = config.cost.state_high[i];
    if (!take_interval(box.state_low, box.state_high, i, own.state_low[i], own.state_high[i])) return false;
  }
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) {
    const double low = own.input_low[i] = config.safety.input_low[i];
    const double high = own.input_high[i] = config.safety.input_high[i];
    if (low == high) continue;
    if (!take_interval(box.input_low, box.input_high, i, own.input_low[i], own.input_high[i])) return false;
    if (!(own.input_low[i] >= low && own.input_high[i] <= high)) return false;
  }
  return true;
}

}  // namespace

extern "C" {

size_t tiller_size(const tiller_config_t* config) {
  return tiller_config_check(config, nullptr) == tiller_status_ok ? measure(*config) : 0;
}

tiller_status_t tiller_init(tiller_t** t, const tiller_config_t* config, const tiller_hooks_t* hooks, void* memory,
                            size_t size) {
  if (t == nullptr) return tiller_status_null_argument;
  *t = nullptr;
  if (config == nullptr || memory == nullptr) return tiller_status_null_argument;
  const tiller_status_t checked = tiller_config_check(config, nullptr);
  if (checked != tiller_status_ok) return checked;
  if (!hooks_match(hooks)) return tiller_status_version_mismatch;
  if (reinterpret_cast<std::uintptr_t>(memory) % TILLER_ALIGNMENT != 0) return tiller_status_memory_misaligned;
  // measured first: a layout that runs out of room half way would hand null pieces to the parts
  if (size < measure(*config)) return tiller_status_memory_too_small;
  Arena arena(memory, size);
  *t = lay_out(arena, *config, hooks);
  return *t != nullptr ? tiller_status_ok : tiller_status_memory_too_small;
}

tiller_status_t tiller_arm(tiller_t* t) { return t ? t->executive->arm() : tiller_status_null_argument; }

tiller_status_t tiller_disarm(tiller_t* t) { return t ? t->executive->disarm() : tiller_status_null_argument; }

tiller_status_t tiller_stop(tiller_t* t, tiller_status_t why) {
  return t ? t->executive->stop(why) : tiller_status_null_argument;
}

tiller_status_t tiller_reset(tiller_t* t) { return t ? t->executive->reset() : tiller_status_null_argument; }

tiller_status_t tiller_tick(tiller_t* t, int64_t now_us, const tiller_measurement_t* measurement,
                            tiller_command_t* command) {
  if (command != nullptr) *command = tiller_command_t{};
  if (t == nullptr || command == nullptr) return tiller_status_null_argument;
  return t->executive->tick(now_us, measurement, *command);
}

tiller_status_t tiller_prepare(tiller_t* t) {
  if (t == nullptr) return tiller_status_null_argument;
  t->executive->prepare();
  return tiller_status_ok;
}

tiller_status_t tiller_force_iterations(tiller_t* t, uint32_t iterations) {
  if (t == nullptr) return tiller_status_null_argument;
  if (iterations > 100) return tiller_status_bad_planner;
  t->executive->force_iterations(iterations);
  return tiller_status_ok;
}

tiller_status_t tiller_set_target(tiller_t* t, const double* target) {
  if (t == nullptr || target == nullptr) return tiller_status_null_argument;
  const tiller_model_t& model = *t->executive->config().model;
  if (!tiller::are_states(model, target, 1)) return tiller_status_bad_cost;
  t->executive->set_target(target);
  return tiller_status_ok;
}

tiller_status_t tiller_set_output_target(tiller_t* t, const double* target) {
  if (t == nullptr || target == nullptr) return tiller_status_null_argument;
  const std::uint32_t outputs = t->executive->config().cost.output_count;
  if (outputs == 0 || !tiller::all_values(target, outputs)) return tiller_status_bad_cost;
  t->executive->set_output_target(target);
  return tiller_status_ok;
}

tiller_status_t tiller_set_reference(tiller_t* t, const double* states, const double* outputs, uint32_t steps) {
  if (t == nullptr || (states == nullptr && outputs == nullptr)) return tiller_status_null_argument;
  const tiller_config_t& config = t->executive->config();
  if (steps == 0 || (outputs != nullptr && config.cost.output_count == 0)) return tiller_status_bad_cost;
  if (states != nullptr && !tiller::are_states(*config.model, states, steps)) return tiller_status_bad_cost;
  if (outputs != nullptr && !tiller::all_values(outputs, std::size_t{steps} * config.cost.output_count))
    return tiller_status_bad_cost;
  t->executive->set_reference(states, outputs, steps);
  return tiller_status_ok;
}

tiller_status_t tiller_calibrate(tiller_t* t, const tiller_box_t* box, uint32_t periods) {
  if (t == nullptr || (box == nullptr && periods > 0)) return tiller_status_null_argument;
  if (!(t->executive->config().probe.weight > 0.0)) return tiller_status_bad_planner;
  tiller::ProbeBox own = {};
  if (periods > 0) {
    if (box->size != sizeof(tiller_box_t) || box->version != TILLER_CONFIG_VERSION)
      return tiller_status_version_mismatch;
    if (!take_box(t->executive->config(), *box, own)) return tiller_status_bad_limit;
  }
  return t->executive->calibrate(own, periods);
}

}  // extern "C"
