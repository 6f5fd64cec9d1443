// The road over CAN: codecs of the runtime on one side, emulated drive and sensor board on the other. The bus is a
// list of frames; what a socket would report of it (bus-off, a full queue) is a switch of the World.

#include "fault_bus.hpp"

namespace tiller::faults {
namespace {

constexpr std::uint32_t kMotor = 1, kBoard = 48;

CanFrame from_sim(const sim::CanFrame& f) {
  CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  for (std::uint32_t i = 0; i < f.length && i < 8; ++i) frame.data[i] = f.data[i];
  return frame;
}

sim::CanFrame to_sim(const CanFrame& f) {
  sim::CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  for (std::uint32_t i = 0; i < f.length && i < 8; ++i) frame.data[i] = f.data[i];
  return frame;
}

class BusLink final : public Link {
 public:
  BusLink(const Setup& setup, Device& device) : plant_(device) { robot_.reset(bus_layout(setup)); }

  bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
             tiller_measurement_t& measurement) override {
    std::vector<CanFrame> frames = plant_.frames(genuine);
    if (fault != nullptr && fault->frames != nullptr) fault->frames(world, frames);
    if (world.cut) frames.clear();
    for (const CanFrame& f : frames)
      if (!robot_.receive(f, world.now_us)) ++refused_;
    return robot_.take(&measurement);
  }

  void send(World& world, const Fault* fault, const tiller_command_t& command) override {
    CanFrame out[CanRobot::kMaxFrames];
    const std::uint32_t count = robot_.command(command, out);
    std::vector<CanFrame> frames(out, out + count);
    if (fault != nullptr && fault->commands != nullptr) fault->commands(world, frames);
    if (world.cut) frames.clear();
    for (const CanFrame& f : frames) plant_.deliver(f);
  }

  tiller_status_t fault(const World& world) const override {
    return world.transport != tiller_status_ok ? world.transport : robot_.fault();
  }
  std::uint64_t refused() const override { return refused_ + robot_.dropped_old(); }
  void after_period() override { plant_.watch(); }

 private:
  BusPlant plant_;
  CanRobot robot_;
  std::uint64_t refused_ = 0;
};

}  // namespace

CanLayout bus_layout(const Setup& setup) {
  CanLayout layout;
  layout.motor_count = 1;
  layout.motors[0].node = kMotor;
  layout.motors[0].wheel_radius_m = 1.0;
  layout.sensor_node = kBoard;
  layout.channel_count = setup.config.measurement_count;
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) layout.channels[i].index = static_cast<std::uint8_t>(i);
  if (setup.motor_encoder) layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.heartbeat_timeout_us = static_cast<std::uint32_t>(setup.heartbeat_timeout_us);
  return layout;
}

BusPlant::BusPlant(Device& device) : device_(device), axis_(kMotor) {}

std::vector<CanFrame> BusPlant::frames(const tiller_measurement_t& genuine) const {
  std::vector<CanFrame> frames = {from_sim(axis_.heartbeat())};
  sim::PlantMeasurement reading{genuine.stamp_us, genuine.sequence, {}};
  reading.value.assign(genuine.value, genuine.value + device_.plant().measurements().size());
  for (const sim::CanFrame& f : sim::sensor_frames(kBoard, reading)) frames.push_back(from_sim(f));
  std::vector<double> state(device_.plant().states().size());
  device_.plant().true_state(state.data());
  const double turns = 1.0 / (2.0 * 3.14159265358979323846);
  frames.push_back(from_sim(axis_.encoder_estimates(state[0] * turns, state[state.size() / 2] * turns)));
  return frames;
}

void BusPlant::deliver(const CanFrame& data) {
  const sim::CanFrame frame = to_sim(data);
  sim::PlantCommand command;
  if (sim::read_controller_status(kBoard, frame, command)) return device_.obey(command);
  sim::CanFrames replies;
  if (axis_.receive(frame, replies) == sim::OdriveAxis::Event::kNone) return;
  command.value = {axis_.torque_Nm()};
  device_.obey(command);
}

void BusPlant::watch() {
  if (device_.plant().watchdog_trips() > trips_) axis_.expire_watchdog();
  trips_ = device_.plant().watchdog_trips();
}

std::unique_ptr<Link> make_bus_link(const Setup& setup, Device& device) {
  return std::make_unique<BusLink>(setup, device);
}

}  // namespace tiller::faults
