#pragma once

#include <string>
#include <vector>

#include "tools/links/arm_source.hpp"
#include "tools/links/link.hpp"

namespace tiller::tools {

/// Who arms: from the decision, by way of drives that get ready, to tiller_arm. Nobody arms in SAFE, and nobody before
/// the first valid measurement; a decision from then does not wait for its time.
class Arming {
 public:
  /// `at_once`: decided already, by the command line.
  Arming(Link& link, bool at_once, const std::vector<ArmSource*>& sources)
      : link_(link), at_once_(at_once), sources_(sources) {}

  /// After the first measurement. Returns what the operator must know; empty: nothing.
  std::string begin();
  /// Before each tick. Returns a sentence for the operator, or nothing.
  std::string step(tiller_t* controller, const tiller_info_t& info);
  /// Whether the step before has armed by an operator's decision: the task begins.
  bool begins_task() const { return begins_; }
  bool at_once() const { return at_once_; }
  bool was_armed() const { return ever_; }
  std::string help() const;

 private:
  ArmRequest ask();
  void get_ready();
  std::string arm_when_ready(tiller_t* controller);
  std::string disarm(tiller_t* controller);

  Link& link_;
  bool at_once_;
  const std::vector<ArmSource*>& sources_;
  bool wanted_ = false, armed_ = false, ever_ = false, begins_ = false;
};

}  // namespace tiller::tools
