// MCAP files of our own: what goes in comes out to the last bit, and a file that ends anywhere is read up to its last
// whole chunk.
#include <zlib.h>

#include <cstring>

#include "run_rig.hpp"
#include "tools/base/whole_file.hpp"
#include "tools/logs/mcap_bytes.hpp"
#include "tools/logs/mcap_reader.hpp"
#include "tools/logs/mcap_writer.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/replay/replay.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint64_t kTicks = 40, kTicksAChunk = 8;

/// Forty ticks in five chunks. `at_flush`: the file's bytes after each flush.
std::string write_run(const RobotFile& robot, const std::string& path, std::vector<std::string>* at_flush = nullptr) {
  McapRun run(robot);
  run.open(path, robot.config, 0);
  for (std::uint64_t k = 0; k < kTicks; ++k) {
    run.add(odd_tick(k).entry);
    if (k % kTicksAChunk != kTicksAChunk - 1) continue;
    run.flush();
    if (at_flush) at_flush->push_back(bytes_of(path));
  }
  EXPECT_TRUE(run.close(1, 0));
  return bytes_of(path);
}

TEST(Mcap, EveryNumberComesBackToTheLastBit) {
  const Folder folder;
  const auto robot = arm();
  const std::string bytes = write_run(*robot, folder / "run.mcap");
  EXPECT_TRUE(is_mcap_run(bytes));
  RecordedRun run;
  std::string error;
  ASSERT_TRUE(read_mcap_run(bytes, "run.mcap", *robot, run, error)) << error;
  EXPECT_EQ(run.note, "");
  ASSERT_EQ(run.entries.size(), kTicks);
  for (std::uint64_t k = 0; k < kTicks; ++k) expect_same(odd_tick(k).entry.record, run.entries[k].record);
  ASSERT_TRUE(run.has_config);
  EXPECT_TRUE(record_header(robot->config) == record_header(run.config)) << "the configuration of the run";
}

TEST(Mcap, ForcesComeBackAndWhereALogHasNoneItSaysSo) {
  const Folder folder;
  const auto robot = pushed_arm(), still = arm();
  for (const bool pushed : {true, false}) {
    McapRun out(pushed ? *robot : *still);
    out.open(folder / "run.mcap", robot->config, 0);
    for (std::uint64_t k = 0; k < kTicks; ++k) out.add(pushed ? pushed_tick(k).entry : odd_tick(k).entry);
    ASSERT_TRUE(out.close(kTicks, 0));
    RecordedRun run;
    std::string error;
    ASSERT_TRUE(read_recorded_run(folder / "run.mcap", *robot, run, error)) << error;
    ASSERT_EQ(run.entries.size(), kTicks);
    for (std::uint64_t k = 0; k < kTicks; ++k) {
      expect_same(odd_tick(k).entry.record, run.entries[k].record);
      expect_same_forces(pushed ? pushed_tick(k).entry : odd_tick(k).entry, run.entries[k]);
    }
    EXPECT_EQ(run.note, pushed ? "" : "the forces beyond the model are not in it");
    ASSERT_TRUE(read_recorded_run(folder / "run.mcap", *still, run, error)) << error;
    EXPECT_EQ(run.note, "") << "a robot that looks for none misses none";
  }
}

/// Where each chunk ends, by walking over the file's records.
std::vector<std::size_t> chunk_ends(const std::string& bytes) {
  std::vector<std::size_t> ends;
  std::size_t at = 8;
  while (at + 9 <= bytes.size()) {
    std::uint64_t length = 0;
    for (std::size_t i = 0; i < 8; ++i)
      length |= std::uint64_t{static_cast<unsigned char>(bytes[at + 1 + i])} << (8 * i);
    const bool chunk = bytes[at] == 6;
    at += 9 + length;
    if (chunk) ends.push_back(at);
  }
  return ends;
}

