#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "sim/servers/serve.hpp"

namespace tiller::sim {

struct LcmOptions {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";  ///< ttl=0: stays on this machine
  std::string channel_prefix = "TILLER_";               ///< <prefix>MEASUREMENT out, <prefix>COMMAND in
  /// Appends to an encoded message what proves where it comes from; takes that off again, or returns false. Empty:
  /// messages go as they are.
  std::function<void(const std::string& channel, std::vector<unsigned char>& message)> sign;
  std::function<bool(const std::string& channel, std::vector<unsigned char>& message)> verify;
};

/// Opens the link (types in runtime/io/lcm). Null with the reason in error.
std::unique_ptr<PlantLink> open_lcm_link(const LcmOptions& options, const Plant& plant, std::string& error);

/// Serves the plant over LCM; see serve().
int serve_lcm(Plant& plant, const LcmOptions& lcm, const ServeOptions& options, ServeReport& report);

}  // namespace tiller::sim
