// Signed messages between two ends whose clocks, restarts and network are simulated, and somebody who records them.
#include "io/message_seal.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <random>
#include <set>
#include <string>
#include <vector>

namespace tiller {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr const char* kUp = "TILLER_MEASUREMENT";
constexpr const char* kDown = "TILLER_COMMAND";
constexpr std::int64_t kWindowUs = 2000000, kPeriodUs = 10000;

MessageSeal make_seal(std::uint8_t key, std::uint32_t secret, std::int64_t window_us = kWindowUs) {
  Bytes keys(MessageSeal::kKeyBytes, key), secrets(MessageSeal::kSecretBytes, 0);
  for (std::size_t i = 0; i < 4; ++i) secrets[i] = static_cast<std::uint8_t>(secret >> (8 * i));
  return MessageSeal(keys.data(), secrets.data(), window_us);
}

Bytes sealed(MessageSeal& seal, const char* channel, const Bytes& message, std::int64_t now_us) {
  Bytes bytes = message;
  bytes.resize(message.size() + MessageSeal::kTrailerBytes);
  seal.seal(channel, bytes.data(), static_cast<std::uint32_t>(message.size()), now_us);
  return bytes;
}

SealState check(MessageSeal& seal, const char* channel, const Bytes& bytes, std::int64_t now_us) {
  return seal.check(channel, bytes.data(), static_cast<std::uint32_t>(bytes.size()), now_us);
}

/// A message on its way, and what only the test knows of it.
struct Signed {
  Bytes bytes;
  std::uint64_t id = 0;
  std::int64_t signed_us = 0;  // of the time that all share
};

/// One end: it may start again at any time, with a monotonic clock that begins anywhere and runs at a rate of its own.
class End {
 public:
  End(const char* speaks, const char* hears, std::int64_t window_us)
      : speaks_(speaks), hears_(hears), window_us_(window_us) {
    start(0, 0, 1.0);
  }

  void start(std::int64_t true_us, std::int64_t clock_us, double rate) {
    static std::uint32_t secret = 0;
    seal_ = make_seal(1, ++secret, window_us_);
    started_us_ = true_us;
    clock_us_ = clock_us;
    rate_ = rate;
  }
  Signed sign(std::int64_t true_us) {
    static std::uint64_t id = 0;
    return {sealed(seal_, speaks_, {1, 2, 3}, clock(true_us)), ++id, true_us};
  }
  SealState hear(const Signed& message, std::int64_t true_us) {
    return check(seal_, hears_, message.bytes, clock(true_us));
  }
  std::int64_t started_us() const { return started_us_; }
  double rate() const { return rate_; }

 private:
  std::int64_t clock(std::int64_t true_us) const {
    return clock_us_ + static_cast<std::int64_t>(rate_ * static_cast<double>(true_us - started_us_));
  }

  const char* speaks_;
  const char* hears_;
  std::int64_t window_us_, started_us_ = 0, clock_us_ = 0;
  double rate_ = 1;
  MessageSeal seal_;
};

/// Plant and runtime: the plant speaks once a period, the runtime answers what it takes, and challenges what it does
/// not.
class Pair {
 public:
  explicit Pair(std::int64_t window_us = kWindowUs) : plant(kUp, kDown, window_us), runtime(kDown, kUp, window_us) {}

  /// Periods with a perfect network until a command has been taken; more than `most`: never.
  int periods_until_heard(int most) {
    for (int k = 1; k <= most; ++k)
      if (period()) return k;
    return most + 1;
  }
  /// Whether both directions worked.
  bool period() {
    now_us += kPeriodUs;
    up.push_back(plant.sign(now_us));
    const SealState state = runtime.hear(up.back(), now_us);
    if (state == SealState::kReplayed || state == SealState::kWrongTag) return false;
    down.push_back(runtime.sign(now_us));
    const bool answered = plant.hear(down.back(), now_us) == SealState::kOk;
    return state == SealState::kOk && answered;
  }
  void run(int periods) {
    for (int k = 0; k < periods; ++k) ASSERT_TRUE(period()) << k;
  }

