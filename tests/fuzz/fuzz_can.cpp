// The robot's side of a CAN bus: frames in, measurements, faults and frames out, for every protocol of actuators.def;
// and the end-to-end code of short frames. An input is one byte that chooses the layout, then steps of a kind and its
// bytes.
#include <cmath>
#include <cstring>

#include "core/e2e.hpp"
#include "fuzz_can.hpp"

namespace {

constexpr double kLevers[] = {0.05, -1.0};

tiller::ActuatorSettings drive_of(std::uint8_t choice, std::uint32_t node) {
  tiller::ActuatorSettings drive;
  drive.kind = static_cast<tiller::ActuatorKind>(choice % static_cast<unsigned>(tiller::ActuatorKind::count));
  drive.node = node;
  drive.reply_id = 16 + node;
  drive.resolution = static_cast<tiller::MoteusResolution>(choice / 4 % 4);
  drive.reply = static_cast<tiller::MitReply>(choice / 4 % 3);
  return drive;
}

tiller::CanLayout layout_of(fuzz::Bytes& input) {
  const std::uint8_t choice = input.byte(), drives = input.byte();
  tiller::CanLayout layout;
  layout.motor_count = 2;
  for (std::uint32_t i = 0; i < 2; ++i) {
    layout.motors[i].node = 1 + i;
    layout.motors[i].wheel_radius_m = kLevers[i];
    layout.motors[i].drive = drive_of(i == 0 ? drives & 15 : drives >> 4, 1 + i);
  }
  layout.channel_count = 3;
  layout.channels[0] = {tiller::CanSource::kMotorPosition, 0};
  layout.channels[1] = {tiller::CanSource::kSensor, 11};
  layout.channels[2] = {tiller::CanSource::kMotorVelocity, 1};
  if (choice % 4 == 1) layout.stamp_on_arrival = true;
  if (choice % 4 == 2) layout.channels[0] = {tiller::CanSource::kSensor, 0};
  if (choice % 4 == 3) {
    layout.sensor_node = tiller::CanLayout::kNoBoard;
    layout.channels[1] = {tiller::CanSource::kMotorPosition, 1};
  }
  return layout;
}

void receive(tiller::CanRobot& robot, const tiller::CanFrame& frame, std::int64_t now_us) {
  const bool taken = robot.receive(frame, now_us);
  if (!taken || frame.id > (frame.extended ? tiller::kExtendedMask : tiller::kStandardMask)) return;
  tiller::CanFilter filters[tiller::CanRobot::kMaxFilters];
  const std::uint32_t count = robot.filters(filters);
  fuzz::require(count <= tiller::CanRobot::kMaxFilters, "filters fit their places");
  bool passes = false;
  for (std::uint32_t i = 0; i < count; ++i) passes = passes || filters[i].passes(frame);
  fuzz::require(passes, "a frame that is used passes the filters");
}

void check_measurement(tiller::CanRobot& robot) {
  tiller_measurement_t measurement;
  if (!robot.take(&measurement)) return;
  for (std::uint32_t i = 0; i < TILLER_MAX_MEASUREMENTS; ++i)
    fuzz::require(!std::isinf(measurement.value[i]), "a measurement is never infinite");
}

void check_command(tiller::CanRobot& robot, fuzz::Bytes& input) {
  tiller_command_t command{};
  command.state = input.byte() % 5;
  bool finite = true;
  for (int i = 0; i < 2; ++i) {
    const std::uint64_t bits = input.long_word();
    std::memcpy(&command.value[i], &bits, sizeof bits);
    finite = finite && std::isfinite(command.value[i]);
  }
  tiller::CanFrame frames[tiller::CanRobot::kMaxFrames];
  const std::uint32_t count = robot.command(command, frames);
  fuzz::check_frames(robot, frames, count);
  fuzz::require(finite || count == 0, "nothing is sent for a command that is not finite");
}

void check_e2e(fuzz::Bytes& input) {
  tiller::E2eReceiver receiver(0x123, input.byte());
  std::int64_t now_us = 0;
  while (!input.empty()) {
    now_us += input.byte() * 10000;
    const std::string frame = input.take(input.byte() % 20);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(frame.data());
    const bool usable = tiller::is_usable(receiver.check(bytes, frame.size(), now_us));
    fuzz::require(!usable || (frame.size() >= tiller::kE2eMinBytes && frame.size() <= tiller::kE2eMaxBytes),
                  "a frame that passes has a possible length");
  }
}

void step(tiller::CanRobot& robot, std::uint8_t kind, fuzz::Bytes& input, std::int64_t now_us) {
  tiller::CanFrame frames[tiller::CanRobot::kMaxFrames];
  switch (kind % 8) {
    case 0: check_command(robot, input); break;
    case 1: fuzz::check_frames(robot, frames, robot.clear_faults(frames)); break;
    case 2: fuzz::check_frames(robot, frames, robot.ask(frames)); break;
    case 3: fuzz::check_frames(robot, frames, robot.queries_due(frames)); break;
    case 4: robot.prepare((kind & 8) != 0); break;
    default: receive(robot, fuzz::can_frame(input), now_us);
  }
  check_measurement(robot);
  fuzz::require((robot.fault() != tiller_status_ok) == (robot.fault_text() != nullptr), "a fault has its text");
}

}  // namespace

// Requirement: SR-16, SR-21
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size > 0 && data[0] == 128) {
    fuzz::Bytes input(data + 1, size - 1);
    check_e2e(input);
    return 0;
  }
  fuzz::Bytes input(data, size);
  const tiller::CanLayout layout = layout_of(input);
  if (tiller::can_layout_error(layout) != nullptr) return 0;
  tiller::CanRobot robot;
  robot.reset(layout);
  std::int64_t now_us = 1000;
  for (int i = 0; i < 256 && !input.empty(); ++i) {
    const std::uint8_t kind = input.byte();
    now_us += kind >> 3 << 12;
    step(robot, kind, input, now_us);
  }
  return 0;
}
