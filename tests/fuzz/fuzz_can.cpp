// The robot's side of a CAN bus: frames in, measurements, faults and frames out; and the end-to-end code of short frames.
// An input is one byte that chooses the layout, then steps of a kind and its bytes.
#include <cmath>
#include <cstring>

#include "core/e2e.hpp"
#include "fuzz.hpp"
#include "io/can_robot.hpp"

namespace {

tiller::CanLayout layout_of(std::uint8_t choice) {
  tiller::CanLayout layout;
  layout.motor_count = 2;
  layout.motors[0] = {1, 0.05};
  layout.motors[1] = {2, -1.0};
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

tiller::CanFrame frame_of(fuzz::Bytes& input) {
  static constexpr std::uint32_t kNodes[] = {1, 2, 48, 63};
  tiller::CanFrame frame;
  const std::uint8_t choice = input.byte();
  frame.id = choice == 255 ? input.word() : kNodes[choice >> 5 & 3] << 5 | (choice & 31u);
  frame.length = input.byte();
  const std::string bytes = input.take(sizeof frame.data);
  std::memcpy(frame.data, bytes.data(), bytes.size());
  return frame;
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
  for (int i = 0; i < 2; ++i) {
    const std::uint64_t bits = std::uint64_t{input.word()} << 32 | input.word();
    std::memcpy(&command.value[i], &bits, sizeof bits);
  }
  tiller::CanFrame frames[tiller::CanRobot::kMaxFrames];
  const std::uint32_t count = robot.command(command, frames);
  fuzz::require(count <= tiller::CanRobot::kMaxFrames, "a command fits its frames");
  const bool finite = std::isfinite(static_cast<float>(command.value[0] * 0.05)) &&
                      std::isfinite(static_cast<float>(command.value[1] * -1.0));
  fuzz::require(finite == (count > 0), "frames are sent for finite torques and for no others");
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

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes input(data, size);
  const std::uint8_t choice = input.byte();
  if (choice == 128) {
    check_e2e(input);
    return 0;
  }
  tiller::CanRobot robot;
  robot.reset(layout_of(choice));
  std::int64_t now_us = 1000;
  for (int step = 0; step < 256 && !input.empty(); ++step) {
    const std::uint8_t kind = input.byte();
    now_us += kind >> 3 << 12;
    if (kind % 8 == 0) {
      check_command(robot, input);
    } else if (kind % 8 == 1) {
      tiller::CanFrame frames[TILLER_MAX_INPUTS];
      fuzz::require(robot.clear_faults(frames) <= TILLER_MAX_INPUTS, "one frame a motor");
    } else {
      robot.receive(frame_of(input), now_us);
    }
    check_measurement(robot);
    fuzz::require((robot.fault() != tiller_status_ok) == (robot.fault_text() != nullptr), "a fault has its text");
  }
  return 0;
}
