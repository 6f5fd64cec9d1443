// What io asks of the system beside CAN, refused: UDP, keys, random numbers, liblcm.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>

#include "fake_kernel.hpp"
#include "io/key_file.hpp"
#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/lcm_transport.hpp"
#include "io/liblcm_backend.hpp"
#include "io/message_seal.hpp"
#include "io/random_secret.hpp"
#include "io/realtime.hpp"
#include "io/udp_multicast.hpp"

namespace {

// liblcm, as far as the transport calls it.
struct Lcm {
  bool creates = true, subscribes = true;
  int handled = 0, publish_error = 0, destroyed = 0;
} lcm;

}  // namespace

extern "C" {
lcm_t* lcm_create(const char*) { return lcm.creates ? reinterpret_cast<lcm_t*>(&lcm) : nullptr; }
void lcm_destroy(lcm_t*) { ++lcm.destroyed; }
lcm_subscription_t* lcm_subscribe(lcm_t*, const char*, lcm_msg_handler_t, void*) {
  return lcm.subscribes ? reinterpret_cast<lcm_subscription_t*>(&lcm) : nullptr;
}
int lcm_handle_timeout(lcm_t*, int) { return lcm.handled > 0 ? lcm.handled-- : lcm.handled; }
int lcm_publish(lcm_t*, const char*, const void*, unsigned) {
  errno = lcm.publish_error;
  return lcm.publish_error == 0 ? 0 : -1;
}
int lcm_get_fileno(lcm_t*) { return 99; }
}

