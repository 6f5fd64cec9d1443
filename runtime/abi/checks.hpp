#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// A defect and its place: `field` is a literal, the path of the field in tiller_config_t.
struct Finding {
  tiller_status_t status = tiller_status_ok;
  const char* field = "";
};

Finding check_model(const tiller_model_t& model);
Finding check_config(const tiller_config_t& config);

}  // namespace tiller
