#include "sim/servers/sensor_board.hpp"

#include <cmath>

#include "tiller_sensors.h"

namespace tiller::sim {
namespace {

constexpr double micro = 1e6;
constexpr double largest_reading = 2147483647;

/// CRC-8H2F over the identifier, low byte first, and seven bytes, bit by bit as dbc/sensors.dbc describes it.
std::uint8_t crc_of(const CanFrame& frame) {
  std::uint8_t crc = 0xff;
  const auto add = [&](std::uint32_t byte) {
    crc = static_cast<std::uint8_t>(crc ^ byte);
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint8_t>(crc & 0x80 ? crc << 1 ^ 0x2f : crc << 1);
  };
  add(frame.id & 0xff);
  add(frame.id >> 8);
  for (int i = 0; i < 7; ++i) add(frame.data[static_cast<std::size_t>(i)]);
  return static_cast<std::uint8_t>(crc ^ 0xff);
}

CanFrame protect(CanFrame frame) {
  frame.data[7] = crc_of(frame);
  return frame;
}

CanFrame protected_stamp_frame(std::uint32_t node, const PlantMeasurement& m) {
  tiller_sensors_protected_stamp_t out{};
  out.time_us = static_cast<std::uint32_t>(m.stamp_us);
  out.sequence_low = m.sequence & 0xffffff;
  CanFrame frame;
  frame.id = can_id(node, TILLER_SENSORS_PROTECTED_STAMP_FRAME_ID);
  frame.length = TILLER_SENSORS_PROTECTED_STAMP_LENGTH;
  tiller_sensors_protected_stamp_pack(frame.data.data(), &out, frame.data.size());
  return protect(frame);
}

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

CanFrame value_frame(std::uint32_t node, std::uint32_t channel, double value, std::uint32_t sequence,
                     bool is_protected) {
  tiller_sensors_value_t out{};
  const double reading = std::round(value * micro);
  out.valid = std::fabs(reading) <= largest_reading;  // false for NaN too
  out.reading = out.valid ? static_cast<std::int32_t>(reading) : 0;
  out.sequence_low = static_cast<std::uint16_t>(sequence);
  out.version = is_protected ? 1 : 0;
  CanFrame frame;
  frame.id = can_id(node, TILLER_SENSORS_VALUE_FRAME_ID + channel);
  frame.length = TILLER_SENSORS_VALUE_LENGTH;
  tiller_sensors_value_pack(frame.data.data(), &out, frame.data.size());
  return is_protected ? protect(frame) : frame;
}

}  // namespace

CanFrames sensor_frames(std::uint32_t node, const PlantMeasurement& m, bool is_protected) {
  CanFrames frames = {is_protected ? protected_stamp_frame(node, m) : stamp_frame(node, m)};
  for (std::size_t i = 0; i < m.value.size(); ++i) {
    frames.push_back(value_frame(node, static_cast<std::uint32_t>(i), m.value[i], m.sequence, is_protected));
  }
  return frames;
}

bool read_controller_status(std::uint32_t node, const CanFrame& frame, PlantCommand& answer, bool is_protected) {
  if (frame.id != can_id(node, TILLER_SENSORS_CONTROLLER_STATUS_FRAME_ID) || frame.remote) return false;
  tiller_sensors_controller_status_t in{};
  if (tiller_sensors_controller_status_unpack(&in, frame.data.data(), frame.length) != 0) return false;
  if (in.version > 1 || (is_protected && in.version == 0) || (in.version == 1 && frame.data[7] != crc_of(frame)))
    return false;
  answer = PlantCommand{};
  answer.sequence = in.answered_sequence;
  answer.has_value = false;
  answer.state = in.state;
  answer.plan = in.plan_sequence_low;
  return true;
}

}  // namespace tiller::sim
