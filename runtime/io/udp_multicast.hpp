#pragma once

#include <cstdint>

#include "io/open_error.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// LCM's URL udpm://GROUP:PORT?ttl=N&recv_buf_size=BYTES.
struct UdpmUrl {
  std::uint8_t group[4] = {239, 255, 76, 67};
  std::uint16_t port = 7667;
  std::uint8_t ttl = 0;  ///< 0: packets stay on this machine, and only this machine's are taken; 1: the local network
  std::int32_t receive_buffer_bytes = 0;  ///< 0: the kernel's default
};

/// Null and a filled `parsed`, or what is wrong with the URL, as a literal. Address and port may be left out.
const char* parse_udpm_url(const char* url, UdpmUrl* parsed);
/// Whether the URL names this provider at all.
bool is_udpm_url(const char* url);

/// The test that liblcm makes with a banner of its own on stderr: whether datagrams to the URL's group can leave this
/// process and reach it. False with a sentence and the command that mends it in `error` (nullable). True for a URL of
/// another provider, and for one that cannot be read, which is told elsewhere. Nothing is sent.
bool has_multicast_route(const char* url, OpenError* error);

/// A datagram and how long it lay in the kernel's queue.
struct UdpDatagram {
  static constexpr std::uint32_t kCapacity = 2048;  ///< several times what tiller's messages need

  std::uint8_t bytes[kCapacity];
  std::uint32_t size = 0;
  std::int64_t waited_us = 0;
  const char* refusal = nullptr;  ///< a literal: larger than the buffer, or from another machine although ttl is 0
};

enum class UdpRead : std::uint8_t { kNothing, kDatagram, kFailed };

/// One socket for LCM's traffic that never waits. Bound to the group's address, so that a datagram sent to this
/// machine's own address does not reach it, whatever the port. One thread at a time; no heap but in open.
class UdpMulticast {
 public:
  static constexpr std::uint32_t kMaxAddresses = 16;

  /// `channel` is the one LCM channel to be read: a packet filter in the kernel drops the others, so that a camera on
  /// the same group does not hold up a tick. Where the kernel has none, they arrive and the caller skips them.
  tiller_status_t open(const UdpmUrl& url, const char* channel, OpenError* error);
  UdpRead read(UdpDatagram* datagram);
  /// ok, queue_full (dropped) or io_error.
  tiller_status_t send(const std::uint8_t* bytes, std::uint32_t size);
  void close();

  bool is_open() const { return socket_ >= 0; }
  int descriptor() const { return socket_; }

 private:
  bool is_own(std::uint32_t address) const;
  bool configure(const UdpmUrl& url);
  void list_own_addresses();
  void attach_filter(const char* channel);

  int socket_ = -1;
  std::uint32_t group_ = 0;  // addresses in network byte order
  std::uint16_t port_ = 0;
  bool own_only_ = true;
  std::uint32_t address_count_ = 0;
  std::uint32_t addresses_[kMaxAddresses] = {};
};

}  // namespace tiller
