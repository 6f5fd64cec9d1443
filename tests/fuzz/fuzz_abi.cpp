// The life of controllers as a program of calls: two at once, created, ticked, steered, stopped, reset and laid out
// anew in any order, with configurations, measurements, goals and boxes of any numbers. An input is two configurations,
// then steps of a call and its arguments. What is promised (tiller.h) is checked after every call.
//
// Controllers are as small as the ranges of config.def allow, settings are chosen by name out of these ranges, and a
// program ends after kLongestLife calls: a life takes a third of a millisecond without sanitizers.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "abi/config_fields.hpp"
#include "fuzz_controller.hpp"

namespace {

constexpr std::size_t kCanary = 128;
constexpr unsigned char kCanaryByte = 0xa5;
constexpr int kLongestLife = 64;
constexpr int kMostLayouts = 3;  // of one controller: each costs as much as twenty ticks

/// A value for a setting of config.def within its range: close to its lowest for a count, which is work; anywhere else,
/// by powers of ten where the range spans many. Beyond it where the first byte is above 240.
double value_of(fuzz::Bytes& input, const tiller::ConfigField& field) {
  const std::uint8_t choice = input.byte();
  const tiller::FieldRange& range = field.range;
  if (field.kind == tiller::FieldKind::count)
    return choice > 240 ? input.word() : range.low + field.multiple * (choice % 8);
  if (field.kind == tiller::FieldKind::flag || field.kind == tiller::FieldKind::choice)
    return choice > 240 ? input.word() : choice % (static_cast<std::uint32_t>(range.high) + 1);
  if (choice > 240) return fuzz::number(input);
  const double share = choice / 240.0;
  if (range.high - range.low <= 1e3) return range.low + share * (range.high - range.low);
  const double size = std::pow(10.0, -6.0 + 12.0 * (choice % 64) / 63.0);
  return choice < 16 ? 0.0 : range.low < 0.0 && choice % 2 == 1 ? -size : size;
}

void set(fuzz::Bytes& input, tiller::Config& c) {
  const tiller::ConfigFields fields = tiller::config_fields();
  const auto& field = fields.begin()[input.byte() % static_cast<std::size_t>(fields.end() - fields.begin())];
  const std::uint32_t element = field.kind == tiller::FieldKind::states ? input.byte() % 2u : 0;
  tiller::set_config_value(c, field, element, value_of(input, field));
}

/// Some of the configuration's own numbers overwritten, with those that a struct of settings may have; no pointers.
void spoil(fuzz::Bytes& input, tiller::Config& c) {
  struct Part {
    void* at;
    std::size_t bytes;
  };
  const Part parts[] = {{&c.planner, sizeof c.planner},
                        {&c.posterior, sizeof c.posterior},
                        {c.priors, 3 * sizeof *c.priors},
                        {c.safety.input_low, 8},
                        {c.safety.input_high, 8},
                        {c.safety.input_rate_per_s, 8},
                        {c.safety.safe_command, 8},
                        {&c.body, sizeof c.body},
                        {c.process_sd, 16},
                        {c.measurement_sd, 8},
                        {&c.period_s, 8}};
  const Part& part = parts[input.byte() % (sizeof parts / sizeof *parts)];
  const std::size_t words = part.bytes / 4;
  const std::size_t at = input.byte() % words;
  auto* bytes = static_cast<unsigned char*>(part.at);
  if ((input.byte() & 1) != 0 && at + 2 <= words) {
    const double value = fuzz::number(input);
    std::memcpy(bytes + at / 2 * 8, &value, sizeof value);
  } else {
    const std::uint32_t value = input.byte() < 200 ? input.byte() : input.word();
    std::memcpy(bytes + at * 4, &value, sizeof value);
  }
}

/// A torque that pushes back, with a range beyond which the fallback plans.
const tiller_policy_t& small_policy() {
  static const float weights[] = {0.0f, 0.5f, 0.0f, -0.3f}, low[] = {-1.0f, -1.0f, -8.0f}, high[] = {1.0f, 1.0f, 8.0f};
  static const tiller_network_t network = {
      sizeof network, TILLER_CONFIG_VERSION, tiller_network_tanh, 3, 1, 1, {0, 0}, weights, 4, 0};
  static const tiller_policy_t policy = {
      sizeof policy, TILLER_CONFIG_VERSION, tiller_policy_state, tiller_policy_cut, &network, low, high};
  return policy;
}

/// A small controller of the pendulum, and what the input makes of it.
tiller::Config config_of(fuzz::Bytes& input) {
  tiller::Config c = fuzz::small_pendulum();
  const std::uint8_t choice = input.byte();
  c.planner.kind = choice % tiller_planner_kind_count;
  if (c.planner.kind == tiller_planner_policy) c.policy = &small_policy();
  c.posterior.kind = choice / 16 % 2 == 0 ? tiller_posterior_filter : tiller_posterior_transition;
  if (c.posterior.kind == tiller_posterior_transition) {  // which wants every state
    c.measurement_count = 2;
    c.measured_state[1] = 1;
    c.measurement_sd[1] = 1.0;
  }
  c.posterior.disturbance = choice / 32 % 2;
  c.probe.weight = choice / 64 % 2;
  // The ratio's cut normal distribution is most of what a controller's first draw costs: half of them do without.
  if (choice / 64 % 2 == 0) c.posterior.noise_ratio_sd = 0.0;
  c.planner.predict_spread = choice / 128;
  const std::uint8_t changes = input.byte();
  for (int i = changes % 8; i > 0; --i) set(input, c);
  for (int i = changes / 8 % 8; i > 5; --i) spoil(input, c);
  return c;
}

/// What takes long by its own settings is measured and not laid out: fuzzers want thousands of lives a second.
bool is_small(const tiller_config_t& c) {
  const double work = 1.0 * c.planner.horizon * c.planner.rollouts * c.planner.particles * c.planner.iterations;
  return work <= 4096 && c.posterior.particles <= 64 && c.posterior.window <= 32 && c.planner.nodes <= 64 &&
         c.substeps <= 4 && c.planner.horizon <= 16 && c.posterior.moves_per_tick <= 16 && c.record_ticks <= 16 &&
         c.planner.qp_iterations <= 20 && c.planner.particles <= 8 && c.planner.refine_iterations <= 3 &&
         c.probe.rollouts <= 64 && c.planner.levels <= 8;
}

class Life {
 public:
  explicit Life(fuzz::Bytes& input) : config_(config_of(input)) {}

