#pragma once

#include <string>

#include "tools/base/text.hpp"
#include "tools/base/toml.hpp"

namespace tiller::tools::tune {

/// A number in the text of a robot file.
struct NumberAt {
  double value = 0;
  std::size_t from = 0, to = 0;  ///< bytes of the text
};

/// "planner.noise_sd.force_N", "effects.0.damping_SI.uniform.1": tables by key, lists by index. A path that ends at a
/// table of a single number names that number.
Words split_path(const std::string& path);

/// False with a sentence in `error` that names the step at which the path ends. `text` is valid TOML.
bool find_number(const std::string& text, const std::string& path, NumberAt& found, std::string& error);

/// Writes `value` in the place of the number at the path; a key of a [section] that is not there yet is added below the
/// section's header. False with a sentence in `error`.
bool set_number(std::string& text, const std::string& path, const std::string& value, std::string& error);

}  // namespace tiller::tools::tune
