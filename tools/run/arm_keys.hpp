#pragma once

#include <termios.h>

#include "tools/links/arm_source.hpp"

namespace tiller::tools {

/// Keys of the terminal on standard input: a arms, d or space disarms. Keys count at once and are not shown while an
/// object of this class lives; Ctrl-C stays what it is. A process in the background, or one without a terminal, has no
/// keys.
class ArmKeys : public ArmSource {
 public:
  ArmKeys();
  ~ArmKeys() override;
  ArmKeys(const ArmKeys&) = delete;
  ArmKeys& operator=(const ArmKeys&) = delete;

  ArmRequest poll() override;
  std::string help() const override;

 private:
  bool is_set_ = false;
  termios before_{};
};

/// What was typed between two ticks, decided: `a` arms alone, because what is pasted or sent by a cursor key may hold
/// one; to disarm, one key among many is enough.
ArmRequest decide(const char* typed, std::size_t count);

}  // namespace tiller::tools
