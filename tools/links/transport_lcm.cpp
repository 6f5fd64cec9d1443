#include <cmath>

#include "io/key_file.hpp"
#include "io/lcm_transport.hpp"
#include "tools/links/transport.hpp"

namespace tiller::tools {
namespace {

class LcmHost final : public HostTransport {
 public:
  tiller_status_t open(const RobotFile& robot, const TransportLinkOptions& options, OpenError& problem) override {
    LcmOptions lcm;
    lcm.url = robot.transport.url.c_str();
    lcm.channel_prefix = robot.transport.channel_prefix.c_str();
    lcm.measurement_count = robot.config.measurement_count;
    lcm.input_count = robot.config.model->input_count;
    lcm.stamp_on_arrival = robot.transport.stamp_on_arrival && !options.lockstep;
    lcm.lockstep = options.lockstep;
    lcm.liblcm = robot.transport.liblcm;
    lcm.replay_window_us = std::llround(1e6 * robot.transport.replay_window_s);
    std::uint8_t key[MessageSeal::kKeyBytes];
    if (!robot.transport.key_file.empty()) {
      const tiller_status_t status = read_key_file(robot.transport.key_file.c_str(), key, &problem);
      if (status != tiller_status_ok) return status;
      lcm.key = key;
    }
    return lcm_transport_open(&lcm_, lcm, &problem);
  }

  const tiller_transport_t& table() const override { return kLcmTransport; }
  void* self() override { return &lcm_; }
  bool tells_latency() const override { return true; }

  void tell(const RobotFile& robot, const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override {
    (void)lcm_send_telemetry(&lcm_, stamp_us, info, robot.config.model->state_count, robot.config.param_count, log);
  }

  std::string more_counters() const override {
    const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
    std::string text;
    if (lcm_.challenged > MessageSeal::kMeetingMessages) text += format(", %llu challenged", n(lcm_.challenged));
    if (lcm_.repeated_answers) text += format(", %llu answers sent again", n(lcm_.repeated_answers));
    if (lcm_.refusal) text += std::string("; last refused: ") + lcm_.refusal;
    return text;
  }

 private:
  LcmTransport lcm_;
};

}  // namespace

std::unique_ptr<HostTransport> make_lcm_transport();
std::unique_ptr<HostTransport> make_lcm_transport() { return std::make_unique<LcmHost>(); }

}  // namespace tiller::tools
