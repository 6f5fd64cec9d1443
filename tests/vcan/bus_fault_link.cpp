#include "bus_fault_link.hpp"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "io/monotonic_clock.hpp"

namespace tiller::faults {
namespace {

constexpr std::uint32_t kBoard = 48;
constexpr int kPatience_ms = 2000;  // before the fault, for a kernel thread of an emulated machine to get its turn

SocketLink* the_link = nullptr;
const char* wrong_now = nullptr;  // with the run that goes on

/// The kernel delivers before a write returns, or, when it has had much to do, by a thread: that one gets its turn.
void let_it_deliver() {
  const timespec moment{0, 100000};
  nanosleep(&moment, nullptr);
}

void sleep_until_us(std::int64_t until_us) {
  const std::int64_t left_us = until_us - monotonic_us();
  if (left_us <= 0) return;
  const timespec pause{left_us / 1000000, (left_us % 1000000) * 1000};
  nanosleep(&pause, nullptr);
}

}  // namespace

const char* plant_interface(Wiring wiring) { return wiring == Wiring::kOneBus ? "vcan0" : "vx0"; }

const char* controller_interface(Wiring wiring) {
  switch (wiring) {
    case Wiring::kPair: return "vx1";
    case Wiring::kOneBus: return "vcan0";
    case Wiring::kGateway: break;
  }
  return "vcan1";
}

// ---- a raw socket ----

bool RawPort::open(const char* interface) {
  fd_ = ::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  const int on = 1;
  (void)setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface));
  return fd_ >= 0 && address.can_ifindex > 0 && bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
}

void RawPort::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

bool RawPort::send(std::uint32_t id, const std::uint8_t* data, std::uint8_t length) {
  can_frame frame{};
  frame.can_id = id;
  frame.can_dlc = length;
  if (length > 0) std::memcpy(frame.data, data, length);
  return ::write(fd_, &frame, sizeof frame) == static_cast<ssize_t>(sizeof frame);
}

bool RawPort::send(const CanFrame& frame) {
  canfd_frame out{};
  out.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0u);
  out.len = frame.length;
  out.flags = frame.fd ? CANFD_BRS : 0;
  std::memcpy(out.data, frame.data, sizeof out.data);
  const std::size_t size = frame.fd ? CANFD_MTU : CAN_MTU;
  return ::write(fd_, &out, size) == static_cast<ssize_t>(size);
}

bool RawPort::receive(CanFrame& frame) {
  canfd_frame in{};
  ssize_t size;
  // an interface that went down is told once, before the frames that are there
  while ((size = ::read(fd_, &in, sizeof in)) >= 0 || errno == ENETDOWN) {
    if (size < 0 || (in.can_id & CAN_RTR_FLAG) != 0) continue;
    frame = CanFrame();
    frame.fd = size == static_cast<ssize_t>(CANFD_MTU);
    frame.extended = (in.can_id & CAN_EFF_FLAG) != 0;
    frame.id = in.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame.length = std::min<std::uint8_t>(in.len, frame.fd ? 64 : 8);
    std::memcpy(frame.data, in.data, frame.length);
    return true;
  }
  return false;
}

// ---- the route ----

SocketLink::SocketLink(const Setup& setup, Device& device, Wiring wiring)
    : plant_(setup, device), tells_torque_(setup.drive == ActuatorKind::odrive) {
  the_link = this;
  SocketCanOptions options;
  options.interface = controller_interface(wiring);
  options.layout = bus_layout(setup);
  OpenError error;
  const bool opened = port_.open(plant_interface(wiring)) && witness_.open(plant_interface(wiring)) &&
                      intruder_.open(plant_interface(wiring)) && neighbour_.open(options.interface) &&
                      socketcan_open(&transport_, options, &error) == tiller_status_ok;
  if (!opened) report("the sockets cannot be opened");
  if (!opened) std::fprintf(stderr, "%s\n", error.text);
  transport_.robot.prepare(true);
  period_us_ = std::llround(1e6 * setup.config.period_s);
}

SocketLink::~SocketLink() {
  kSocketCanTransport.close(&transport_);
  the_link = nullptr;
  wrong_now = nullptr;
}

SocketLink& SocketLink::current() {
  if (the_link == nullptr) std::abort();
  return *the_link;
}

void SocketLink::report(const char* why) {
  if (wrong_now == nullptr) wrong_now = why;
}
const char* SocketLink::wrong() const { return wrong_now; }

bool SocketLink::sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
                       tiller_measurement_t& measurement) {
  drain_plant();
  // a plant does not wait for its bus either
  for (const CanFrame& frame : plant_.frames(genuine)) published_ += port_.send(frame);
  let_it_deliver();
  if (world.hung) return false;  // and does not read
  look(measurement);
  if (status_ == tiller_status_no_new_measurement) {  // a drive has been asked, and answers
    let_it_deliver();
    drain_plant();
    let_it_deliver();
    look(measurement);
  }
  while (status_ == tiller_status_no_new_measurement && fault == nullptr) {
    pollfd wanted = {transport_.socket, POLLIN, 0};
    if (::poll(&wanted, 1, kPatience_ms) <= 0) break;
    look(measurement);
  }
  const bool fresh = status_ == tiller_status_ok;
  missed_ += !fresh;
  if (status_ == tiller_status_no_new_measurement) status_ = tiller_status_ok;
  return fresh;
}

