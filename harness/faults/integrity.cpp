// Integrity of our own frames and messages, counted. The runtime's readers on one side, the plant's writers (which
// share no code with them) on the other.

#include "harness/faults/integrity.hpp"

#include <algorithm>
#include <cstdio>
#include <deque>
#include <vector>

#include "harness/faults/fault_bus.hpp"
#include "harness/faults/sealed_pair.hpp"
#include "io/lcm_messages.hpp"
#include "io/lcm_transport.hpp"

namespace tiller::faults {
namespace {

constexpr std::uint32_t kBoard = 48, kIdentifierBits = 11, kBits = kIdentifierBits + 64;
constexpr const char* kChannel = "TILLER_MEASUREMENT";

void flip(CanFrame& frame, std::uint32_t bit) {
  if (bit < kIdentifierBits)
    frame.id ^= 1u << bit;
  else
    frame.data[(bit - kIdentifierBits) / 8] ^= static_cast<std::uint8_t>(1u << ((bit - kIdentifierBits) % 8));
}
void flip(Packet& packet, std::uint32_t bit) { packet[bit / 8] ^= static_cast<unsigned char>(1u << (bit % 8)); }

/// Calls take(damaged) for every frame with one or two bits of `good` flipped.
template <class Take>
void for_every_damage(const CanFrame& good, const Take& take) {
  for (std::uint32_t a = 0; a < kBits; ++a) {
    for (std::uint32_t b = 0; b <= a; ++b) {
      CanFrame bad = good;
      flip(bad, a);
      if (b != a) flip(bad, b);
      take(bad);
    }
  }
}

CanFrame from_sim(const sim::CanFrame& f) {
  CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  std::copy_n(f.data.begin(), 8, frame.data);
  return frame;
}
sim::CanFrame to_sim(const CanFrame& f) {
  sim::CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  std::copy_n(f.data, 8, frame.data.begin());
  return frame;
}

std::vector<CanFrame> board_frames(std::uint32_t sequence, Random& random) {
  const sim::PlantMeasurement reading{
      static_cast<std::int64_t>(sequence) * 10000, sequence, {random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)}};
  std::vector<CanFrame> frames;
  for (const sim::CanFrame& f : sim::sensor_frames(kBoard, reading, true)) frames.push_back(from_sim(f));
  return frames;
}

/// A robot that has heard its board, so that what is not protected is refused.
class Bus {
 public:
  explicit Bus(Random& random) : random_(random) {
    Setup setup = setup_of(Robot::kCartPole, 1);
    CanLayout layout = bus_layout(setup);
    layout.heartbeat_timeout_us = 0;
    robot_.reset(layout);
    (void)on_frame(next());
  }
  std::vector<CanFrame> next() { return board_frames(++sequence_, random_); }
  /// True if a measurement came of these frames.
  bool on_frame(const std::vector<CanFrame>& frames) {
    for (const CanFrame& f : frames) (void)robot_.receive(f, 10000 * std::int64_t{sequence_});
    tiller_measurement_t m{};
    return robot_.take(&m);
  }
  CanFrame status() {
    tiller_command_t command{};
    command.sequence = static_cast<std::uint32_t>(random_.next());
    command.state = tiller_state_active;
    command.plan_sequence = static_cast<std::uint32_t>(random_.next());
    CanFrame frames[CanRobot::kMaxFrames];
    return frames[robot_.command(command, frames) - 1];
  }

