#include "effects/effect_info.hpp"

#include <cstring>

#include "effects/catalogue.hpp"
#include "effects/effect_roles.hpp"

namespace tiller {
namespace {
constexpr EffectInfo kInfos[] = {
#define TILLER_EFFECT(name, Type, ...) Type<double>::info,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
constexpr Hook kHooks[] = {
#define TILLER_EFFECT(name, Type, ...) Type<double>::hook,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
constexpr const char* kLike[] = {
#define TILLER_EFFECT(name, Type, roles, like) like,
#include "tiller/effects.def"
#undef TILLER_EFFECT
};
constexpr std::uint32_t kCount = sizeof(kInfos) / sizeof(kInfos[0]);
static_assert(kCount == tiller_effect_kind_count, "the C enumeration and the catalogue come from the same lines");

/// Whether `name` is one of the words of `list`.
bool lists(const char* list, const char* name) {
  const std::size_t length = std::strlen(name);
  for (const char* at = std::strstr(list, name); at; at = std::strstr(at + 1, name))
    if ((at == list || at[-1] == ' ') && (at[length] == ' ' || at[length] == '\0')) return true;
  return false;
}
}  // namespace

const EffectInfo& effect_info(std::uint32_t kind) { return kInfos[kind]; }
Hook hook_of(std::uint32_t kind) { return kind < kCount ? kHooks[kind] : Hook::sensor; }
std::uint32_t effect_kind_count() { return kCount; }
int find_effect(const char* name) {
  for (std::uint32_t kind = 0; kind < kCount; ++kind)
    if (std::strcmp(kInfos[kind].name, name) == 0) return static_cast<int>(kind);
  return -1;
}

bool are_alike(std::uint32_t a, std::uint32_t b) {
  return lists(kLike[a], kInfos[b].name) || lists(kLike[b], kInfos[a].name);
}

const char* port_kind_name(PortKind port) {
  static constexpr const char* kNames[kPortKinds] = {"joint", "input", "sensor", "body"};
  return kNames[static_cast<int>(port)];
}
std::uint32_t port_count(PortKind port, const tiller_model_t& model) {
  switch (port) {
    case PortKind::joint: return model.joint_count;
    case PortKind::input: return model.input_count;
    case PortKind::sensor: return model.state_count;
    default: return 1;
  }
}
const char* port_name(PortKind port, const tiller_model_t& model, std::uint32_t index) {
  if (index == TILLER_EVERY_PORT) return "all";
  switch (port) {
    case PortKind::joint: return model.joints[index].name;
    case PortKind::input: return model.input_names[index];
    case PortKind::sensor: return model.state_names[index];
    default: return "body";
  }
}
namespace {

bool is_quaternion_state(const tiller_model_t& model, std::uint32_t state) {
  const std::uint32_t mask = model.quaternion_mask;
  return ((mask | mask << 1 | mask << 2 | mask << 3) >> state) & 1u;
}

/// At one port.
bool stands_at(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model) {
  if (port >= port_count(info.port, model)) return false;
  if (info.port == PortKind::joint) {
    const tiller_joint_t& joint = model.joints[port];
    return (!info.needs_drive || joint.drive != 0) && (!info.needs_position || joint.position != TILLER_NO_POSITION);
  }
  // four states are one reading there: a bias or a scale of one component says nothing
  if (info.port == PortKind::sensor && is_quaternion_state(model, port)) return false;
  if (info.port == PortKind::input && info.needs_drive) {
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      if (model.joints[j].drive == port + 1)  // the effect acts there
        return !info.needs_position || model.joints[j].position != TILLER_NO_POSITION;
    return false;
  }
  return true;
}

}  // namespace

bool port_fits(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model) {
  if (port != TILLER_EVERY_PORT) return stands_at(info, port, model);
  std::uint32_t count = 0;
  for (std::uint32_t p = 0; p < port_count(info.port, model); ++p) count += stands_at(info, p, model) ? 1 : 0;
  return count > 1;
}

std::uint32_t ports_of(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model) {
  std::uint32_t count = 0;
  for_ports(info, port, model, [&](std::uint32_t) { ++count; });
  return count;
}

std::uint32_t first_port(const EffectInfo& info, std::uint32_t port, const tiller_model_t& model) {
  std::uint32_t first = TILLER_EVERY_PORT;
  for_ports(info, port, model, [&](std::uint32_t p) { first = p < first ? p : first; });
  return first;
}

}  // namespace tiller
