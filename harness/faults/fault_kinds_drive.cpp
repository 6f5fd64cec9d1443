// Faults of drives that speak other protocols than ODrive's (fault_kinds_bus.cpp has those): moteus, Damiao's and the
// plain dialect of MIT. They answer frames, so what they tell is the answer to the last command.

#include <algorithm>
#include <cstring>
#include <limits>

#include "harness/faults/fault.hpp"

namespace tiller::faults {
namespace {

constexpr const char* kGroup = "drives";
constexpr std::uint32_t kMotor = 1, kBoard = 48;

void with_moteus(Setup& s) { s.drive = ActuatorKind::moteus; }
void with_mit(Setup& s) { s.drive = ActuatorKind::mit; }
void with_plain_mit(Setup& s) {
  s.drive = ActuatorKind::mit;
  s.mit_reply = MitReply::plain;
}

/// An answer of the drive: moteus puts its node into the identifier's high byte, MIT drives answer under 0.
bool from_drive(const CanFrame& f) { return f.id >> 5 != kBoard; }
/// A set point, a stop or a question: not the status for the board.
bool to_drive(const CanFrame& f) { return f.id >> 5 != kBoard; }

/// The mode in an answer becomes "off". A moteus answers with the mode in its third byte.
void say_off(CanFrame& answer, ActuatorKind kind) {
  if (kind == ActuatorKind::moteus)
    answer.data[2] = 0;
  else
    answer.data[0] = kMotor;
}

template <class Wanted>
void drop(std::vector<CanFrame>& frames, const Wanted& wanted) {
  frames.erase(std::remove_if(frames.begin(), frames.end(), wanted), frames.end());
}

/// The same fault of both drives that tell how they are.
struct Both {
  const char *moteus, *mit;
};
template <class Change>
void both(std::vector<Fault>& list, Both names, const char* what_moteus, const char* what_mit, End end, Timeout timeout,
          const char* answer, const Change& change) {
  list.push_back({names.moteus, kGroup, what_moteus, Route::kBus, end, timeout, answer});
  list.back().prepare = with_moteus;
  change(list.back());
  list.push_back({names.mit, kGroup, what_mit, Route::kBus, end, timeout, answer});
  list.back().prepare = with_mit;
  change(list.back());
}

void troubles(std::vector<Fault>& list) {
  both(list, {"drive_error_moteus", "drive_error_mit"}, "moteus: the gate driver fails, the drive stops",
       "MIT (Damiao): over-current, the drive stops", End::kStops, Timeout::kNow,
       "`actuator_fault` with the drive's text, SAFE; its code stays", [](Fault& f) {
         f.step = [](World& w) {
           if (w.ticks == 0) w.drive = DriveTrouble::kFails;
         };
       });
  both(list, {"drive_stopped_moteus", "drive_stopped_mit"}, "moteus: another program stops the drive",
       "MIT (Damiao): another program stops the drive", End::kStops, Timeout::kNow,
       "not enabled, and not by us: `actuator_fault`, SAFE", [](Fault& f) {
         f.step = [](World& w) {
           if (w.ticks == 0) w.drive = DriveTrouble::kStoppedByAnother;
         };
       });
  both(list, {"drive_watchdog_moteus", "drive_watchdog_mit"}, "moteus: commands are lost until its watchdog expires",
       "MIT (Damiao): commands are lost until its watchdog expires", End::kStops, Timeout::kWatchdog,
       "the drive releases its motor and latches: `actuator_fault`, SAFE", [](Fault& f) {
         f.commands = [](World& w, std::vector<CanFrame>& frames) {
           if (w.ticks < 8) frames.clear();
         };
       });
  both(list, {"drive_restarts_moteus", "drive_restarts_mit"}, "moteus: its supply breaks down for a moment",
       "MIT (Damiao): its supply breaks down for a moment", End::kBounded, Timeout::kSensor,
       "moteus: every command has the mode, it continues; Damiao reports that it is off: SAFE", [](Fault& f) {
         f.step = [](World& w) {
           if (w.ticks == 0) w.drive = DriveTrouble::kRestarts;
         };
       });
}

void answers_missing(std::vector<Fault>& list) {
  both(list, {"drive_silent_moteus", "drive_silent_mit"}, "moteus: its answers are lost", "MIT: its answers are lost",
       End::kStops, Timeout::kHeartbeat, "`actuator_fault`, SAFE",
       [](Fault& f) { f.frames = [](World&, std::vector<CanFrame>& frames) { drop(frames, from_drive); }; });
  both(list, {"drive_cut_moteus", "drive_cut_mit"}, "moteus: its answers are cut off", "MIT: its answers are cut off",
       End::kStops, Timeout::kHeartbeat, "refused: it counts as silent, SAFE", [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           const std::uint32_t whole = w.setup.drive == ActuatorKind::moteus ? 3 : 6;
           for (CanFrame& frame : frames)
             if (from_drive(frame)) frame.length = static_cast<std::uint8_t>(w.random.below(whole));
         };
       });
  both(list, {"drive_wrong_id_moteus", "drive_wrong_id_mit"}, "moteus: it answers under another node",
       "MIT: it answers under another node", End::kStops, Timeout::kHeartbeat, "not heard: it counts as silent, SAFE",
       [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           for (CanFrame& frame : frames) {
             if (!from_drive(frame)) continue;
             const std::uint32_t node = 2 + w.random.below(12);
             if (w.setup.drive == ActuatorKind::moteus)
               frame.id = node << 8;
             else
               frame.data[0] = static_cast<std::uint8_t>((frame.data[0] & 0xf0u) | node);
           }
         };
       });
}

