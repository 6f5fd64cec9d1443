#pragma once

#include <deque>

#include "tools/links/arm_source.hpp"
#include "tools/links/lcm_channel.hpp"
#include "tools/links/lcm_seal.hpp"

namespace tiller::tools {

/// arm_t on the LCM channel <prefix>ARM (runtime/io/lcm/arm_t.lcm). A message counts if it answers a command that this
/// run sent within the last second, later than the one that the last message answered: neither a recording of another
/// run nor the same message again arms. With a key_file it must be signed as well; what answers no challenge gets one
/// on <prefix>ARM_CHALLENGE (docs/reference/security.md).
class LcmArming : public ArmSource {
 public:
  explicit LcmArming(const RobotFile& robot) : robot_(robot) {}
  /// False with a sentence and a remedy in `error`.
  bool open(std::string& error);

  ArmRequest poll() override;
  std::string help() const override;
  void note_sent(const tiller_command_t& command) override;
  std::string counters() const override;
  /// Takes one encoded message, any bytes, as poll() does with what the channel brought; the next poll() tells.
  void take(const std::uint8_t* bytes, std::uint32_t size);

 private:
  void refuse(const char* why);
  bool is_of_this_run(std::int64_t stamp_us) const;

  const RobotFile& robot_;
  LcmChannel channel_;
  LcmSeal seal_;
  std::deque<std::int64_t> sent_us_;  // stamps of the last second's commands
  std::int64_t answered_us_ = INT64_MIN;
  ArmRequest decided_ = ArmRequest::none;
  bool challenge_due_ = false;
  std::uint64_t taken_ = 0, refused_ = 0;
  const char* why_ = nullptr;  // it was refused last
};

}  // namespace tiller::tools
