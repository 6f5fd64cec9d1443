#include "ros2/ros2_transport.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "io/monotonic_clock.hpp"
#include "ros2/ros2_wire.hpp"
#include "ros2_messages.h"

namespace tiller {
namespace {

using JointState = sensor_msgs_msg_dds__JointState_;
using Imu = sensor_msgs_msg_dds__Imu_;
using Odometry = nav_msgs_msg_dds__Odometry_;
using Efforts = std_msgs_msg_dds__Float64MultiArray_;

constexpr int kMaxHandled = 64;            // of one topic between two ticks: a flood cannot hold one
constexpr std::uint32_t kMaxJoints = 256;  // of one message: more are a mistake, or meant to cost time
constexpr std::int64_t kNsPerS = 1000000000;

Ros2Transport* transport_of(void* self) { return static_cast<Ros2Transport*>(self); }

Ros2Reader& reader_of(Ros2Transport* transport, Ros2Message message) {
  return transport->reader[static_cast<std::size_t>(message)];
}

bool refuse(Ros2Transport* transport, std::uint64_t& counter, const char* why) {
  ++counter;
  transport->refusal = why;
  transport->refused_source = nullptr;
  return false;
}

// ---- stamps ----

/// False: it is no time.
template <class Message>
bool stamp_of(const Message& message, std::int64_t* stamp_ns) {
  const auto& stamp = message.header.stamp;
  *stamp_ns = std::int64_t{stamp.sec} * kNsPerS + stamp.nanosec;
  return stamp.sec >= 0 && stamp.nanosec < kNsPerS;
}

/// Of this machine's system clock, by its monotonic one: as far from now.
std::int64_t to_monotonic_us(std::int64_t stamp_us, std::int64_t now_us) { return now_us - (realtime_us() - stamp_us); }

/// Only newer stamps pass, until nothing has passed for as long as a publisher needs to start again. One that is ahead
/// of the clock passes, for the controller to reject by name, and bars nothing.
bool pass_gate(Ros2Transport* transport, std::int64_t stamp_ns, std::int64_t now_us) {
  const bool lockstep = transport->options.lockstep;
  const bool quiet = !lockstep && now_us - transport->accepted_us >= Ros2Transport::kQuietUs;
  if (stamp_ns <= transport->gate_ns && !quiet) return false;
  transport->accepted_us = now_us;
  const bool own_clock = !lockstep && !transport->options.stamp_on_arrival;
  if (!own_clock || to_monotonic_us(stamp_ns / 1000, now_us) <= now_us) transport->gate_ns = stamp_ns;
  return true;
}

// ---- messages ----

void copy_names(Ros2Transport* transport, const JointState& message) {
  std::size_t at = 0;
  transport->seen[0] = '\0';
  for (std::uint32_t j = 0; j < message.name._length; ++j) {
    const char* name = message.name._buffer[j];
    const std::size_t length = std::strlen(name);
    if (at + length + 3 > Ros2Transport::kSeen) return;
    if (j > 0) at = static_cast<std::size_t>(stpcpy(transport->seen + at, ", ") - transport->seen);
    std::memcpy(transport->seen + at, name, length + 1);
    at += length;
  }
}

bool refuse_source(Ros2Transport* transport, const Ros2Source& source, const JointState& message, const char* why) {
  refuse(transport, transport->counters.bad_messages, why);
  transport->refused_source = &source;
  copy_names(transport, message);
  return false;
}

const double* find_number(const JointState& message, const Ros2Source& source, std::uint32_t joint) {
  const auto& values = source.field == 0 ? message.position : source.field == 1 ? message.velocity : message.effort;
  return joint < values._length ? &values._buffer[joint] : nullptr;
}

bool take_joint(Ros2Transport* transport, const JointState& message, std::uint32_t row, double* value) {
  const Ros2Source& source = transport->options.source[row];
  std::uint32_t joint = 0;
  while (joint < message.name._length && std::strcmp(message.name._buffer[joint], source.joint) != 0) ++joint;
  if (joint == message.name._length) return refuse_source(transport, source, message, "has no joint");
  const double* number = find_number(message, source, joint);
  if (number == nullptr) return refuse_source(transport, source, message, "has no such value of the joint");
  value[row] = *number;
  return true;
}

bool take_numbers(Ros2Transport* transport, const JointState& message) {
  if (message.name._length > kMaxJoints)
    return refuse(transport, transport->counters.bad_messages, "a JointState has more than 256 joints");
  const Ros2Options& options = transport->options;
  double value[TILLER_MAX_MEASUREMENTS] = {};
  for (std::uint32_t row = 0; row < options.measurement_count; ++row)
    if (options.source[row].message == Ros2Message::kJointState && !take_joint(transport, message, row, value))
      return false;
  std::memcpy(transport->joint_value, value, sizeof value);
  return true;
}

void take_angles(double* quaternion, double* angles) {
  double of[3];
  ros2_angles({quaternion[0], quaternion[1], quaternion[2], quaternion[3]}, of);
  std::memcpy(angles, of, sizeof of);
}

bool take_numbers(Ros2Transport* transport, const Imu& message) {
  double* to = reader_of(transport, Ros2Message::kImu).number;
  const auto& q = message.orientation;
  const auto &w = message.angular_velocity, &a = message.linear_acceleration;
  const double numbers[] = {q.x, q.y, q.z, q.w, w.x, w.y, w.z, a.x, a.y, a.z};
  std::memcpy(to, numbers, sizeof numbers);
  take_angles(to, to + 10);
  return true;
}

bool take_numbers(Ros2Transport* transport, const Odometry& message) {
  double* to = reader_of(transport, Ros2Message::kOdometry).number;
  const auto& p = message.pose.pose.position;
  const auto& q = message.pose.pose.orientation;
  const auto &l = message.twist.twist.linear, &w = message.twist.twist.angular;
  const double numbers[] = {p.x, p.y, p.z, q.x, q.y, q.z, q.w, l.x, l.y, l.z, w.x, w.y, w.z};
  std::memcpy(to, numbers, sizeof numbers);
  take_angles(to + 3, to + 13);
  return true;
}

// ---- receiving ----

tiller_status_t publish(Ros2Transport* transport, const tiller_command_t& command) {
  auto* message = static_cast<Efforts*>(transport->command);
  for (std::uint32_t i = 0; i < transport->options.input_count; ++i) message->data._buffer[i] = command.value[i];
  const dds_return_t sent = transport->options.lockstep && transport->answered_ns > 0
                                ? dds_write_ts(transport->writer, message, transport->answered_ns)
                                : dds_write(transport->writer, message);
  if (sent == DDS_RETCODE_OK) return tiller_status_ok;
  if (sent != DDS_RETCODE_TIMEOUT) return tiller_status_io_error;
  ++transport->counters.queue_full;
  return tiller_status_queue_full;
}

/// The publisher has not got the answer, or not yet: it may still be on its way, and the publisher takes it once.
void repeat_answer(Ros2Transport* transport) {
  const tiller_command_t* answer = transport->answers.answer();
  if (answer != nullptr && publish(transport, *answer) == tiller_status_ok) ++transport->repeated_answers;
}

double value_of(const Ros2Transport* transport, std::uint32_t row, std::int64_t time_us) {
  const Ros2Source& source = transport->options.source[row];
  const Ros2Reader& reader = transport->reader[static_cast<std::size_t>(source.message)];
  if (!reader.has_numbers || std::llabs(reader.time_us - time_us) > transport->options.together_us)
    return std::numeric_limits<double>::quiet_NaN();
  return source.message == Ros2Message::kJointState ? transport->joint_value[row] : reader.number[source.field];
}

void compose(Ros2Transport* transport, const Ros2Reader& first, std::int64_t now_us) {
  const Ros2Options& options = transport->options;
  tiller_measurement_t& m = transport->newest;
  m = tiller_measurement_t{};
  m.sequence = ++transport->sequence;
  const bool as_it_is = options.lockstep || options.stamp_on_arrival;
  m.stamp_us = as_it_is ? first.time_us : to_monotonic_us(first.time_us, now_us);
  for (std::uint32_t i = 0; i < options.measurement_count; ++i) m.value[i] = value_of(transport, i, first.time_us);
}

/// The numbers of this message are the reader's now.
void note(const Ros2Transport* transport, Ros2Reader& reader, std::int64_t stamp_ns) {
  reader.has_numbers = true;
  reader.time_us =
      transport->options.stamp_on_arrival ? reader.arrived_us.load(std::memory_order_relaxed) : stamp_ns / 1000;
}

/// Of the message that makes a measurement.
template <class Message>
bool take_first(Ros2Transport* transport, Ros2Reader& reader, const Message& message, std::int64_t stamp_ns) {
  const Ros2Options& options = transport->options;
  tiller_transport_counters_t& counters = transport->counters;
  const std::int64_t now_us = monotonic_us();
  if (stamp_ns == 0 && !options.stamp_on_arrival)
    return refuse(transport, counters.bad_messages, "header.stamp is zero; set stamp_on_arrival = true");
  const bool waited_long = now_us - reader.arrived_us.load(std::memory_order_relaxed) > options.max_wait_us;
  if (!options.lockstep && options.max_wait_us > 0 && waited_long)
    return refuse(transport, counters.dropped_old, "a message waited too long before it was read");
  const std::int64_t stamp_us = stamp_ns / 1000;
  if (options.lockstep && transport->answers.is_repeated(transport->sequence, stamp_us)) {
    repeat_answer(transport);
    return false;
  }
  if (!take_numbers(transport, message)) return false;
  if (stamp_ns != 0 && !pass_gate(transport, stamp_ns, now_us))
    return refuse(transport, counters.dropped_old, "a header.stamp is not newer than the last one");
  note(transport, reader, stamp_ns);
  if (transport->has_new) ++counters.dropped_old;
  compose(transport, reader, now_us);
  if (options.lockstep) {
    transport->answers.ask(transport->sequence, stamp_us);
    transport->answered_ns = stamp_ns;
  }
  transport->has_new = true;
  ++counters.received;
  return true;
}

template <class Message>
void take(Ros2Transport* transport, Ros2Reader& reader, bool first) {
  const auto& message = *static_cast<const Message*>(reader.sample);
  std::int64_t stamp_ns;
  if (!stamp_of(message, &stamp_ns)) {
    refuse(transport, transport->counters.bad_messages, "a header.stamp is no time");
  } else if (first) {
    take_first(transport, reader, message, stamp_ns);
  } else if (take_numbers(transport, message)) {
    note(transport, reader, stamp_ns);
  }
}

template <class Message>
bool drain(Ros2Transport* transport, Ros2Message which, bool first) {
  Ros2Reader& reader = reader_of(transport, which);
  if (reader.entity == 0) return true;
  for (int handled = 0; handled < kMaxHandled; ++handled) {
    dds_sample_info_t info;
    const dds_return_t count = dds_take(reader.entity, &reader.sample, &info, 1, 1);
    if (count < 0) return false;
    if (count == 0) break;
    if (info.valid_data) take<Message>(transport, reader, first);
  }
  return true;
}

bool drain(Ros2Transport* transport, Ros2Message which, Ros2Message first) {
  switch (which) {
    case Ros2Message::kJointState: return drain<JointState>(transport, which, which == first);
    case Ros2Message::kImu: return drain<Imu>(transport, which, which == first);
    case Ros2Message::kOdometry: return drain<Odometry>(transport, which, which == first);
  }
  return true;
}

tiller_status_t ros2_poll(void* self, tiller_measurement_t* measurement) {
  Ros2Transport* transport = transport_of(self);
  if (transport->participant <= 0) return tiller_status_transport_closed;
  std::uint64_t arrivals;
  (void)!read(transport->event, &arrivals, sizeof arrivals);
  const Ros2Message first = transport->options.source[0].message;
  bool works = true;
  for (std::uint32_t i = 0; i < kRos2Messages; ++i)
    if (static_cast<Ros2Message>(i) != first) works = drain(transport, static_cast<Ros2Message>(i), first) && works;
  works = drain(transport, first, first) && works;
  if (!works) return tiller_status_io_error;
  if (!transport->has_new) return tiller_status_no_new_measurement;
  transport->has_new = false;
  *measurement = transport->newest;
  return tiller_status_ok;
}

tiller_status_t ros2_send(void* self, const tiller_command_t* command) {
  Ros2Transport* transport = transport_of(self);
  if (transport->participant <= 0) return tiller_status_transport_closed;
  for (std::uint32_t i = 0; i < transport->options.input_count; ++i)
    if (!std::isfinite(command->value[i])) return tiller_status_command_not_finite;
  if (transport->options.lockstep) transport->answers.note(*command);
  const tiller_status_t status = publish(transport, *command);
  if (status == tiller_status_ok) ++transport->counters.sent;
  return status;
}

// ---- the table ----

int ros2_descriptor(void* self) { return transport_of(self)->event; }

void ros2_counters(const void* self, tiller_transport_counters_t* counters) {
  const auto* transport = static_cast<const Ros2Transport*>(self);
  *counters = transport->counters;
  counters->bad_messages += ros2_undecodable() - transport->undecodable;
  for (const Ros2Reader& reader : transport->reader) {
    dds_sample_lost_status_t lost{};
    if (reader.entity > 0 && dds_get_sample_lost_status(reader.entity, &lost) == DDS_RETCODE_OK)
      counters->overflows += lost.total_count;
  }
}

constexpr Ros2Type kReads[] = {Ros2Type::kJointState, Ros2Type::kImu, Ros2Type::kOdometry};

void ros2_close(void* self) {
  Ros2Transport* transport = transport_of(self);
  if (transport->participant > 0) (void)dds_delete(transport->participant);  // its threads write no event from now on
  transport->participant = 0;
  for (std::uint32_t i = 0; i < kRos2Messages; ++i) {
    Ros2Reader& reader = transport->reader[i];
    if (reader.sample != nullptr) dds_sample_free(reader.sample, ros2_type(kReads[i]).descriptor, DDS_FREE_ALL);
    reader.sample = nullptr;
    reader.entity = 0;
  }
  if (transport->command != nullptr)
    dds_sample_free(transport->command, ros2_type(Ros2Type::kEffort).descriptor, DDS_FREE_ALL);
  transport->command = nullptr;
  if (transport->event >= 0) ::close(transport->event);
  transport->event = -1;
}

// ---- opening ----

void on_data(dds_entity_t, void* arg) {
  auto* reader = static_cast<Ros2Reader*>(arg);
  reader->arrived_us.store(monotonic_us(), std::memory_order_relaxed);
  const std::uint64_t one = 1;
  (void)!write(reader->event, &one, sizeof one);
}

tiller_status_t failed(OpenError* error, const char* what, const char* name, dds_return_t why) {
  set_open_error(error, "ros2: %s '%.100s': %s; is CYCLONEDDS_URI right, and is there a network interface?", what, name,
                 dds_strretcode(why));
  return tiller_status_io_error;
}

tiller_status_t name_topic(const char* key, const char* name, char (&topic)[kRos2Topic], OpenError* error) {
  if (ros2_topic(name, topic)) return tiller_status_ok;
  set_open_error(error,
                 "ros2: %s '%.100s' is no name of a topic: parts of letters, digits and _, none of which begins with a "
                 "digit, with / between them",
                 key, name);
  return tiller_status_bad_message;
}

tiller_status_t open_reader(Ros2Transport* transport, std::uint32_t i, const char* key, const char* name,
                            OpenError* error) {
  char topic[kRos2Topic];
  const tiller_status_t status = name_topic(key, name, topic, error);
  if (status != tiller_status_ok) return status;
  Ros2Reader& reader = transport->reader[i];
  reader.event = transport->event;
  reader.sample = dds_alloc(ros2_type(kReads[i]).descriptor->m_size);
  dds_listener_t* listener = dds_create_listener(&reader);
  dds_lset_data_available(listener, on_data);
  const Ros2Qos qos = transport->options.lockstep ? Ros2Qos::kReliable : Ros2Qos::kSensorData;
  const dds_entity_t entity = ros2_reader(transport->participant, kReads[i], topic, qos, listener);
  dds_delete_listener(listener);
  if (entity < 0) return failed(error, "cannot read", topic, entity);
  reader.entity = entity;
  return tiller_status_ok;
}

tiller_status_t open_readers(Ros2Transport* transport, const Ros2Options& options, OpenError* error) {
  const char* const keys[] = {"joint_states", "imu", "odometry"};
  const char* const names[] = {options.joint_states, options.imu, options.odometry};
  for (std::uint32_t i = 0; i < kRos2Messages; ++i) {
    bool used = false;
    for (std::uint32_t row = 0; row < options.measurement_count; ++row)
      used = used || options.source[row].message == static_cast<Ros2Message>(i);
    const tiller_status_t status = used ? open_reader(transport, i, keys[i], names[i], error) : tiller_status_ok;
    if (status != tiller_status_ok) return status;
  }
  return tiller_status_ok;
}

tiller_status_t open_writer(Ros2Transport* transport, const Ros2Options& options, OpenError* error) {
  char topic[kRos2Topic];
  const tiller_status_t status = name_topic("commands", options.commands, topic, error);
  if (status != tiller_status_ok) return status;
  auto* message = static_cast<Efforts*>(dds_alloc(sizeof(Efforts)));
  message->data._buffer = static_cast<double*>(dds_alloc(options.input_count * sizeof(double)));
  message->data._length = message->data._maximum = options.input_count;
  message->data._release = true;
  transport->command = message;
  const dds_entity_t writer = ros2_writer(transport->participant, Ros2Type::kEffort, topic);
  if (writer < 0) return failed(error, "cannot write", topic, writer);
  transport->writer = writer;
  transport->diagnostics = ros2_writer(transport->participant, Ros2Type::kDiagnostics, "rt/diagnostics");
  if (transport->diagnostics < 0) return failed(error, "cannot write", "rt/diagnostics", transport->diagnostics);
  return tiller_status_ok;
}

tiller_status_t announce(const Ros2Transport* transport, const Ros2Options& options, OpenError* error) {
  dds_entity_t readers[kRos2Messages];
  const dds_entity_t writers[] = {transport->writer, transport->diagnostics};
  std::size_t count = 0;
  for (const Ros2Reader& reader : transport->reader)
    if (reader.entity > 0) readers[count++] = reader.entity;
  const dds_return_t told = ros2_announce(transport->participant, {options.node, readers, count, writers, 2});
  return told < 0 ? failed(error, "cannot announce the node", options.node, told) : tiller_status_ok;
}

tiller_status_t open_all(Ros2Transport* transport, const Ros2Options& options, OpenError* error) {
  transport->event = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (transport->event < 0) return tiller_status_io_error;
  const dds_entity_t participant = ros2_participant();
  if (participant < 0) return failed(error, "cannot join the domain", "ROS_DOMAIN_ID", participant);
  transport->participant = participant;
  transport->undecodable = ros2_undecodable();
  const tiller_status_t status = open_readers(transport, options, error);
  if (status != tiller_status_ok) return status;
  const tiller_status_t writes = open_writer(transport, options, error);
  return writes == tiller_status_ok ? announce(transport, options, error) : writes;
}

}  // namespace

const tiller_transport_t kRos2Transport = {sizeof(tiller_transport_t),
                                           TILLER_TRANSPORT_VERSION,
                                           "ros2",
                                           ros2_poll,
                                           ros2_send,
                                           ros2_descriptor,
                                           ros2_counters,
                                           ros2_close};

tiller_status_t ros2_transport_open(Ros2Transport* transport, const Ros2Options& options, OpenError* error) {
  if (transport == nullptr) return tiller_status_null_argument;
  if (options.measurement_count < 1 || options.measurement_count > TILLER_MAX_MEASUREMENTS || options.input_count < 1 ||
      options.input_count > TILLER_MAX_INPUTS) {
    set_open_error(error, "ros2: %u measurements and %u inputs; there may be 1..%d and 1..%d",
                   options.measurement_count, options.input_count, TILLER_MAX_MEASUREMENTS, TILLER_MAX_INPUTS);
    return tiller_status_bad_dimension;
  }
  transport->options = options;
  transport->options.joint_states = transport->options.imu = transport->options.odometry = nullptr;
  transport->options.commands = transport->options.node = nullptr;
  const tiller_status_t status = open_all(transport, options, error);
  if (status != tiller_status_ok) ros2_close(transport);
  return status;
}

tiller_status_t ros2_send_diagnostics(Ros2Transport* transport, const Ros2Diagnostics& diagnostics) {
  if (transport->participant <= 0) return tiller_status_transport_closed;
  // Cyclone's C types have no const: it only reads what is written
  const auto text = [](const char* literal) { return const_cast<char*>(literal); };
  diagnostic_msgs_msg_dds__KeyValue_ values[Ros2Diagnostics::kValues];
  for (std::uint32_t i = 0; i < diagnostics.count; ++i)
    values[i] = {text(diagnostics.value[i].key), text(diagnostics.value[i].text)};
  diagnostic_msgs_msg_dds__DiagnosticStatus_ status{};
  status.level = diagnostics.level;
  status.name = text(diagnostics.name);
  status.message = text(diagnostics.message);
  status.hardware_id = text("");
  status.values._buffer = values;
  status.values._length = diagnostics.count;
  diagnostic_msgs_msg_dds__DiagnosticArray_ message{};
  const std::int64_t now_us = realtime_us();
  message.header.stamp.sec = static_cast<std::int32_t>(now_us / 1000000);
  message.header.stamp.nanosec = static_cast<std::uint32_t>(now_us % 1000000 * 1000);
  message.header.frame_id = text("");
  message.status._buffer = &status;
  message.status._length = 1;
  const dds_return_t sent = dds_write(transport->diagnostics, &message);
  return sent == DDS_RETCODE_OK ? tiller_status_ok : tiller_status_io_error;
}

void ros2_silence(const Ros2Transport* transport, char* text, std::size_t size) {
  if (size == 0) return;
  text[0] = '\0';
  const auto first = static_cast<std::size_t>(transport->options.source[0].message);
  const Ros2Reader& reader = transport->reader[first];
  if (transport->participant <= 0 || reader.arrived_us.load(std::memory_order_relaxed) != 0) return;
  char topic[kRos2Topic];
  if (dds_get_name(dds_get_topic(reader.entity), topic, sizeof topic) < 0) return;
  ros2_explain_silence(transport->participant, reader.entity, kReads[first], topic, text, size);
}

}  // namespace tiller
