// Stamps of arrival: off control messages, and from an interface's clock that begins and drifts as it likes.
#include "io/arrival_stamp.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <vector>

namespace tiller {
namespace {

constexpr std::int64_t kMs = 1000000, kUs = 1000;

/// A control message as the kernel lays it out.
ArrivalStamp stamp_in(int type, const std::vector<timespec>& times, bool* taken, int level = SOL_SOCKET) {
  alignas(cmsghdr) char bytes[256] = {};
  auto* message = reinterpret_cast<cmsghdr*>(bytes);
  message->cmsg_level = level;
  message->cmsg_type = type;
  message->cmsg_len = CMSG_LEN(times.size() * sizeof(timespec));
  if (!times.empty()) std::memcpy(CMSG_DATA(message), times.data(), times.size() * sizeof(timespec));
  ArrivalStamp stamp;
  *taken = read_arrival_stamp(message, &stamp);
  return stamp;
}

TEST(ArrivalStamp, IsReadFromEitherMessage) {
  bool taken = false;
  ArrivalStamp stamp = stamp_in(SO_TIMESTAMPING, {{7, 5}, {0, 0}, {3, 999999999}}, &taken);
  EXPECT_TRUE(taken);
  EXPECT_EQ(7000000005, stamp.kernel_ns);
  EXPECT_EQ(3999999999, stamp.interface_ns);
  EXPECT_EQ(StampSource::kInterface, source_of(stamp));
  stamp = stamp_in(SO_TIMESTAMPING, {{7, 5}, {0, 0}, {0, 0}}, &taken);
  EXPECT_EQ(StampSource::kKernel, source_of(stamp));
  stamp = stamp_in(SO_TIMESTAMPNS, {{7, 5}}, &taken);
  EXPECT_TRUE(taken);
  EXPECT_EQ(7000000005, stamp.kernel_ns);
  EXPECT_EQ(0, stamp.interface_ns);
  EXPECT_EQ(StampSource::kReader, source_of({}));
}

TEST(ArrivalStamp, OtherMessagesAndShortOnesAreLeft) {
  bool taken = true;
  (void)stamp_in(SO_RXQ_OVFL, {{7, 5}}, &taken);
  EXPECT_FALSE(taken);
  (void)stamp_in(SO_TIMESTAMPING, {{7, 5}}, &taken);
  EXPECT_FALSE(taken) << "three times, or none";
  (void)stamp_in(SO_TIMESTAMPNS, {}, &taken);
  EXPECT_FALSE(taken);
  (void)stamp_in(SO_TIMESTAMPNS, {{7, 5}}, &taken, IPPROTO_IP);
  EXPECT_FALSE(taken);
}

/// What a kernel really sends, on a socket that every machine has: its own stamp, and it says that it is the kernel's.
TEST(ArrivalStamp, AKernelWithoutSuchAnInterfaceStampsByItself) {
  const int receiver = ::socket(AF_INET, SOCK_DGRAM, 0), sender = ::socket(AF_INET, SOCK_DGRAM, 0);
  ASSERT_GE(std::min(receiver, sender), 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(0, bind(receiver, reinterpret_cast<sockaddr*>(&address), sizeof address));
  socklen_t size = sizeof address;
  ASSERT_EQ(0, getsockname(receiver, reinterpret_cast<sockaddr*>(&address), &size));
  ASSERT_TRUE(request_arrival_stamps(receiver));
  timespec before{};
  ArrivalStamp stamp;
  // the kernel begins to stamp some time after it was asked
  for (int attempt = 0; attempt < 200 && stamp.kernel_ns == 0; ++attempt) {
    clock_gettime(CLOCK_REALTIME, &before);
    ASSERT_EQ(1, sendto(sender, "x", 1, 0, reinterpret_cast<sockaddr*>(&address), sizeof address));
    char byte = 0;
    alignas(cmsghdr) char control[kArrivalStampSpace];
    iovec part = {&byte, 1};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    ASSERT_EQ(1, recvmsg(receiver, &message, 0));
    cmsghdr* first = CMSG_FIRSTHDR(&message);
    if (first == nullptr || !read_arrival_stamp(first, &stamp)) usleep(10000);
  }
  EXPECT_EQ(StampSource::kKernel, source_of(stamp));
  EXPECT_GE(stamp.kernel_ns, before.tv_sec * 1000 * kMs + before.tv_nsec);
  ::close(receiver);
  ::close(sender);
}

/// An interface whose clock begins at `begin_ns` and runs `ppm` fast, and a kernel that serves its interrupts after 5
/// us at least, 100 us on average, now and then 3 ms.
class Interface {
 public:
  Interface(std::int64_t begin_ns, double ppm, unsigned seed)
      : begin_ns_(begin_ns), rate_(1 + 1e-6 * ppm), random_(seed) {}

  ArrivalStamp stamp(std::int64_t true_ns) {
    std::exponential_distribution<double> wait(1.0 / 95e3);
    std::int64_t late_ns = 5 * kUs + static_cast<std::int64_t>(wait(random_));
    if (random_() % 50 == 0) late_ns += 3 * kMs;
    return {kBegin + true_ns + late_ns + kernel_set_ns,
            begin_ns_ + static_cast<std::int64_t>(std::llround(static_cast<double>(true_ns) * rate_))};
  }
  /// By the kernel's clock.
  std::int64_t truth(std::int64_t true_ns) const { return kBegin + true_ns + kernel_set_ns; }

  static constexpr std::int64_t kBegin = 1795000000000 * kMs;
  std::int64_t kernel_set_ns = 0;

 private:
  std::int64_t begin_ns_;
  double rate_;
  std::mt19937 random_;
};

TEST(InterfaceClock, TellsTheArrivalBetterThanTheKernelWhateverTheCrystal) {
  for (const double ppm : {-100.0, -20.0, 0.0, 20.0, 100.0}) {
    for (const std::int64_t begin_ns : {std::int64_t{1}, std::int64_t{5} * 1000 * kMs, Interface::kBegin + 7 * kMs}) {
      Interface interface(begin_ns, ppm, 3);
      InterfaceClock clock;
      std::vector<std::int64_t> error_ns, kernel_ns;
      for (std::int64_t k = 1; k <= 20000; ++k) {  // 100 s of 200 frames a second
        const std::int64_t true_ns = k * 5 * kMs;
        const ArrivalStamp stamp = interface.stamp(true_ns);
        const std::int64_t arrival_ns = clock.arrival_ns(stamp);
        ASSERT_LE(arrival_ns, stamp.kernel_ns);
        if (k < 100) continue;
        error_ns.push_back(std::llabs(arrival_ns - interface.truth(true_ns)));
        kernel_ns.push_back(std::llabs(stamp.kernel_ns - interface.truth(true_ns)));
      }
      // drift over two windows, plus the least that an interrupt took among 50 frames
      EXPECT_LE(*std::max_element(error_ns.begin(), error_ns.end()), 75 * kUs) << ppm;
      EXPECT_GE(*std::max_element(kernel_ns.begin(), kernel_ns.end()), 3 * kMs);
      std::nth_element(error_ns.begin(), error_ns.begin() + 10000, error_ns.end());
      std::nth_element(kernel_ns.begin(), kernel_ns.begin() + 10000, kernel_ns.end());
      EXPECT_LE(3 * error_ns[10000], 2 * kernel_ns[10000]) << ppm;
    }
  }
}

TEST(InterfaceClock, ClocksThatAreSetCostHalfASecondAtMost) {
  for (const std::int64_t step_ns : {-3600000 * kMs, -50 * kMs, 50 * kMs, 3600000 * kMs}) {
    Interface interface(1000, 30, 5);
    InterfaceClock clock;
    for (std::int64_t k = 1; k <= 2000; ++k) {
      const std::int64_t true_ns = k * 5 * kMs;
      if (k == 1000) interface.kernel_set_ns = step_ns;
      const ArrivalStamp stamp = interface.stamp(true_ns);
      const std::int64_t arrival_ns = clock.arrival_ns(stamp);
      ASSERT_LE(arrival_ns, stamp.kernel_ns);
      ASSERT_LE(std::llabs(arrival_ns - interface.truth(true_ns)), 20 * kMs) << k;
      if (k >= 1100) {
        ASSERT_LE(std::llabs(arrival_ns - interface.truth(true_ns)), 100 * kUs) << k;
      }
    }
  }
}

/// The interface is reset: its clock starts again.
TEST(InterfaceClock, AnInterfaceThatBeginsAnewIsBelievedAgain) {
  InterfaceClock clock;
  Interface before(90000000 * kMs, 30, 5), after(1000, 30, 6);
  for (std::int64_t k = 1; k <= 2000; ++k) {
    const std::int64_t true_ns = k * 5 * kMs;
    const ArrivalStamp stamp = k < 1000 ? before.stamp(true_ns) : after.stamp(true_ns);
    const std::int64_t arrival_ns = clock.arrival_ns(stamp);
    ASSERT_LE(arrival_ns, stamp.kernel_ns);
    ASSERT_LE(std::llabs(arrival_ns - before.truth(true_ns)), 20 * kMs) << k;
    if (k >= 1100) {
      ASSERT_LE(std::llabs(arrival_ns - before.truth(true_ns)), 100 * kUs) << k;
    }
  }
}

TEST(InterfaceClock, FramesThatAreRareHaveTheKernelsStamp) {
  Interface interface(1000, 30, 5);
  InterfaceClock clock;
  for (std::int64_t k = 1; k <= 100; ++k) {
    const ArrivalStamp stamp = interface.stamp(k * 1000 * kMs);
    EXPECT_EQ(stamp.kernel_ns, clock.arrival_ns(stamp));
  }
  EXPECT_EQ(5, clock.arrival_ns({5, 0})) << "and one that the interface did not stamp";
  EXPECT_EQ(0, clock.arrival_ns({0, 7})) << "none by the kernel's clock";
}

}  // namespace
}  // namespace tiller
