// The route over CAN: codecs of the runtime on one side, emulated drive and sensor board on the other. The bus is a
// list of frames; what a socket would report of it (bus-off, a full queue) is a switch of the World.

#include "harness/faults/fault_bus.hpp"

#include <algorithm>

namespace tiller::faults {
namespace {

constexpr std::uint32_t kMotor = 1, kBoard = 48;
constexpr double kMitTorque_Nm = 25.0;  // more than either plant asks for

CanFrame from_sim(const sim::CanFrame& f) {
  CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  frame.extended = f.extended;
  frame.fd = f.fd;
  std::copy(f.data.begin(), f.data.end(), frame.data);
  return frame;
}

sim::CanFrame to_sim(const CanFrame& f) {
  sim::CanFrame frame;
  frame.id = f.id;
  frame.length = f.length;
  frame.extended = f.extended;
  frame.fd = f.fd;
  std::copy(f.data, f.data + sizeof f.data, frame.data.begin());
  return frame;
}

ActuatorSettings settings_of(const Setup& setup) {
  ActuatorSettings s;
  s.kind = setup.drive;
  s.node = kMotor;
  s.watchdog_s = setup.plant.watchdog_timeout_s;
  s.reply = setup.mit_reply;
  s.range.torque_Nm = kMitTorque_Nm;
  return s;
}

std::unique_ptr<sim::DriveAxis> drive_of(const ActuatorSettings& settings) {
  sim::DriveOptions options;
  options.protocol = actuator_name(settings.kind).word;
  options.node = settings.node;
  options.torque_Nm = settings.range.torque_Nm;
  options.reply = kMitReplyNames[static_cast<std::size_t>(settings.reply)];
  std::string error;
  return sim::make_drive(options, error);
}

class BusLink final : public Link {
 public:
  BusLink(const Setup& setup, Device& device) : plant_(setup, device) { robot_.reset(bus_layout(setup)); }

  bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
             tiller_measurement_t& measurement) override {
    if (fault != nullptr) plant_.inject(world.drive);
    world.drive = DriveTrouble::kNone;
    on_frame(world, fault, plant_.frames(genuine));
    CanFrame questions[CanRobot::kMaxFrames];
    const std::uint32_t count = robot_.queries_due(questions);
    if (count > 0 && !world.cut) {
      for (std::uint32_t i = 0; i < count; ++i) plant_.deliver(questions[i]);
      on_frame(world, fault, plant_.answers());
    }
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
  void on_frame(World& world, const Fault* fault, std::vector<CanFrame> frames) {
    if (fault != nullptr && fault->frames != nullptr) fault->frames(world, frames);
    if (world.cut) frames.clear();
    for (const CanFrame& f : frames)
      if (!robot_.receive(f, world.now_us)) ++refused_;
  }

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
  layout.motors[0].drive = settings_of(setup);
  layout.sensor_node = kBoard;
  layout.channel_count = setup.config.measurement_count;
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) layout.channels[i].index = static_cast<std::uint8_t>(i);
  if (setup.motor_encoder) layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.heartbeat_timeout_us = static_cast<std::uint32_t>(setup.heartbeat_timeout_us);
  return layout;
}

BusPlant::BusPlant(const Setup& setup, Device& device)
    : device_(device), settings_(settings_of(setup)), axis_(drive_of(settings_)) {}

BusPlant::BusPlant(Device& device) : BusPlant(Setup{}, device) {}

sim::Shaft BusPlant::shaft() const {
  std::vector<double> state(device_.plant().states().size());
  device_.plant().true_state(state.data());
  return {state[0], state[state.size() / 2]};
}

std::vector<CanFrame> BusPlant::answers() {
  std::vector<CanFrame> frames;
  for (const sim::CanFrame& f : answers_) frames.push_back(from_sim(f));
  answers_.clear();
  return frames;
}

std::vector<CanFrame> BusPlant::frames(const tiller_measurement_t& genuine) {
  std::vector<CanFrame> frames = answers();
  const auto add = [&](const sim::CanFrames& more) {
    for (const sim::CanFrame& f : more) frames.push_back(from_sim(f));
  };
  add(axis_->before_reading());
  sim::PlantMeasurement reading{genuine.stamp_us, genuine.sequence, {}};
  reading.value.assign(genuine.value, genuine.value + device_.plant().measurements().size());
  add(sim::sensor_frames(kBoard, reading));
  add(axis_->after_period(shaft()));
  return frames;
}

void BusPlant::deliver(const CanFrame& data) {
  const sim::CanFrame frame = to_sim(data);
  sim::PlantCommand command;
  if (sim::read_controller_status(kBoard, frame, command)) return device_.apply(command);
  if (axis_->take(frame, shaft(), answers_) == sim::DriveAxis::Event::kNone) return;
  command.value = {axis_->torque_Nm()};
  device_.apply(command);
}

void BusPlant::inject(DriveTrouble trouble) {
  if (trouble == DriveTrouble::kNone) return;
  if (trouble == DriveTrouble::kStoppedByAnother) {
    CanFrame stop[ActuatorProtocol::kMaxFrames];
    const std::uint32_t count = actuator_protocol(settings_.kind).disable(settings_, stop);
    for (std::uint32_t i = 0; i < count; ++i) deliver(stop[i]);
    return;
  }
  if (trouble == DriveTrouble::kRestarts) {
    axis_ = drive_of(settings_);
  } else {
    axis_->break_down();
  }
  const double none = 0.0;
  device_.plant().apply(&none);  // the drive releases its motor by itself, whatever its board thinks of the plan
}

void BusPlant::watch() {
  if (device_.plant().watchdog_trips() > trips_) axis_->expire_watchdog();
  trips_ = device_.plant().watchdog_trips();
}

std::unique_ptr<Link> make_bus_link(const Setup& setup, Device& device) {
  return std::make_unique<BusLink>(setup, device);
}

}  // namespace tiller::faults
