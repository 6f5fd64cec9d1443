#include "harness/faults/soak.hpp"

#include <link.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <new>

#include "harness/faults/soak_events.hpp"
#include "io/memory_transport.hpp"
#include "tiller/config.hpp"

namespace tiller::faults {
namespace {

constexpr double kPi = 3.14159265358979323846, kPeriod_s = 0.01;

struct AlignedFree {
  void operator()(void* p) const { ::operator delete (p, std::align_val_t{TILLER_ALIGNMENT}); }
};

tiller::Config upright(const SoakCase& soak) {
  Setup s = setup_of(Robot::kPendulum, 1);
  tiller::Config& c = s.config;
  c.period_s = kPeriod_s;
  c.initial_state[0] = kPi;
  c.posterior.particles = 16;
  c.posterior.moves_per_tick = soak.moves;
  c.planner.kind = tiller_planner_mppi;
  c.planner.horizon = 20;
  c.planner.knots = 5;
  c.planner.rollouts = 32;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  c.cost.terminal = tiller_terminal_lqr;
  c.record_ticks = 16;
  c.posterior.disturbance = soak.eventful ? 1 : 0;
  c.posterior.relearn = soak.eventful && soak.moves > 0 ? 1 : 0;
  return c;
}

struct Resident {
  std::int64_t all = 0, of_files = 0;  // bytes; the rest is the process's own: heap, stacks, written data
};

Resident resident() {
  char text[256] = {};
  std::FILE* file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr) return {};
  const char* read = std::fgets(text, sizeof text, file);
  std::fclose(file);
  if (read == nullptr) return {};
  char* at = text;
  (void)std::strtoll(at, &at, 10);  // of the address space
  const std::int64_t all = std::strtoll(at, &at, 10), of_files = std::strtoll(at, &at, 10);
  const std::int64_t page = sysconf(_SC_PAGESIZE);
  return {all * page, of_files * page};
}

/// Reads a byte of every page of the program and its libraries. The kernel maps a file's pages when they are first
/// touched, 16 around each (fault_around_bytes), so a branch that runs for the first time after hours would be counted
/// as 64 KiB of growth; a robot that calls mlockall has them all from the start. Between the variables as well, which
/// AddressSanitizer takes for a mistake elsewhere.
__attribute__((no_sanitize_address)) int touch_segments(dl_phdr_info* object, std::size_t, void* sum) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (int i = 0; i < object->dlpi_phnum; ++i) {
    const ElfW(Phdr)& segment = object->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_R) == 0) continue;
    const auto* bytes = reinterpret_cast<const volatile unsigned char*>(object->dlpi_addr + segment.p_vaddr);
    for (std::size_t at = 0; at < segment.p_filesz; at += page) *static_cast<unsigned*>(sum) += bytes[at];
  }
  return 0;
}
void touch_program() {
  unsigned sum = 0;
  dl_iterate_phdr(touch_segments, &sum);
}
std::int64_t heap_bytes() { return static_cast<std::int64_t>(mallinfo2().uordblks); }

/// FNV-1a.
void hash_bits(std::uint64_t& hash, double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  for (int i = 0; i < 8; ++i) hash = (hash ^ (bits >> (8 * i) & 0xff)) * 1099511628211ull;
}

class Soak {
 public:
  explicit Soak(const SoakCase& soak) : soak_(soak), config_(upright(soak)), random_(11) {
    const std::size_t size = tiller_size(&config_);
    block_.reset(::operator new (size, std::align_val_t{TILLER_ALIGNMENT}));
    if (tiller_init(&controller_, &config_, nullptr, block_.get(), size) != tiller_status_ok ||
        tiller_arm(controller_) != tiller_status_ok) {
      const char* field = "";
      (void)tiller_config_check(&config_, &field);
      std::fprintf(stderr, "soak: the controller does not start: %s\n", field);
      std::exit(1);
    }
    out_.hash = 14695981039346656037ull;
    if (soak.eventful) events_ = std::make_unique<SoakEvents>(controller_, config_, bob_, out_);
  }

  SoakOutcome go() {
    std::int64_t heap = 0;
    Resident before;
    for (std::uint64_t k = 0; k < soak_.ticks; ++k) {
      if (k == std::min<std::uint64_t>(1000, soak_.ticks / 2)) {
        touch_program();
        before = resident();
        heap = heap_bytes();  // after the other, whose file leaves a buffer in the allocator's cache
      }
      one(k);
      if (soak_.progress && (k + 1) % std::max<std::uint64_t>(1, soak_.ticks / 20) == 0)
        std::fprintf(stderr, "%.3g of %.3g ticks, %.0f unsafe\n", static_cast<double>(k + 1),
                     static_cast<double>(soak_.ticks), static_cast<double>(out_.unsafe));
    }
    const Resident after = resident();
    out_.resident_growth_bytes = after.all - before.all;
    out_.own_growth_bytes = out_.resident_growth_bytes - (after.of_files - before.of_files);
    out_.heap_growth_bytes = heap_bytes() - heap;
    return out_;
  }

 private:
  void one(std::uint64_t k) {
    Reading reading;
    reading.now_us = reading.stamp_us =
        soak_.first_stamp_us + static_cast<std::int64_t>(k) * std::llround(kPeriod_s * 1e6);
    reading.angle_rad = bob_.x[0] + 0.002 * noise();
    if (events_) events_->disturb(reading, state_);
    tiller_measurement_t m{}, read{};
    m.stamp_us = reading.stamp_us;
    m.sequence = soak_.first_sequence + static_cast<std::uint32_t>(k);
    m.value[0] = reading.angle_rad;
    if (reading.sent) (void)memory_put_measurement(&transport_, m);
    const bool fresh = kMemoryTransport.poll(&transport_, &read) == tiller_status_ok;
    tiller_command_t command{}, taken{};
    const tiller_status_t status = tiller_tick(controller_, reading.now_us, fresh ? &read : nullptr, &command);
    (void)kMemoryTransport.send(&transport_, &command);
    if (!memory_take_command(&transport_, taken) || (!events_ && taken.sequence != m.sequence)) ++out_.unanswered;
    judge(k, status, taken);
    for (int i = 0; i < 5; ++i) bob_.step(taken.value[0], kPeriod_s / 5);
  }

  void judge(std::uint64_t k, tiller_status_t status, const tiller_command_t& command) {
    ++out_.ticks;
    hash_bits(out_.hash, command.value[0]);
    if (events_) events_->judge(command);
    state_ = command.state;
    if (status >= 1 && status < 200) {
      ++out_.faults;
      if (out_.first_fault == tiller_status_ok) out_.first_fault = status;
    }
    if (command.state != tiller_state_active) ++out_.not_active;
    if (k > 100) out_.worst_angle_rad = std::max(out_.worst_angle_rad, std::fabs(bob_.x[0] - kPi));
  }

  /// Near enough to normal for a sensor: a sum of four uniforms.
  double noise() {
    double sum = 0.0;
    for (int i = 0; i < 4; ++i) sum += random_.uniform(-1.0, 1.0);
    return sum * 0.8660254037844386;
  }

  SoakCase soak_;
  tiller::Config config_;
  Random random_;
  Bob bob_;
  MemoryTransport transport_;
  std::unique_ptr<void, AlignedFree> block_;
  tiller_t* controller_ = nullptr;
  SoakOutcome out_;
  std::unique_ptr<SoakEvents> events_;  // null: nothing happens
  std::uint32_t state_ = tiller_state_init;
};

}  // namespace

SoakOutcome run_soak(const SoakCase& soak) { return std::make_unique<Soak>(soak)->go(); }

}  // namespace tiller::faults
