#include "harness/faults/fault_refusals.hpp"

#include <cmath>

#include "tiller/config.hpp"

namespace tiller::faults {

const std::vector<Refusal>& all_refusals() {
  static const std::vector<Refusal> all = {
      {"other_version", "a configuration of another version", [](tiller::Config& c) { c.version += 1; }},
      {"other_size", "a configuration of another size", [](tiller::Config& c) { c.size -= 8; }},
      {"block_too_small", "a block that is a byte too small", [](tiller::Config&) {}, 1, 0},
      {"block_misaligned", "a block that is not aligned", [](tiller::Config&) {}, 0, 8},
      {"limit_nan", "a command limit that is NaN", [](tiller::Config& c) { c.safety.input_high[0] = std::nan(""); }},
      {"limit_infinite", "no command limit", [](tiller::Config& c) { c.safety.input_high[0] = INFINITY; }},
      {"limit_reversed", "a command limit the wrong way round",
       [](tiller::Config& c) { std::swap(c.safety.input_low[0], c.safety.input_high[0]); }},
      {"rate_nan", "a rate limit that is NaN", [](tiller::Config& c) { c.safety.input_rate_per_s[0] = std::nan(""); }},
      {"safe_outside", "a safe command outside the limits",
       [](tiller::Config& c) { c.safety.safe_command[0] = 2.0 * c.safety.input_high[0]; }},
      {"no_prior", "a parameter without a prior",
       [](tiller::Config& c) { c.priors[0] = {tiller_prior_fixed, 0, std::nan(""), 0.0, -INFINITY, INFINITY}; }},
      {"no_timeout", "no timeout of the sensors", [](tiller::Config& c) { c.safety.sensor_timeout_s = 0.0; }},
      {"other_model", "parameters of another model", [](tiller::Config& c) { c.param_count += 1; }},
  };
  return all;
}

bool is_refused(const Refusal& refusal, Robot robot) {
  tiller::Config config = setup_of(robot, 1).config;
  const std::size_t good = tiller_size(&config);
  std::vector<unsigned char> bytes(good + 2 * TILLER_ALIGNMENT);
  const auto first = reinterpret_cast<std::uintptr_t>(bytes.data());
  const std::size_t skip = (TILLER_ALIGNMENT - first % TILLER_ALIGNMENT) % TILLER_ALIGNMENT;
  unsigned char* block = bytes.data() + skip;

  tiller_t* controller = nullptr;
  if (tiller_init(&controller, &config, nullptr, block, good) != tiller_status_ok) return false;  // the judge is blind
  controller = nullptr;
  refusal.spoil(config);
  const tiller_status_t status =
      tiller_init(&controller, &config, nullptr, block + refusal.shift_bytes, good - refusal.missing_bytes);
  return status != tiller_status_ok && controller == nullptr;
}

}  // namespace tiller::faults
