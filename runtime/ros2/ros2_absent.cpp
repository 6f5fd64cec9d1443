// The transport and the goals of a build without Cyclone DDS.
#include "ros2/ros2_goal_reader.hpp"
#include "ros2/ros2_transport.hpp"

namespace tiller {
namespace {

tiller_status_t refuse(OpenError* error) {
  set_open_error(error,
                 "ros2: this build is without Cyclone DDS. Install the packages cyclonedds-dev and cyclonedds-tools, "
                 "then configure and build again (cmake -DTILLER_ROS2=ON says if something is still missing)");
  return tiller_status_io_error;
}

tiller_status_t absent_poll(void*, tiller_measurement_t*) { return tiller_status_transport_closed; }
tiller_status_t absent_send(void*, const tiller_command_t*) { return tiller_status_transport_closed; }
int absent_descriptor(void*) { return -1; }
void absent_counters(const void*, tiller_transport_counters_t* counters) { *counters = tiller_transport_counters_t(); }
void absent_close(void*) {}

}  // namespace

const tiller_transport_t kRos2Transport = {
    sizeof(tiller_transport_t), TILLER_TRANSPORT_VERSION, "ros2",      absent_poll, absent_send,
    absent_descriptor,          absent_counters,          absent_close};

tiller_status_t ros2_transport_open(Ros2Transport*, const Ros2Options&, OpenError* error) { return refuse(error); }

tiller_status_t Ros2GoalReader::open(const char*, const char*, const char*, OpenError* error) { return refuse(error); }
void Ros2GoalReader::close() {}
bool Ros2GoalReader::take(Ros2JointGoal*) { return false; }
bool Ros2GoalReader::take(double (&)[kRos2PoseNumbers]) { return false; }

tiller_status_t ros2_send_diagnostics(Ros2Transport*, const Ros2Diagnostics&) { return tiller_status_transport_closed; }

void ros2_silence(const Ros2Transport*, char* text, std::size_t size) {
  if (size > 0) text[0] = '\0';
}

}  // namespace tiller
