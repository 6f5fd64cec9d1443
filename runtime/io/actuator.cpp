#include "io/actuator.hpp"

namespace tiller {

const ActuatorProtocol& actuator_protocol(ActuatorKind kind) {
  static const ActuatorProtocol* const tables[] = {
#define TILLER_ACTUATOR(name, table) &table,
#include "io/actuators.def"
#undef TILLER_ACTUATOR
  };
  return *tables[static_cast<std::size_t>(kind)];
}

}  // namespace tiller