// Every length from nothing to the whole file: the ticks of the chunks that are whole, each as it was written, and no
// others.
TEST(Mcap, CutAtEveryByteItOpensUpToTheLastWholeChunk) {
  const Folder folder;
  const auto robot = arm();
  const std::string whole = write_run(*robot, folder / "run.mcap");
  const std::vector<std::size_t> ends = chunk_ends(whole);
  ASSERT_EQ(ends.size(), kTicks / kTicksAChunk);
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const std::string cut = whole.substr(0, size);
    std::size_t expected = 0;
    for (const std::size_t end : ends) expected += size >= end;
    McapContent content;
    ASSERT_EQ(read_mcap_bytes(cut, content), size >= 8) << size;
    ASSERT_EQ(content.chunks, expected) << size;
    const bool at_an_end = std::count(ends.begin(), ends.end(), size) + std::count(ends.begin(), ends.end(), size + 1);
    if (!at_an_end && size % 499 != 0) continue;  // decoding JSON takes the time of a hundred cuts
    RecordedRun run;
    std::string error;
    ASSERT_EQ(read_mcap_run(cut, "cut", *robot, run, error), expected > 0) << size << error;
    ASSERT_EQ(run.entries.size(), expected * kTicksAChunk) << size;
    for (const RecordEntry& entry : run.entries) expect_same(odd_tick(entry.record.tick).entry.record, entry.record);
    ASSERT_FALSE(HasNonfatalFailure()) << size;
  }
  std::printf("%zu lengths\n", whole.size() + 1);
}

// A process that is killed leaves what its last flush left: a finished file by its marks.
TEST(Mcap, BetweenTwoFlushesTheFileIsAFinishedOne) {
  const Folder folder;
  const auto robot = arm();
  std::vector<std::string> at_flush;
  (void)write_run(*robot, folder / "run.mcap", &at_flush);
  ASSERT_EQ(at_flush.size(), kTicks / kTicksAChunk);
  for (std::size_t i = 0; i < at_flush.size(); ++i) {
    McapContent content;
    ASSERT_TRUE(read_mcap_bytes(at_flush[i], content));
    EXPECT_EQ(content.stopped, "") << "the marks of the end";
    EXPECT_EQ(content.chunks, i + 1);
  }
}

// A torn write: the new bytes only up to somewhere, then what stood there before.
TEST(Mcap, ATornWriteCostsNoChunkThatWasWhole) {
  const Folder folder;
  const auto robot = arm();
  std::vector<std::string> at_flush;
  (void)write_run(*robot, folder / "run.mcap", &at_flush);
  const std::string &before = at_flush[2], &after = at_flush[3];
  for (std::size_t torn = before.size() - 50; torn < after.size(); ++torn) {
    std::string bytes = after.substr(0, torn);
    if (torn < before.size()) bytes += before.substr(torn);
    bytes.resize(after.size(), '\0');
    McapContent content;
    ASSERT_TRUE(read_mcap_bytes(bytes, content));
    ASSERT_GE(content.chunks, 3u) << torn;
    ASSERT_LE(content.chunks, 4u) << torn;
    for (std::size_t i = 0; i < content.messages.size(); ++i) ASSERT_EQ(content.messages[i].data.front(), '{') << torn;
  }
}

TEST(Mcap, ADamagedChunkIsNotBelieved) {
  const Folder folder;
  const auto robot = arm();
  std::vector<std::string> at_flush;
  const std::string whole = write_run(*robot, folder / "run.mcap", &at_flush);
  int checked = 0;
  for (std::size_t at = at_flush[1].size() + 100; at < at_flush[2].size() - 2000; at += 37, ++checked) {
    std::string bytes = whole;
    bytes[at] = static_cast<char>(bytes[at] ^ 4);
    McapContent content;
    ASSERT_TRUE(read_mcap_bytes(bytes, content));
    ASSERT_EQ(content.chunks, 2u) << at;
    ASSERT_EQ(content.stopped, "a chunk with a wrong CRC");
  }
  std::printf("%d bits, each found\n", checked);
  EXPECT_GT(checked, 20);
}

TEST(Mcap, OfAnotherRobotIsTold) {
  const Folder folder;
  const auto robot = arm();
  const std::string bytes = write_run(*robot, folder / "run.mcap");
  RobotFile other = *robot;
  other.names.measurements[1] = "rate_deg_s";
  RecordedRun run;
  std::string error;
  EXPECT_FALSE(read_mcap_run(bytes, "run.mcap", other, run, error));
  EXPECT_NE(error.find("run.mcap: a message of /measurement at 1.000000 s is not what arm.toml expects"),
            std::string::npos)
      << error;
}

