#include "io/actuator.hpp"

#include <cstring>

namespace tiller {
namespace {

struct Row {
  const ActuatorProtocol* protocol;
  ActuatorName name;
};

const Row kRows[] = {
#define TILLER_ACTUATOR(name, motor, first, last, help) {&name##_protocol, {#name, motor, first, last, help}},
#include "io/actuators.def"
};

}  // namespace

const ActuatorProtocol& actuator_protocol(ActuatorKind kind) { return *kRows[static_cast<std::size_t>(kind)].protocol; }

const ActuatorName& actuator_name(ActuatorKind kind) { return kRows[static_cast<std::size_t>(kind)].name; }

bool find_actuator(const char* name, ActuatorKind& kind) {
  for (std::size_t i = 0; i < sizeof kRows / sizeof kRows[0]; ++i)
    if (std::strcmp(kRows[i].name.word, name) == 0) return kind = static_cast<ActuatorKind>(i), true;
  return false;
}

}  // namespace tiller
