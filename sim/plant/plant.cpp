#include "sim/plant/plant.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "sim/effects/effects.hpp"
#include "sim/plant/check.hpp"
#include "sim/plant/motor_line.hpp"
#include "sim/plant/sensor.hpp"

namespace tiller::sim {
namespace {

std::int64_t to_us(double seconds) { return std::llround(seconds * 1e6); }

double or_zero(const std::map<std::string, double>& values, const std::string& name) {
  const auto at = values.find(name);
  return at == values.end() ? 0.0 : at->second;
}

/// An effect and the joint, command or sensor it acts on.
struct PlacedEffect {
  std::unique_ptr<Effect> effect;
  std::size_t port;
  PortKind where;
};

}  // namespace

struct Plant::Impl {
  Impl(const PlantOptions& o, const MechanismInfo& i)
      : options(o),
        info(i),
        measured(measured_states(o, i)),
        parameters(merged_parameters(o, i)),
        lines(i.commands.size(), MotorLine(to_us(o.command_latency_s), to_us(o.watchdog_timeout_s), o.command_limit)),
        process_noise(o.seed, "process." + i.commands[0].name),
        step_us(to_us(o.step_s)),
        state(i.states.size()),
        motor(i.commands.size()),
        dry(i.joints.size(), false),
        limit(i.joints.size()),
        driven(i.joints.size()) {
    for (const std::size_t s : measured) measurements.push_back(info.states[s]);
    for (const Channel& c : measurements) {
      encoders.push_back({or_zero(o.encoder_noise_sd, c.name), or_zero(o.encoder_step, c.name),
                          NoiseStream(o.seed, "encoder." + c.name)});
    }
    for (const HiddenEffect& e : o.effects) place_effect(e);
    std::int64_t latest_us = 0;
    for (std::size_t i = 0; i < measured.size(); ++i) latest_us = std::max(latest_us, late_us(i));
    history.keep(to_us(o.measurement_latency_s) + latest_us);
  }

  void place_effect(const HiddenEffect& e) {
    const EffectInfo& what = *find_effect(e.kind);
    effects.push_back({what.make(e.parameters), static_cast<std::size_t>(find_port(e, options, info)), what.port});
    if (what.port == PortKind::joint && effects.back().effect->is_dry()) dry[effects.back().port] = true;
  }

  /// A new world each time: nothing that ODE keeps inside can leak from one run into the next.
  bool build(std::string& error) {
    mechanism = info.build(parameters);
    for (PlacedEffect& e : effects) {
      if (!e.effect->build(*mechanism, e.port, error)) return false;
      e.effect->reset(options.seed);
    }
    return true;
  }

  /// ODE takes forces at the start of a step, so viscous friction is stable while coefficient * step is
  /// below twice the inertia; a tenth of that keeps its decay honest as well.
  bool friction_is_stable(std::string& error) const {
    for (std::size_t j = 0; j < info.joints.size(); ++j) {
      double coefficient = mechanism->own_damping(j);
      for (const PlacedEffect& e : effects) {
        if (e.where == PortKind::joint && e.port == j) coefficient += e.effect->damping();
      }
      const double most = 0.2 * mechanism->joint(j).least_inertia() / options.step_s;
      if (coefficient <= most) continue;
      std::ostringstream text;
      text << "viscous friction " << coefficient << " at joint " << info.joints[j]
           << " is too stiff for step_s = " << options.step_s << ": at most " << most << "; choose a smaller step_s";
      error = text.str();
      return false;
    }
    return true;
  }

  bool reset(std::string& error) {
    state = info.default_state;
    for (std::size_t i = 0; i < state.size(); ++i) {
      const auto at = options.initial_state.find(info.states[i].name);
      if (at != options.initial_state.end()) state[i] = at->second;
    }
    if (!build(error)) return false;
    mechanism->place(state);
    for (MotorLine& line : lines) line.reset();
    time_us = options.start_us;
    carried_us = 0;
    std::fill(motor.begin(), motor.end(), 0.0);
    dropped = 0;
    history.reset(state);
    return true;
  }

