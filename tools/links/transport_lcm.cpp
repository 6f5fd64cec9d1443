#include <cmath>

#include "io/key_file.hpp"
#include "io/lcm_transport.hpp"
#include "tools/links/transport_link.hpp"

namespace tiller::tools {
namespace {

class LcmLink final : public TransportLink {
 public:
  LcmLink(const RobotFile& robot, const TransportLinkOptions& options)
      : TransportLink(robot, options, kLcmTransport, &lcm_) {}
  ~LcmLink() override { kLcmTransport.close(&lcm_); }

  tiller_status_t open(OpenError& problem) override {
    LcmOptions lcm;
    lcm.url = robot_.transport.url.c_str();
    lcm.channel_prefix = robot_.transport.channel_prefix.c_str();
    lcm.measurement_count = robot_.config.measurement_count;
    lcm.input_count = robot_.config.model->input_count;
    lcm.stamp_on_arrival = robot_.transport.stamp_on_arrival && !options_.lockstep;
    lcm.lockstep = options_.lockstep;
    lcm.liblcm = robot_.transport.liblcm;
    lcm.replay_window_us = std::llround(1e6 * robot_.transport.replay_window_s);
    std::uint8_t key[MessageSeal::kKeyBytes];
    if (!robot_.transport.key_file.empty()) {
      const tiller_status_t status = read_key_file(robot_.transport.key_file.c_str(), key, &problem);
      if (status != tiller_status_ok) return status;
      lcm.key = key;
    }
    return lcm_transport_open(&lcm_, lcm, &problem);
  }

  void tell(const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override {
    TransportLink::tell(info, stamp_us, log);
    const tiller_config_t& config = robot_.config;
    (void)lcm_send_telemetry(&lcm_, stamp_us, info, config.model->state_count, config.param_count, log);
  }

  std::string counters() const override {
    const auto n = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
    std::string text = TransportLink::counters();
    if (lcm_.challenged > MessageSeal::kMeetingMessages) text += format(", %llu challenged", n(lcm_.challenged));
    if (lcm_.repeated_answers) text += format(", %llu answers sent again", n(lcm_.repeated_answers));
    if (lcm_.refusal) text += std::string("; last refused: ") + lcm_.refusal;
    return text;
  }

 private:
  bool tells_latency() const override { return true; }

  LcmTransport lcm_;
};

}  // namespace

std::unique_ptr<TransportLink> make_lcm_link(const RobotFile& robot, const TransportLinkOptions& options) {
  return std::make_unique<LcmLink>(robot, options);
}

}  // namespace tiller::tools
