#include "io/udp_multicast.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace tiller {
namespace {

constexpr char kScheme[] = "udpm://";

/// A decimal number up to `largest`; moves `at` behind it. -1 if there is none.
std::int64_t number(const char*& at, std::int64_t largest) {
  if (*at < '0' || *at > '9') return -1;
  std::int64_t value = 0;
  for (; *at >= '0' && *at <= '9'; ++at) {
    value = 10 * value + (*at - '0');
    if (value > largest) return -1;
  }
  return value;
}

bool skip(const char*& at, const char* word) {
  const std::size_t length = std::strlen(word);
  if (std::strncmp(at, word, length) != 0) return false;
  at += length;
  return true;
}

const char* parse_address(const char*& at, UdpmUrl* parsed) {
  constexpr const char* kWrong = "the address is not a multicast group (224.0.0.0 to 239.255.255.255)";
  if (*at == '\0' || *at == '?') return nullptr;
  for (int i = 0; i < 4; ++i) {
    const std::int64_t part = i > 0 && !skip(at, ".") ? -1 : number(at, 255);
    if (part < 0) return kWrong;
    parsed->group[i] = static_cast<std::uint8_t>(part);
  }
  if (parsed->group[0] < 224 || parsed->group[0] > 239) return kWrong;
  if (!skip(at, ":")) return nullptr;
  const std::int64_t port = number(at, 65535);
  if (port < 1) return "the port is not 1..65535";
  parsed->port = static_cast<std::uint16_t>(port);
  return nullptr;
}

const char* parse_argument(const char*& at, UdpmUrl* parsed) {
  if (skip(at, "ttl=")) {
    const std::int64_t ttl = number(at, 255);
    if (ttl < 0) return "ttl is not 0..255";
    parsed->ttl = static_cast<std::uint8_t>(ttl);
    return nullptr;
  }
  if (skip(at, "recv_buf_size=")) {
    const std::int64_t bytes = number(at, 0x7fffffff);
    if (bytes < 0) return "recv_buf_size is not a number of bytes";
    parsed->receive_buffer_bytes = static_cast<std::int32_t>(bytes);
    return nullptr;
  }
  return "an argument is unknown (known: ttl, recv_buf_size)";
}

template <class Value>
bool set_option(int socket, int level, int name, const Value& value) {
  return setsockopt(socket, level, name, &value, sizeof value) == 0;
}

std::uint32_t network_order(const std::uint8_t* group) {
  std::uint32_t address;
  std::memcpy(&address, group, sizeof address);
  return address;
}

// The kernel stamps arrivals with the wall clock. Should that be set back meanwhile, the wait comes out negative and
// the datagram passes: the sequence gate still stands.
std::int64_t waited_us(msghdr& message) {
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_TIMESTAMP) continue;
    timeval then, now;
    std::memcpy(&then, CMSG_DATA(c), sizeof then);
    gettimeofday(&now, nullptr);
    return static_cast<std::int64_t>(now.tv_sec - then.tv_sec) * 1000000 + (now.tv_usec - then.tv_usec);
  }
  return 0;
}

/// A classic BPF program that lets one channel pass: as a whole message, or as the first fragment of a larger one,
/// which the parser then refuses by name. It sees a datagram from its UDP header on.
class ChannelFilter {
 public:
  explicit ChannelFilter(const char* channel) {
    constexpr std::uint32_t kPayload = 8, kFragmentNumber = kPayload + 16;
    const std::uint32_t size = static_cast<std::uint32_t>(std::strlen(channel)) + 1;
    load(BPF_W, kPayload);
    const std::uint32_t whole = add(BPF_JMP | BPF_JEQ | BPF_K, 0x4c433032);
    drop_unless(0x4c433033);
    load(BPF_H, kFragmentNumber);
    drop_unless(0);
    compare(channel, size, kPayload + 20);
    code_[whole].jt = static_cast<std::uint8_t>(count_ - whole - 1);
    compare(channel, size, kPayload + 8);
    const std::uint32_t drop = add(BPF_RET | BPF_K, 0);
    for (std::uint32_t i = 0; i < count_; ++i)
      if (code_[i].jf == kDrop) code_[i].jf = static_cast<std::uint8_t>(drop - i - 1);
  }
  sock_fprog program() { return {static_cast<unsigned short>(count_), code_}; }

