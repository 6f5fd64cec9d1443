#include "core/e2e.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <vector>

#include "core/rng.hpp"

namespace tiller {
namespace {

using Frame = std::vector<std::uint8_t>;

constexpr std::uint16_t kName = 0x0630;
constexpr std::int64_t kPeriodUs = 10000;

Frame random_frame(Rng& rng, std::size_t size) {
  Frame frame(size);
  for (std::uint8_t& byte : frame) byte = static_cast<std::uint8_t>(rng.next_u32());
  return frame;
}

void flip(Frame& frame, std::size_t bit) { frame[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8)); }

bool passes(const Frame& frame, std::uint16_t name = kName) {
  E2eReceiver fresh(name);
  return is_usable(fresh.check(frame.data(), frame.size(), 0));
}

// The check values that AUTOSAR's Specification of CRC Routines gives for CRC-8H2F.
TEST(E2e, CrcHasItsPublishedValues) {
  const auto crc = [](const Frame& bytes) {
    return static_cast<int>(kE2eCrc8.add(0xFF, bytes.data(), bytes.size()) ^ 0xFFu);
  };
  EXPECT_EQ(0x12, crc({0, 0, 0, 0}));
  EXPECT_EQ(0xC2, crc({0xF2, 0x01, 0x83}));
  EXPECT_EQ(0xC6, crc({0x0F, 0xAA, 0x00, 0x55}));
  EXPECT_EQ(0x77, crc({0x00, 0xFF, 0x55, 0x11}));
  EXPECT_EQ(0x11, crc({0x33, 0x22, 0x55, 0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF}));
  EXPECT_EQ(0x33, crc({0x92, 0x6B, 0x55}));
  EXPECT_EQ(0x6C, crc({0xFF, 0xFF, 0xFF, 0xFF}));
  EXPECT_EQ(0xDF, crc({'1', '2', '3', '4', '5', '6', '7', '8', '9'}));
}

// Exhaustive: every frame length, every pattern of 1, 2 and 3 flipped bits of data, counter and CRC.
TEST(E2e, EveryFlipOfUpToThreeBitsIsDetected) {
  Rng rng(1, 1, 0);
  std::uint64_t trials = 0;
  for (std::size_t size = kE2eMinBytes; size <= kE2eMaxBytes; ++size) {
    Frame frame = random_frame(rng, size);
    E2eSender sender(kName, static_cast<std::uint8_t>(rng.next_u32()));
    ASSERT_TRUE(sender.protect(frame.data(), size));
    ASSERT_TRUE(passes(frame));
    for (std::size_t a = 0; a < 8 * size; ++a) {
      flip(frame, a);
      ASSERT_FALSE(passes(frame)) << size << " bytes, bit " << a;
      for (std::size_t b = 0; b < a; ++b) {
        flip(frame, b);
        ASSERT_FALSE(passes(frame)) << size << " bytes, bits " << a << ' ' << b;
        for (std::size_t c = 0; c < b; ++c) {
          flip(frame, c);
          ASSERT_FALSE(passes(frame)) << size << " bytes, bits " << a << ' ' << b << ' ' << c;
          flip(frame, c);
          ++trials;
        }
        flip(frame, b);
      }
      flip(frame, a);
    }
  }
  std::printf("%llu patterns\n", static_cast<unsigned long long>(trials));
}

// The distance is 4, not more: some pattern of four bits passes. Without this the test above could not fail.
TEST(E2e, SomeFlipOfFourBitsIsNotDetected) {
  Frame frame(8);
  E2eSender sender(kName);
  ASSERT_TRUE(sender.protect(frame.data(), frame.size()));
  std::uint64_t undetected = 0;
  for (std::size_t a = 3; a < 64; ++a)
    for (std::size_t b = 2; b < a; ++b)
      for (std::size_t c = 1; c < b; ++c)
        for (std::size_t d = 0; d < c; ++d) {
          for (std::size_t bit : {a, b, c, d}) flip(frame, bit);
          undetected += passes(frame);
          for (std::size_t bit : {a, b, c, d}) flip(frame, bit);
        }
  EXPECT_GT(undetected, 0u);
  EXPECT_LT(undetected, 635376u / 64) << "an even number of bits passes twice in 256 on average, here with slack";
}

// Every identifier differs from ours in some bit of the protected bytes: up to three bits by the distance, and so do
// the nodes and commands of one bus.
TEST(E2e, AFrameUnderAnothersNameIsRefused) {
  Frame frame = {1, 2, 3, 4, 5, 6, 0, 0};
  E2eSender sender(kName);
  ASSERT_TRUE(sender.protect(frame.data(), frame.size()));
  ASSERT_TRUE(passes(frame));
  int passed = 0;
  for (unsigned name = 0; name < 2048; ++name) {  // all 11-bit identifiers
    if (name == kName) continue;
    int bits = 0;
    for (unsigned difference = name ^ kName; difference != 0; difference &= difference - 1) ++bits;
    const bool accepted = passes(frame, static_cast<std::uint16_t>(name));
    EXPECT_FALSE(accepted && bits <= 3) << name;
    passed += accepted;
  }
  EXPECT_LE(passed, 16) << "1 in 256 of all, twice over";
}

TEST(E2e, ImpossibleLengthsAreRefused) {
  Frame frame(64);
  E2eSender sender(kName);
  E2eReceiver receiver(kName);
  for (std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{2}, kE2eMaxBytes + 1, std::size_t{64}}) {
    EXPECT_FALSE(sender.protect(frame.data(), size));
    EXPECT_EQ(E2eState::kWrongCrc, receiver.check(frame.data(), size, 0));
  }
  EXPECT_EQ(5u, receiver.counters().wrong_crc);
}

