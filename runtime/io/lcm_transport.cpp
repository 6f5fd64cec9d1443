#include "io/lcm_transport.hpp"

#include <lcm/lcm.h>
#include <sys/time.h>

#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

#include "io/monotonic_clock.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tiller_lcm/telemetry_t.hpp"

namespace tiller {
namespace {

// More than liblcm queues for one subscription (30), so a poll drains it; bounded, so a flood cannot hold a
// tick.
constexpr int kMaxHandled = 64;

bool refuse(LcmTransport* transport, std::uint64_t& counter, const char* why) {
  ++counter;
  transport->refusal = why;
  return false;
}

// liblcm stamps arrivals with the wall clock. Should that be set back meanwhile, the wait comes out negative
// and the message passes: the sequence gate still stands.
std::int64_t waited_us(std::int64_t arrival_wall_us) {
  timeval now;
  gettimeofday(&now, nullptr);
  return static_cast<std::int64_t>(now.tv_sec) * 1000000 + now.tv_usec - arrival_wall_us;
}

void on_measurement(const lcm_recv_buf_t* buffer, const char*, void* user) {
  lcm_take_measurement(static_cast<LcmTransport*>(user), buffer->data, buffer->data_size,
                       waited_us(buffer->recv_utime));
}

const char* wrong_content(const tiller_lcm::measurement_t& message, std::uint32_t expected) {
  if (message.count < 0 || static_cast<std::uint32_t>(message.count) != expected)
    return "a measurement's count is not the number of values in the robot file's [measurement]";
  if (message.sequence < 0 || message.sequence > std::int64_t{0xffffffff})
    return "a measurement's sequence is outside 0..4294967295";
  if (message.command_latency_us < 0) return "a measurement's command_latency_us is negative";
  return nullptr;
}

tiller_measurement_t convert(const tiller_lcm::measurement_t& message) {
  tiller_measurement_t measurement{};
  measurement.stamp_us = message.stamp_us;
  measurement.sequence = static_cast<std::uint32_t>(message.sequence);
  measurement.command_latency_us = static_cast<std::uint32_t>(message.command_latency_us);
  for (int i = 0; i < message.count; ++i) {
    const bool valid = (static_cast<std::uint32_t>(message.valid_mask) >> i & 1u) != 0;
    measurement.value[i] = valid ? message.value[i] : std::numeric_limits<double>::quiet_NaN();
  }
  return measurement;
}

tiller_status_t lcm_poll(void* self, tiller_measurement_t* measurement) {
  auto* transport = static_cast<LcmTransport*>(self);
  if (transport->lcm == nullptr) return tiller_status_transport_closed;
  int handled = 0;
  while (handled < kMaxHandled) {
    const int result = lcm_handle_timeout(transport->lcm, 0);
    if (result < 0) return tiller_status_io_error;
    if (result == 0) break;
    ++handled;
  }
  if (!transport->has_new) return tiller_status_no_new_measurement;
  transport->has_new = false;
  *measurement = transport->newest;
  return tiller_status_ok;
}

template <class Message, int kBytes>
tiller_status_t publish(LcmTransport* transport, const char* channel, const Message& message) {
  unsigned char bytes[kBytes];
  const int size = message.encode(bytes, 0, kBytes);
  if (size < 0) return tiller_status_bad_message;
  if (lcm_publish(transport->lcm, channel, bytes, static_cast<unsigned>(size)) != 0) {
    if (errno != ENOBUFS && errno != EAGAIN) return tiller_status_io_error;
    ++transport->counters.queue_full;
    return tiller_status_queue_full;
  }
  return tiller_status_ok;
}

tiller_status_t lcm_send(void* self, const tiller_command_t* command) {
  auto* transport = static_cast<LcmTransport*>(self);
  if (transport->lcm == nullptr) return tiller_status_transport_closed;
  tiller_lcm::command_t message{};
  message.stamp_us = command->stamp_us;
  message.sequence = command->sequence;
  message.state = static_cast<std::int32_t>(command->state);
  message.plan_sequence = command->plan_sequence;
  message.count = static_cast<std::int32_t>(transport->options.input_count);
  for (std::uint32_t i = 0; i < transport->options.input_count; ++i) {
    if (!std::isfinite(command->value[i])) return tiller_status_command_not_finite;
    message.value[i] = command->value[i];
  }
  const tiller_status_t status = publish<tiller_lcm::command_t, 128>(transport, transport->command_channel, message);
  if (status == tiller_status_ok) ++transport->counters.sent;
  return status;
}

int lcm_descriptor(void* self) {
  auto* transport = static_cast<LcmTransport*>(self);
  return transport->lcm != nullptr ? lcm_get_fileno(transport->lcm) : -1;
}

void lcm_counters(const void* self, tiller_transport_counters_t* counters) {
  *counters = static_cast<const LcmTransport*>(self)->counters;
}

void lcm_close(void* self) {
  auto* transport = static_cast<LcmTransport*>(self);
  if (transport->lcm != nullptr) lcm_destroy(transport->lcm);
  transport->lcm = nullptr;
}

// liblcm takes a channel for a regular expression, so a prefix may hold nothing that is special there.
bool is_prefix(const char* prefix) {
  if (std::strlen(prefix) > LcmTransport::kMaxPrefix) return false;
  for (const char* c = prefix; *c != '\0'; ++c)
    if (std::isalnum(static_cast<unsigned char>(*c)) == 0 && *c != '_' && *c != '-') return false;
  return true;
}

tiller_status_t check_options(const LcmOptions& options, OpenError* error) {
  if (options.url == nullptr || options.channel_prefix == nullptr) return tiller_status_null_argument;
  if (!is_prefix(options.channel_prefix)) {
    set_open_error(error, "lcm: channel_prefix '%.60s' may hold at most %u letters, digits, '_' and '-'",
                   options.channel_prefix, LcmTransport::kMaxPrefix);
    return tiller_status_bad_message;
  }
  if (options.measurement_count < 1 || options.measurement_count > TILLER_MAX_MEASUREMENTS || options.input_count < 1 ||
      options.input_count > TILLER_MAX_INPUTS) {
    set_open_error(error, "lcm: %u measurements and %u inputs; messages hold 1..%d and 1..%d",
                   options.measurement_count, options.input_count, TILLER_MAX_MEASUREMENTS, TILLER_MAX_INPUTS);
    return tiller_status_bad_dimension;
  }
  return tiller_status_ok;
}

}  // namespace

const tiller_transport_t kLcmTransport = {sizeof(tiller_transport_t),
                                          TILLER_TRANSPORT_VERSION,
                                          "lcm",
                                          lcm_poll,
                                          lcm_send,
                                          lcm_descriptor,
                                          lcm_counters,
                                          lcm_close};

bool lcm_take_measurement(LcmTransport* transport, const void* data, std::uint32_t size, std::int64_t waited) {
  tiller_transport_counters_t& counters = transport->counters;
  tiller_lcm::measurement_t message{};
  if (size > 4096 || message.decode(data, 0, static_cast<int>(size)) < 0)
    return refuse(transport, counters.bad_messages,
                  "a message is not a tiller_lcm.measurement_t (length or fingerprint)");
  if (const char* why = wrong_content(message, transport->options.measurement_count))
    return refuse(transport, counters.bad_messages, why);
  if (transport->options.max_wait_us > 0 && waited > transport->options.max_wait_us)
    return refuse(transport, counters.dropped_old, "a measurement waited too long before it was read");
  const std::int64_t now_us = monotonic_us();
  if (!transport->gate.accept(static_cast<std::uint32_t>(message.sequence), now_us))
    return refuse(transport, counters.dropped_old, "a measurement's sequence is not newer than the last one");
  if (transport->has_new) ++counters.dropped_old;
  transport->newest = convert(message);
  if (transport->options.stamp_on_arrival) transport->newest.stamp_us = now_us;
  transport->has_new = true;
  ++counters.received;
  return true;
}

tiller_status_t lcm_transport_open(LcmTransport* transport, const LcmOptions& options, OpenError* error) {
  if (transport == nullptr) return tiller_status_null_argument;
  const tiller_status_t status = check_options(options, error);
  if (status != tiller_status_ok) return status;
  *transport = LcmTransport();
  transport->options = options;
  char channel[sizeof transport->command_channel];
  std::snprintf(channel, sizeof channel, "%sMEASUREMENT", options.channel_prefix);
  std::snprintf(transport->command_channel, sizeof channel, "%sCOMMAND", options.channel_prefix);
  std::snprintf(transport->telemetry_channel, sizeof channel, "%sTELEMETRY", options.channel_prefix);
  transport->lcm = lcm_create(options.url);
  if (transport->lcm == nullptr) {
    set_open_error(error,
                   "lcm: cannot open '%.120s'. Where there is no network, give loopback a multicast route: "
                   "ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo",
                   options.url);
    return tiller_status_io_error;
  }
  if (lcm_subscribe(transport->lcm, channel, on_measurement, transport) == nullptr) {
    set_open_error(error,
                   "lcm: cannot receive on '%.120s': multicast does not reach this process. Give loopback a "
                   "multicast route: ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo",
                   options.url);
    lcm_close(transport);
    return tiller_status_io_error;
  }
  transport->options.url = transport->options.channel_prefix = nullptr;
  return tiller_status_ok;
}

tiller_status_t lcm_send_telemetry(LcmTransport* transport, std::int64_t stamp_us, const tiller_info_t& info,
                                   std::uint32_t state_count, std::uint32_t param_count) {
  if (transport->lcm == nullptr) return tiller_status_transport_closed;
  if (state_count > TILLER_MAX_STATES || param_count > TILLER_MAX_PARAMS) return tiller_status_bad_dimension;
  tiller_lcm::telemetry_t message{};
  message.stamp_us = stamp_us;
  message.tick = static_cast<std::int64_t>(info.ticks);
  message.state = static_cast<std::int32_t>(info.state);
  message.status = info.status;
  message.first_fault = info.first_fault;
  message.planner_iterations = static_cast<std::int32_t>(info.planner_iterations);
  message.tick_ns = info.tick_ns;
  message.plans = static_cast<std::int64_t>(info.plans);
  message.plan_cost = info.plan_cost;
  message.effective_samples = info.effective_samples;
  message.likelihood_exponent = info.likelihood_exponent;
  message.noise_scale = info.noise_scale;
  static_assert(
      sizeof message.state_mean >= sizeof info.state_mean && sizeof message.param_mean >= sizeof info.param_mean,
      "the type holds fewer values than a controller may have");
  message.state_count = static_cast<std::int32_t>(state_count);
  message.param_count = static_cast<std::int32_t>(param_count);
  std::memcpy(message.state_mean, info.state_mean, state_count * sizeof(double));
  std::memcpy(message.state_sd, info.state_sd, state_count * sizeof(double));
  std::memcpy(message.param_mean, info.param_mean, param_count * sizeof(double));
  std::memcpy(message.param_sd, info.param_sd, param_count * sizeof(double));
  return publish<tiller_lcm::telemetry_t, 768>(transport, transport->telemetry_channel, message);
}

}  // namespace tiller