  void step(fuzz::Bytes& input) {
    if (layouts_ == 0) init(0);
    const std::uint8_t call = input.byte();
    switch (call % 16) {
      case 0: call < 64 && layouts_ < kMostLayouts ? init(input.byte()) : tick(input, call / 16); break;
      case 1: armed_ = call_with_status(tiller_arm(t_)) || armed_; break;
      case 2: armed_ = !call_with_status(tiller_disarm(t_)) && armed_; break;
      case 3: armed_ = !call_with_status(tiller_stop(t_, tiller_status_stopped)) && armed_; break;
      case 4: reset(); break;
      case 5: goal(input); break;
      case 6: box(input); break;
      case 7: (void)tiller_prepare(t_); break;
      case 8: (void)tiller_force_iterations(t_, input.byte()); break;
      case 9: read(input); break;
      default: tick(input, call / 16);
    }
    for (std::size_t i = 0; i < kCanary && memory_; ++i)
      fuzz::require(memory_[-1 - static_cast<long>(i)] == kCanaryByte && memory_[size_ + i] == kCanaryByte,
                    "nothing is written outside of the block");
  }

 private:
  /// Sizes beside the right one, a wrong alignment; what is right is laid out.
  void init(std::uint8_t choice) {
    ++layouts_;
    t_ = nullptr;
    memory_ = nullptr;
    const char* field = nullptr;
    const tiller_status_t checked = tiller_config_check(&config_, &field);
    fuzz::require((checked == tiller_status_ok) == (field == nullptr || *field == '\0'), "a refusal names its field");
    const std::size_t size = tiller_size(&config_);
    fuzz::require((size > 0) == (checked == tiller_status_ok), "a good configuration has a size");
    if (!is_small(config_) || size > (2u << 20)) return;
    storage_.assign(size + TILLER_ALIGNMENT + 2 * kCanary, kCanaryByte);
    const auto first = reinterpret_cast<std::uintptr_t>(storage_.data()) + kCanary;
    unsigned char* const aligned =
        storage_.data() + kCanary + (TILLER_ALIGNMENT - first % TILLER_ALIGNMENT) % TILLER_ALIGNMENT;
    if (size > 0 && choice % 4 == 1)
      fuzz::require(tiller_init(&t_, &config_, nullptr, aligned, size - 1) == tiller_status_memory_too_small,
                    "a byte less is too little");
    if (choice % 4 == 2)
      fuzz::require(tiller_init(&t_, &config_, nullptr, aligned + 8, size) != tiller_status_ok, "alignment");
    fuzz::require(t_ == nullptr, "what was refused gives no controller");
    const tiller_status_t made = tiller_init(&t_, &config_, nullptr, aligned, size);
    fuzz::require(made == checked, "init agrees with check");
    fuzz::require((t_ != nullptr) == (made == tiller_status_ok), "and gives a controller then");
    if (t_ == nullptr) return;
    memory_ = aligned;
    size_ = size;
    safe_ = moving_ = armed_ = ticked_ = set_back_ = false;
  }