void answers_wrong(std::vector<Fault>& list) {
  both(list, {"drive_doubled_moteus", "drive_doubled_mit"}, "moteus: a second drive of the same node, off, answers too",
       "MIT (Damiao): a second drive of the same node, off, answers too", End::kStops, Timeout::kNow,
       "its answer contradicts: `actuator_fault`, SAFE", [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           std::vector<CanFrame> all;
           for (const CanFrame& frame : frames) {
             all.push_back(frame);
             if (!from_drive(frame)) continue;
             all.push_back(frame);
             say_off(all.back(), w.setup.drive);
           }
           frames = all;
         };
       });
  both(list, {"drive_bits_flip_moteus", "drive_bits_flip_mit"}, "moteus: a bit of every twentieth answer flips",
       "MIT (Damiao): a bit of every twentieth answer flips", End::kBounded, Timeout::kSensor,
       "what is refused is not used; `actuator_fault`, SAFE where the bit says so", [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           for (CanFrame& frame : frames) {
             if (!from_drive(frame) || !w.random.chance(0.05)) continue;
             const std::uint32_t bit = w.random.below(8u * frame.length);
             frame.data[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
           }
         };
       });
  both(list, {"drive_answers_late_moteus", "drive_answers_late_mit"}, "moteus: every answer comes a tick later",
       "MIT: every answer comes a tick later", End::kRides, Timeout::kSensor, "the board measures; the drive is alive",
       [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           std::vector<CanFrame> now(w.held.begin(), w.held.end());
           w.held.clear();
           for (const CanFrame& frame : frames) {
             if (from_drive(frame))
               w.held.push_back(frame);
             else
               now.push_back(frame);
           }
           frames = now;
         };
       });
}

void positions_missing(std::vector<Fault>& list) {
  list.push_back({"encoder_nan_moteus", kGroup, "moteus: the position that it measures is NaN", Route::kBus,
                  End::kStops, Timeout::kSensor, "no measurement is complete: `sensor_stale`, SAFE"});
  list.back().prepare = [](Setup& s) {
    with_moteus(s);
    s.motor_encoder = true;
  };
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (CanFrame& frame : frames)
      if (from_drive(frame)) std::memcpy(frame.data + 5, &nan, sizeof nan);  // behind the mode, and f32 from 0x001
  };
}

