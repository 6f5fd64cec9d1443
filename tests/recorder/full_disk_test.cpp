// What becomes of a run whose disk is full, or takes no file at all.
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <thread>

#include "run_rig.hpp"
#include "tools/logs/mcap_reader.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

TEST(Recorder, AFullDiskIsTold) {
  const auto robot = arm();
  RecorderOptions options;
  options.records = {"/dev/full"};
  options.lossless = true;
  Recorder recorder(*robot, options);
  EXPECT_EQ(recorder.state().status, tiller_status_ok);
  recorder.start(robot->config);
  EXPECT_EQ(recorder.state().status, tiller_status_io_error) << "before the first tick";
  for (std::uint64_t k = 0; k < 100; ++k) recorder.push(odd_tick(k));
  const RecorderReport report = recorder.stop();
  EXPECT_FALSE(report.complete);
  EXPECT_TRUE(report.disk_refused);
  EXPECT_EQ(report.dropped_ticks, 0u);
  EXPECT_EQ(recorder.state().status, tiller_status_io_error);
  EXPECT_EQ(recorder.state().waiting_bytes, record_header(robot->config).size() + 100 * sizeof(RecordEntry));
  ASSERT_FALSE(report.messages.empty());
  EXPECT_NE(report.messages[0].find("No space left on device"), std::string::npos) << report.messages[0];
}

TEST(Recorder, AFolderThatDoesNotTakeFilesIsTold) {
  const auto robot = arm();
  RecorderOptions options;
  options.log = "/proc/none/run.csv";
  Recorder recorder(*robot, options);
  recorder.start(robot->config);
  EXPECT_EQ(recorder.state().status, tiller_status_io_error);
  EXPECT_GT(recorder.state().waiting_bytes, 100u);
  const RecorderReport report = recorder.stop();
  EXPECT_FALSE(report.complete);
  EXPECT_EQ(report.messages.size(), 1u);
}

/// A limit of the process on the size of files is a disk that is full, and is freed when the limit is lifted.
class Disk {
 public:
  explicit Disk(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    limit(bytes);
  }
  void limit(rlim_t bytes) {
    rlimit now{};
    getrlimit(RLIMIT_FSIZE, &now);
    now.rlim_cur = std::min(bytes, now.rlim_max);
    setrlimit(RLIMIT_FSIZE, &now);
  }
};

