// The route over LCM: the runtime's decoder and gate on one side, generated types on the other. The network is a list
// of packets.

#include <algorithm>
#include <cstdio>

#include "harness/faults/fault_link.hpp"
#include "harness/faults/sealed_pair.hpp"
#include "io/lcm_transport.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"

namespace tiller::faults {
namespace {

Packet packet_of(const tiller_measurement_t& m, std::uint32_t count) {
  tiller_lcm::measurement_t out{};
  out.stamp_us = m.stamp_us;
  out.sequence = m.sequence;
  out.count = static_cast<std::int32_t>(count);
  out.valid_mask = (1 << count) - 1;
  std::copy(m.value, m.value + count, out.value);
  Packet bytes(256);
  bytes.resize(static_cast<std::size_t>(std::max(0, out.encode(bytes.data(), 0, static_cast<int>(bytes.size())))));
  return bytes;
}

class LcmLink final : public Link {
 public:
  LcmLink(const Setup& setup, Device& device) : device_(device) {
    std::snprintf(transport_.measurement_channel, sizeof transport_.measurement_channel, "%s", kChannel);
    if (setup.keyed) {
      const std::uint8_t key[MessageSeal::kKeyBytes] = {1, 2, 3, 4, 5, 6, 7, 8};
      make_sealed_pair(key, transport_.seal, plant_seal_);
    }
    transport_.options.measurement_count = setup.config.measurement_count;
    transport_.options.input_count = setup.config.model->input_count;
  }

  bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
             tiller_measurement_t& measurement) override {
    std::vector<Packet> packets = {packet_of(genuine, transport_.options.measurement_count)};
    if (plant_seal_.has_key()) {
      const auto size = static_cast<std::uint32_t>(packets[0].size());
      packets[0].resize(size + MessageSeal::kTrailerBytes);
      plant_seal_.seal(kChannel, packets[0].data(), size, world.now_us);
    }
    world.past_packets.push_back(packets[0]);
    if (world.past_packets.size() > 32) world.past_packets.pop_front();
    if (fault != nullptr && fault->packets != nullptr) fault->packets(world, packets);
    if (world.cut) packets.clear();
    for (const Packet& p : packets)
      if (!lcm_take_measurement(&transport_, p.data(), static_cast<std::uint32_t>(p.size()), world.waited_us))
        ++refused_;
    if (!transport_.has_new) return false;
    transport_.has_new = false;
    measurement = transport_.newest;
    return true;
  }

  void send(World& world, const Fault*, const tiller_command_t& command) override {
    if (world.cut) return;
    sim::PlantCommand plain = plant_command(command, transport_.options.input_count);
    tiller_lcm::command_t out{}, in{};
    out.sequence = command.sequence;
    out.state = static_cast<std::int32_t>(command.state);
    out.count = static_cast<std::int32_t>(plain.value.size());
    std::copy(plain.value.begin(), plain.value.end(), out.value);
    out.plan_sequence = command.plan_sequence;
    unsigned char bytes[256];
    const int size = out.encode(bytes, 0, sizeof bytes);
    if (size < 0 || in.decode(bytes, 0, size) < 0) return;
    plain.value.assign(in.value, in.value + in.count);
    plain.sequence = in.sequence;
    plain.state = in.state;
    plain.plan = in.plan_sequence;
    device_.apply(plain);
  }

  std::uint64_t refused() const override { return refused_; }

 private:
  static constexpr const char* kChannel = "TILLER_MEASUREMENT";

  Device& device_;
  LcmTransport transport_;
  MessageSeal plant_seal_;
  std::uint64_t refused_ = 0;
};

}  // namespace

std::unique_ptr<Link> make_lcm_link(const Setup& setup, Device& device) {
  return std::make_unique<LcmLink>(setup, device);
}

}  // namespace tiller::faults