  End plant, runtime;
  std::int64_t now_us = 1000000;
  std::vector<Signed> up, down;  // all that was ever said
};

void expect_refused(End& end, const std::vector<Signed>& recording, std::int64_t now_us) {
  for (const Signed& message : recording) ASSERT_NE(end.hear(message, now_us), SealState::kOk) << message.id;
}

TEST(MessageSeal, TwoEndsThatHaveNeverMetDoSoInTwoPeriods) {
  Pair pair;
  EXPECT_FALSE(pair.period()) << "the plant cannot know yet what the runtime wants answered";
  pair.run(1000);  // ten seconds: several times as long as a challenge lives
}

// Requirement: SR-17
TEST(MessageSeal, OneKeyOneChannelOnceAndInOrder) {
  Pair pair;
  ASSERT_LE(pair.periods_until_heard(2), 2);
  const std::int64_t now_us = pair.now_us;
  const Signed first = pair.plant.sign(now_us), second = pair.plant.sign(now_us), third = pair.plant.sign(now_us);
  EXPECT_EQ(pair.runtime.hear(second, now_us), SealState::kOk);
  EXPECT_EQ(pair.runtime.hear(second, now_us), SealState::kReplayed);
  EXPECT_EQ(pair.runtime.hear(first, now_us), SealState::kReplayed) << "older than the last one";
  EXPECT_EQ(pair.runtime.hear(pair.down.back(), now_us), SealState::kWrongTag) << "its own, on the other channel";
  MessageSeal stranger = make_seal(2, 99);
  EXPECT_EQ(pair.runtime.hear({sealed(stranger, kUp, {1}, 0)}, now_us), SealState::kWrongTag);
  EXPECT_EQ(pair.runtime.hear({Bytes{1, 2, 3}}, now_us), SealState::kUnsealed);
  EXPECT_EQ(pair.runtime.hear({Bytes(MessageSeal::kTrailerBytes)}, now_us), SealState::kWrongTag);
  EXPECT_EQ(pair.runtime.hear(third, now_us), SealState::kOk);
}

// Requirement: SR-17
TEST(MessageSeal, EveryFlipOfOneOrTwoBitsIsDetected) {
  Pair pair;
  ASSERT_LE(pair.periods_until_heard(2), 2);
  Signed message = pair.plant.sign(pair.now_us);
  const auto flip = [&](std::size_t bit) { message.bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8)); };
  const auto refused = [&] { return pair.runtime.hear(message, pair.now_us) == SealState::kWrongTag; };
  for (std::size_t a = 0; a < 8 * message.bytes.size(); ++a) {
    flip(a);
    ASSERT_TRUE(refused()) << a;
    for (std::size_t b = 0; b < a; ++b) {
      flip(b);
      ASSERT_TRUE(refused()) << a << ' ' << b;
      flip(b);
    }
    flip(a);
  }
  EXPECT_EQ(pair.runtime.hear(message, pair.now_us), SealState::kOk) << "a refusal changes nothing";
}

// Requirement: SR-17
TEST(MessageSeal, AReceiverThatStartsAnewTakesNothingOfARecording) {
  for (const std::int64_t window_us : {kWindowUs, std::int64_t{0}}) {
    Pair pair(window_us);
    (void)pair.period();
    pair.run(300);
    pair.runtime.start(pair.now_us, 0, 1.0);
    expect_refused(pair.runtime, pair.up, pair.now_us + 1);
    EXPECT_LE(pair.periods_until_heard(3), 3) << "the recording keeps nobody out";
    expect_refused(pair.runtime, pair.up, pair.now_us + 1);
    pair.run(100);
    // the plant too: it has taken up a new session of the runtime, and the old one's commands are dead
    expect_refused(pair.plant, pair.down, pair.now_us + 1);
  }
}

/// The clocks of the time of day take no part, so the sender's that is behind is a monotonic one that begins at zero.
TEST(MessageSeal, ASenderThatStartsAnewWithAnyClockIsHeardAtOnceAndItsOldMessagesNoMore) {
  for (const std::int64_t clock_us : {std::int64_t{0}, std::int64_t{3600000000}, std::int64_t{-3600000000}}) {
    Pair pair;
    (void)pair.period();
    pair.run(300);
    pair.plant.start(pair.now_us, clock_us, 1.0);
    EXPECT_LE(pair.periods_until_heard(3), 3) << clock_us;
    expect_refused(pair.runtime, pair.up, pair.now_us);
    pair.run(300);
    expect_refused(pair.runtime, pair.up, pair.now_us);
  }
}

TEST(MessageSeal, BothStartAnew) {
  Pair pair;
  (void)pair.period();
  pair.run(300);
  pair.plant.start(pair.now_us, 5, 1.0);
  pair.runtime.start(pair.now_us, -7, 1.0);
  expect_refused(pair.runtime, pair.up, pair.now_us);
  expect_refused(pair.plant, pair.down, pair.now_us);
  EXPECT_LE(pair.periods_until_heard(3), 3);
  pair.run(300);
}

TEST(MessageSeal, WhatIsHeldUpForLongerThanTheWindowIsRefused) {
  for (const std::int64_t held_us : {std::int64_t{0}, kWindowUs / 2 - 2 * kPeriodUs, kWindowUs + 1, 10 * kWindowUs}) {
    Pair pair;
    (void)pair.period();
    pair.run(37);
    const Signed held = pair.plant.sign(pair.now_us);
    // meanwhile the plant is cut off; commands go on
    for (std::int64_t us = kPeriodUs; us <= held_us; us += kPeriodUs) (void)pair.runtime.sign(pair.now_us + us);
    pair.now_us += held_us;
    EXPECT_EQ(pair.runtime.hear(held, pair.now_us), held_us < kWindowUs ? SealState::kOk : SealState::kHeldUp)
        << held_us;
    EXPECT_LE(pair.periods_until_heard(3), 3);
  }
}