 private:
  static constexpr std::uint8_t kDrop = 255;  // a mark, until the distance is known

  std::uint32_t add(unsigned code, std::uint32_t k) {
    code_[count_] = sock_filter{static_cast<std::uint16_t>(code), 0, 0, k};
    return count_++;
  }
  void load(unsigned width, std::uint32_t at) { add(BPF_LD | BPF_ABS | width, at); }
  void drop_unless(std::uint32_t value) { code_[add(BPF_JMP | BPF_JEQ | BPF_K, value)].jf = kDrop; }
  void compare(const char* channel, std::uint32_t size, std::uint32_t at) {
    std::uint32_t i = 0;
    for (; i + 4 <= size; i += 4) {
      std::uint32_t word = 0;
      for (std::uint32_t j = 0; j < 4; ++j) word = word << 8 | static_cast<std::uint8_t>(channel[i + j]);
      load(BPF_W, at + i);
      drop_unless(word);
    }
    for (; i < size; ++i) {
      load(BPF_B, at + i);
      drop_unless(static_cast<std::uint8_t>(channel[i]));
    }
    add(BPF_RET | BPF_K, 0xffff);
  }

  sock_filter code_[96];  // two comparisons of 64 bytes and ten more
  std::uint32_t count_ = 0;
};

void tell_no_route(const UdpmUrl& url, int why, OpenError* error) {
  set_open_error(error,
                 "lcm: multicast %u.%u.%u.%u:%u does not reach this process: %s. Where there is no network, give "
                 "loopback a multicast route: ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo",
                 url.group[0], url.group[1], url.group[2], url.group[3], url.port, std::strerror(why));
}

sockaddr_in address_of(const UdpmUrl& url) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = network_order(url.group);
  address.sin_port = htons(url.port);
  return address;
}

/// The group can be joined, and there is a way out to it: each fails without a route, by kernel.
bool joins_and_reaches(int socket, const UdpmUrl& url) {
  const sockaddr_in address = address_of(url);
  ip_mreq group{};
  group.imr_multiaddr = address.sin_addr;
  return set_option(socket, IPPROTO_IP, IP_ADD_MEMBERSHIP, group) &&
         connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

}  // namespace

bool has_multicast_route(const char* url, OpenError* error) {
  UdpmUrl parsed;
  if (!is_udpm_url(url) || parse_udpm_url(url, &parsed) != nullptr) return true;
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return true;  // not a matter of routes
  const bool reaches = joins_and_reaches(socket, parsed);
  const int why = errno;
  ::close(socket);
  if (!reaches) tell_no_route(parsed, why, error);
  return reaches;
}

bool is_udpm_url(const char* url) { return std::strncmp(url, kScheme, sizeof kScheme - 1) == 0; }

const char* parse_udpm_url(const char* url, UdpmUrl* parsed) {
  if (!is_udpm_url(url)) return "it does not begin with udpm://";
  *parsed = UdpmUrl();
  const char* at = url + sizeof kScheme - 1;
  if (const char* wrong = parse_address(at, parsed)) return wrong;
  if (*at == '\0') return nullptr;
  if (!skip(at, "?")) return "something follows the port";
  do {
    if (const char* wrong = parse_argument(at, parsed)) return wrong;
  } while (skip(at, "&"));
  return *at == '\0' ? nullptr : "something follows an argument";
}

tiller_status_t UdpMulticast::open(const UdpmUrl& url, const char* channel, OpenError* error) {
  close();
  group_ = network_order(url.group);
  port_ = htons(url.port);
  own_only_ = url.ttl == 0;
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket_ < 0) {
    set_open_error(error, "lcm: cannot open a UDP socket: %s", std::strerror(errno));
    return tiller_status_io_error;
  }
  if (std::strlen(channel) < 64) attach_filter(channel);  // before bind: nothing else ever gets into the queue
  if (configure(url)) {
    if (own_only_) list_own_addresses();
    return tiller_status_ok;
  }
  const int why = errno;
  close();
  tell_no_route(url, why, error);
  return tiller_status_io_error;
}

