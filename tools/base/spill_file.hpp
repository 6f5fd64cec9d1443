#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace tiller::tools {

/// Bytes that are wanted back once, at the end of a run, in the order in which they came. The first megabyte is kept in
/// memory, what comes after it in a file without a name in `folder`: a run of weeks takes no more memory than one of
/// minutes, and nothing is left behind however the program ends.
class SpillFile {
 public:
  SpillFile() = default;
  ~SpillFile();
  SpillFile(const SpillFile&) = delete;
  SpillFile& operator=(const SpillFile&) = delete;

  void open(const std::string& folder) { folder_ = folder; }
  /// While the disk refuses, up to kWaiting bytes wait in memory. False: there are more, or the memory is used up, now
  /// or at an earlier call. Nothing is held any more then. Never throws.
  bool append(const std::string& bytes);
  bool whole() const { return !failed_; }
  std::uint64_t size() const { return size_; }
  /// Calls `take` with one piece after another. False: not everything could be read.
  bool each(const std::function<void(const std::string&)>& take) const;

  static constexpr std::size_t kPiece = std::size_t{1} << 20, kWaiting = std::size_t{16} << 20;

 private:
  bool spill();
  bool fail();

  std::string folder_, recent_;  // recent_: behind what the file holds
  std::uint64_t size_ = 0, in_file_ = 0;
  int descriptor_ = -1;
  bool failed_ = false;
};

}  // namespace tiller::tools