  Moment now(double drive) const { return {time_us, options.step_s, drive}; }

  /// The mean forces that the motors make over the coming step.
  void drive_motors() {
    for (std::size_t i = 0; i < motor.size(); ++i) motor[i] = lines[i].wanted();
    for (PlacedEffect& e : effects) {
      if (e.where == PortKind::command) motor[e.port] = e.effect->drive(motor[e.port], now(motor[e.port]));
    }
    mechanism->drive(motor.data());
    std::fill(driven.begin(), driven.end(), 0.0);
    for (std::size_t i = 0; i < info.motors.size(); ++i) driven[info.motors[i]] = motor[i];
  }

  void push_joints() {
    std::fill(limit.begin(), limit.end(), 0.0);
    for (PlacedEffect& e : effects) {
      if (e.where != PortKind::joint) continue;
      Joint& joint = mechanism->joint(e.port);
      e.effect->push(joint, now(driven[e.port]));
      if (e.effect->is_dry()) limit[e.port] += e.effect->dry_friction(joint, now(driven[e.port]));
    }
    for (std::size_t j = 0; j < limit.size(); ++j) {
      if (dry[j]) mechanism->joint(j).set_dry_friction(limit[j]);
    }
    if (options.process_noise_sd <= 0) return;
    // drawn per millisecond and not per step: a finer physics step feels the same force
    const auto millisecond = static_cast<std::uint64_t>(time_us / 1000);
    mechanism->joint(info.actuated).add_force(options.process_noise_sd * process_noise.normal(millisecond));
  }

  void step() {
    mechanism->begin(options.step_s);
    drive_motors();
    push_joints();
    mechanism->step(options.step_s);
    time_us += step_us;
    for (MotorLine& line : lines) line.deliver(time_us);
    mechanism->read_state(state.data());
    history.push(time_us, state);
  }

  std::int64_t measured_us() const { return time_us - to_us(options.measurement_latency_s); }

  /// How much later than the other sensors sensor i shows the plant.
  std::int64_t late_us(std::size_t i) const {
    double late_s = 0;
    for (const PlacedEffect& e : effects) {
      if (e.where == PortKind::sensor && e.port == i) late_s += e.effect->late_by_s();
    }
    return to_us(late_s);
  }

  /// What the sensors would show without noise.
  void show(std::vector<double>& out) const {
    std::vector<double> seen, late;
    history.at(measured_us(), seen);
    out.resize(measured.size());
    for (std::size_t i = 0; i < out.size(); ++i) {
      const std::int64_t late_by_us = late_us(i);
      if (late_by_us > 0) history.at(measured_us() - late_by_us, late);
      out[i] = (late_by_us > 0 ? late : seen)[measured[i]];
      for (const PlacedEffect& e : effects) {
        if (e.where == PortKind::sensor && e.port == i) out[i] = e.effect->show(out[i]);
      }
    }
  }

