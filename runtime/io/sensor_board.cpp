#include "io/sensor_board.hpp"

#include <limits>

#include "core/e2e.hpp"

extern "C" {
#include "tiller_sensors.h"
}

namespace tiller {
namespace {

constexpr std::uint32_t kCommandMask = 31;

}  // namespace

std::uint8_t board_crc(const CanFrame& frame) { return e2e_crc(static_cast<std::uint16_t>(frame.id), frame.data, 7); }

bool BoardReader::admit(const CanFrame& frame, std::uint32_t version) {
  if (version == 0) return !protected_;
  if (version != 1 || frame.data[7] != board_crc(frame)) return false;
  protected_ = true;
  return true;
}

BoardFrame BoardReader::read(const CanFrame& frame) {
  BoardFrame out;
  const std::uint32_t command = frame.id & kCommandMask;
  if (frame.fd || frame.length != 8) return out;
  if (command == TILLER_SENSORS_STAMP_FRAME_ID) {
    tiller_sensors_stamp_t in;
    if (tiller_sensors_stamp_unpack(&in, frame.data, frame.length) != 0 || !admit(frame, 0)) return out;
    out = {BoardFrame::Kind::stamp, in.time_us, in.sequence, 32, 0, 0.0};
  } else if (command == TILLER_SENSORS_PROTECTED_STAMP_FRAME_ID) {
    tiller_sensors_protected_stamp_t in;
    if (tiller_sensors_protected_stamp_unpack(&in, frame.data, frame.length) != 0 || !admit(frame, 1)) return out;
    out = {BoardFrame::Kind::stamp, in.time_us, in.sequence_low, 24, 0, 0.0};
  } else if (command - TILLER_SENSORS_VALUE_FRAME_ID < kBoardChannels) {  // wraps far above 11 for smaller ones
    tiller_sensors_value_t in;
    if (tiller_sensors_value_unpack(&in, frame.data, frame.length) != 0 || !admit(frame, in.version)) return out;
    // a reading that the board marks invalid is missing, which the filter knows how to skip
    const double value = in.valid != 0 ? in.reading * 1e-6 : std::numeric_limits<double>::quiet_NaN();
    out = {BoardFrame::Kind::value, 0, in.sequence_low, 16, command - TILLER_SENSORS_VALUE_FRAME_ID, value};
  }
  return out;
}

}  // namespace tiller
