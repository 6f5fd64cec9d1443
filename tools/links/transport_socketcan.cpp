#include <cmath>
#include <cstdio>

#include "io/socketcan_transport.hpp"
#include "tools/links/transport_link.hpp"
#include "tools/robot/drive_settings.hpp"

namespace tiller::tools {
namespace {

/// "board:3" or "position:force_N" (checked when the robot file was read).
CanChannel parse_channel(const std::string& text, const Words& inputs) {
  const std::string source = text.substr(0, text.find(':'));
  const std::string rest = text.substr(text.find(':') + 1);
  CanChannel channel;
  if (source == "board") {
    channel.index = static_cast<std::uint8_t>(std::stoi(rest));
    return channel;
  }
  channel.source = source == "position" ? CanSource::kMotorPosition : CanSource::kMotorVelocity;
  channel.index = static_cast<std::uint8_t>(index_of(inputs, rest));
  return channel;
}

bool can_layout(const RobotFile& robot, CanLayout& layout, std::string& error) {
  const TransportSection& t = robot.transport;
  layout.motor_count = robot.config.model->input_count;
  for (std::uint32_t i = 0; i < layout.motor_count; ++i) {
    layout.motors[i].node = i < t.nodes.size() ? t.nodes[i] : i + 1;
    layout.motors[i].wheel_radius_m = i < t.wheel_radius_m.size() ? t.wheel_radius_m[i] : 1;
    if (i < t.drives.size() && !drive_settings(t.drives[i], layout.motors[i].node, layout.motors[i].drive, error)) {
      error = robot.path + ": transport.drives." + robot.names.inputs[i] + ": " + error;
      return false;
    }
    const double rate_per_s = robot.config.safety.input_rate_per_s[i];
    layout.motors[i].entry_rate_per_s = std::isfinite(rate_per_s) ? rate_per_s : 0;
  }
  layout.channel_count = robot.config.measurement_count;
  bool board = t.channels.empty();
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) {
    layout.channels[i].index = static_cast<std::uint8_t>(i);
    if (!t.channels.empty()) layout.channels[i] = parse_channel(t.channels[i], robot.names.inputs);
    board = board || layout.channels[i].source == CanSource::kSensor;
  }
  layout.sensor_node = board ? t.sensor_node : CanLayout::kNoBoard;
  layout.heartbeat_timeout_us = static_cast<std::uint32_t>(std::lround(1e6 * t.heartbeat_timeout_s));
  layout.stamp_on_arrival = t.stamp_on_arrival;
  return true;
}

class SocketCanLink final : public TransportLink {
 public:
  SocketCanLink(const RobotFile& robot, const TransportLinkOptions& options)
      : TransportLink(robot, options, kSocketCanTransport, &can_) {}
  ~SocketCanLink() override { kSocketCanTransport.close(&can_); }

  tiller_status_t open(OpenError& problem) override {
    SocketCanOptions can;
    can.interface = robot_.transport.interface.c_str();
    std::string error;
    if (!can_layout(robot_, can.layout, error)) {
      std::snprintf(problem.text, sizeof problem.text, "%s", error.c_str());
      return tiller_status_bad_dimension;
    }
    if (options_.lockstep) can.layout.stamp_on_arrival = false;
    const tiller_status_t status = socketcan_open(&can_, can, &problem);
    if (status == tiller_status_ok) can_.robot.keep_off(options_.kept_off);
    return status;
  }

  void permit() override { can_.robot.keep_off(false); }
  void prepare(bool on) override { can_.robot.prepare(on); }
  bool is_ready() const override { return can_.robot.is_ready(); }

  std::string counters() const override {
    const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
    const SocketCanCounters& c = can_.bus_counters;
    std::string text = TransportLink::counters() + ", times of arrival by " + stamp_source_text(can_.stamps);
    if (c.held_back) text += format(", %llu commands held back by a stuck bus", n(c.held_back));
    if (c.foreign) text += format(", %llu set points of another program", n(c.foreign));
    if (c.bus_offs) text += format(", %llu times bus-off", n(c.bus_offs));
    if (const char* why = socketcan_fault_text(&can_)) text += std::string("; ") + why;
    return text;
  }

 private:
  bool asks() const override { return can_.robot.needs_asking(); }
  void ask() override { (void)socketcan_ask(&can_); }

  SocketCanTransport can_;
};

}  // namespace

std::unique_ptr<TransportLink> make_socketcan_link(const RobotFile& robot, const TransportLinkOptions& options) {
  return std::make_unique<SocketCanLink>(robot, options);
}

}  // namespace tiller::tools