  PlantOptions options;
  const MechanismInfo& info;
  std::vector<std::size_t> measured;  // states
  std::map<std::string, double> parameters;
  std::unique_ptr<Mechanism> mechanism;
  std::vector<MotorLine> lines;  // (commands)
  StateHistory history;
  NoiseStream process_noise;
  std::vector<Encoder> encoders;
  std::vector<PlacedEffect> effects;
  std::vector<Channel> measurements;
  std::int64_t step_us;
  std::int64_t time_us = 0;
  std::int64_t carried_us = 0;
  std::vector<double> state;   // (states) at time_us
  std::vector<double> motor;   // (commands)
  std::vector<bool> dry;       // (joints) there is an effect of dry friction
  std::vector<double> limit;   // (joints) its force
  std::vector<double> driven;  // (joints) force of the motor there
  std::uint64_t dropped = 0;
};

Plant::Plant(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Plant::~Plant() = default;

std::unique_ptr<Plant> Plant::make(const PlantOptions& options, std::string& error) {
  const MechanismInfo* info = options.made ? options.made.get() : find_mechanism(options.kind);
  if (info == nullptr) {
    error = "unknown plant '" + options.kind + "'; known:";
    for (const MechanismInfo& known : mechanisms()) error += " " + known.kind;
    return nullptr;
  }
  if (!check_options(options, *info, error)) return nullptr;
  auto impl = std::make_unique<Impl>(options, *info);
  if (!impl->reset(error)) return nullptr;
  if (!impl->friction_is_stable(error)) return nullptr;
  return std::unique_ptr<Plant>(new Plant(std::move(impl)));
}

const PlantOptions& Plant::options() const { return impl_->options; }
const std::vector<Channel>& Plant::measurements() const { return impl_->measurements; }
const std::vector<Channel>& Plant::commands() const { return impl_->info.commands; }
const std::vector<Channel>& Plant::states() const { return impl_->info.states; }

double Plant::parameter(const std::string& name) const {
  const auto at = impl_->parameters.find(name);
  return at == impl_->parameters.end() ? std::nan("") : at->second;
}

void Plant::reset() {
  std::string error;  // what could be built once can be built again
  impl_->reset(error);
}

void Plant::apply(const double* command) {
  const std::size_t count = impl_->lines.size();
  if (!std::all_of(command, command + count, [](double value) { return std::isfinite(value); })) {
    ++impl_->dropped;
    return;
  }
  for (std::size_t i = 0; i < count; ++i) impl_->lines[i].send(command[i], impl_->time_us);
}

void Plant::advance(double duration_s) {
  impl_->carried_us += to_us(duration_s);
  for (; impl_->carried_us >= impl_->step_us; impl_->carried_us -= impl_->step_us) impl_->step();
}

std::int64_t Plant::time_us() const { return impl_->time_us; }

std::int64_t Plant::measured_us() const { return impl_->measured_us(); }

void Plant::measure(double* out) const {
  std::vector<double> shown;
  impl_->show(shown);
  for (std::size_t i = 0; i < shown.size(); ++i) out[i] = impl_->encoders[i].read(shown[i], measured_us());
}

void Plant::measure_clean(double* out) const {
  std::vector<double> shown;
  impl_->show(shown);
  std::copy(shown.begin(), shown.end(), out);
}

void Plant::true_state(double* out) const { std::copy(impl_->state.begin(), impl_->state.end(), out); }
void Plant::motor(double* out) const { std::copy(impl_->motor.begin(), impl_->motor.end(), out); }
double Plant::energy_J() const { return impl_->mechanism->energy_J(); }
bool Plant::watchdog_tripped() const { return impl_->lines[0].tripped(); }
std::uint64_t Plant::watchdog_trips() const { return impl_->lines[0].trips(); }
std::uint64_t Plant::dropped_commands() const { return impl_->dropped; }

std::string plant_help() {
  std::ostringstream out;
  for (const MechanismInfo& info : mechanisms()) {
    out << info.kind << ": " << info.help << "\n  parameters:\n";
    for (const ParameterInfo& p : info.parameters) {
      out << "    " << p.name << " = " << p.default_value << "  " << p.help << "\n";
    }
    out << "  states:";
    for (const Channel& c : info.states) out << " " << c.name;
    out << "\n  measured:";
    for (const std::size_t i : info.measured) out << " " << info.states[i].name;
    out << "\n  commands:";
    for (const Channel& c : info.commands) out << " " << c.name;
    out << "\n  joints:";
    for (const std::string& name : info.joints) out << " " << name;
    if (info.joints.empty()) out << " none";
    out << "\n";
  }
  out << "hidden effects:\n";
  for (const EffectInfo& e : effect_infos()) {
    static constexpr const char* kWhere[] = {"at a joint", "at a command", "at a sensor", "of the whole"};
    out << "  " << e.kind << ":";
    for (std::size_t i = 0; i < e.parameters.size(); ++i) out << (i ? "," : "") << e.parameters[i].name << "=VALUE";
    out << "  " << e.help << " (" << kWhere[static_cast<int>(e.port)] << ")\n";
  }
  return out.str();
}

}  // namespace tiller::sim