  /// Whether the call was accepted.
  bool call_with_status(tiller_status_t status) {
    fuzz::require(t_ != nullptr || status == tiller_status_null_argument, "no controller, no call");
    return status == tiller_status_ok;
  }

  void reset() {
    if (call_with_status(tiller_reset(t_))) safe_ = armed_ = false;
  }

  void goal(fuzz::Bytes& input) {
    rows_.resize(4);
    for (double& value : rows_) value = fuzz::number(input);
    const std::uint8_t kind = input.byte();
    if (kind % 4 == 0) (void)tiller_set_target(t_, kind < 8 ? nullptr : rows_.data());
    if (kind % 4 == 1) (void)tiller_set_output_target(t_, kind < 8 ? nullptr : rows_.data());
    if (kind % 4 == 2) (void)tiller_set_reference(t_, rows_.data(), kind < 8 ? rows_.data() : nullptr, kind / 4 % 3);
    if (kind % 4 == 3) (void)tiller_set_reference(t_, nullptr, nullptr, 1);
  }

  void box(fuzz::Bytes& input) {
    double low[2], high[2], from = fuzz::number(input), to = fuzz::number(input);
    for (int i = 0; i < 2; ++i) low[i] = fuzz::number(input), high[i] = fuzz::number(input);
    const std::uint8_t kind = input.byte();
    const tiller_box_t wanted = {kind == 1 ? 3u : static_cast<std::uint32_t>(sizeof(tiller_box_t)),
                                 TILLER_CONFIG_VERSION,
                                 kind & 2 ? low : nullptr,
                                 kind & 4 ? high : nullptr,
                                 kind & 8 ? &from : nullptr,
                                 kind & 16 ? &to : nullptr};
    (void)tiller_calibrate(t_, kind == 0 ? nullptr : &wanted, input.byte());
  }

  /// Into arrays of exactly what the header says.
  void read(fuzz::Bytes& input) {
    const std::uint32_t np = config_.param_count, nx = 2, nu = 1, at = input.byte() < 250 ? input.byte() : input.word();
    std::vector<double> square(std::size_t{np} * np), params(np), state(nx), sd(nx), inputs(at % 80 + 1), gain(nx * nu),
        ratio(np);
    double weight = 0.0, value = 0.0;
    std::uint32_t d = 0;
    tiller_info_t info;
    tiller_get_info(t_, &info);
    (void)tiller_get_covariance(t_, square.data());
    (void)tiller_get_quantile(t_, at % 5, fuzz::number(input), &value);
    (void)tiller_get_contraction(t_, &d, ratio.data(), square.data());
    fuzz::require(d <= np, "no more directions than parameters");
    const std::uint32_t steps = tiller_get_plan(t_, inputs.data(), static_cast<std::uint32_t>(inputs.size()));
    fuzz::require(steps <= inputs.size(), "no more steps than there is room for");
    (void)tiller_get_feedback(t_, at, gain.data(), state.data(), &value);
    (void)tiller_get_prediction(t_, at, state.data(), sd.data());
    (void)tiller_get_particle(t_, at, params.data(), state.data(), &weight);
    (void)tiller_get_outputs(t_, nullptr);
    auto record = std::make_unique<tiller_record_t>();
    (void)tiller_get_record(t_, at, record.get());
  }