void commands(std::vector<Fault>& list) {
  both(list, {"drive_unheard_moteus", "drive_unheard_mit"},
       "moteus: no command reaches it, the status reaches the board",
       "MIT: no command reaches it, the status reaches the board", End::kStops, Timeout::kWatchdog,
       "the drive's watchdog; it counts as silent, SAFE",
       [](Fault& f) { f.commands = [](World&, std::vector<CanFrame>& frames) { drop(frames, to_drive); }; });
  both(list, {"send_queue_full_moteus", "send_queue_full_mit"}, "moteus: ENOBUFS, no frame can be sent",
       "MIT: ENOBUFS, no frame can be sent", End::kStops, Timeout::kWatchdog,
       "dropped and counted; the drive's watchdog; it counts as silent, SAFE",
       [](Fault& f) { f.commands = [](World&, std::vector<CanFrame>& frames) { frames.clear(); }; });
  both(list, {"some_lost_moteus", "some_lost_mit"}, "moteus: a tenth of all frames is lost both ways",
       "MIT (Damiao): a tenth of all frames is lost both ways", End::kBounded, Timeout::kSensor,
       "an incomplete measurement is dropped; the next command brings the set point", [](Fault& f) {
         f.frames = [](World& w, std::vector<CanFrame>& frames) {
           drop(frames, [&](const CanFrame&) { return w.random.chance(0.1); });
         };
         f.commands = f.frames;
       });
  both(list, {"hangs_behind_live_thread_moteus", "hangs_behind_live_thread_mit"},
       "moteus: a tick does not end, a thread answers every measurement",
       "MIT: a tick does not end, a thread answers every measurement", End::kStops, Timeout::kPlanWatch,
       "the plan's number stands still: the device stops",
       [](Fault& f) { f.step = [](World& w) { w.hung = w.repeater = w.repeater_answers = true; }; });
  both(list, {"bus_off_moteus", "bus_off_mit"}, "moteus: the controller's interface goes bus-off",
       "MIT: the controller's interface goes bus-off", End::kStops, Timeout::kWatchdog,
       "`bus_off`, SAFE; nothing passes: the drive's watchdog", [](Fault& f) {
         f.step = [](World& w) {
           w.transport = tiller_status_bus_off;
           w.cut = true;
         };
       });
}

// Those tell neither faults nor whether they are enabled.
void plain(std::vector<Fault>& list) {
  list.push_back({"drive_watchdog_mit_plain", kGroup, "MIT (plain): commands are lost for 0.3 s", Route::kBus,
                  End::kStops, Timeout::kWatchdog, "the motor is free; it counts as silent: `actuator_fault`, SAFE"});
  list.back().prepare = with_plain_mit;
  list.back().commands = [](World& w, std::vector<CanFrame>& frames) {
    if (w.ticks < 15) frames.clear();
  };
  list.push_back({"drive_silent_mit_plain", kGroup, "MIT (plain): its answers are lost", Route::kBus, End::kStops,
                  Timeout::kHeartbeat, "`actuator_fault`, SAFE"});
  list.back().prepare = with_plain_mit;
  list.back().frames = [](World&, std::vector<CanFrame>& frames) { drop(frames, from_drive); };
  list.push_back({"drive_restarts_mit_plain", kGroup, "MIT (plain): its supply breaks down for a moment", Route::kBus,
                  End::kBounded, Timeout::kSensor,
                  "without force from then on; only the motion shows it (`model_inadequate`)"});
  list.back().prepare = with_plain_mit;
  list.back().step = [](World& w) {
    if (w.ticks == 0) w.drive = DriveTrouble::kRestarts;
  };
}

}  // namespace

std::vector<Fault> drive_faults() {
  std::vector<Fault> list;
  troubles(list);
  answers_missing(list);
  answers_wrong(list);
  positions_missing(list);
  commands(list);
  plain(list);
  return list;
}

}  // namespace tiller::faults
