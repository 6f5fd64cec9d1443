#include "sim/servers/serve_ros2.hpp"

#if TILLER_WITH_ROS2

#include <algorithm>
#include <ctime>

#include "ros2/ros2_wire.hpp"
#include "ros2_messages.h"

namespace tiller::sim {
namespace {

using JointState = sensor_msgs_msg_dds__JointState_;
using Efforts = std_msgs_msg_dds__Float64MultiArray_;

constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::int64_t kOfAnother = -2;  // the answer to an earlier measurement

std::int64_t clock_ns(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return std::int64_t{now.tv_sec} * kNsPerS + now.tv_nsec;
}

/// Joints by their names, in the order of the first channel of each, and what the message holds of them.
class JointMessage {
 public:
  explicit JointMessage(const std::vector<Ros2Channel>& channels) : channels_(channels) {
    for (const Ros2Channel& channel : channels) {
      const auto found = std::find(names_.begin(), names_.end(), channel.joint);
      joint_.push_back(static_cast<std::size_t>(found - names_.begin()));
      if (found == names_.end()) names_.push_back(channel.joint);
      has_[channel.field] = true;
    }
    for (std::string& name : names_) pointers_.push_back(name.data());
    for (std::vector<double>& values : values_) values.assign(names_.size(), 0.0);
  }

  const JointState& fill(const PlantMeasurement& m, std::int64_t stamp_ns) {
    for (std::size_t i = 0; i < channels_.size(); ++i)
      values_[static_cast<std::size_t>(channels_[i].field)][joint_[i]] = m.value[i];
    message_ = JointState{};
    message_.header.stamp.sec = static_cast<std::int32_t>(stamp_ns / kNsPerS);
    message_.header.stamp.nanosec = static_cast<std::uint32_t>(stamp_ns % kNsPerS);
    message_.header.frame_id = frame_;
    message_.name._buffer = pointers_.data();
    message_.name._length = message_.name._maximum = static_cast<std::uint32_t>(pointers_.size());
    fill(message_.position, 0);
    fill(message_.velocity, 1);
    fill(message_.effort, 2);
    return message_;
  }

 private:
  void fill(dds_sequence_double& to, std::size_t field) {
    if (!has_[field]) return;
    to._buffer = values_[field].data();
    to._length = to._maximum = static_cast<std::uint32_t>(values_[field].size());
  }

  const std::vector<Ros2Channel>& channels_;
  std::vector<std::size_t> joint_;  // of each channel
  std::vector<std::string> names_;
  std::vector<char*> pointers_;
  std::vector<double> values_[3];
  bool has_[3] = {};
  char frame_[1] = "";
  JointState message_{};
};

class Ros2Link final : public PlantLink {
 public:
  Ros2Link(const Ros2Options& options, bool lockstep)
      : lockstep_(lockstep), channels_(options.channels), message_(channels_) {
    if (!ros2_topic(options.joint_states.c_str(), states_) || !ros2_topic(options.commands.c_str(), commands_))
      error_ = "'" + options.joint_states + "' or '" + options.commands + "' is no name of a topic";
    else
      open();
  }
  ~Ros2Link() override {
    if (participant_ > 0) (void)dds_delete(participant_);
    dds_sample_free(command_, ros2_type(Ros2Type::kEffort).descriptor, DDS_FREE_ALL);
  }
  Ros2Link(const Ros2Link&) = delete;
  Ros2Link& operator=(const Ros2Link&) = delete;

  bool publish(const PlantMeasurement& m) override {
    sequence_ = m.sequence;
    stamp_ns_ = m.stamp_us * 1000;
    if (!lockstep_) stamp_ns_ += clock_ns(CLOCK_REALTIME) - clock_ns(CLOCK_MONOTONIC);
    const dds_return_t sent = dds_write(writer_, &message_.fill(m, stamp_ns_));
    if (sent < 0 && sent != DDS_RETCODE_TIMEOUT) fail("cannot write", sent);
    return error_.empty();
  }

  bool receive(PlantCommand& command, std::int64_t timeout_us) override {
    if (take(command)) return true;
    (void)dds_waitset_wait(waitset_, nullptr, 0, timeout_us * 1000);
    return take(command);
  }

  std::string error() const override { return error_; }

 private:
  void fail(const char* what, dds_return_t why) { error_ = std::string("ROS 2: ") + what + ": " + dds_strretcode(why); }

  void open() {
    participant_ = ros2_participant();
    if (participant_ < 0) return fail("cannot join the domain", participant_);
    writer_ = ros2_writer(participant_, Ros2Type::kJointState, states_);
    if (writer_ < 0) return fail("cannot write", writer_);
    reader_ = ros2_reader(participant_, Ros2Type::kEffort, commands_, Ros2Qos::kReliable, nullptr);
    if (reader_ < 0) return fail("cannot read", reader_);
    (void)dds_set_status_mask(reader_, DDS_DATA_AVAILABLE_STATUS);
    waitset_ = dds_create_waitset(participant_);
    const dds_return_t attached = dds_waitset_attach(waitset_, reader_, 0);
    if (attached < 0) fail("cannot wait", attached);
  }

  bool take(PlantCommand& command) {
    dds_sample_info_t info;
    void* sample = command_;
    const dds_return_t count = dds_take(reader_, &sample, &info, 1, 1);
    if (count < 0) fail("cannot read", count);
    if (count <= 0 || !info.valid_data) return false;
    command = PlantCommand();
    command.value.assign(command_->data._buffer, command_->data._buffer + command_->data._length);
    if (lockstep_) command.sequence = info.source_timestamp == stamp_ns_ ? sequence_ : kOfAnother;
    return true;
  }

  const bool lockstep_;
  const std::vector<Ros2Channel> channels_;
  JointMessage message_;
  char states_[kRos2Topic] = "", commands_[kRos2Topic] = "";
  dds_entity_t participant_ = 0, writer_ = 0, reader_ = 0, waitset_ = 0;
  Efforts* command_ = static_cast<Efforts*>(dds_alloc(sizeof(Efforts)));
  std::int64_t stamp_ns_ = 0, sequence_ = 0;
  std::string error_;
};

}  // namespace

std::unique_ptr<PlantLink> open_ros2_link(const Ros2Options& ros2, bool lockstep, std::string& error) {
  auto link = std::make_unique<Ros2Link>(ros2, lockstep);
  error = link->error();
  if (!error.empty()) return nullptr;
  return link;
}

}  // namespace tiller::sim

#else

namespace tiller::sim {

std::unique_ptr<PlantLink> open_ros2_link(const Ros2Options&, bool, std::string& error) {
  error =
      "ros2: this build is without Cyclone DDS. Install the packages cyclonedds-dev and cyclonedds-tools, then "
      "configure and build again";
  return nullptr;
}

}  // namespace tiller::sim

#endif

namespace tiller::sim {

int serve_ros2(Plant& plant, const Ros2Options& ros2, const ServeOptions& options, ServeReport& report) {
  report = ServeReport{};
  const auto link = open_ros2_link(ros2, options.lockstep, report.error);
  return link == nullptr ? 1 : serve(plant, *link, options, report);
}

}  // namespace tiller::sim