void SocketLink::look(tiller_measurement_t& measurement) {
  status_ = kSocketCanTransport.poll(&transport_, &measurement);
  note(seen_, status_);
}

void SocketLink::send(World&, const Fault*, const tiller_command_t& command) {
  commanded_.push_back({tick_, static_cast<float>(command.value[0])});
  if (commanded_.size() > 256) commanded_.pop_front();
  note(refused_, kSocketCanTransport.send(&transport_, &command));
  let_it_deliver();
  if (!tells_torque_) note_sent();
  drain_plant();
}

/// The controller's interface shows what it was given to send; one that is refused it does not show.
void SocketLink::note_sent() {
  CanFrame frame;
  while (neighbour_.receive(frame))
    if (is_set_point(frame)) sent_.push_back({tick_, frame});
  while (sent_.size() > 256) sent_.pop_front();
}

bool SocketLink::is_set_point(const CanFrame& frame) const {
  for (std::uint32_t i = 0; i < transport_.own_count; ++i)
    if (transport_.own[i].passes(frame)) return true;
  return false;
}

void SocketLink::after_period() {
  const std::int64_t now_us = monotonic_us();
  if (began_us_ != 0) longest_us_ = std::max(longest_us_, now_us - began_us_);
  if (paced_from_us_ >= 0) {
    paced_from_us_ += pace_us_;
    sleep_until_us(paced_from_us_);
    paced_from_us_ = std::max(paced_from_us_, monotonic_us());  // a machine that was held up does not catch up
  }
  drain_plant();
  plant_.watch();
  ++tick_;
  began_us_ = monotonic_us();
}

std::int64_t SocketLink::period_wall_us() const {
  return paced_from_us_ >= 0 ? pace_us_ : std::max(period_us_, longest_us_);
}

void SocketLink::inject_board(const tiller_measurement_t& reading) {
  sim::PlantMeasurement m{reading.stamp_us, reading.sequence, {}};
  m.value.assign(reading.value, reading.value + transport_.robot.layout().channel_count);
  for (const sim::CanFrame& f : sim::sensor_frames(kBoard, m)) (void)inject(f.id, f.data.data(), f.length);
}

void SocketLink::pace(bool on) {
  if (on) pace_us_ = period_wall_us();  // delays are multiples of it: a period must not end sooner later on
  paced_from_us_ = on ? monotonic_us() : -1;
}

void SocketLink::drain_plant() {
  watch_wire();
  CanFrame frame;
  while (port_.receive(frame)) plant_.deliver(frame);
  for (const CanFrame& answer : plant_.answers()) (void)port_.send(answer);
}

void SocketLink::watch_wire() {
  CanFrame frame;
  while (witness_.receive(frame))
    if (judges_wire_ && is_set_point(frame)) judge(frame);
}

void SocketLink::judge(const CanFrame& set_point) {
  if (!tells_torque_) {
    for (auto s = sent_.rbegin(); s != sent_.rend(); ++s)
      if (std::memcmp(s->set_point.data, set_point.data, sizeof set_point.data) == 0) return judge_age(s->tick);
    return report("a set point on the wire that was never sent");
  }
  float torque_Nm;
  std::memcpy(&torque_Nm, set_point.data, sizeof torque_Nm);
  // zero is always in order: a drive that is being enabled is told nothing else
  if (torque_Nm == 0.0f) return;
  for (auto c = commanded_.rbegin(); c != commanded_.rend(); ++c)
    if (c->torque_Nm == torque_Nm) return judge_age(c->tick);
  report("a torque on the wire that was never commanded");
}

void SocketLink::judge_age(int tick) {
  const int age = tick_ - tick;
  if (age > 0 && tick != latest_late_) ++late_, latest_late_ = tick;
  if (age > late_ticks_ || late_ > late_of_ticks_) report("a stale torque on the wire");
}

// ---- what happened ----

tiller_transport_counters_t SocketLink::counters() const {
  tiller_transport_counters_t c{};
  kSocketCanTransport.counters(&transport_, &c);
  return c;
}

void SocketLink::note(std::uint64_t (&bits)[4], tiller_status_t status) {
  const auto code = static_cast<std::uint32_t>(status);
  if (code < 256) bits[code / 64] |= std::uint64_t{1} << code % 64;
}

bool SocketLink::seen(tiller_status_t status) const {
  const auto code = static_cast<std::uint32_t>(status);
  return code < 256 && (seen_[code / 64] >> code % 64 & 1u) != 0;
}

bool SocketLink::refused(tiller_status_t status) const {
  const auto code = static_cast<std::uint32_t>(status);
  return code < 256 && (refused_[code / 64] >> code % 64 & 1u) != 0;
}

}  // namespace tiller::faults