/// A run of days has more chunks than the memory keeps the places of (SpillFile): the summary has every one all the
/// same, in order, and its CRC.
TEST(Mcap, TheSummaryOfALongLogHasEveryChunk) {
  const Folder folder;
  const std::string path = folder / "long.mcap";
  constexpr std::uint64_t kChunks = 30000;
  McapWriter writer;
  writer.open(path, "test");
  const std::uint16_t channel = writer.add_channel("/tick", "", writer.add_schema("tick", "", ""));
  for (std::uint64_t k = 0; k < kChunks; ++k) {
    writer.add_message(channel, static_cast<std::uint32_t>(k), k, "x");
    writer.close_chunk();
  }
  const std::filesystem::directory_iterator files(folder / ""), end;
  EXPECT_EQ(std::distance(files, end), 1) << "what is put aside has no name";
  ASSERT_TRUE(writer.close());
  const std::string bytes = bytes_of(path);
  mcap::Cursor footer(bytes.data() + bytes.size() - 37, 37);
  (void)footer.u8();
  (void)footer.u64();
  const std::uint64_t start = footer.u64();
  (void)footer.u64();
  ASSERT_LT(start, bytes.size());
  const std::size_t covered = bytes.size() - 12 - start;  // the CRC and the magic stand behind
  EXPECT_EQ(footer.u32(), ::crc32_z(0, reinterpret_cast<const unsigned char*>(bytes.data() + start), covered));
  mcap::Cursor summary(bytes.data() + start, covered);
  std::uint64_t indexes = 0, size = 0;
  while (summary.left() > 9) {
    const std::uint8_t opcode = summary.u8();
    const std::uint64_t length = summary.u64();
    const char* content = summary.skip(length);
    if (opcode == mcap::kFooter) break;  // whose CRC is not covered
    ASSERT_NE(content, nullptr);
    if (opcode != mcap::kChunkIndex) continue;
    size += 9 + length;
    mcap::Cursor index(content, length);
    ASSERT_EQ(index.u64(), indexes++) << "the time of its first message";
    (void)index.u64();
    const std::uint64_t offset = index.u64();
    ASSERT_EQ(bytes.at(offset), static_cast<char>(mcap::kChunk));
  }
  EXPECT_EQ(indexes, kChunks);
  EXPECT_GT(size, 2 * SpillFile::kPiece) << "else nothing was put aside";
}

/// The place for it cannot be had: it waits for one, and gives up where too much waits.
TEST(SpillFile, WithoutAPlaceItWaitsThenGivesUpAndSaysSo) {
  const Folder folder;
  const std::string place = folder / "place", piece(SpillFile::kPiece / 2, 'x');
  for (const bool comes : {true, false}) {
    SpillFile file;
    file.open(place);
    std::uint64_t size = 0;
    while (size < SpillFile::kWaiting) {
      ASSERT_TRUE(file.append(piece)) << size;
      size += piece.size();
    }
    if (comes) std::filesystem::create_directory(place);
    EXPECT_EQ(file.append(piece), comes);
    EXPECT_EQ(file.whole(), comes);
    std::uint64_t read = 0;
    EXPECT_EQ(file.each([&](const std::string& bytes) { read += bytes.size(); }), comes);
    EXPECT_EQ(read, comes ? size + piece.size() : 0);
    EXPECT_EQ(file.append("x"), comes);
    std::filesystem::remove(place);
  }
}

TEST(WholeFile, WhatTheMemoryDoesNotHoldIsRefusedWithFigures) {
  EXPECT_EQ(too_large_for_memory("run.mcap", 1000000000, 3000000000), "");
  const std::string told = too_large_for_memory("run.mcap", 100000000000, 8000000000);
  EXPECT_NE(told.find("run.mcap: 100.0 GB"), std::string::npos) << told;
  EXPECT_NE(told.find("8.0 GB are free"), std::string::npos) << told;
  const std::uint64_t free = free_memory_bytes();
  EXPECT_GT(free, std::uint64_t{1} << 20);
  EXPECT_LT(free, std::uint64_t{1} << 50);
  const Folder folder;
  std::string bytes = "what was there", error;
  EXPECT_FALSE(read_whole_file(folder / "none", bytes, error));
  EXPECT_NE(error.find("none: cannot be read: No such file"), std::string::npos) << error;
  EXPECT_FALSE(read_whole_file(folder / "", bytes, error));
  EXPECT_NE(error.find("it is a folder"), std::string::npos) << error;
  { std::ofstream(folder / "log", std::ios::binary) << std::string(200000, 'x'); }
  std::filesystem::resize_file(folder / "log", std::uintmax_t{1} << 42);  // holes: the disk does not have 4 TB
  EXPECT_FALSE(read_whole_file(folder / "log", bytes, error));
  EXPECT_NE(error.find("4398.0 GB"), std::string::npos) << error;
  std::filesystem::resize_file(folder / "log", 200000);
  ASSERT_TRUE(read_whole_file(folder / "log", bytes, error)) << error;
  EXPECT_EQ(bytes, std::string(200000, 'x'));
}

}  // namespace
}  // namespace tiller::tools
