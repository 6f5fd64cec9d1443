#pragma once

#include <string>

namespace tiller::tools {

/// A file that grows during a run and must not stop it. What cannot be written is kept in memory; the first
/// refusal is told at once on stderr, and closing tries again, then rescues the rest into the folder for
/// temporary files. Nothing is formatted or written in here but whole blocks, so the exact byte that the system
/// accepted last is known.
class OutputFile {
 public:
  OutputFile() = default;
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  /// Creates or empties the file. Where that is refused, everything is kept for rescue.
  void open(const std::string& path);
  /// False: nothing of it is kept, for the disk refuses and the memory for it is used up. Never throws.
  bool write(const char* bytes, std::size_t size);
  bool write(const std::string& text) { return write(text.data(), text.size()); }
  /// The tail that every flush writes behind the content and the next one overwrites: a closing mark, so that the file
  /// is whole between two flushes too. Not in files that cannot be overwritten (pipes, devices). Empty: none.
  void set_tail(std::string tail) { tail_ = std::move(tail); }
  /// Hands what is buffered to the operating system, in one write; what it refuses is tried again by the next one.
  void flush();
  /// False: something is missing in the file at its path; message() says what, and where the rest is.
  bool close();

  /// Bytes that wait for the operating system, and bytes that were given up.
  std::size_t waiting() const { return pending_.size(); }
  std::size_t lost() const { return lost_bytes_; }
  bool refused() const { return !failure_.empty(); }
  /// The last flush could not hand over everything: what waits is tried again by the next one.
  bool lags() const { return lags_; }
  bool complete() const { return failure_.empty() && !lost_; }
  const std::string& path() const { return path_; }
  /// Where the whole content is readable after close: path(), or the rescued copy; empty if nowhere.
  const std::string& readable_path() const { return readable_; }
  const std::string& message() const { return message_; }

 private:
  void create();
  bool drain();
  void fail(const char* what);
  void rescue();
  bool copy_written(int to) const;

  static constexpr std::size_t kKeep = std::size_t{256} << 20;  // bytes kept at most when the disk refuses

  std::string path_;
  int descriptor_ = -1;
  bool overwritable_ = false;
  std::size_t written_ = 0;  // bytes in the file
  std::string pending_;      // bytes after them
  std::string tail_;         // behind them, until the next flush
  std::string failure_, message_, readable_;
  std::size_t lost_bytes_ = 0;
  bool open_ = false;
  bool lost_ = false;
  bool lags_ = false;
};

/// Makes the folders that are missing on the way to a file, and says so on stderr: every output option does. What
/// cannot be made shows when the file is.
void make_folders_for(const std::string& path);

/// Whether a file can be written at `path`, tried without changing one that is there; folders are made on the way.
/// False with a sentence in `error` that names the file and the reason.
bool can_write_file(const std::string& path, std::string& error);

/// Puts `bytes` in the place of the file at `path`, or leaves it as it was: a reader sees the old content or the new
/// one whole, also after a crash or a loss of power at any instant. Written to `<folder>/.<name>.tmp`, synced, renamed
/// over the file, the folder synced; the one temporary file that a kill may leave is used again by the next call. Two
/// processes that write the same file are told apart by a lock. False with a sentence in `error` that names the file.
bool replace_file(const std::string& path, const std::string& bytes, std::string& error);

}  // namespace tiller::tools