TEST(MessageSeal, AfterAnyPauseTheyGoOn) {
  for (const std::int64_t pause_us : {std::int64_t{60000000}, std::int64_t{86400000000}}) {
    Pair pair;
    (void)pair.period();
    pair.run(50);
    pair.now_us += pause_us;
    EXPECT_LE(pair.periods_until_heard(3), 3);
    pair.run(50);
  }
}

TEST(MessageSeal, ATrailerAloneIsAMessageThatCarriesAChallenge) {
  MessageSeal runtime = make_seal(1, 501), plant = make_seal(1, 502);
  EXPECT_FALSE(plant.has_answer());
  EXPECT_EQ(check(plant, kDown, sealed(runtime, kDown, {}, 0), 0), SealState::kUnanswered);
  EXPECT_TRUE(plant.has_answer());
  EXPECT_EQ(check(runtime, kUp, sealed(plant, kUp, {7}, 0), 0), SealState::kOk);
  EXPECT_EQ(check(plant, kDown, sealed(runtime, kDown, {}, 0), 0), SealState::kOk);
}

/// A third party that replays while the peer lives does not set what is answered.
TEST(MessageSeal, ARecordingDoesNotTakeThePlaceOfALivePeersChallenge) {
  Pair pair;
  (void)pair.period();
  pair.run(100);
  const std::vector<Signed> old = pair.down;
  pair.runtime.start(pair.now_us, 0, 1.0);
  ASSERT_LE(pair.periods_until_heard(3), 3);
  for (int k = 0; k < 100; ++k) {
    expect_refused(pair.plant, old, pair.now_us);
    ASSERT_TRUE(pair.period()) << k;
  }
}

/// Everything at once, by chance: losses, delays, recordings of any age, restarts, clocks that run one per cent wrong.
/// What must never happen is counted while it lasts; when the adversary rests, the two must find each other.
struct Adversary {
  explicit Adversary(std::uint32_t seed, std::int64_t window_us)
      : random(seed), pair(window_us), window_us_(window_us) {}

  bool chance(double p) { return std::uniform_real_distribution<double>(0, 1)(random) < p; }
  std::int64_t any(std::int64_t most) { return std::uniform_int_distribution<std::int64_t>(0, most)(random); }

  void hear(End& end, const Signed& message) {
    if (end.hear(message, pair.now_us) != SealState::kOk) return;
    ++taken;
    const bool again = !seen.insert(message.id).second;
    const auto age_us = static_cast<double>(pair.now_us - message.signed_us) * end.rate();
    EXPECT_FALSE(again) << "message " << message.id << " was taken twice";
    EXPECT_GE(message.signed_us, end.started_us()) << "signed before the receiver started";
    if (window_us_ > 0) {
      EXPECT_LE(age_us, static_cast<double>(window_us_ + 1));
    }
  }
  void restart(End& end) {
    end.start(pair.now_us, any(7200000000) - 3600000000, 0.99 + 0.02 * static_cast<double>(any(1000)) / 1000);
  }
  void step() {
    pair.now_us += any(2 * kPeriodUs) + (chance(0.005) ? any(3 * kWindowUs) : 0);
    if (chance(0.004)) restart(pair.plant);
    if (chance(0.004)) restart(pair.runtime);
    pair.up.push_back(pair.plant.sign(pair.now_us));
    pair.down.push_back(pair.runtime.sign(pair.now_us));
    if (chance(0.7)) hear(pair.runtime, pair.up.back());
    if (chance(0.7)) hear(pair.plant, pair.down.back());
    replay(pair.runtime, pair.up);
    replay(pair.plant, pair.down);
  }
  /// One of the last, or any; also what never arrived.
  void replay(End& end, const std::vector<Signed>& said) {
    while (chance(0.5)) {
      const auto most = static_cast<std::int64_t>(said.size()) - 1;
      hear(end, said[static_cast<std::size_t>(most - any(chance(0.5) ? std::min<std::int64_t>(most, 20) : most))]);
    }
  }

  std::mt19937 random;
  Pair pair;
  std::set<std::uint64_t> seen;
  std::uint64_t taken = 0;

 private:
  std::int64_t window_us_;
};

// Requirement: SR-17
TEST(MessageSeal, NoAdversaryGetsAnythingTakenTwiceOrTooLateAndNoneKeepsThemApart) {
  std::uint64_t taken = 0;
  for (const std::int64_t window_us : {kWindowUs, std::int64_t{0}}) {
    for (std::uint32_t seed = 1; seed <= 100; ++seed) {
      Adversary adversary(seed, window_us);
      for (int k = 0; k < 1000; ++k) adversary.step();
      ASSERT_FALSE(testing::Test::HasFailure()) << "seed " << seed;
      ASSERT_LE(adversary.pair.periods_until_heard(4), 4) << "seed " << seed;
      taken += adversary.taken;
    }
  }
  std::printf("%llu messages taken of 400000 said\n", static_cast<unsigned long long>(taken));
  EXPECT_GT(taken, 200000u) << "the ends met too seldom for the test to prove anything";
}

}  // namespace
}  // namespace tiller
