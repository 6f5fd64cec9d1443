// Faults of an LCM network: bytes that are not ours, and bytes that were. Without a key nobody can tell a plausible
// forgery from the plant: docs/reference/security.md.

#include <algorithm>

#include "harness/faults/fault.hpp"
#include "tiller_lcm/measurement_t.hpp"

namespace tiller::faults {
namespace {

constexpr const char* kGroup = "LCM";
constexpr std::size_t kMostPackets = 1000;

Fault lcm(const char* name, const char* what, End end, Timeout timeout, const char* answer) {
  return {name, kGroup, what, Route::kLcm, end, timeout, answer};
}

/// Changes the message of every packet as the function says.
template <class Change>
void rewrite(std::vector<Packet>& packets, const Change& change) {
  for (Packet& p : packets) {
    tiller_lcm::measurement_t m{};
    if (m.decode(p.data(), 0, static_cast<int>(p.size())) < 0) continue;
    change(m);
    (void)m.encode(p.data(), 0, static_cast<int>(p.size()));
  }
}

void forms(std::vector<Fault>& list) {
  list.push_back(lcm("network_silent", "no message arrives", End::kStops, Timeout::kSensor, "`sensor_stale`, SAFE"));
  list.back().packets = [](World&, std::vector<Packet>& packets) { packets.clear(); };
  list.push_back(lcm("wrong_fingerprint", "messages of another type", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    for (Packet& p : packets) p[w.random.below(8)] ^= static_cast<unsigned char>(1 + w.random.below(255));
  };
  list.push_back(lcm("short_packet", "messages are cut off", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    for (Packet& p : packets) p.resize(w.random.below(static_cast<std::uint32_t>(p.size())));
  };
  list.push_back(lcm("oversized_packet", "messages of 64 kB", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World&, std::vector<Packet>& packets) {
    for (Packet& p : packets) p.resize(65000);
  };
  list.push_back(lcm("random_bytes", "random bytes of random length", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    for (Packet& p : packets) {
      p.resize(w.random.below(300));
      for (unsigned char& byte : p) byte = static_cast<unsigned char>(w.random.below(256));
    }
  };
  list.push_back(lcm("wrong_count", "a count that is not the robot file's", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    rewrite(packets, [&](auto& m) { m.count = m.count + 1 + static_cast<std::int32_t>(w.random.below(100)); });
  };
  list.push_back(lcm("negative_latency", "a latency below zero", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    rewrite(packets, [&](auto& m) { m.command_latency_us = -1 - static_cast<std::int32_t>(w.random.below(1u << 30)); });
  };
  list.push_back(lcm("nothing_valid", "valid_mask is zero", End::kStops, Timeout::kBadTicks,
                     "missing values: `sensor_not_finite`, SAFE"));
  list.back().packets = [](World&, std::vector<Packet>& packets) {
    rewrite(packets, [](auto& m) { m.valid_mask = 0; });
  };
  list.push_back(lcm("bits_flip_lcm", "a bit of every packet flips", End::kBounded, Timeout::kSensor,
                     "what is refused is not used; SAFE if it goes on"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    for (Packet& p : packets)
      p[w.random.below(static_cast<std::uint32_t>(p.size()))] ^= static_cast<unsigned char>(1u << w.random.below(8));
  };
}

void order(std::vector<Fault>& list) {
  list.push_back(lcm("replayed", "old messages again, in the place of new ones", End::kStops, Timeout::kSensor,
                     "old numbers are refused: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    packets = {
        w.past_packets[w.random.below(static_cast<std::uint32_t>(std::min<std::size_t>(w.past_packets.size(), 20)))]};
    if (w.ticks > 11) packets = {w.past_packets.front()};
  };
  list.push_back(lcm("replayed_among_new", "old messages again, behind each new one", End::kRides, Timeout::kSensor,
                     "old numbers are refused, the new one counts"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    for (std::size_t i = 0; i + 1 < w.past_packets.size(); ++i) packets.push_back(w.past_packets[i]);
  };
  list.push_back(lcm("doubled", "every message comes twice", End::kRides, Timeout::kSensor, "the second is refused"));
  list.back().packets = [](World&, std::vector<Packet>& packets) { packets.push_back(packets.front()); };
  list.push_back(lcm("plant_restarts", "the plant counts from zero again", End::kStops, Timeout::kSensor,
                     "old numbers are refused: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    rewrite(packets, [&](auto& m) { m.sequence = w.ticks; });
  };
  list.push_back(lcm("number_out_of_range", "a sequence beyond 32 bits", End::kStops, Timeout::kSensor,
                     "`bad_messages`: `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    rewrite(packets, [&](auto& m) { m.sequence = w.random.below(2) ? std::int64_t{1} << 32 : -1; });
  };
  list.push_back(lcm("waited", "messages lay unread for a second", End::kStops, Timeout::kSensor,
                     "refused: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) { w.waited_us = 1000000; };
  list.push_back(lcm("flooded", "a thousand foreign packets around each message", End::kRides, Timeout::kSensor,
                     "`bad_messages`; the newest of ours counts"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    Packet rubbish(64);
    for (unsigned char& byte : rubbish) byte = static_cast<unsigned char>(w.random.below(256));
    packets.insert(packets.begin(), kMostPackets / 2, rubbish);
    packets.insert(packets.end(), kMostPackets / 2, rubbish);
  };
  list.push_back(lcm("spoofed", "somebody sends other values under numbers ahead of the plant's", End::kStops,
                     Timeout::kSensor, "the plant's own are refused then: `sensor_jump` or `sensor_stale`, SAFE"));
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    if (w.amount == 0.0) w.amount = w.random.sign() * w.random.uniform(w.reach_rad(), 3.0);
    std::vector<Packet> forged = packets;
    const std::uint32_t angle = w.angle();
    rewrite(forged, [&](auto& m) {
      m.sequence += 1000;
      m.value[angle] += w.amount;
    });
    packets.insert(packets.end(), forged.begin(), forged.end());
  };
}

void keyed(std::vector<Fault>& list) {
  const auto hold_a_key = [](Setup& s) { s.keyed = true; };
  list.push_back(lcm("spoofed_under_a_key", "plausible forgeries, while plant and controller hold a key", End::kRides,
                     Timeout::kSensor, "wrong tags are refused: the forger is not heard"));
  list.back().prepare = hold_a_key;
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    std::vector<Packet> forged = packets;
    const std::uint32_t angle = w.angle();
    rewrite(forged, [&](auto& m) {
      m.sequence += 1000;
      m.value[angle] += 0.2;
    });
    packets.insert(packets.begin(), forged.begin(), forged.end());
  };
  list.push_back(lcm("replayed_under_a_key", "old messages with their tags, before each new one", End::kRides,
                     Timeout::kSensor, "their counters are old: refused"));
  list.back().prepare = hold_a_key;
  list.back().packets = [](World& w, std::vector<Packet>& packets) {
    packets.insert(packets.begin(), w.past_packets.begin(), w.past_packets.end() - 1);
  };
  list.push_back(lcm("unsigned_under_a_key", "the plant has lost its key", End::kStops, Timeout::kSensor,
                     "messages without a tag are refused: `sensor_stale`, SAFE"));
  list.back().prepare = hold_a_key;
  list.back().packets = [](World&, std::vector<Packet>& packets) {
    for (Packet& p : packets) p.resize(p.size() - 24);
  };
}

}  // namespace

std::vector<Fault> lcm_faults() {
  std::vector<Fault> list;
  forms(list);
  order(list);
  keyed(list);
  return list;
}

}  // namespace tiller::faults
