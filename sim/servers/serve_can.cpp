#include "sim/servers/serve_can.hpp"

#include <cmath>

#include "sim/devices/can_socket.hpp"
#include "sim/servers/sensor_board.hpp"

namespace tiller::sim {
namespace {

class CanLink final : public PlantLink {
 public:
  CanLink(const CanOptions& options, const Plant& plant, std::unique_ptr<DriveAxis> axis)
      : options_(options), plant_(plant), axis_(std::move(axis)) {}

  bool open() {
    const std::uint32_t node_bits = can_id(can_node_count - 1, 0);
    return socket_.open(options_.interface, {axis_->listens(), {can_id(options_.sensor_node, 0), node_bits, false}},
                        axis_->speaks_fd());
  }

  /// The drive first: who reads the measurement knows the state of the axis at that time.
  bool publish(const PlantMeasurement& m) override {
    // what it sends cyclically it has sent before the first reading, too
    if (m.sequence == 0 && !send(axis_->after_period(shaft()))) return false;
    return send(axis_->before_reading()) && send(sensor_frames(options_.sensor_node, m, options_.protected_frames));
  }

  bool receive(PlantCommand& command, std::int64_t timeout_us) override {
    CanFrame frame;
    if (!socket_.receive(frame, timeout_us)) return false;
    if (read_controller_status(options_.sensor_node, frame, command, options_.protected_frames)) return true;
    CanFrames replies;
    const DriveAxis::Event event = axis_->take(frame, shaft(), replies);
    send(replies);
    if (event == DriveAxis::Event::kNone) return false;
    command = PlantCommand{};
    command.value = {axis_->torque_Nm() / options_.wheel_radius_m};
    return true;
  }

  std::string error() const override { return socket_.error(); }
  // a controller of the bus sends each frame until another one has acknowledged it
  bool is_lossy() const override { return false; }

  void after_period(const Plant& plant) override {
    // the event and not the state: an axis that was armed again waits for its first torque
    if (plant.watchdog_trips() > seen_trips_) axis_->expire_watchdog();
    seen_trips_ = plant.watchdog_trips();
    send(axis_->after_period(shaft()));
  }

 private:
  bool send(const CanFrames& frames) {
    for (const CanFrame& frame : frames) {
      if (!socket_.send(frame)) return false;
    }
    return true;
  }

  /// The motor's own encoder sits before the joint's and is taken to be free of error.
  Shaft shaft() const {
    std::vector<double> state(plant_.states().size());
    plant_.true_state(state.data());
    return {state[0] / options_.wheel_radius_m, state[plant_.states().size() / 2] / options_.wheel_radius_m};
  }

  CanOptions options_;
  const Plant& plant_;
  std::unique_ptr<DriveAxis> axis_;
  CanSocket socket_;
  std::uint64_t seen_trips_ = 0;
};

}  // namespace

std::unique_ptr<PlantLink> open_can_link(const CanOptions& options, const Plant& plant, std::string& error) {
  auto axis = make_drive(options.drive, error);
  if (axis == nullptr) return nullptr;
  const bool same = axis->shares_board_numbers() && options.drive.node == options.sensor_node;
  if (options.sensor_node >= can_node_count || same) {
    error = "sensor_node must be from 0 to 63, and not the drive's";
    return nullptr;
  }
  if (options.wheel_radius_m == 0 || !std::isfinite(options.wheel_radius_m)) {
    error = "wheel_radius_m must be finite and not zero";
    return nullptr;
  }
  if (plant.commands().size() != 1) {
    error = "one motor driver drives plants with one command";
    return nullptr;
  }
  auto link = std::make_unique<CanLink>(options, plant, std::move(axis));
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
