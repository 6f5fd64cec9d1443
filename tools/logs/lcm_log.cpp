#include "tools/logs/lcm_log.hpp"

namespace tiller::tools {
namespace {

void big_endian(std::string& bytes, std::uint64_t v, int width) {
  for (int i = width - 1; i >= 0; --i) bytes += static_cast<char>(v >> (8 * i) & 0xffu);
}

}  // namespace

void LcmLog::open(const std::string& path, std::int64_t epoch_us) {
  epoch_us_ = epoch_us;
  file_.open(path);
}

/// Layout: sync word, event number, microseconds, two lengths, channel, message; big-endian (lcm/eventlog.h).
void LcmLog::event(const char* channel, std::int64_t now_us, const LcmType& type, const void* message) {
  constexpr std::uint64_t kSync = 0xEDA1DA01u;
  const std::string name = robot_.transport.channel_prefix + channel;
  std::string content(lcm_size(type, message), '\0');
  (void)lcm_encode(type, message, reinterpret_cast<std::uint8_t*>(content.data()));
  std::string bytes;
  big_endian(bytes, kSync, 4);
  big_endian(bytes, number_, 8);
  big_endian(bytes, static_cast<std::uint64_t>(now_us + epoch_us_), 8);
  big_endian(bytes, name.size(), 4);
  big_endian(bytes, content.size(), 4);
  if (file_.write(bytes + name + content))
    ++number_;
  else
    ++lost_messages_;
}

void LcmLog::add(const RecordEntry& entry, const tiller_info_t& info, const LogState& log) {
  const tiller_record_t& r = entry.record;
  const tiller_config_t& c = robot_.config;
  const std::uint32_t nx = c.model->state_count, nu = c.model->input_count, ny = c.measurement_count;
  if (r.has_measurement != 0) {
    const LcmMeasurement measurement = lcm_message(r.measurement, ny);
    event("MEASUREMENT", r.now_us, lcm_measurement_type(ny), &measurement);
  }
  const LcmCommand command = lcm_message(r.command, nu);
  event("COMMAND", r.now_us, lcm_command_type(nu), &command);
  const LcmTelemetry telemetry = lcm_message(info, r.now_us, nx, c.param_count, log);
  event("TELEMETRY", r.now_us, lcm_telemetry_type(nx, c.param_count), &telemetry);
  if (info.force_joints > 0) {
    const LcmForces forces = lcm_forces(info, r.now_us);
    event("FORCES", r.now_us, kLcmForcesType, &forces);
  }
  if (!lcm_tells_of_probing(info)) return;
  const LcmProbing probing = lcm_probing(info, r.now_us);
  event("PROBING", r.now_us, kLcmProbingType, &probing);
}

}  // namespace tiller::tools