/// Pushes ticks until the recorder says so, or for a minute.
bool until(Recorder& recorder, tiller_status_t status, std::uint64_t& pushed) {
  for (int i = 0; i < 6000 && recorder.state().status != status; ++i) {
    recorder.push(odd_tick(pushed++));
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return recorder.state().status == status;
}

/// The child's account of it: 0, or which step went wrong.
int fills_and_frees(const RobotFile& robot, const RecorderOptions& options, std::uint64_t& pushed) {
  Disk disk(60000);
  Recorder recorder(robot, options);
  recorder.start(robot.config);
  if (recorder.state().status != tiller_status_ok) return 1;
  if (!until(recorder, tiller_status_io_error, pushed)) return 2;
  const LogState full = recorder.state();
  if (full.waiting_bytes == 0 || full.dropped_ticks != 0 || full.lost_bytes != 0) return 3;
  disk.limit(RLIM_INFINITY);
  if (!until(recorder, tiller_status_ok, pushed)) return 4;
  if (recorder.state().waiting_bytes != 0) return 5;
  const RecorderReport report = recorder.stop();
  if (!report.complete || !report.disk_refused) return 6;
  return recorder.state().status == tiller_status_ok ? 0 : 7;
}

TEST(Recorder, ADiskThatIsFullAndFreedAgainIsAStatusForAsLongAsItLasts) {
  const Folder folder;
  const auto robot = arm();
  RecorderOptions options;
  options.log = folder / "run.csv";
  options.records = {folder / "run.mcap", folder / "run.lcm", folder / "run.rec"};
  const pid_t child = fork();
  if (child == 0) {
    std::uint64_t pushed = 0;
    const int code = fills_and_frees(*robot, options, pushed);
    std::ofstream(folder / "pushed") << pushed;
    _exit(code);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  const std::uint64_t pushed = std::stoull(bytes_of(folder / "pushed"));
  for (const std::string& path : options.records) {
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_recorded_run(path, *robot, run, error)) << error;
    EXPECT_EQ(run.entries.size(), pushed) << path;
    EXPECT_FALSE(run.cut_off) << path;
  }
  const std::string csv = bytes_of(options.log);
  EXPECT_EQ(static_cast<std::uint64_t>(std::count(csv.begin(), csv.end(), '\n')), pushed + 1);
}

constexpr const char* kSevenMissing =
    "7 ticks are missing: 20 to 26; from tick 27 on a replay knows other things than the recorded controller did: equal "
    "bits are promised for the 20 ticks before that";

TEST(Recorder, TicksThatWereDroppedAreToldByTheReader) {
  const Folder folder;
  const auto robot = arm();
  McapRun run(*robot);
  run.open(folder / "run.mcap", robot->config, 0);
  OutputFile record;
  record.open(folder / "run.rec");
  write_record_header(record, robot->config);
  for (std::uint64_t k = 0; k < 50; ++k) {
    if (k >= 20 && k < 27) continue;
    run.add(odd_tick(k).entry);
    write_record(record, odd_tick(k).entry);
  }
  EXPECT_TRUE(run.close(50, 7));
  EXPECT_TRUE(record.close());
  EXPECT_NE(bytes_of(folder / "run.mcap").find("dropped_ticks"), std::string::npos);
  for (const char* name : {"run.mcap", "run.rec"}) {
    RecordedRun read;
    std::string error;
    ASSERT_TRUE(read_recorded_run(folder / name, *robot, read, error)) << error;
    EXPECT_EQ(read.entries.size(), 43u);
    EXPECT_TRUE(read.cut_off);
    EXPECT_EQ(read.note, kSevenMissing);
  }
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose shadow needs the address space itself
/// Where memory is limited too, what cannot be kept is counted; nothing throws.
TEST(OutputFile, WithoutMemoryItCountsWhatItGivesUp) {
  const pid_t child = fork();
  if (child == 0) {
    OutputFile file;
    file.open("/dev/full");
    const rlimit most = {std::size_t{256} << 20, std::size_t{256} << 20};
    setrlimit(RLIMIT_AS, &most);
    const std::string megabyte(1 << 20, 'x');
    std::size_t kept = 0;
    for (int i = 0; i < 250; ++i) {
      kept += file.write(megabyte) ? megabyte.size() : 0;
      if (i % 10 == 0) file.flush();
    }
    file.flush();
    _exit(kept > 0 && file.lost() > 0 && kept + file.lost() == 250 * megabyte.size() && file.waiting() == kept ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status)) << "ended by a signal";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}
#endif

/// The disk is full at some byte of the file (a limit of the process stands in for it: the write is cut there): the
/// file is readable up to its last whole chunk.
TEST(Recorder, WhereTheDiskEndsTheFileStaysReadable) {
  const Folder folder;
  const std::string path = folder / "run.mcap";
  const auto robot = arm();
  for (const rlim_t limit : {rlim_t{40000}, rlim_t{80000}, rlim_t{81111}}) {
    const pid_t child = fork();
    if (child == 0) {
      std::signal(SIGXFSZ, SIG_IGN);
      const rlimit most = {limit, limit};
      setrlimit(RLIMIT_FSIZE, &most);
      setenv("TMPDIR", "/proc/none", 1);  // nothing to rescue into
      McapRun run(*robot);
      run.open(path, robot->config, 0);
      for (std::uint64_t k = 0; k < 400; ++k) {
        run.add(odd_tick(k).entry);
        if (k % 10 == 9) run.flush();
      }
      _exit(run.close(400, 0) ? 1 : 0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_EQ(WEXITSTATUS(status), 0) << "told that the file is not complete";
    const std::string bytes = bytes_of(path);
    EXPECT_EQ(bytes.size(), limit);
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_mcap_run(bytes, path, *robot, run, error)) << error;
    EXPECT_EQ(run.entries.size() % 10, 0u);
    EXPECT_GT(run.entries.size(), limit / 2000);
    EXPECT_NE(run.note, "");
    for (const RecordEntry& entry : run.entries) expect_same(odd_tick(entry.record.tick).entry.record, entry.record);
    std::printf("disk of %llu bytes: %zu ticks\n", static_cast<unsigned long long>(limit), run.entries.size());
  }
}

/// In a child with a mount table of its own: two small disks, for the log and for temporary files. -1: not permitted.
template <class Body>
int with_small_disks(const std::string& folder, const char* log_MB, const char* temporary_MB, const Body& body) {
  const std::string disk = folder + "/disk", temporary = folder + "/temporary";
  std::filesystem::create_directories(disk);
  std::filesystem::create_directories(temporary);
  const uid_t user = geteuid();
  const gid_t group = getegid();
  const pid_t child = fork();
  if (child == 0) {
    const auto put = [](const char* path, const std::string& text) { std::ofstream(path) << text; };
    bool apart = unshare(CLONE_NEWNS) == 0;
    if (!apart && unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0) {  // the user is root there
      apart = true;
      put("/proc/self/setgroups", "deny");
      put("/proc/self/uid_map", "0 " + std::to_string(user) + " 1");
      put("/proc/self/gid_map", "0 " + std::to_string(group) + " 1");
    }
    const auto mounted = [](const std::string& at, const char* MB) {
      return mount("tmpfs", at.c_str(), "tmpfs", 0, (std::string("size=") + MB + "m").c_str()) == 0;
    };
    if (!apart || mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 || !mounted(disk, log_MB) ||
        !mounted(temporary, temporary_MB) || !(std::ofstream(disk + "/probe") << "x") ||
        !(std::ofstream(temporary + "/probe") << "x"))
      _exit(77);
    std::filesystem::remove(disk + "/probe");
    std::filesystem::remove(temporary + "/probe");
    setenv("TMPDIR", temporary.c_str(), 1);
    _exit(body(disk) ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  if (!WIFEXITED(status)) return 2;  // ended by a signal
  return WEXITSTATUS(status) == 77 ? -1 : WEXITSTATUS(status);
}

/// A megabyte that is unlike its neighbours.
std::string megabyte(int i) { return std::string(1 << 20, static_cast<char>('a' + i % 26)); }

/// 24 MB on a disk of 20 MB: what is rescued is the whole, byte for byte.
TEST(OutputFile, OfAFullDiskTheRescuedCopyIsWhole) {
  const Folder folder;
  const int ended = with_small_disks(folder / "", "20", "60", [](const std::string& disk) {
    OutputFile file;
    file.open(disk + "/run.log");
    for (int i = 0; i < 24; ++i) {
      if (!file.write(megabyte(i))) return false;
      file.flush();
    }
    if (file.close() || file.readable_path().empty()) return false;
    std::string whole;
    for (int i = 0; i < 24; ++i) whole += megabyte(i);
    return bytes_of(file.readable_path()) == whole;
  });
  if (ended == -1) GTEST_SKIP() << "no disks of one's own without user namespaces";
  EXPECT_EQ(ended, 0);
}

/// A copy that would take more than half of what the other disk has left is not made: that disk may be the memory.
TEST(OutputFile, ALongLogDoesNotFillTheNextDisk) {
  const Folder folder;
  const int ended = with_small_disks(folder / "", "20", "40", [](const std::string& disk) {
    OutputFile file;
    file.open(disk + "/run.log");
    for (int i = 0; i < 24; ++i) {
      if (!file.write(megabyte(i))) return false;
      file.flush();
    }
    const bool complete = file.close();
    const bool told = file.message().find("the log is incomplete: free space") != std::string::npos &&
                      file.message().find("does not hold a copy of 24 MB") != std::string::npos;
    return !complete && told && file.readable_path().empty() && std::filesystem::is_empty(std::getenv("TMPDIR")) &&
           bytes_of(disk + "/run.log").size() > (19u << 20);
  });
  if (ended == -1) GTEST_SKIP() << "no disks of one's own without user namespaces";
  EXPECT_EQ(ended, 0);
}

}  // namespace
}  // namespace tiller::tools
