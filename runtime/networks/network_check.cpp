#include "networks/network_check.hpp"

#include <cmath>

namespace tiller {
namespace {

const char* shape_defect(const tiller_network_t& n) {
  if (n.size != sizeof(tiller_network_t)) return "size";
  if (n.version != TILLER_CONFIG_VERSION) return "version";
  if (n.kind > tiller_network_gaussian) return "kind";
  if (n.inputs < 1 || n.inputs > TILLER_MAX_NETWORK_INPUTS) return "inputs";
  if (n.outputs < 1 || n.outputs > TILLER_MAX_NETWORK_OUTPUTS) return "outputs";
  if (n.members < 1 || n.members > TILLER_MAX_NETWORK_MEMBERS) return "members";
  if (n.kind == tiller_network_tanh) {
    const bool gap = n.hidden[0] == 0 && n.hidden[1] != 0;
    if (gap || n.hidden[0] > TILLER_MAX_NETWORK_WIDTH || n.hidden[1] > TILLER_MAX_NETWORK_WIDTH) return "hidden";
  } else if (n.hidden[0] > TILLER_MAX_NETWORK_FEATURES || n.hidden[1] > TILLER_MAX_NETWORK_FEATURES ||
             n.hidden[0] + n.hidden[1] > TILLER_MAX_NETWORK_FEATURES || n.hidden[0] + n.hidden[1] == 0) {
    return "hidden";
  }
  return nullptr;
}

}  // namespace

std::size_t network_weight_count(const tiller_network_t& n) {
  const std::size_t in = n.inputs, out = n.outputs, a = n.hidden[0], b = n.hidden[1];
  if (n.kind == tiller_network_gaussian) return in + a * in + b * (1 + in) + n.members * out * (1 + a + b);
  const std::size_t last = b ? b : a ? a : in;
  return n.members * (a * (1 + in) + b * (1 + a) + out * (1 + last));
}

const char* network_defect(const tiller_network_t& n) {
  if (const char* defect = shape_defect(n)) return defect;
  if (n.weight_count != network_weight_count(n)) return "weight_count";
  if (!n.weights) return "weights";
  for (std::size_t i = 0; i < n.weight_count; ++i)
    if (!(std::fabs(n.weights[i]) <= static_cast<float>(TILLER_LARGEST_VALUE))) return "weights";
  return nullptr;
}

}  // namespace tiller
