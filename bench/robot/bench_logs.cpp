// ./dev bench logs: a log of 100 GB on a disk that fills. The bytes pass through the writer of MCAP logs into a real
// file; what was written is given back to the disk at once (fallocate, punched holes), so the file takes some MB. The
// limit of the process on the size of files stands for the disk's end.
#include <fcntl.h>
#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zlib.h>

#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "bench/table/bench_table.hpp"
#include "tools/logs/mcap_bytes.hpp"
#include "tools/logs/mcap_writer.hpp"

namespace tiller::tools {
namespace {

using bench::at_most;

constexpr std::size_t kMessage = 4000;        // bytes of a tick's messages
constexpr std::uint64_t kTicksAFlush = 25;    // a quarter of a second at 100 Hz
constexpr std::uint64_t kBehind = 64u << 20;  // bytes that stay on the disk
constexpr std::uint64_t kBeyond = 50u << 20;  // bytes that wait while the disk is full
constexpr std::uint64_t kHead = 1u << 20;

std::int64_t heap_bytes() {
  const struct mallinfo2 m = mallinfo2();
  return static_cast<std::int64_t>(m.uordblks + m.hblkhd);
}
void end_disk_at(rlim_t bytes) {
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  limit.rlim_cur = std::min(bytes, limit.rlim_max);
  setrlimit(RLIMIT_FSIZE, &limit);
}

/// What a robot of 100 Hz writes, as fast as it goes.
class Robot {
 public:
  explicit Robot(const std::string& path) : file_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)) {
    writer_.open(path, "bench");
    const std::uint16_t schema = writer_.add_schema("tick", "", "");
    channel_ = writer_.add_channel("/tick", "", schema);
  }
  ~Robot() { ::close(file_); }
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;

  McapWriter& writer() { return writer_; }
  std::uint64_t ticks() const { return ticks_; }
  std::uint64_t bytes() const { return ticks_ * kMessage; }
  void write_until(std::uint64_t bytes, bool give_back) {
    while (this->bytes() < bytes) {
      std::memcpy(message_.data(), &ticks_, sizeof ticks_);
      writer_.add_message(channel_, static_cast<std::uint32_t>(ticks_), ticks_ * 10000000, message_);
      if (++ticks_ % kTicksAFlush == 0) writer_.flush();
      if (give_back && this->bytes() > given_back_ + 2 * kBehind) punch(this->bytes() - kBehind);
    }
  }

 private:
  void punch(std::uint64_t to) {
    const std::uint64_t from = std::max(given_back_, kHead);
    if (::fallocate(file_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(from),
                    static_cast<off_t>(to - from)) != 0) {
      std::fprintf(stderr, "bench_logs: this file system gives nothing back (punched holes); name another folder\n");
      std::exit(1);
    }
    given_back_ = to;
  }

  McapWriter writer_;
  int file_;
  std::uint16_t channel_ = 0;
  std::uint64_t ticks_ = 0, given_back_ = 0;
  std::string message_ = std::string(kMessage, 'x');
};

std::string part_of(const std::string& path, std::uint64_t from, std::uint64_t size) {
  std::ifstream file(path, std::ios::binary);
  std::string bytes(size, '\0');
  file.seekg(static_cast<std::streamoff>(from));
  file.read(bytes.data(), static_cast<std::streamsize>(size));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  return bytes;
}
std::uint64_t size_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  return static_cast<std::uint64_t>(file.tellg());
}

struct ReadBack {
  double indexes = 0;       // of chunks, in the summary
  double looked_at = 0;     // chunks whose bytes are still there
  double wrong = 0;         // of these: no chunk there, or its CRC is another
  std::uint64_t ticks = 0;  // the last one's number, and one
  bool summary = false;     // with the CRC that the footer states
};

