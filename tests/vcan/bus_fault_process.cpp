#include "bus_fault_process.hpp"

#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <ctime>
#include <new>

#include "bus_fault_wires.hpp"
#include "io/monotonic_clock.hpp"

namespace tiller::faults {
namespace {

constexpr std::uint32_t kTorque = 1u << 5 | 0x0eu, kStatus = 48u << 5 | 1u;
constexpr std::int64_t kEpoch_us = 1000000;
constexpr int kPatience_ms = 20000;  // for an emulated machine that others slow down
constexpr std::int64_t kNoReading_us = 200000;

Setup process_setup(Robot robot, std::uint64_t seed) {
  Setup setup = setup_of(robot, seed);
  shrink(setup);
  // on the wall clock here: an emulated machine that is held up for a while must not look like a fault
  setup.config.safety.sensor_timeout_s = 1.0;
  return setup;
}

void sleep_us(std::int64_t left_us) {
  if (left_us <= 0) return;
  const timespec pause{left_us / 1000000, (left_us % 1000000) * 1000};
  nanosleep(&pause, nullptr);
}

// ---- the controller's process ----

/// As a program that steers a robot goes: stamps on arrival, ticks on measurements. Ends half a second of ticks after
/// SAFE, with what led to it.
int control(const Setup& setup) {
  SocketCanTransport transport;
  SocketCanOptions options;
  options.interface = controller_interface(Wiring::kPair);
  options.layout = bus_layout(setup);
  options.layout.stamp_on_arrival = true;
  OpenError error;
  if (socketcan_open(&transport, options, &error) != tiller_status_ok) return 1;
  const std::size_t size = tiller_size(&setup.config);
  void* block = ::operator new (size, std::align_val_t{TILLER_ALIGNMENT});
  tiller_t* controller = nullptr;
  if (tiller_init(&controller, &setup.config, nullptr, block, size) != tiller_status_ok) return 1;
  transport.robot.prepare(true);
  bool armed = false;
  tiller_command_t command{};
  std::int64_t last_us = monotonic_us();
  for (int safe = 0; safe < 25;) {
    pollfd wanted = {transport.socket, POLLIN, 0};
    (void)::poll(&wanted, 1, static_cast<int>(kNoReading_us / 1000));
    tiller_measurement_t m{};
    const tiller_status_t status = kSocketCanTransport.poll(&transport, &m);
    const bool fresh = status == tiller_status_ok;
    if (status == tiller_status_no_new_measurement && monotonic_us() - last_us < kNoReading_us) continue;
    last_us = monotonic_us();
    if (!fresh && status != tiller_status_no_new_measurement && command.state != tiller_state_safe)
      (void)tiller_stop(controller, status);
    if (!armed && transport.robot.is_ready()) armed = tiller_arm(controller) == tiller_status_ok;
    (void)tiller_tick(controller, last_us, fresh ? &m : nullptr, &command);
    (void)kSocketCanTransport.send(&transport, &command);
    safe = command.state == tiller_state_safe ? safe + 1 : 0;
    if (status != tiller_status_ok && status != tiller_status_no_new_measurement) sleep_us(20000);
  }
  tiller_info_t info;
  tiller_get_info(controller, &info);
  return info.first_fault;
}

class Process {
 public:
  explicit Process(const Setup& setup) : id_(fork()) {
    if (id_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    _exit(control(setup));
  }
  ~Process() { end(); }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  void signal(int number) const { (void)kill(id_, number); }
  void end() {
    if (id_ <= 0) return;
    signal(SIGKILL);
    (void)waitpid(id_, nullptr, 0);
    id_ = -1;
  }
  /// What it has ended with; -1 while it runs.
  int code() {
    int status = 0;
    if (waitpid(id_, &status, WNOHANG) != id_) return -1;
    id_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 0;
  }

 private:
  pid_t id_;
};

// ---- the plant ----

class Run {
 public:
  Run(const ProcessFault& fault, Robot robot, std::uint64_t seed)
      : fault_(fault), setup_(process_setup(robot, seed)), random_(seed * 7919 + 17) {
    period_us_ = std::llround(setup_.config.period_s * 1e6);
  }

  Outcome go() {
    if (!begin()) return outcome_;
    Process first(setup_);
    const auto onset = static_cast<int>(25 + random_.below(50));
    for (int k = 0; k < 400 && (k < onset || !drives()); ++k) period(true);
    if (!drives()) wrong("it was not in motion before the fault");
    publish();  // the fault comes between this reading and its answer, or the next reading
    sleep_us(random_.below(static_cast<std::uint32_t>(period_us_)));
    const std::int64_t limit_us = std::llround(1e6 * setup_.plant.watchdog_timeout_s) + 2 * period_us_;
    begin_us_ = plant_->time_us();
    if (fault_.stopped_s > 0)
      stop_and_go_on(first, limit_us);
    else
      kill_it(first, limit_us);
    outcome_.stopped_s = drives() ? -1.0 : 1e-6 * static_cast<double>(last_force_us_);
    return outcome_;
  }

 private:
  void kill_it(Process& first, std::int64_t limit_us) {
    first.end();
    torques_ = 0;
    for (int k = 0; k < 50; ++k) judged_period(limit_us);
    if (!fault_.anew) return;
    Process second(setup_);
    expect_safe(second, limit_us);
  }

