#pragma once

#include <cstdint>
#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

enum class ArmRequest : std::uint8_t { none, arm, disarm };

/// Where an operator's decision to permit or to end motion comes from. Asked before every tick.
class ArmSource {
 public:
  virtual ~ArmSource() = default;
  /// What was decided since the last call.
  virtual ArmRequest poll() = 0;
  /// How to arm and disarm here, for the operator: "key a arms, d or space disarms". Empty: not possible at present.
  virtual std::string help() const = 0;
  virtual void note_sent(const tiller_command_t&) {}
  /// One line for the end of a run; empty if there is nothing to tell.
  virtual std::string counters() const { return ""; }
};

}  // namespace tiller::tools
