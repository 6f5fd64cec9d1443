#pragma once

#include <memory>
#include <string>

#include "sim/serve.hpp"

namespace tiller::sim {

struct LcmOptions {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";  ///< ttl=0: stays on this machine
  std::string channel_prefix = "TILLER_";               ///< <prefix>MEASUREMENT out, <prefix>COMMAND in
};

/// Opens the link (types in runtime/io/lcm). Null with the reason in error.
std::unique_ptr<PlantLink> open_lcm_link(const LcmOptions& options, const Plant& plant, std::string& error);

/// Serves the plant over LCM; see serve().
int serve_lcm(Plant& plant, const LcmOptions& lcm, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