  void stop_and_go_on(Process& first, std::int64_t limit_us) {
    first.signal(SIGSTOP);
    const auto periods = static_cast<int>(std::lround(fault_.stopped_s / setup_.config.period_s));
    for (int k = 0; k < periods; ++k) judged_period(limit_us);
    torques_ = 0;
    first.signal(SIGCONT);
    expect_safe(first, limit_us);
    // the one that it held in its hands when it was stopped
    if (torques_ > 1) wrong("more than one torque after it went on");
  }

  void expect_safe(Process& process, std::int64_t limit_us) {
    const std::int64_t until_us = monotonic_us() + 1000 * kPatience_ms;
    int code = -1;
    while ((code = process.code()) < 0 && monotonic_us() < until_us) judged_period(limit_us);
    outcome_.status = static_cast<tiller_status_t>(code);
    outcome_.state = tiller_state_safe;
    if (code < 0) wrong("it did not end in SAFE");
    const bool known = code == tiller_status_sensor_stale || code == tiller_status_actuator_fault;
    if (code >= 0 && !known) wrong("it ended for another reason");
  }

  bool begin() {
    restore_wires();
    std::string error;
    plant_ = sim::Plant::make(setup_.plant, error);
    if (plant_ && port_.open("vx0") && witness_.open("vx0")) {
      device_ = std::make_unique<Device>(*plant_, setup_.plan_timeout_s);
      bus_ = std::make_unique<BusPlant>(*device_);
      return true;
    }
    wrong("the plant or its sockets cannot be made");
    return false;
  }

  void wrong(const char* why) {
    if (outcome_.wrong != nullptr) return;
    outcome_.wrong = why;
    outcome_.wrong_s = 1e-6 * static_cast<double>(plant_ ? plant_->time_us() - begin_us_ : 0);
  }

  bool drives() const {
    double force[TILLER_MAX_INPUTS] = {};
    plant_->motor(force);
    return force[0] != setup_.config.safety.safe_command[0];
  }

  void publish() {
    tiller_measurement_t m{};
    m.stamp_us = kEpoch_us + plant_->measured_us();
    m.sequence = ++sequence_;
    plant_->measure(m.value);
    for (const CanFrame& f : bus_->frames(m)) (void)port_.send(f.id, f.data, f.length);
  }

  /// True when the controller's status is among what came.
  bool deliver() {
    CanFrame frame;
    bool answered = false;
    while (port_.receive(frame)) {
      answered = answered || frame.id == kStatus;
      bus_->deliver(frame);
    }
    while (witness_.receive(frame)) {
      float torque_Nm = 0.0f;
      if (frame.id == kTorque) std::memcpy(&torque_Nm, frame.data, sizeof torque_Nm);
      torques_ += torque_Nm != 0.0f;
    }
    return answered;
  }

  /// At the pace of the wall clock, or as slowly as the controller answers.
  void period(bool waits) {
    const std::int64_t begin_us = monotonic_us();
    publish();
    while (waits && !deliver() && monotonic_us() - begin_us < 1000 * kPatience_ms) sleep_us(500);
    sleep_us(begin_us + period_us_ - monotonic_us());
    (void)deliver();
    plant_->advance(setup_.config.period_s);
    bus_->watch();
  }

  void judged_period(std::int64_t limit_us) {
    period(false);
    const std::int64_t since_us = plant_->time_us() - begin_us_;
    if (!drives()) return;
    last_force_us_ = since_us;
    if (since_us > limit_us) wrong("the motor was still driven after the timeout");
  }

  const ProcessFault& fault_;
  Setup setup_;
  Random random_;
  Outcome outcome_;
  std::unique_ptr<sim::Plant> plant_;
  std::unique_ptr<Device> device_;
  std::unique_ptr<BusPlant> bus_;
  RawPort port_, witness_;
  std::uint32_t sequence_ = 0;
  std::int64_t period_us_ = 0, begin_us_ = 0, last_force_us_ = 0;
  int torques_ = 0;  // that would move the motor, seen on the wire
};

}  // namespace

const std::vector<ProcessFault>& process_faults() {
  static const std::vector<ProcessFault> all = {
      {"process_killed", "SIGKILL to the controller's process", "the device's watchdog", 0.0, false},
      {"process_killed_and_anew", "SIGKILL, and a new process a second later",
       "the device's watchdog; the drive's error stands: `actuator_fault`, SAFE", 0.0, true},
      {"process_stopped_briefly", "SIGSTOP for 0.3 s, then SIGCONT",
       "the device's watchdog; `actuator_fault`, SAFE; one old torque at most, to a drive that has disarmed", 0.3,
       false},
      {"process_stopped", "SIGSTOP for 1.5 s, longer than the sensors' timeout",
       "the device's watchdog; what waits in the socket is as old as it is: SAFE", 1.5, false}};
  return all;
}

Outcome run_process_fault(const ProcessFault& fault, Robot robot, std::uint64_t seed) {
  return Run(fault, robot, seed).go();
}

Fault row_of(const ProcessFault& fault) {
  Fault row{fault.name, "processes", fault.what, Route::kSocket, End::kStops, Timeout::kWatchdog, fault.answer};
  row.prepare = shrink;
  return row;
}

}  // namespace tiller::faults