/// As a reader that seeks: the footer, the summary, the chunks that the summary points to.
ReadBack read_back(const std::string& path) {
  ReadBack out;
  const std::uint64_t end = size_of(path);
  const std::string footer = part_of(path, end - 37, 37);
  mcap::Cursor f(footer.data(), footer.size());
  (void)f.u8();
  (void)f.u64();
  const std::uint64_t start = f.u64();
  (void)f.u64();
  const std::uint32_t crc = f.u32();
  if (start == 0 || start >= end) return out;
  const std::string summary = part_of(path, start, end - 12 - start);
  out.summary = crc == ::crc32_z(0, reinterpret_cast<const unsigned char*>(summary.data()), summary.size());
  mcap::Cursor s(summary.data(), summary.size());
  while (!s.bad() && s.left() > 9) {
    const std::uint8_t opcode = s.u8();
    const std::uint64_t size = s.u64();
    const char* content = s.skip(size);
    if (content == nullptr || opcode != mcap::kChunkIndex) continue;
    ++out.indexes;
    mcap::Cursor c(content, size);
    (void)c.u64();
    (void)c.u64();
    const std::uint64_t offset = c.u64(), length = c.u64();
    if (offset < start - kBehind / 2) continue;
    ++out.looked_at;
    const std::string chunk = part_of(path, offset, length);
    mcap::Cursor k(chunk.data(), chunk.size());
    const bool is_chunk = k.u8() == mcap::kChunk;
    for (int i = 0; i < 4; ++i) (void)k.u64();
    const std::uint32_t stated = k.u32();
    (void)k.text();
    const std::string messages = k.raw(k.u64());
    const bool right = is_chunk && !messages.empty() &&
                       stated == ::crc32_z(0, reinterpret_cast<const unsigned char*>(messages.data()), messages.size());
    if (!right) ++out.wrong;
    if (right) std::memcpy(&out.ticks, messages.data() + messages.size() - kMessage, sizeof out.ticks);
  }
  ++out.ticks;
  return out;
}

int run(const std::string& folder, std::uint64_t bytes) {
  std::signal(SIGXFSZ, SIG_IGN);
  setenv("TMPDIR", "/proc/none", 1);  // nothing to rescue into
  const std::string path = folder + "/tiller_bench.mcap";
  bench::Table table;
  table.heading("a log of " + std::to_string(bytes / 1000000000) + " GB, then the disk is full, then there is room");
  {
    Robot robot(path);
    robot.write_until(bytes / 100, true);
    const std::int64_t heap = heap_bytes();
    for (int part = 1; part < 10; ++part) {
      robot.write_until(bytes / 10 * static_cast<std::uint64_t>(part), true);
      std::fprintf(stderr, "%d of 10\n", part);
    }
    robot.write_until(bytes - kTicksAFlush * kMessage, true);
    table.row("bytes written", static_cast<double>(robot.bytes()), "");
    table.row("growth of the heap from a hundredth on", static_cast<double>(heap_bytes() - heap), "bytes",
              at_most(2 * SpillFile::kPiece));
    end_disk_at(size_of(path));
    const std::uint64_t full = robot.bytes();
    robot.write_until(full + kBeyond, false);
    const OutputFile& file = robot.writer().file();
    table.row("full: refusals that were not told", file.refused() && file.lags() ? 0 : 1, "", at_most(0));
    table.row("full: bytes that wait", static_cast<double>(file.waiting()), "");
    table.row("full: bytes given up", static_cast<double>(file.lost()), "", at_most(0));
    end_disk_at(RLIM_INFINITY);
    const bool complete = robot.writer().close();
    const ReadBack back = read_back(path);
    table.row("room again: the log is not complete", complete ? 0 : 1, "", at_most(0));
    table.row("no summary, or its CRC is another", back.summary ? 0 : 1, "", at_most(0));
    table.row("chunks in the summary", back.indexes, "");
    table.row("chunks at the end read through it", back.looked_at, "");
    table.row("of these wrong", back.wrong, "", at_most(0));
    table.row("ticks missing at the end", static_cast<double>(robot.ticks() - back.ticks), "", at_most(0));
  }
  ::unlink(path.c_str());
  return table.finish();
}

}  // namespace
}  // namespace tiller::tools

int main(int argc, char** argv) {
  std::string folder = ".";
  double bytes = 1e11;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (std::strcmp(argv[i], "--bytes") == 0) bytes = std::strtod(argv[i + 1], nullptr);
    if (std::strcmp(argv[i], "--folder") == 0) folder = argv[i + 1];
  }
  if (argc % 2 == 0 || !(bytes >= 1e9)) {
    std::fprintf(
        stderr,
        "usage: bench_logs [--bytes N] [--folder DIR]\n"
        "  writes N bytes (1e11; at least 1e9) of an MCAP log into DIR (.), of which 130 MB stay on the disk at\n"
        "  a time, and then fills it\n");
    return 2;
  }
  return tiller::tools::run(folder, static_cast<std::uint64_t>(bytes));
}
