// Names that the C ABI gives to kinds and settings. No controller is needed.
#include "scalar/isa.hpp"
#include "tiller/tiller.h"

#define TILLER_TEXT_OF(x) #x
#define TILLER_TEXT(x) TILLER_TEXT_OF(x)

extern "C" {

const char* tiller_state_name(tiller_state_t state) {
  switch (state) {
    case tiller_state_init: return "INIT";
    case tiller_state_standby: return "STANDBY";
    case tiller_state_active: return "ACTIVE";
    case tiller_state_hold: return "HOLD";
    case tiller_state_safe: return "SAFE";
  }
  return "unknown";
}

const char* tiller_feature_name(tiller_feature_t feature) {
  switch (feature) {
    case tiller_feature_none: return "none";
    case tiller_feature_bias: return "bias";
    case tiller_feature_velocity: return "velocity";
    case tiller_feature_velocity_sign: return "velocity_sign";
    case tiller_feature_input: return "input";
    case tiller_feature_input_change: return "input_change";
    case tiller_feature_previous: return "previous";
    case tiller_feature_size: return "size";
    case tiller_feature_position: return "position";
    case tiller_feature_count: break;
  }
  return "unknown";
}

const char* tiller_instruction_set(void) { return tiller::isa_name(tiller::best_isa()); }

const char* tiller_version(void) { return TILLER_TEXT(TILLER_VERSION_MAJOR) "." TILLER_TEXT(TILLER_VERSION_MINOR); }

}  // extern "C"
