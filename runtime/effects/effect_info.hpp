#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Where an effect attaches.
enum class PortKind {
  joint,   ///< a generalised force of a joint
  input,   ///< between a command and the force that it makes
  sensor,  ///< between a state and its measurement
  body     ///< the whole robot, gravity and payload: one port, 0
};
constexpr int kPortKinds = 4;
/// "joint", "input", "sensor", "body".
const char* port_kind_name(PortKind port);

/// How the kernel calls an effect; see rollout/step.hpp for the order within a step.
enum class Hook {
  period_input,  ///< once a period, before anything else: the acting input from the history of inputs
  input,         ///< once a substep: the acting input, advances the effect's own state
  force,         ///< generalised force that enters the dynamics as it stands
  joints,        ///< the same at every joint, from all joints and inputs
  inertia,       ///< after the free step, first: more inertia
  servo,         ///< after the free step, which has no part of the command then: makes the drive force of it
  drive,         ///< after the free step: what the drive train makes of the drive force
  elastic,       ///< after the free step: generalised force by position, implicit
  dissipation,   ///< after the free step, last: generalised force by velocity, implicit
  body,          ///< once a period: changes the body argument of the dynamics
  sensor         ///< outside the step: measurement from state (rollout/measurement.hpp)
};

/// The quantity that a parameter's magnitude scales with, so that a fit can start anywhere: a start is a multiple of
/// it.
enum class Scale {
  none,                 ///< the start as it stands
  force,                ///< typical generalised force at the joint
  force_per_velocity,   ///< force / typical velocity
  force_per_velocity2,  ///< force / velocity^2
  force_per_position,   ///< force / typical excursion
  force_per_position2,  ///< force / excursion^2
  force_per_position3,  ///< force / excursion^3
  stiffness,            ///< force / typical excursion about its mean
  position,             ///< typical excursion of the joint about its mean
  place,          ///< excursion of the joint from its lowest to its highest position; starts count from the lowest
  velocity,       ///< typical velocity of the joint
  input,          ///< typical command
  per_input,      ///< 1 / typical command
  period,         ///< the control period
  mass,           ///< mass that the joint's force moves
  inertia,        ///< inertia that the joint's force moves (kg for a sliding joint)
  spatial_period  ///< no start can be had: scanned over [low, high], evenly in the logarithm
};

constexpr int kMaxEffectParams = 16;
constexpr int kMaxStarts = 6;

struct EffectParam {
  const char* name = nullptr;  ///< ends in its unit; "_SI": N or N m and the like, by the port
  const char* unit = "";
  double low = -__builtin_huge_val();  ///< hard bounds; infinite for none
  double high = __builtin_huge_val();
  Scale scale = Scale::none;
  int start_count = 0;
  double start[kMaxStarts] = {};  ///< multiples of the scale, for fits
};

struct EffectInfo {
  const char* name = nullptr;
  PortKind port = PortKind::joint;
  int param_count = 0;
  EffectParam params[kMaxEffectParams] = {};
  int state_count = 0;
  bool needs_drive = false;          ///< only at a joint that an input drives (tiller_joint_t.drive), or that input
  bool needs_position = false;       ///< only at a joint that has one
  bool paired_starts = false;        ///< starts go together, the k-th of each parameter; else each with each
  bool unnamed = false;              ///< stands for physics without a name: never a candidate of a search for names
  bool learnt = false;               ///< is a function of the configuration's network; in a robot at most once
  const char* help = nullptr;        ///< one line
  const char* equation = nullptr;    ///< plain text
  const char* source = nullptr;      ///< paper or textbook
  const char* contains[3] = {};      ///< effects that are special cases of this one
  const char* aliases[4] = {};       ///< effects that measurements of positions alone may not tell from it
  const char* separation = nullptr;  ///< the experiment or the sensor that tells them apart
};

/// Metadata of a kind (tiller_effect_kind_t); kind < effect_kind_count().
const EffectInfo& effect_info(std::uint32_t kind);
/// Where the kernel calls it; Hook::sensor, which the kernel does not, for a kind that there is not.
Hook hook_of(std::uint32_t kind);
/// Kind by name; -1 if there is none.
int find_effect(const char* name);
std::uint32_t effect_kind_count();
/// Number of ports that an effect of this kind can have on the model.
std::uint32_t port_count(PortKind port, const tiller_model_t& model);
/// Its name: of the joint, the input or the state; "body"; "all" for TILLER_EVERY_PORT.
const char* port_name(PortKind port, const tiller_model_t& model, std::uint32_t index);
/// Whether the effect can stand at the port: the joint has what it needs. At TILLER_EVERY_PORT, if there are two.
bool port_fits(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model);
/// Calls visit(p) for the ports at which an effect with this one acts, in their order.
template <class Visit>
void for_ports(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model, const Visit& visit) {
  const bool every = port == TILLER_EVERY_PORT;
  const std::uint32_t end = every ? port_count(info.port, model) : port + 1;
  for (std::uint32_t p = every ? 0 : port; p < end; ++p)
    if (!every || port_fits(info, p, model)) visit(p);
}
/// The first of them.
std::uint32_t first_port(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model);
/// How many they are.
std::uint32_t ports_of(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model);

}  // namespace tiller
