#pragma once

#include <cstdint>

#include "io/answer_memory.hpp"
#include "io/lcm_messages.hpp"
#include "io/message_seal.hpp"
#include "io/open_error.hpp"
#include "io/sequence_gate.hpp"
#include "io/udp_multicast.hpp"
#include "tiller/transport.h"

struct _lcm_t;

namespace tiller {

/// Messages over LCM (UDP multicast): channels <prefix>MEASUREMENT, <prefix>COMMAND, <prefix>TELEMETRY and
/// <prefix>FORCES with the types of runtime/io/lcm. docs/guide/lcm.md is the plant's view.
struct LcmOptions {
  const char* url = "udpm://239.255.76.67:7667?ttl=0";  ///< ttl=0 keeps messages on this machine
  const char* channel_prefix = "TILLER_";               ///< letters, digits, _ and -; at most 40 characters
  std::uint32_t measurement_count = 0;                  ///< ny; messages with another count are refused
  std::uint32_t input_count = 0;                        ///< nu
  /// A message that waited longer than this between its arrival and poll is refused: the runtime was stopped
  /// or starved, and what it reads is the past. 0: never.
  std::int64_t max_wait_us = 500000;
  /// Replace the plant's stamp by this machine's monotonic clock at poll: for plants with a clock of their
  /// own.
  bool stamp_on_arrival = false;
  /// The plant waits for each answer, so only the order counts, and max_wait_us does not. It repeats a measurement
  /// whose answer does not come: one that was answered already gets the same command again, and is never taken as a
  /// new one, however long nothing came.
  bool lockstep = false;
  /// MessageSeal::kKeyBytes of a key that the plant has too, or null: measurements that are not signed with it are
  /// refused, commands and telemetry are signed. A plant whose messages answer no challenge is sent one on the command
  /// channel. Copied by open.
  const std::uint8_t* key = nullptr;
  std::int64_t replay_window_us = MessageSeal::kWindowUs;  ///< see MessageSeal
  /// Go through liblcm, where this build has it, instead of the runtime's own codec. Providers other than udpm always
  /// do. liblcm has a thread of its own, and a heap.
  bool liblcm = false;
};

/// Owned by the caller, filled by lcm_transport_open. One thread at a time.
struct LcmTransport {
  static constexpr std::uint32_t kMaxPrefix = 40;
  static constexpr std::uint32_t kMaxChannel = kMaxPrefix + 16;

  UdpMulticast udp;
  _lcm_t* lcm = nullptr;  // in place of udp
  LcmOptions options;     // its pointers are not kept
  char measurement_channel[kMaxChannel] = "";
  char command_channel[kMaxChannel] = "";
  char telemetry_channel[kMaxChannel] = "";
  char forces_channel[kMaxChannel] = "", probing_channel[kMaxChannel] = "";
  MessageSeal seal;
  std::uint64_t challenged = 0;  ///< authentic messages that answered no challenge, or one of too long ago
  std::uint32_t packets_sent = 0;
  SequenceGate gate;
  AnswerMemory answers;                ///< in lockstep
  std::uint64_t repeated_answers = 0;  ///< in lockstep: sent again, because the plant asked again
  bool has_new = false;
  tiller_measurement_t newest{};
  tiller_transport_counters_t counters{};
  /// Why a message was last refused (a literal), for a tool's report; null if none was.
  const char* refusal = nullptr;
};

extern const tiller_transport_t kLcmTransport;

/// Joins the multicast group and subscribes. With the own codec (url udpm://) the only call that uses the heap; liblcm
/// takes milliseconds here, and seconds where multicast does not work.
[[nodiscard]] tiller_status_t lcm_transport_open(LcmTransport* transport, const LcmOptions& options, OpenError* error);

/// Telemetry of the controller, and behind it the forces beyond the model and what it does to find out, if there are
/// any. Cost: one encode of 700 bytes and one sendto; each of the others is one more, of at most 300 bytes.
tiller_status_t lcm_send_telemetry(LcmTransport* transport, std::int64_t stamp_us, const tiller_info_t& info,
                                   std::uint32_t state_count, std::uint32_t param_count, const LogState& log = {});

/// Takes one encoded measurement (with its trailer, if there is a key): any bytes, any length. `waited_us` is the time
/// since its arrival. True if it is now the newest one.
bool lcm_take_measurement(LcmTransport* transport, const void* data, std::uint32_t size, std::int64_t waited_us);

/// Takes one datagram: any bytes, any length. Messages on other channels are passed over, without a count. True if it
/// was a measurement that is now the newest one.
bool lcm_take_packet(LcmTransport* transport, const std::uint8_t* bytes, std::uint32_t size, std::int64_t waited_us);

}  // namespace tiller
