#include "sim/servers/serve_lcm.hpp"

#include <poll.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <deque>

#include <lcm/lcm.h>

#include <tiller_lcm/command_t.hpp>
#include <tiller_lcm/measurement_t.hpp>
#include <tiller_lcm/wide_command_t.hpp>
#include <tiller_lcm/wide_measurement_t.hpp>

namespace tiller::sim {
namespace {

constexpr std::size_t value_capacity = 12;   // of measurement_t
constexpr std::size_t command_capacity = 4;  // of command_t
constexpr std::size_t wide_value_capacity = 32, wide_command_capacity = 16;
constexpr std::int64_t longest_us = 1'000'000'000;
// a full socket buffer passes, a missing route does not
constexpr int failures_until_dead = 20;

class LcmLink final : public PlantLink {
 public:
  LcmLink(const LcmOptions& options, const Plant& plant)
      : options_(options),
        lcm_(lcm_create(options.url.c_str())),
        channel_out_(options.channel_prefix + "MEASUREMENT"),
        url_(options.url),
        latency_us_(static_cast<std::int32_t>(std::lround(plant.options().command_latency_s * 1e6))) {
    if (lcm_ == nullptr) return;
    // not lcm::LCM::subscribe: it prints each message that it cannot decode, and tells nobody
    lcm_subscribe(lcm_, (options.channel_prefix + "COMMAND").c_str(), &LcmLink::on_command, this);
  }
  ~LcmLink() override {
    if (lcm_ != nullptr) lcm_destroy(lcm_);
  }
  LcmLink(const LcmLink&) = delete;
  LcmLink& operator=(const LcmLink&) = delete;

  bool good() const { return lcm_ != nullptr; }

  bool publish(const PlantMeasurement& m) override {
    std::vector<unsigned char> bytes;
    if (m.value.size() <= value_capacity) {
      tiller_lcm::measurement_t out{};
      fill(m, out);
      std::copy(m.value.begin(), m.value.end(), out.value);
      bytes = encoded(out);
    } else {
      tiller_lcm::wide_measurement_t out{};
      fill(m, out);
      out.value = m.value;
      bytes = encoded(out);
    }
    if (options_.sign) options_.sign(channel_out_, bytes);
    const bool sent = lcm_publish(lcm_, channel_out_.c_str(), bytes.data(), static_cast<unsigned>(bytes.size())) == 0;
    failures_ = sent ? 0 : failures_ + 1;
    if (failures_ >= failures_until_dead) {
      error_ = "LCM cannot send on '" + url_ +
               "': is there a multicast route? (ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo)";
    }
    return error_.empty();
  }

  bool receive(PlantCommand& command, std::int64_t timeout_us) override {
    if (commands_.empty()) wait_and_handle(timeout_us);
    if (commands_.empty()) return false;
    command = std::move(commands_.front());
    commands_.pop_front();
    return true;
  }

  std::string error() const override { return error_; }

 private:
  void wait_and_handle(std::int64_t timeout_us) {
    pollfd wanted{lcm_get_fileno(lcm_), POLLIN, 0};
    const timespec timeout{timeout_us / 1'000'000, (timeout_us % 1'000'000) * 1000};
    if (ppoll(&wanted, 1, &timeout, nullptr) > 0 && lcm_handle(lcm_) != 0) {
      error_ = "LCM cannot receive on '" + url_ + "'";
    }
  }

  template <class Message>
  void fill(const PlantMeasurement& m, Message& out) const {
    out.stamp_us = m.stamp_us;
    out.sequence = m.sequence;
    out.command_latency_us = static_cast<std::int32_t>(std::min<std::int64_t>(m.answer_us + latency_us_, longest_us));
    out.count = static_cast<std::int32_t>(m.value.size());
    out.valid_mask = static_cast<std::int32_t>((std::uint64_t{1} << m.value.size()) - 1);
  }

  template <class Message>
  static std::vector<unsigned char> encoded(const Message& out) {
    std::vector<unsigned char> bytes(static_cast<std::size_t>(out.getEncodedSize()));
    out.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    return bytes;
  }

  /// Takes what both types have; the values are those of `value`, as many as the count says and there are.
  template <class Message, class Values>
  static void take(const Message& in, const Values& value, std::size_t capacity, PlantCommand& command) {
    command.sequence = in.sequence;
    command.state = in.state;
    if (in.plan_sequence != 0) command.plan = in.plan_sequence;  // 0: a sender that does not count
    const auto count = std::clamp<std::int64_t>(in.count, 0, static_cast<std::int64_t>(capacity));
    command.value.assign(std::begin(value), std::begin(value) + count);
  }

  /// The generated decoder asks for as much memory as a packet claims: a wide message is as long as its count says, and
  /// that no more than a plant may have.
  static bool is_wide_command(const std::vector<unsigned char>& bytes) {
    constexpr std::size_t before_count = 8 + 8 + 8 + 4;
    if (bytes.size() < before_count + 4) return false;
    std::size_t count = 0;
    for (std::size_t i = 0; i < 4; ++i) count = count << 8 | bytes[before_count + i];
    return count <= wide_command_capacity && bytes.size() == before_count + 4 + 8 * count + 8;
  }

  static void on_command(const lcm_recv_buf_t* buffer, const char* channel, void* user) {
    auto* link = static_cast<LcmLink*>(user);
    const auto* data = static_cast<const unsigned char*>(buffer->data);
    std::vector<unsigned char> bytes(data, data + buffer->data_size);
    // a forged message is no command at all: it must not stop a motor either
    if (link->options_.verify && !link->options_.verify(channel, bytes)) return;
    tiller_lcm::command_t in{};
    tiller_lcm::wide_command_t wide{};
    PlantCommand command;
    const int size = static_cast<int>(bytes.size());
    // what cannot be decoded, or has a wrong count, leaves a wrong size, which the loop counts as a bad
    // command
    if (in.decode(bytes.data(), 0, size) >= 0) {
      take(in, in.value, command_capacity, command);
    } else if (is_wide_command(bytes) && wide.decode(bytes.data(), 0, size) >= 0) {
      take(wide, wide.value, wide.value.size(), command);
    }
    link->commands_.push_back(std::move(command));
  }

  LcmOptions options_;
  lcm_t* lcm_;
  std::string channel_out_;
  std::string url_;
  std::int32_t latency_us_;
  int failures_ = 0;
  std::deque<PlantCommand> commands_;
  std::string error_;
};

}  // namespace

std::unique_ptr<PlantLink> open_lcm_link(const LcmOptions& options, const Plant& plant, std::string& error) {
  if (plant.measurements().size() > wide_value_capacity || plant.commands().size() > wide_command_capacity) {
    error = "the plant has more channels than the LCM types hold";
    return nullptr;
  }
  auto link = std::make_unique<LcmLink>(options, plant);
  if (link->good()) return link;
  error = "LCM cannot open '" + options.url + "': check the URL and, for udpm, the multicast route";
  return nullptr;
}

int serve_lcm(Plant& plant, const LcmOptions& lcm, const ServeOptions& options, ServeReport& report) {
  report = ServeReport{};
  const auto link = open_lcm_link(lcm, plant, report.error);
  return link == nullptr ? 1 : serve(plant, *link, options, report);
}

}  // namespace tiller::sim
