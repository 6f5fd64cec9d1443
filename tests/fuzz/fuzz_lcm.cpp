// The runtime's LCM codec: packets, messages, signatures, URLs. An input is one byte of options, then packets, each
// with its length in two bytes, or what the option says.
#include <cmath>
#include <cstring>

#include "fuzz.hpp"
#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/lcm_transport.hpp"

namespace {

constexpr std::uint32_t kValues = 3;
const std::uint8_t kSecret[tiller::MessageSeal::kSecretBytes] = {4, 5, 6};
const std::uint8_t kOtherSecret[tiller::MessageSeal::kSecretBytes] = {7, 8, 9};

void check_newest(const tiller::LcmTransport& transport) {
  for (std::uint32_t i = kValues; i < TILLER_MAX_MEASUREMENTS; ++i)
    fuzz::require(transport.newest.value[i] == 0.0, "values beyond the configured count stay zero");
}

void take_packets(fuzz::Bytes& input, bool has_key) {
  static const std::uint8_t key[tiller::MessageSeal::kKeyBytes] = {1, 2, 3};
  tiller::LcmTransport transport;
  transport.options.measurement_count = kValues;
  std::strcpy(transport.measurement_channel, "M");
  if (has_key) transport.seal = tiller::MessageSeal(key, kSecret, 0);
  std::uint64_t taken = 0;
  while (!input.empty()) {
    const std::uint32_t high = input.byte();
    const std::string packet = input.take(high << 8 | input.byte());
    taken += tiller::lcm_take_packet(&transport, reinterpret_cast<const std::uint8_t*>(packet.data()),
                                     static_cast<std::uint32_t>(packet.size()), 0);
    check_newest(transport);
  }
  fuzz::require(taken == transport.counters.received, "every measurement taken is counted");
  fuzz::require(taken == 0 || transport.has_new, "a measurement that was taken is there");
}

void parse_url(const std::string& text) {
  tiller::UdpmUrl url;
  if (tiller::parse_udpm_url(text.c_str(), &url) != nullptr) return;
  fuzz::require(url.group[0] >= 224 && url.group[0] <= 239 && url.port > 0, "a URL that is read names a group");
}

void check_seal(const std::string& message) {
  static const std::uint8_t key[tiller::MessageSeal::kKeyBytes] = {1, 2, 3};
  tiller::MessageSeal seal(key, kSecret, 0), sender(key, kOtherSecret, 0);
  const auto size = static_cast<std::uint32_t>(message.size());
  fuzz::require(
      seal.check("M", reinterpret_cast<const std::uint8_t*>(message.data()), size, 1) != tiller::SealState::kOk,
      "nobody guesses a signature");
  std::string room = message + std::string(tiller::MessageSeal::kTrailerBytes, '\0');
  auto* bytes = reinterpret_cast<std::uint8_t*>(&room[0]);
  sender.seal("M", bytes, size, 1);
  fuzz::require(seal.check("M", bytes, size + tiller::MessageSeal::kTrailerBytes, 1) == tiller::SealState::kUnanswered,
                "a sender that has not heard the challenge is not taken");
  std::uint8_t challenge[tiller::MessageSeal::kTrailerBytes];
  seal.seal("C", challenge, 0, 1);
  (void)sender.check("C", challenge, sizeof challenge, 1);
  sender.seal("M", bytes, size, 1);
  fuzz::require(seal.check("M", bytes, size + tiller::MessageSeal::kTrailerBytes, 1) == tiller::SealState::kOk,
                "what is signed and answers it is authentic");
}

tiller_measurement_t measurement_of(fuzz::Bytes& input, std::uint32_t count) {
  tiller_measurement_t m{};
  m.stamp_us = static_cast<std::int64_t>(input.long_word());
  m.sequence = input.word();
  m.command_latency_us = input.word() >> 1;  // more is cut to what the message holds
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint64_t bits = input.long_word();
    std::memcpy(&m.value[i], &bits, sizeof bits);
  }
  return m;
}

/// Our own plants' messages are read by the runtime.
void check_round_trip(fuzz::Bytes& input) {
  const std::uint32_t count = 1 + input.byte() % TILLER_MAX_MEASUREMENTS;
  const tiller_measurement_t sent = measurement_of(input, count);
  std::uint8_t packet[1024];
  const std::uint32_t at = tiller::lc02_begin(packet, sizeof packet, 7, "M");
  const tiller::LcmMeasurement message = tiller::lcm_message(sent, count);
  const std::uint32_t size = tiller::lcm_encode(tiller::lcm_measurement_type(count), &message, packet + at);
  tiller::LcmTransport transport;
  transport.options.measurement_count = count;
  std::strcpy(transport.measurement_channel, "M");
  fuzz::require(tiller::lcm_take_packet(&transport, packet, at + size, 0), "what we write we read");
  const tiller_measurement_t& got = transport.newest;
  fuzz::require(got.stamp_us == sent.stamp_us && got.sequence == sent.sequence, "stamp and number come back");
  for (std::uint32_t i = 0; i < TILLER_MAX_MEASUREMENTS; ++i)
    fuzz::require(std::isnan(sent.value[i]) ? std::isnan(got.value[i])
                                            : std::memcmp(&got.value[i], &sent.value[i], sizeof(double)) == 0,
                  "values come back to the last bit");
}

}  // namespace

// Requirement: SR-16, SR-17
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes input(data, size);
  switch (input.byte() % 8) {
    case 0: take_packets(input, false); break;
    case 1: take_packets(input, true); break;
    case 2: parse_url("udpm://" + input.take(256)); break;
    case 3: check_seal(input.take(512)); break;
    default: check_round_trip(input);
  }
  return 0;
}
