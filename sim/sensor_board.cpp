#include "sim/sensor_board.hpp"

#include <cmath>

#include "tiller_sensors.h"

namespace tiller::sim {
namespace {

constexpr double micro = 1e6;
constexpr double largest_reading = 2147483647;

CanFrame stamp_frame(std::uint32_t node, const PlantMeasurement& m) {
  tiller_sensors_stamp_t out{};
  out.time_us = static_cast<std::uint32_t>(m.stamp_us);  // the low 32 bits, as the board's clock has no more
  out.sequence = m.sequence;
  CanFrame frame;
  frame.id = can_id(node, TILLER_SENSORS_STAMP_FRAME_ID);
  frame.length = TILLER_SENSORS_STAMP_LENGTH;
  tiller_sensors_stamp_pack(frame.data.data(), &out, frame.data.size());
  return frame;
}

CanFrame value_frame(std::uint32_t node, std::uint32_t channel, double value, std::uint32_t sequence) {
  tiller_sensors_value_t out{};
  const double reading = std::round(value * micro);
  out.valid = std::fabs(reading) <= largest_reading;  // false for NaN too
  out.reading = out.valid ? static_cast<std::int32_t>(reading) : 0;
  out.sequence_low = static_cast<std::uint16_t>(sequence);
  CanFrame frame;
  frame.id = can_id(node, TILLER_SENSORS_VALUE_FRAME_ID + channel);
  frame.length = TILLER_SENSORS_VALUE_LENGTH;
  tiller_sensors_value_pack(frame.data.data(), &out, frame.data.size());
  return frame;
}

}  // namespace

CanFrames sensor_frames(std::uint32_t node, const PlantMeasurement& m) {
  CanFrames frames = {stamp_frame(node, m)};
  for (std::size_t i = 0; i < m.value.size(); ++i) {
    frames.push_back(value_frame(node, static_cast<std::uint32_t>(i), m.value[i], m.sequence));
  }
  return frames;
}

bool read_controller_status(std::uint32_t node, const CanFrame& frame, PlantCommand& answer) {
  if (frame.id != can_id(node, TILLER_SENSORS_CONTROLLER_STATUS_FRAME_ID) || frame.remote) return false;
  tiller_sensors_controller_status_t in{};
  if (tiller_sensors_controller_status_unpack(&in, frame.data.data(), frame.length) != 0) return false;
  answer = PlantCommand{};
  answer.sequence = in.answered_sequence;
  answer.has_value = false;
  answer.state = in.state;
  answer.plan = in.plan_sequence_low;
  return true;
}

}  // namespace tiller::sim