 private:
  Random& random_;
  CanRobot robot_;
  std::uint32_t sequence_ = 0;
};

/// The plant's seal on one side, the transport's gate and key on the other.
class Sealed {
 public:
  explicit Sealed(Random& random) : random_(random) {
    const std::uint8_t key[MessageSeal::kKeyBytes] = {1, 2, 3, 4, 5, 6, 7, 8};
    make_sealed_pair(key, transport_.seal, plant_);
    std::snprintf(transport_.measurement_channel, sizeof transport_.measurement_channel, "%s", kChannel);
    transport_.options.measurement_count = 2;
    transport_.options.input_count = 1;
  }
  Packet next() {
    LcmMeasurement m{};
    m.sequence = ++sequence_;
    m.stamp_us = 10000 * m.sequence;
    m.count = 2;
    m.valid_mask = 3;
    for (double& v : m.value) v = random_.uniform(-3.0, 3.0);
    const std::uint32_t size = kLcmMeasurementType.bytes;
    Packet packet(size + MessageSeal::kTrailerBytes);
    lcm_encode(kLcmMeasurementType, &m, packet.data());
    plant_.seal(kChannel, packet.data(), size, m.stamp_us);
    return packet;
  }
  bool on_frame(const Packet& packet) {
    (void)lcm_take_measurement(&transport_, packet.data(), static_cast<std::uint32_t>(packet.size()), 0);
    const bool taken = transport_.has_new;
    transport_.has_new = false;
    return taken;
  }

 private:
  Random& random_;
  LcmTransport transport_;
  MessageSeal plant_;
  std::int64_t sequence_ = 0;
};

/// Repetitions, swapped neighbours and replays of a route's deliveries.
template <class Route>
IntegrityRow disorder(Route& route, Random& random, std::uint64_t trials) {
  IntegrityRow row;
  std::deque<decltype(route.next())> past = {route.next()};
  (void)route.on_frame(past.back());
  const auto wrong = [&](bool taken) {
    ++row.trials;
    row.passed += taken;
  };
  while (row.trials < trials) {
    for (; past.size() > kReplayWindow; past.pop_front()) {
    }
    past.push_back(route.next());
    switch (random.below(3)) {
      case 0:  // the last one again
        (void)route.on_frame(past.back());
        wrong(route.on_frame(past.back()));
        break;
      case 1:  // the next two in the wrong order
        past.push_back(route.next());
        (void)route.on_frame(past.back());
        wrong(route.on_frame(past[past.size() - 2]));
        break;
      default: {  // one from long ago
        (void)route.on_frame(past.back());
        wrong(route.on_frame(past[random.below(static_cast<std::uint32_t>(past.size()))]));
      }
    }
  }
  return row;
}

}  // namespace

IntegrityRow flips_of_board(std::uint64_t trials) {
  IntegrityRow row;
  Random random(1);
  BoardReader reader;
  for (std::uint32_t sequence = 1; row.trials < trials; ++sequence) {
    for (const CanFrame& good : board_frames(sequence, random)) {
      (void)reader.read(good);
      for_every_damage(good, [&](const CanFrame& bad) {
        ++row.trials;
        // another node's is kept out by the filter
        row.passed += bad.id >> 5 == kBoard && reader.read(bad).kind != BoardFrame::Kind::refused;
      });
    }
  }
  return row;
}

IntegrityRow flips_of_status(std::uint64_t trials) {
  IntegrityRow row;
  Random random(2);
  Bus bus(random);
  while (row.trials < trials) {
    for_every_damage(bus.status(), [&](const CanFrame& bad) {
      ++row.trials;
      sim::PlantCommand answer;
      row.passed += sim::read_controller_status(kBoard, to_sim(bad), answer, true);
    });
  }
  return row;
}

IntegrityRow flips_of_sealed(std::uint64_t trials) {
  IntegrityRow row;
  Random random(3);
  Sealed route(random);
  (void)route.on_frame(route.next());
  for (; row.trials < trials; ++row.trials) {
    Packet bad = route.next();
    const auto bits = static_cast<std::uint32_t>(8 * bad.size());
    const std::uint32_t first = random.below(bits), second = random.below(bits);
    flip(bad, first);
    if (second != first) flip(bad, second);
    row.passed += route.on_frame(bad);
  }
  return row;
}

IntegrityRow disorder_of_board(std::uint64_t trials) {
  Random random(4);
  Bus bus(random);
  return disorder(bus, random, trials);
}

IntegrityRow disorder_of_sealed(std::uint64_t trials) {
  Random random(5);
  Sealed route(random);
  return disorder(route, random, trials);
}

}  // namespace tiller::faults