namespace tiller {
namespace {

using fake_kernel::kernel;

class RefusedCalls : public ::testing::Test {
 protected:
  void SetUp() override {
    fake_kernel::reset();
    lcm = Lcm();
  }
  void TearDown() override { fake_kernel::reset(); }
  OpenError error;
};

bool holds(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

// ---- UDP ----

UdpmUrl loopback_url() {
  UdpmUrl url;
  EXPECT_EQ(parse_udpm_url("udpm://239.255.76.67:7667?ttl=0&recv_buf_size=65536", &url), nullptr);
  return url;
}

TEST_F(RefusedCalls, EveryCallThatOpensUdpMayFail) {
  UdpMulticast udp;
  for (int calls = 0;; ++calls) {
    ASSERT_LT(calls, 30);
    fake_kernel::reset();
    kernel().refuse_after = calls;
    const int before = fake_kernel::open_descriptors();
    const tiller_status_t status = udp.open(loopback_url(), "A", &error);
    if (status == tiller_status_ok) {
      const std::set<std::string> refused = kernel().refused;
      udp.close();
      if (refused.empty()) break;
      // the filter saves copies and the list of addresses tells own packets: both may be missing
      const std::string filter = "setsockopt " + std::to_string(SOL_SOCKET) + " " + std::to_string(SO_ATTACH_FILTER);
      EXPECT_TRUE(refused.count("getifaddrs") + refused.count(filter) == 1) << *refused.begin();
      continue;
    }
    EXPECT_EQ(status, tiller_status_io_error);
    EXPECT_TRUE(holds(error.text, "lcm: ")) << error.text;
    EXPECT_FALSE(udp.is_open());
    EXPECT_EQ(fake_kernel::open_descriptors(), before);
  }
}

TEST_F(RefusedCalls, ReadingAndSendingTellFullFromBroken) {
  UdpMulticast udp;
  ASSERT_EQ(
      udp.open(loopback_url(), "A_CHANNEL_WHOSE_NAME_IS_LONGER_THAN_THE_63_LETTERS_THAT_LCM_MESSAGES_MAY_HAVE", &error),
      tiller_status_ok);
  UdpDatagram datagram;
  kernel().datagram_error = EINTR;
  EXPECT_EQ(udp.read(&datagram), UdpRead::kNothing) << "repeated";
  kernel().datagram_error = EAGAIN;
  EXPECT_EQ(udp.read(&datagram), UdpRead::kNothing);
  kernel().datagram_error = EIO;
  EXPECT_EQ(udp.read(&datagram), UdpRead::kFailed);
  const std::uint8_t bytes[4] = {};
  for (const int full : {ENOBUFS, EAGAIN, EINTR}) {
    kernel().datagram_error = full;
    EXPECT_EQ(udp.send(bytes, sizeof bytes), tiller_status_queue_full) << full;
  }
  kernel().datagram_error = EPERM;
  EXPECT_EQ(udp.send(bytes, sizeof bytes), tiller_status_io_error);
}

TEST_F(RefusedCalls, ARouteIsAskedForWhereItMatters) {
  EXPECT_TRUE(has_multicast_route("tcpq://localhost:7700", &error)) << "liblcm's own";
  EXPECT_TRUE(has_multicast_route("udpm://1.2.3.4:5", &error)) << "liblcm says what is wrong";
  EXPECT_TRUE(has_multicast_route("udpm://239.255.76.67:7667?ttl=0", &error));
  kernel().only = "socket";
  EXPECT_TRUE(has_multicast_route("udpm://239.255.76.67:7667?ttl=0", &error)) << "no matter of routes";
  kernel().only = "connect";
  kernel().error = ENETUNREACH;
  EXPECT_FALSE(has_multicast_route("udpm://239.255.76.67:7667?ttl=0", &error));
  EXPECT_TRUE(holds(error.text, "ip route add 224.0.0.0/4 dev lo")) << error.text;
}

TEST_F(RefusedCalls, UrlsAreReadToTheLastLetter) {
  UdpmUrl url;
  for (const char* good : {"udpm://", "udpm://?ttl=1", "udpm://239.0.0.1", "udpm://224.0.0.1:1"})
    EXPECT_EQ(parse_udpm_url(good, &url), nullptr) << good;
  for (const char* wrong :
       {"tcp://", "udpm://240.0.0.1", "udpm://223.0.0.1", "udpm://239.0.0.1:0", "udpm://239.0.0.:1", "udpm://239.0",
        "udpm://239.0.0.256", "udpm://239.0.0.1:1 ", "udpm://239.0.0.1:1?ttl=", "udpm://239.0.0.1:1?ttl=256",
        "udpm://239.0.0.1:1?recv_buf_size=", "udpm://239.0.0.1:1?ttl=1;", "udpm://239.0.0.1:1?hops=1"})
    EXPECT_NE(parse_udpm_url(wrong, &url), nullptr) << wrong;
}

TEST_F(RefusedCalls, WhoSentItAndHowMuchIsLookedAt) {
  UdpMulticast udp;
  kernel().made_up_addresses = 200;
  ASSERT_EQ(udp.open(loopback_url(), std::string(70, 'A').c_str(), &error), tiller_status_ok) << "more than it keeps";
  const int sender = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in from{}, to{};
  from.sin_family = to.sin_family = AF_INET;
  from.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  to.sin_addr.s_addr = inet_addr("239.255.76.67");
  to.sin_port = htons(7667);
  ASSERT_EQ(::bind(sender, reinterpret_cast<const sockaddr*>(&from), sizeof from), 0);
  const in_addr loopback = from.sin_addr;
  ASSERT_EQ(setsockopt(sender, IPPROTO_IP, IP_MULTICAST_IF, &loopback, sizeof loopback), 0);
  static const char bytes[UdpDatagram::kCapacity + 100] = {};
  UdpDatagram datagram;
  for (const std::size_t size : {std::size_t{10}, sizeof bytes}) {
    ASSERT_EQ(::sendto(sender, bytes, size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to),
              static_cast<ssize_t>(size));
    ASSERT_EQ(udp.read(&datagram), UdpRead::kDatagram);
    EXPECT_EQ(datagram.refusal != nullptr, size > UdpDatagram::kCapacity);
  }
  ::close(sender);
}

constexpr const char* kUdp = "udpm://239.255.76.67:7667?ttl=0";
constexpr const char* kLiblcm = "tcpq://localhost:7700";

LcmOptions by(const char* url) {
  LcmOptions options;
  options.url = url;
  options.channel_prefix = "";
  options.measurement_count = options.input_count = 1;
  return options;
}

TEST_F(RefusedCalls, AFloodHoldsNoTickAndABrokenSocketIsTold) {
  LcmTransport transport;
  ASSERT_EQ(lcm_transport_open(&transport, by(kUdp), &error), tiller_status_ok) << error.text;
  UdpMulticast other;
  ASSERT_EQ(other.open(loopback_url(), "OTHER", &error), tiller_status_ok);
  std::uint8_t packet[64];
  const std::uint32_t size = lc02_begin(packet, sizeof packet, 0, "MEASUREMENT");
  for (int i = 0; i < 300; ++i) ASSERT_EQ(other.send(packet, size), tiller_status_ok);
  tiller_measurement_t measurement;
  EXPECT_EQ(kLcmTransport.poll(&transport, &measurement), tiller_status_no_new_measurement);
  const std::uint64_t handled = transport.counters.bad_messages;
  EXPECT_LE(handled, 256u);
  EXPECT_GT(handled, 0u);
  kernel().datagram_error = EIO;
  EXPECT_EQ(kLcmTransport.poll(&transport, &measurement), tiller_status_io_error);
  other.close();
  kLcmTransport.close(&transport);
}

TEST_F(RefusedCalls, TelemetryStopsAtTheFirstMessageThatDoesNotGoOut) {
  LcmTransport transport;
  ASSERT_EQ(lcm_transport_open(&transport, by(kUdp), &error), tiller_status_ok) << error.text;
  tiller_info_t info{};
  const auto tell = [&](std::uint32_t states, std::uint32_t params) {
    return lcm_send_telemetry(&transport, 0, info, states, params, {});
  };
  EXPECT_EQ(tell(1, 1), tiller_status_ok);
  EXPECT_EQ(tell(TILLER_MAX_STATES + 1, 1), tiller_status_bad_dimension);
  EXPECT_EQ(tell(1, TILLER_MAX_PARAMS + 1), tiller_status_bad_dimension);
  info.force_joints = 1;
  info.probing = tiller_probing_plan;
  const std::uint32_t before = transport.packets_sent;
  EXPECT_EQ(tell(1, 1), tiller_status_ok);
  EXPECT_EQ(transport.packets_sent, before + 3) << "telemetry, forces, probing";
  kernel().datagram_error = EIO;
  EXPECT_EQ(tell(1, 1), tiller_status_io_error);
  EXPECT_EQ(transport.packets_sent, before + 4);
  kLcmTransport.close(&transport);
}

TEST_F(RefusedCalls, AnAnswerIsRepeatedWhileThereIsSomewhereToSendIt) {
  LcmTransport transport;
  LcmOptions options = by(kUdp);
  options.lockstep = true;
  ASSERT_EQ(lcm_transport_open(&transport, options, &error), tiller_status_ok) << error.text;
  LcmMeasurement message{};
  message.count = 1, message.valid_mask = 1, message.sequence = 1;
  std::uint8_t bytes[256];
  const std::uint32_t size = lcm_encode(kLcmMeasurementType, &message, bytes);
  const auto take = [&] { return lcm_take_measurement(&transport, bytes, size, 0); };
  EXPECT_TRUE(take());
  tiller_command_t command{};
  EXPECT_EQ(kLcmTransport.send(&transport, &command), tiller_status_ok);
  EXPECT_FALSE(take());
  EXPECT_EQ(transport.repeated_answers, 1u);
  kernel().datagram_error = EIO;
  EXPECT_FALSE(take());
  EXPECT_EQ(transport.repeated_answers, 1u) << "it did not go out";
  kLcmTransport.close(&transport);
  EXPECT_FALSE(take());
  EXPECT_EQ(transport.repeated_answers, 1u);
}

// ---- real time ----

TEST_F(RefusedCalls, MemoryIsLockedWithoutALimitAlone) {
  RealtimeOptions options;
  options.lock_memory = true;
  const auto given = [&] {
    const RealtimeReport report = realtime_begin(options);
    realtime_end(report);
    return report[RealtimePart::memory].given;
  };
  kernel().only = "mlockall";
  kernel().memory_lock = RLIM_INFINITY;
  EXPECT_FALSE(given()) << "refused";
  kernel().only = "getrlimit";
  (void)given();  // by the capability then, or not
  kernel().only.clear();
  kernel().memory_lock = 65536;
  (void)given();
  options = {};
  options.stack_bytes = 65536;
  kernel().only = "pthread_getattr_np";
  EXPECT_FALSE(realtime_begin(options)[RealtimePart::stack].given) << "where the stack ends is not known";
  kernel().only.clear();
  options.stack_bytes = RealtimeOptions::kMostStack;
  const RealtimeReport most = realtime_begin(options);
  EXPECT_TRUE(most[RealtimePart::stack].given || most[RealtimePart::stack].error == ENOMEM);
  options.stack_bytes = RealtimeOptions::kMostStack + 1;
  EXPECT_FALSE(realtime_begin(options)[RealtimePart::stack].given);
  EXPECT_FALSE(realtime_begin(options).complete());
}

TEST_F(RefusedCalls, OnlyWhatWasGivenIsGivenBack) {
  for (const RealtimePart part : {RealtimePart::priority, RealtimePart::cpus, RealtimePart::memory}) {
    RealtimeReport report;
    report.part[static_cast<int>(part)].asked = report.part[static_cast<int>(part)].given = true;
    EXPECT_TRUE(report.complete());
    realtime_end(report);
    report.part[static_cast<int>(part)].given = false;
    EXPECT_FALSE(report.complete());
    realtime_end(report);
  }
}

// ---- keys and random numbers ----

class KeyFile : public RefusedCalls {
 protected:
  std::string write(const std::string& text, mode_t mode = 0600) {
    const std::string path = ::testing::TempDir() + "key_file_test";
    std::ofstream(path) << text;
    EXPECT_EQ(::chmod(path.c_str(), mode), 0);
    return path;
  }
  tiller_status_t read(const std::string& path) { return read_key_file(path.c_str(), key, &error); }
  std::uint8_t key[MessageSeal::kKeyBytes] = {};
};

TEST_F(KeyFile, HoldsSixtyFourDigitsAndSpaceAroundThem) {
  const std::string digits = "000102030405060708090a0b0c0d0e0f101112131415161718191A1B1C1D1E1F";
  for (const std::string& text : {digits, digits + "\n", " \t\r\n" + digits + " \t\r\n"}) {
    std::memset(key, 0xff, sizeof key);
    EXPECT_EQ(read(write(text)), tiller_status_ok) << text;
    for (std::uint8_t i = 0; i < MessageSeal::kKeyBytes; ++i) EXPECT_EQ(key[i], i);
  }
  for (const char letter : {'/', ':', '@', 'G', '`', 'g', ' ', '-'}) {
    std::string text = digits;
    text[20] = letter;
    EXPECT_EQ(read(write(text)), tiller_status_bad_message) << letter;
  }
  EXPECT_EQ(read(write(digits + "0")), tiller_status_bad_message);
  EXPECT_EQ(read(write(digits.substr(1))), tiller_status_bad_message);
  EXPECT_EQ(read(write("")), tiller_status_bad_message);
  EXPECT_TRUE(holds(error.text, "64 hexadecimal digits"));
}

TEST_F(KeyFile, OfOthersOrUnreadableIsRefused) {
  const std::string digits(64, 'a');
  for (const mode_t mode : {mode_t{0604}, mode_t{0640}}) {
    EXPECT_EQ(read(write(digits, mode)), tiller_status_io_error);
    EXPECT_TRUE(holds(error.text, "chmod 600")) << error.text;
  }
  EXPECT_EQ(read("/nowhere/key"), tiller_status_io_error);
  EXPECT_TRUE(holds(error.text, "openssl rand")) << error.text;
  kernel().only = "read";
  EXPECT_EQ(read(write(digits)), tiller_status_bad_message);
  kernel().only = "fstat";
  EXPECT_EQ(read(write(digits)), tiller_status_ok) << "a file system without owners";
}

TEST_F(RefusedCalls, RandomNumbersComeOrTheOpeningFails) {
  std::uint8_t bytes[16] = {};
  EXPECT_EQ(read_random(bytes, sizeof bytes, &error), tiller_status_ok);
  kernel().refuse_after = 0;
  kernel().error = EINTR;
  EXPECT_EQ(read_random(bytes, sizeof bytes, &error), tiller_status_ok) << "asked again";
  kernel().only = "getrandom";
  kernel().error = ENOSYS;
  EXPECT_EQ(read_random(bytes, sizeof bytes, &error), tiller_status_io_error);
  EXPECT_TRUE(holds(error.text, "no random numbers"));
  kernel().error = 0;  // none, without an error
  EXPECT_EQ(read_random(bytes, sizeof bytes, &error), tiller_status_io_error);
  LcmTransport transport;
  LcmOptions options;
  const std::uint8_t key[MessageSeal::kKeyBytes] = {1};
  options.url = "udpm://239.255.76.67:7667?ttl=0";
  options.channel_prefix = "";
  options.key = key;
  options.measurement_count = options.input_count = 1;
  EXPECT_EQ(lcm_transport_open(&transport, options, &error), tiller_status_io_error) << "no signature without a secret";
}

// ---- liblcm ----

TEST_F(RefusedCalls, LiblcmThatDoesNotOpenLeavesNothing) {
  LcmTransport transport;
  lcm.creates = false;
  EXPECT_EQ(lcm_transport_open(&transport, by(kLiblcm), &error), tiller_status_io_error);
  EXPECT_TRUE(holds(error.text, "URL of one of liblcm's providers")) << error.text;
  lcm.creates = true;
  lcm.subscribes = false;
  EXPECT_EQ(lcm_transport_open(&transport, by(kLiblcm), &error), tiller_status_io_error);
  EXPECT_TRUE(holds(error.text, "cannot receive")) << error.text;
  EXPECT_EQ(lcm.destroyed, 1);
  EXPECT_EQ(transport.lcm, nullptr);
  liblcm_close(&transport);
  EXPECT_EQ(lcm.destroyed, 1) << "once";
  LcmOptions unreachable = by(kLiblcm);
  unreachable.url = "udpm://239.255.76.67:7667?ttl=0";
  unreachable.liblcm = true;
  kernel().only = "connect";
  EXPECT_EQ(lcm_transport_open(&transport, unreachable, &error), tiller_status_io_error);
}

TEST_F(RefusedCalls, LiblcmsErrorsAreStatuses) {
  LcmTransport transport;
  ASSERT_EQ(lcm_transport_open(&transport, by(kLiblcm), &error), tiller_status_ok);
  tiller_measurement_t measurement;
  EXPECT_EQ(kLcmTransport.poll(&transport, &measurement), tiller_status_no_new_measurement);
  EXPECT_EQ(kLcmTransport.descriptor(&transport), 99);
  lcm.handled = 1000;
  EXPECT_EQ(kLcmTransport.poll(&transport, &measurement), tiller_status_no_new_measurement);
  EXPECT_EQ(lcm.handled, 1000 - 256) << "a flood holds no tick";
  lcm.handled = -1;
  EXPECT_EQ(kLcmTransport.poll(&transport, &measurement), tiller_status_io_error);
  tiller_command_t command{};
  EXPECT_EQ(kLcmTransport.send(&transport, &command), tiller_status_ok);
  const struct {
    int error;
    tiller_status_t status;
  } cases[] = {{ENOBUFS, tiller_status_queue_full}, {EAGAIN, tiller_status_queue_full}, {EIO, tiller_status_io_error}};
  for (const auto& c : cases) {
    lcm.publish_error = c.error;
    EXPECT_EQ(kLcmTransport.send(&transport, &command), c.status);
  }
  tiller_transport_counters_t counters;
  kLcmTransport.counters(&transport, &counters);
  EXPECT_EQ(counters.queue_full, 2u);
  EXPECT_EQ(counters.sent, 1u);
  kLcmTransport.close(&transport);
  EXPECT_EQ(kLcmTransport.send(&transport, &command), tiller_status_transport_closed);
}

TEST_F(RefusedCalls, OptionsOfLcmAreCheckedOneByOne) {
  LcmTransport transport;
  const auto open = [&](const LcmOptions& options) { return lcm_transport_open(&transport, options, &error); };
  EXPECT_EQ(lcm_transport_open(nullptr, by(kLiblcm), &error), tiller_status_null_argument);
  LcmOptions o = by(kLiblcm);
  o.url = nullptr;
  EXPECT_EQ(open(o), tiller_status_null_argument);
  o = by(kLiblcm), o.channel_prefix = nullptr;
  EXPECT_EQ(open(o), tiller_status_null_argument);
  const std::string longer(LcmTransport::kMaxPrefix + 1, 'a');
  for (const char* prefix : {longer.c_str(), "a.b", "a*", "\xff"}) {
    o = by(kLiblcm), o.channel_prefix = prefix;
    EXPECT_EQ(open(o), tiller_status_bad_message) << prefix;
  }
  o = by(kLiblcm), o.channel_prefix = "arm-1_";
  EXPECT_EQ(open(o), tiller_status_ok);
  kLcmTransport.close(&transport);
  const std::uint32_t counts[][2] = {{0, 1}, {TILLER_MAX_MEASUREMENTS + 1, 1}, {1, 0}, {1, TILLER_MAX_INPUTS + 1}};
  for (const auto& c : counts) {
    o = by(kLiblcm), o.measurement_count = c[0], o.input_count = c[1];
    EXPECT_EQ(open(o), tiller_status_bad_dimension) << c[0] << " " << c[1];
  }
}

}  // namespace
}  // namespace tiller