bool UdpMulticast::configure(const UdpmUrl& url) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = group_;
  address.sin_port = port_;
  ip_mreq group{};  // not ip_mreqn, which says no more here and which qemu-user hands on with its last word undefined
  group.imr_multiaddr.s_addr = group_;
  const int on = 1;
  const int ttl = url.ttl;
  bool ok = set_option(socket_, SOL_SOCKET, SO_REUSEADDR, on);  // every process on the group binds this port
  ok = ok && set_option(socket_, SOL_SOCKET, SO_TIMESTAMP, on);
  ok = ok && set_option(socket_, IPPROTO_IP, IP_MULTICAST_LOOP, on);
  ok = ok && set_option(socket_, IPPROTO_IP, IP_MULTICAST_TTL, ttl);
  if (url.receive_buffer_bytes > 0) ok = ok && set_option(socket_, SOL_SOCKET, SO_RCVBUF, url.receive_buffer_bytes);
  ok = ok && bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  return ok && set_option(socket_, IPPROTO_IP, IP_ADD_MEMBERSHIP, group);
}

void UdpMulticast::list_own_addresses() {
  address_count_ = 0;
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return;
  for (const ifaddrs* i = list; i != nullptr && address_count_ < kMaxAddresses; i = i->ifa_next) {
    if (i->ifa_addr == nullptr || i->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address;
    std::memcpy(&address, i->ifa_addr, sizeof address);
    addresses_[address_count_++] = address.sin_addr.s_addr;
  }
  freeifaddrs(list);
}

// From outside, the kernel drops packets with one of these as their source. Where loopback is all there is, multicast
// has the source 0.0.0.0, which it takes from outside for 224.0.0.x alone.
bool UdpMulticast::is_own(std::uint32_t address) const {
  if (address == 0) return (ntohl(group_) >> 8) != 0xe00000;
  if ((ntohl(address) >> 24) == 127) return true;
  for (std::uint32_t i = 0; i < address_count_; ++i)
    if (addresses_[i] == address) return true;
  return false;
}

void UdpMulticast::attach_filter(const char* channel) {
  ChannelFilter filter(channel);
  const sock_fprog program = filter.program();
  (void)set_option(socket_, SOL_SOCKET, SO_ATTACH_FILTER, program);
}

UdpRead UdpMulticast::read(UdpDatagram* datagram) {
  sockaddr_in from{};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(timeval))];
  iovec part = {datagram->bytes, sizeof datagram->bytes};
  msghdr message{};
  message.msg_name = &from;
  message.msg_namelen = sizeof from;
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  ssize_t size;
  do {
    size = recvmsg(socket_, &message, MSG_DONTWAIT);
  } while (size < 0 && errno == EINTR);
  if (size < 0) return errno == EAGAIN ? UdpRead::kNothing : UdpRead::kFailed;
  datagram->size = static_cast<std::uint32_t>(size);
  datagram->waited_us = waited_us(message);
  datagram->refusal = nullptr;
  if ((message.msg_flags & MSG_TRUNC) != 0) datagram->refusal = "a message is larger than any of tiller's";
  if (own_only_ && !is_own(from.sin_addr.s_addr))
    datagram->refusal = "a message comes from another machine, and the url says ttl=0";
  return UdpRead::kDatagram;
}

tiller_status_t UdpMulticast::send(const std::uint8_t* bytes, std::uint32_t size) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = group_;
  to.sin_port = port_;
  const ssize_t sent =
      sendto(socket_, bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  if (sent == static_cast<ssize_t>(size)) return tiller_status_ok;
  const bool full = errno == ENOBUFS || errno == EAGAIN || errno == EINTR;
  return full ? tiller_status_queue_full : tiller_status_io_error;
}

void UdpMulticast::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

}  // namespace tiller