/// Frames of one sender, each with its own content, in sending order.
class Stream {
 public:
  explicit Stream(std::uint8_t first) : sender_(kName, first) {}
  const Frame& send(Rng& rng) {
    Frame frame = random_frame(rng, 8);
    EXPECT_TRUE(sender_.protect(frame.data(), frame.size()));
    history_.push_back(frame);
    return history_.back();
  }
  /// 0 is the newest.
  const Frame& ago(std::size_t n) const { return history_[history_.size() - 1 - n]; }
  std::size_t size() const { return history_.size(); }

 private:
  E2eSender sender_;
  std::vector<Frame> history_;
};

// A million disturbed deliveries: a duplicate, a swap of two neighbours, a replay from within the window, a loss within
// max_step. Only what was sent, once and in order, may pass.
TEST(E2e, DuplicatesReordersAndReplaysAreDetected) {
  constexpr int kTrials = 1000000;
  Rng rng(2, 1, 0);
  Stream stream(200);
  E2eReceiver receiver(kName);
  std::int64_t now_us = 0;
  const auto deliver = [&](const Frame& frame) { return receiver.check(frame.data(), frame.size(), now_us); };
  ASSERT_EQ(E2eState::kFirst, deliver(stream.send(rng)));
  std::uint64_t lost = 0, repeated = 0, stale = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    now_us += kPeriodUs;
    switch (rng.below(4)) {
      case 0:
        ASSERT_EQ(E2eState::kOk, deliver(stream.send(rng)));
        ASSERT_EQ(E2eState::kRepeated, deliver(stream.ago(0)));
        ++repeated;
        break;
      case 1:  // the later one overtakes: it passes with one loss, the earlier one is refused
        stream.send(rng);
        ASSERT_EQ(E2eState::kOk, deliver(stream.send(rng)));
        ASSERT_EQ(E2eState::kWrongSequence, deliver(stream.ago(1)));
        ++lost, ++stale;
        break;
      case 2: {
        const std::size_t reach = std::min<std::size_t>(stream.size() - 1, 255 - E2eCounter::kMaxStep);
        const std::size_t n = rng.below(static_cast<std::uint32_t>(reach + 1));
        ASSERT_EQ(n == 0 ? E2eState::kRepeated : E2eState::kWrongSequence, deliver(stream.ago(n))) << n;
        ++(n == 0 ? repeated : stale);
        break;
      }
      default: {
        const std::uint32_t gap = rng.below(E2eCounter::kMaxStep);
        for (std::uint32_t i = 0; i < gap; ++i) stream.send(rng);
        ASSERT_EQ(E2eState::kOk, deliver(stream.send(rng)));
        lost += gap;
      }
    }
  }
  EXPECT_EQ(lost, receiver.counters().lost);
  EXPECT_EQ(repeated, receiver.counters().repeated);
  EXPECT_EQ(stale, receiver.counters().wrong_sequence);
  EXPECT_EQ(0u, receiver.counters().wrong_crc);
}

// The stated window, to the frame: 256 - max_step frames ago is the first that an 8-bit counter cannot tell.
TEST(E2e, TheReplayWindowEndsWhereItIsStated) {
  for (int max_step : {1, 2, 15, 100}) {
    for (int first : {0, 7, 250}) {
      Rng rng(3, 1, 0);
      Stream stream(static_cast<std::uint8_t>(first));
      for (int i = 0; i < 600; ++i) stream.send(rng);
      for (int n = 0; n < 512; ++n) {
        E2eReceiver receiver(kName, static_cast<std::uint8_t>(max_step));
        ASSERT_EQ(E2eState::kFirst, receiver.check(stream.ago(0).data(), 8, 0));
        const bool passed = is_usable(receiver.check(stream.ago(static_cast<std::size_t>(n)).data(), 8, 1));
        ASSERT_EQ(n % 256 >= 256 - max_step, passed) << n << " frames ago, max_step " << max_step;
      }
    }
  }
}

TEST(E2e, ADamagedFrameLeavesTheCounterAlone) {
  Rng rng(4, 1, 0);
  Stream stream(0);
  E2eReceiver receiver(kName);
  ASSERT_EQ(E2eState::kFirst, receiver.check(stream.send(rng).data(), 8, 0));
  Frame damaged = stream.send(rng);
  flip(damaged, 6 * 8 + 3);  // of the counter
  EXPECT_EQ(E2eState::kWrongCrc, receiver.check(damaged.data(), 8, 1));
  EXPECT_EQ(E2eState::kOk, receiver.check(stream.ago(0).data(), 8, 2));
  EXPECT_EQ(0u, receiver.counters().lost);
}

TEST(E2e, ARestartedSenderIsHeardAfterASilence) {
  Rng rng(5, 1, 0);
  Stream old(100), restarted(0);
  E2eReceiver receiver(kName, 15, 2000000);
  ASSERT_EQ(E2eState::kFirst, receiver.check(old.send(rng).data(), 8, 0));
  EXPECT_EQ(E2eState::kWrongSequence, receiver.check(restarted.send(rng).data(), 8, kPeriodUs));
  EXPECT_EQ(E2eState::kWrongSequence, receiver.check(restarted.send(rng).data(), 8, 1999999));
  EXPECT_EQ(E2eState::kFirst, receiver.check(restarted.send(rng).data(), 8, 2000000));
  EXPECT_EQ(E2eState::kOk, receiver.check(restarted.send(rng).data(), 8, 2000000 + kPeriodUs));
}

}  // namespace
}  // namespace tiller
