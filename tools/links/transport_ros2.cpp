#include <cmath>
#include <cstdio>

#include "ros2/ros2_transport.hpp"
#include "tools/links/transport_link.hpp"
#include "tools/robot/ros2_topics.hpp"

namespace tiller::tools {
namespace {

std::string text_of(const Ros2Source& source) {
  switch (source.message) {
    case Ros2Message::kJointState: return std::string(kJointFields[source.field]) + " of the joint " + source.joint;
    case Ros2Message::kImu: return std::string("imu:") + kImuFields[source.field];
    case Ros2Message::kOdometry: break;
  }
  return std::string("odometry:") + kOdometryFields[source.field];
}

class Ros2Link final : public TransportLink {
 public:
  Ros2Link(const RobotFile& robot, const TransportLinkOptions& options)
      : TransportLink(robot, options, kRos2Transport, &ros2_) {}
  ~Ros2Link() override { kRos2Transport.close(&ros2_); }

  tiller_status_t open(OpenError& problem) override {
    const Ros2Section& section = robot_.transport.ros2;
    const std::string commands = ros2_commands_topic(robot_), node = ros2_node_name(robot_);
    Ros2Options ros2;
    ros2.joint_states = section.joint_states.c_str();
    ros2.imu = section.imu.c_str();
    ros2.odometry = section.odometry.c_str();
    ros2.commands = commands.c_str();
    ros2.node = node.c_str();
    ros2.measurement_count = robot_.config.measurement_count;
    ros2.input_count = robot_.config.model->input_count;
    ros2.together_us = std::llround(1e6 * robot_.config.period_s);
    ros2.stamp_on_arrival = robot_.transport.stamp_on_arrival && !options_.lockstep;
    ros2.lockstep = options_.lockstep;
    const tiller_status_t status = name_sources(ros2, problem);
    return status == tiller_status_ok ? ros2_transport_open(&ros2_, ros2, &problem) : status;
  }

  /// Asked for while nothing has come yet: a joint that is called otherwise, a topic that nobody publishes.
  std::string news() override {
    if (ros2_.counters.received > 0) return TransportLink::news();
    if (ros2_.refusal != nullptr) return refusal();
    char silence[300];
    ros2_silence(&ros2_, silence, sizeof silence);
    return silence;
  }

  void tell(const tiller_info_t& info, std::int64_t stamp_us, const LogState& log) override {
    TransportLink::tell(info, stamp_us, log);
    constexpr std::int64_t kEveryUs = 1000000;
    if (told_ && stamp_us - told_us_ < kEveryUs && info.state == told_state_) return;
    told_ = true;
    told_us_ = stamp_us;
    told_state_ = info.state;
    (void)ros2_send_diagnostics(&ros2_, diagnostics_of(info));
  }

  std::string counters() const override {
    std::string text = TransportLink::counters();
    if (ros2_.repeated_answers)
      text += format(", %llu answers sent again", static_cast<unsigned long long>(ros2_.repeated_answers));
    if (ros2_.refusal != nullptr) text += "; last refused: " + refusal();
    char silence[300];
    ros2_silence(&ros2_, silence, sizeof silence);
    if (*silence) text += std::string("; ") + silence;
    return text;
  }

 private:
  tiller_status_t name_sources(Ros2Options& ros2, OpenError& problem) const {
    const Words& given = robot_.transport.ros2.sources;
    for (std::uint32_t i = 0; i < ros2.measurement_count; ++i) {
      const std::string& name = robot_.names.measurements[i];
      if (!given.empty() && ros2_parse_source(given[i].c_str(), &ros2.source[i])) continue;
      if (given.empty() && ros2_source_of_name(name.c_str(), &ros2.source[i])) continue;
      set_open_error(&problem,
                     "ros2: the unit of %.60s does not say which message holds it; add sources = { %.60s = "
                     "\"position:joint\" } (docs/guide/ros2.md)",
                     name.c_str(), name.c_str());
      return tiller_status_bad_message;
    }
    return tiller_status_ok;
  }

  /// ACTIVE is OK, SAFE an error, everything else worth a look.
  Ros2Diagnostics diagnostics_of(const tiller_info_t& info) const {
    Ros2Diagnostics d;
    const auto state = static_cast<tiller_state_t>(info.state);
    d.level = state == tiller_state_active ? 0 : state == tiller_state_safe ? 2 : 1;
    d.name = robot_.name.c_str();
    d.message = state == tiller_state_safe ? tiller_status_text(static_cast<tiller_status_t>(info.first_fault))
                                           : tiller_state_name(state);
    const auto add = [&d](const char* key, double value) {
      Ros2Diagnostics::Value& to = d.value[d.count++];
      to.key = key;
      (void)std::snprintf(to.text, sizeof to.text, "%.9g", value);
    };
    add("ticks", static_cast<double>(info.ticks));
    add("tick_ms", 1e-6 * static_cast<double>(info.tick_ns));
    add("plans", static_cast<double>(info.plans));
    add("plan_cost", info.plan_cost);
    add("effective_samples", info.effective_samples);
    add("received", static_cast<double>(ros2_.counters.received));
    add("bad_messages", static_cast<double>(ros2_.counters.bad_messages));
    add("dropped_old", static_cast<double>(ros2_.counters.dropped_old));
    return d;
  }

  std::string refusal() const {
    if (ros2_.refused_source == nullptr) return ros2_.refusal;
    return "a JointState without the " + text_of(*ros2_.refused_source) +
           "; its joints are: " + (ros2_.seen[0] ? ros2_.seen : "none");
  }

  Ros2Transport ros2_;
  bool told_ = false;
  std::int64_t told_us_ = 0;
  std::uint32_t told_state_ = 0;
};

}  // namespace

std::unique_ptr<TransportLink> make_ros2_link(const RobotFile& robot, const TransportLinkOptions& options) {
  return std::make_unique<Ros2Link>(robot, options);
}

}  // namespace tiller::tools