  void tick(fuzz::Bytes& input, std::uint8_t pace) {
    static constexpr std::int64_t kSteps_us[] = {20000, 20000, 20000, 20000, 0, 40000, 400000, -20000};
    now_us_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(now_us_) +
                                        static_cast<std::uint64_t>(kSteps_us[pace % 8]));
    const std::uint8_t kind = input.byte();
    if (kind == 255) now_us_ = static_cast<std::int64_t>(input.long_word());
    const double period_us = config_.period_s * 1e6 + 1.0;
    set_back_ = ticked_ && static_cast<double>(static_cast<__int128>(ticked_us_) - now_us_) > period_us;
    ticked_us_ = now_us_;
    ticked_ = true;
    tiller_measurement_t m;
    std::memset(&m, 0, sizeof m);
    m.stamp_us = kind % 16 == 1 ? static_cast<std::int64_t>(input.long_word()) : now_us_;
    m.sequence = ++sequence_;
    if (kind % 16 == 2) m.command_latency_us = input.word();
    const double step = (kind % 8 - 4) * 0.01;
    m.value[0] = angle_ += step;
    m.value[1] = step / 0.02;
    if (kind % 16 == 3) m.value[0] = fuzz::number(input);
    tiller_command_t command;
    std::memset(&command, 0xff, sizeof command);
    const bool has_reading = kind % 16 != 4;
    const tiller_status_t status = tiller_tick(t_, now_us_, has_reading ? &m : nullptr, &command);
    if (t_ == nullptr) {
      fuzz::require(status == tiller_status_null_argument && command.value[0] == 0.0, "a command is always filled");
      return;
    }
    const bool may_begin = has_reading && (std::isfinite(m.value[0]) || config_.measurement_count > 1);
    if (may_begin) stamps_.push_back(m.stamp_us);
    judge(command, may_begin);
  }

  /// Whether anything was given to this tick or one before it that is neither older than the timeout nor more of the
  /// future than small steps back of the clock make of it, which count as silence.
  bool has_fresh_reading() const {
    const double longest_us = config_.safety.sensor_timeout_s * 1e6 + 1.0, ahead_us = config_.period_s * 1e6 + 1.0;
    return std::any_of(stamps_.begin(), stamps_.end(), [&](std::int64_t stamp_us) {
      const double age_us = static_cast<double>(static_cast<__int128>(now_us_) - stamp_us);
      return age_us <= longest_us && age_us >= -ahead_us - longest_us;
    });
  }

  void judge(const tiller_command_t& command, bool may_begin) {
    const double u = command.value[0], low = config_.safety.input_low[0], high = config_.safety.input_high[0];
    fuzz::require(u >= low && u <= high, "a command is a number within its limits");
    for (int i = 1; i < TILLER_MAX_INPUTS; ++i)
      fuzz::require(command.value[i] == 0.0, "inputs that there are not are 0");
    const bool moving = command.state == tiller_state_active || command.state == tiller_state_hold;
    fuzz::require(command.state <= tiller_state_safe, "a state");
    if (!moving) fuzz::require(u == config_.safety.safe_command[0], "at rest the safe command goes out");
    if (!armed_) fuzz::require(!moving, "nothing moves before it is armed");
    if (moving) fuzz::require(has_fresh_reading(), "nothing moves on stale readings");
    if (moving) fuzz::require(!set_back_, "nothing moves at the tick whose clock was set back");
    if (moving && !moving_) fuzz::require(may_begin, "motion begins with a measurement");
    if (safe_) fuzz::require(command.state == tiller_state_safe, "SAFE is left by reset alone");
    safe_ = command.state == tiller_state_safe;
    armed_ = armed_ && !safe_;
    if (moving && moving_ && std::isfinite(config_.safety.input_rate_per_s[0])) {
      const double step = config_.safety.input_rate_per_s[0] * (config_.period_s + 1e-6);
      fuzz::require(std::fabs(u - last_) <= step * (1.0 + 1e-9) + 1e-12, "no faster than its rate");
    }
    moving_ = moving;
    last_ = u;
  }

  tiller::Config config_;
  std::vector<unsigned char> storage_;
  unsigned char* memory_ = nullptr;
  std::size_t size_ = 0;
  tiller_t* t_ = nullptr;
  std::vector<std::int64_t> stamps_;
  std::vector<double> rows_;  // a reference is not copied
  std::int64_t now_us_ = 1000000;
  std::uint32_t sequence_ = 0;
  double angle_ = 0.1, last_ = 0.0;
  int layouts_ = 0;
  bool safe_ = false, moving_ = false, armed_ = false;
  bool ticked_ = false, set_back_ = false;  // by this controller; by more than a period since its last tick
  std::int64_t ticked_us_ = 0;
};

}  // namespace

// Requirement: SR-1, SR-2, SR-3, SR-4, SR-5, SR-7, SR-12, SR-13, SR-14
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes input(data, size);
  Life first(input), second(input);
  for (int i = 0; i < kLongestLife && !input.empty(); ++i) {
    const std::uint8_t who = input.byte();
    (who % 4 == 0 ? second : first).step(input);
  }
  return 0;
}
