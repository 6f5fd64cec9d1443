#include "io/lcm_transport.hpp"

#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/liblcm_backend.hpp"
#include "io/monotonic_clock.hpp"
#include "io/random_secret.hpp"

namespace tiller {
namespace {

// Drains what a plant can have sent between two ticks; bounded, so a flood cannot hold a tick.
constexpr int kMaxHandled = 256;

LcmTransport* transport_of(void* self) { return static_cast<LcmTransport*>(self); }

bool is_open(const LcmTransport* transport) { return transport->udp.is_open() || transport->lcm != nullptr; }

// ---- receiving ----

bool refuse(LcmTransport* transport, std::uint64_t& counter, const char* why) {
  ++counter;
  transport->refusal = why;
  return false;
}

const char* wrong_content(const LcmMeasurement& message, std::uint32_t expected) {
  if (message.count < 0 || static_cast<std::uint32_t>(message.count) != expected)
    return "a measurement's count is not the number of values in the robot file's [measurement]";
  if (message.sequence < 0 || message.sequence > std::int64_t{0xffffffff})
    return "a measurement's sequence is outside 0..4294967295";
  if (message.command_latency_us < 0) return "a measurement's command_latency_us is negative";
  return nullptr;
}

tiller_measurement_t convert(const LcmMeasurement& message) {
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

const char* not_ours(const LcmTransport* transport, std::uint32_t size) {
  const std::uint32_t count = transport->options.measurement_count;
  LcmMeasurement of_ours{};
  of_ours.count = static_cast<std::int32_t>(count);
  if (!transport->seal.has_key() &&
      size == lcm_size(lcm_measurement_type(count), &of_ours) + MessageSeal::kTrailerBytes)
    return "a measurement is signed, and the robot file names no key_file";
  return "a message is neither a tiller_lcm.measurement_t nor a wide_measurement_t (length or fingerprint)";
}

tiller_status_t udp_poll(LcmTransport* transport) {
  UdpDatagram datagram;
  for (int handled = 0; handled < kMaxHandled; ++handled) {
    const UdpRead result = transport->udp.read(&datagram);
    if (result == UdpRead::kNothing) break;
    if (result == UdpRead::kFailed) return tiller_status_io_error;
    if (datagram.refusal != nullptr)
      refuse(transport, transport->counters.bad_messages, datagram.refusal);
    else
      lcm_take_packet(transport, datagram.bytes, datagram.size, datagram.waited_us);
  }
  return tiller_status_ok;
}

tiller_status_t lcm_poll(void* self, tiller_measurement_t* measurement) {
  LcmTransport* transport = transport_of(self);
  if (!is_open(transport)) return tiller_status_transport_closed;
  const tiller_status_t status = transport->lcm != nullptr ? liblcm_poll(transport, kMaxHandled) : udp_poll(transport);
  if (status != tiller_status_ok) return status;
  if (!transport->has_new) return tiller_status_no_new_measurement;
  transport->has_new = false;
  *measurement = transport->newest;
  return tiller_status_ok;
}

// ---- sending ----

/// Without a type: a message that is nothing but its trailer.
tiller_status_t publish(LcmTransport* transport, const char* channel, const LcmType* type, const void* message) {
  std::uint8_t packet[UdpDatagram::kCapacity];
  const bool own = transport->lcm == nullptr;
  std::uint32_t size = type != nullptr ? lcm_size(*type, message) : 0;
  const std::uint32_t at = lc02_begin(packet, sizeof packet, transport->packets_sent, channel);
  if (at == 0 || at + size + MessageSeal::kTrailerBytes > sizeof packet) return tiller_status_bad_message;
  std::uint8_t* body = packet + at;
  if (type != nullptr) (void)lcm_encode(*type, message, body);
  if (transport->seal.has_key()) {
    transport->seal.seal(channel, body, size, monotonic_us());
    size += MessageSeal::kTrailerBytes;
  }
  const tiller_status_t status =
      own ? transport->udp.send(packet, at + size) : liblcm_publish(transport, channel, body, size);
  ++transport->packets_sent;
  if (status == tiller_status_queue_full) ++transport->counters.queue_full;
  return status;
}

tiller_status_t publish_command(LcmTransport* transport, const tiller_command_t& command) {
  const LcmCommand message = lcm_message(command, transport->options.input_count);
  return publish(transport, transport->command_channel, &lcm_command_type(transport->options.input_count), &message);
}

tiller_status_t lcm_send(void* self, const tiller_command_t* command) {
  LcmTransport* transport = transport_of(self);
  if (!is_open(transport)) return tiller_status_transport_closed;
  for (std::uint32_t i = 0; i < transport->options.input_count; ++i)
    if (!std::isfinite(command->value[i])) return tiller_status_command_not_finite;
  if (transport->options.lockstep) transport->answers.note(*command);
  const tiller_status_t status = publish_command(transport, *command);
  if (status == tiller_status_ok) ++transport->counters.sent;
  return status;
}

/// The plant has not got the answer, or not yet: it may still be on its way, and the plant takes it once.
void repeat_answer(LcmTransport* transport) {
  const tiller_command_t* answer = transport->answers.answer();
  if (answer == nullptr || !is_open(transport)) return;
  if (publish_command(transport, *answer) == tiller_status_ok) ++transport->repeated_answers;
}

/// The plant's message proves nothing of when it was signed: the next one can, once the plant has heard this.
void challenge(LcmTransport* transport) {
  ++transport->challenged;
  if (is_open(transport)) (void)publish(transport, transport->command_channel, nullptr, nullptr);
}

bool is_authentic(LcmTransport* transport, const std::uint8_t* bytes, std::uint32_t size) {
  const SealState state = transport->seal.check(transport->measurement_channel, bytes, size, monotonic_us());
  if (state == SealState::kOk) return true;
  if (state != SealState::kUnanswered && state != SealState::kHeldUp)
    return refuse(transport, transport->counters.bad_messages, seal_text(state));
  challenge(transport);
  if (transport->challenged > MessageSeal::kMeetingMessages) transport->refusal = seal_text(state);
  return false;
}

// ---- the table ----

int lcm_descriptor(void* self) {
  LcmTransport* transport = transport_of(self);
  return transport->lcm != nullptr ? liblcm_descriptor(transport) : transport->udp.descriptor();
}

void lcm_counters(const void* self, tiller_transport_counters_t* counters) {
  *counters = static_cast<const LcmTransport*>(self)->counters;
}

void lcm_close(void* self) {
  LcmTransport* transport = transport_of(self);
  transport->udp.close();
  if (transport->lcm != nullptr) liblcm_close(transport);
}

// ---- opening ----

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

void name_channels(LcmTransport* transport, const char* prefix) {
  std::snprintf(transport->measurement_channel, LcmTransport::kMaxChannel, "%sMEASUREMENT", prefix);
  std::snprintf(transport->command_channel, LcmTransport::kMaxChannel, "%sCOMMAND", prefix);
  std::snprintf(transport->telemetry_channel, LcmTransport::kMaxChannel, "%sTELEMETRY", prefix);
  std::snprintf(transport->forces_channel, LcmTransport::kMaxChannel, "%sFORCES", prefix);
  std::snprintf(transport->probing_channel, LcmTransport::kMaxChannel, "%sPROBING", prefix);
}

tiller_status_t make_seal(LcmTransport* transport, const LcmOptions& options, OpenError* error) {
  if (options.key == nullptr) return tiller_status_ok;
  std::uint8_t secret[MessageSeal::kSecretBytes];
  const tiller_status_t status = read_random(secret, sizeof secret, error);
  if (status == tiller_status_ok) transport->seal = MessageSeal(options.key, secret, options.replay_window_us);
  return status;
}

tiller_status_t open_udp(LcmTransport* transport, const char* text, OpenError* error) {
  UdpmUrl url;
  if (const char* wrong = parse_udpm_url(text, &url)) {
    set_open_error(error, "lcm: url '%.120s': %s", text, wrong);
    return tiller_status_io_error;
  }
  return transport->udp.open(url, transport->measurement_channel, error);
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
  const auto* bytes = static_cast<const std::uint8_t*>(data);
  if (transport->seal.has_key()) {
    if (!is_authentic(transport, bytes, size)) return false;
    size -= MessageSeal::kTrailerBytes;
    if (size == 0) return false;  // a challenge and nothing else
  }
  LcmMeasurement message{};
  if (!lcm_read(bytes, size, message)) return refuse(transport, counters.bad_messages, not_ours(transport, size));
  if (const char* why = wrong_content(message, transport->options.measurement_count))
    return refuse(transport, counters.bad_messages, why);
  if (!transport->options.lockstep && transport->options.max_wait_us > 0 && waited > transport->options.max_wait_us)
    return refuse(transport, counters.dropped_old, "a measurement waited too long before it was read");
  const auto sequence = static_cast<std::uint32_t>(message.sequence);
  if (transport->options.lockstep && transport->answers.is_repeated(sequence, message.stamp_us)) {
    repeat_answer(transport);
    return false;
  }
  const std::int64_t now_us = monotonic_us();
  // in lockstep a pause says nothing of the plant: whoever is held up for long must not take the past for new
  if (!transport->gate.accept(sequence, transport->options.lockstep ? 0 : now_us))
    return refuse(transport, counters.dropped_old, "a measurement's sequence is not newer than the last one");
  if (transport->options.lockstep) transport->answers.ask(sequence, message.stamp_us);
  if (transport->has_new) ++counters.dropped_old;
  transport->newest = convert(message);
  if (transport->options.stamp_on_arrival) transport->newest.stamp_us = now_us;
  transport->has_new = true;
  ++counters.received;
  return true;
}

bool lcm_take_packet(LcmTransport* transport, const std::uint8_t* bytes, std::uint32_t size, std::int64_t waited) {
  Lc02Packet packet;
  if (const char* why = lc02_parse(bytes, size, &packet))
    return refuse(transport, transport->counters.bad_messages, why);
  if (std::strcmp(packet.channel, transport->measurement_channel) != 0) return false;
  return lcm_take_measurement(transport, packet.message, packet.size, waited);
}

tiller_status_t lcm_transport_open(LcmTransport* transport, const LcmOptions& options, OpenError* error) {
  if (transport == nullptr) return tiller_status_null_argument;
  tiller_status_t status = check_options(options, error);
  if (status != tiller_status_ok) return status;
  *transport = LcmTransport();
  transport->options = options;
  transport->options.url = transport->options.channel_prefix = nullptr;
  transport->options.key = nullptr;
  status = make_seal(transport, options, error);
  if (status != tiller_status_ok) return status;
  name_channels(transport, options.channel_prefix);
  const bool library = options.liblcm || !is_udpm_url(options.url);
  return library ? liblcm_open(transport, options.url, error) : open_udp(transport, options.url, error);
}

tiller_status_t lcm_send_telemetry(LcmTransport* transport, std::int64_t stamp_us, const tiller_info_t& info,
                                   std::uint32_t state_count, std::uint32_t param_count, const LogState& log) {
  if (!is_open(transport)) return tiller_status_transport_closed;
  if (state_count > TILLER_MAX_STATES || param_count > TILLER_MAX_PARAMS) return tiller_status_bad_dimension;
  const LcmTelemetry message = lcm_message(info, stamp_us, state_count, param_count, log);
  tiller_status_t status =
      publish(transport, transport->telemetry_channel, &lcm_telemetry_type(state_count, param_count), &message);
  if (status == tiller_status_ok && info.force_joints > 0) {
    const LcmForces forces = lcm_forces(info, stamp_us);
    status = publish(transport, transport->forces_channel, &kLcmForcesType, &forces);
  }
  if (status != tiller_status_ok || !lcm_tells_of_probing(info)) return status;
  const LcmProbing probing = lcm_probing(info, stamp_us);
  return publish(transport, transport->probing_channel, &kLcmProbingType, &probing);
}

}  // namespace tiller
