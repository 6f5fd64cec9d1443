#include "abi/checks.hpp"
#include "core/bits.hpp"
#include "rollout/attitude.hpp"
#include "rollout/model_adapter.hpp"

namespace tiller {
namespace {

bool all_named(const char* const* names, std::uint32_t count) {
  if (count > 0 && names == nullptr) return false;
  for (std::uint32_t i = 0; i < count; ++i)
    if (names[i] == nullptr || names[i][0] == '\0') return false;
  return true;
}

bool joints_fit(const tiller_model_t& m) {
  if (m.joint_count > 0 && m.joints == nullptr) return false;
  for (std::uint32_t j = 0; j < m.joint_count; ++j) {
    const tiller_joint_t& joint = m.joints[j];
    if (joint.name == nullptr || joint.name[0] == '\0') return false;
    if (joint.position >= m.state_count && joint.position != TILLER_NO_POSITION) return false;
    if (joint.velocity >= m.state_count || joint.force >= m.joint_count || joint.drive > m.input_count) return false;
  }
  return true;
}

/// A joint's velocity is the derivative of its position, which none of a quaternion's four states has.
bool quaternion_is_joint(const tiller_model_t& m) {
  const std::uint32_t taken = quaternion_states(m.quaternion_mask);
  for (std::uint32_t j = 0; j < m.joint_count; ++j) {
    const tiller_joint_t& joint = m.joints[j];
    if ((taken >> joint.velocity) & 1u) return true;
    if (joint.position != TILLER_NO_POSITION && ((taken >> joint.position) & 1u)) return true;
  }
  return false;
}

}  // namespace

Finding check_model(const tiller_model_t& m) {
  if (m.size != sizeof(tiller_model_t)) return {tiller_status_version_mismatch, "model.size"};
  if (m.version != TILLER_MODEL_VERSION) return {tiller_status_version_mismatch, "model.version"};
  if (m.name == nullptr || m.name[0] == '\0') return {tiller_status_bad_model, "model.name"};
  if (m.state_count == 0 || m.state_count > TILLER_MAX_STATES) return {tiller_status_bad_model, "model.state_count"};
  if (m.input_count == 0 || m.input_count > TILLER_MAX_INPUTS) return {tiller_status_bad_model, "model.input_count"};
  if (m.param_count > TILLER_MAX_PARAMS) return {tiller_status_bad_model, "model.param_count"};
  if (m.joint_count > TILLER_MAX_JOINTS) return {tiller_status_bad_model, "model.joint_count"};
  if (!all_named(m.state_names, m.state_count)) return {tiller_status_bad_model, "model.state_names"};
  if (!all_named(m.input_names, m.input_count)) return {tiller_status_bad_model, "model.input_names"};
  if (!all_named(m.param_names, m.param_count)) return {tiller_status_bad_model, "model.param_names"};
  if (!all_named(m.force_names, m.joint_count)) return {tiller_status_bad_model, "model.force_names"};
  if (m.output_count > TILLER_MAX_OUTPUTS) return {tiller_status_bad_model, "model.output_count"};
  if (!all_named(m.output_names, m.output_count)) return {tiller_status_bad_model, "model.output_names"};
  if (m.output_count > 0 && m.outputs == nullptr) return {tiller_status_bad_model, "model.outputs"};
  if (!joints_fit(m)) return {tiller_status_bad_model, "model.joints"};
  if ((m.angle_mask & ~low_bits(m.state_count)) != 0) return {tiller_status_bad_model, "model.angle_mask"};
  if (!quaternions_fit(m.quaternion_mask, m.state_count, m.angle_mask) || quaternion_is_joint(m))
    return {tiller_status_bad_model, "model.quaternion_mask"};
#if defined(TILLER_NO_C_MODELS)
  if (m.kernels == nullptr) return {tiller_status_bad_model, "model.kernels"};
#else
  if (m.dynamics == nullptr && m.kernels == nullptr) return {tiller_status_bad_model, "model.dynamics"};
#endif
  return {};
}

}  // namespace tiller
