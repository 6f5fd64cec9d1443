#include "sim/serve_can.hpp"

#include <cmath>

#include "sim/can_socket.hpp"
#include "sim/odrive_axis.hpp"
#include "sim/sensor_board.hpp"

namespace tiller::sim {
namespace {

class CanLink final : public PlantLink {
 public:
  explicit CanLink(const CanOptions& options) : options_(options), axis_(options.axis_node) {}

  bool open() { return socket_.open(options_.interface, {options_.axis_node, options_.sensor_node}); }

  /// Heartbeat first: who reads the measurement knows the state of the axis at that time.
  bool publish(const PlantMeasurement& m) override {
    if (!socket_.send(axis_.heartbeat())) return false;
    for (const CanFrame& frame : sensor_frames(options_.sensor_node, m)) {
      if (!socket_.send(frame)) return false;
    }
    return true;
  }

  bool receive(PlantCommand& command, std::int64_t timeout_us) override {
    CanFrame frame;
    if (!socket_.receive(frame, timeout_us)) return false;
    if (read_controller_status(options_.sensor_node, frame, command)) return true;
    CanFrames replies;
    const OdriveAxis::Event event = axis_.receive(frame, replies);
    for (const CanFrame& reply : replies) socket_.send(reply);
    if (event == OdriveAxis::Event::kNone) return false;
    command = PlantCommand{};
    command.value = {axis_.torque_Nm() / options_.wheel_radius_m};
    return true;
  }

  std::string error() const override { return socket_.error(); }

  void after_period(const Plant& plant) override {
    // the event and not the state: an axis that was armed again waits for its first torque
    if (plant.watchdog_trips() > seen_trips_) axis_.expire_watchdog();
    seen_trips_ = plant.watchdog_trips();
    // the motor's own encoder sits before the joint's and is taken to be free of error
    std::vector<double> state(plant.states().size());
    plant.true_state(state.data());
    const double per_unit = 1 / (2 * 3.141592653589793 * options_.wheel_radius_m);
    const double rate = state[plant.states().size() / 2];
    socket_.send(axis_.encoder_estimates(state[0] * per_unit, rate * per_unit));
  }

 private:
  CanOptions options_;
  OdriveAxis axis_;
  CanSocket socket_;
  std::uint64_t seen_trips_ = 0;
};

}  // namespace

std::unique_ptr<PlantLink> open_can_link(const CanOptions& options, const Plant& plant, std::string& error) {
  if (options.axis_node >= can_node_count || options.sensor_node >= can_node_count ||
      options.axis_node == options.sensor_node) {
    error = "axis_node and sensor_node must be two numbers from 0 to 63";
    return nullptr;
  }
  if (options.wheel_radius_m == 0 || !std::isfinite(options.wheel_radius_m)) {
    error = "wheel_radius_m must be finite and not zero";
    return nullptr;
  }
  if (plant.commands().size() != 1) {
    error = "an ODrive axis drives plants with one command";
    return nullptr;
  }
  auto link = std::make_unique<CanLink>(options);
  if (link->open()) return link;
  error = link->error();
  return nullptr;
}

int serve_can(Plant& plant, const CanOptions& can, const ServeOptions& options, ServeReport& report) {
  report = ServeReport{};
  const auto link = open_can_link(can, plant, report.error);
  return link == nullptr ? 1 : serve(plant, *link, options, report);
}

}  // namespace tiller::sim
