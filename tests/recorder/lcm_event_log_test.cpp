// The reader of LCM logs: what liblcm writes it reads, damage costs the damaged event alone, and memory does not depend
// on what a file claims.
#include "tools/logs/lcm_event_log.hpp"

#include <gtest/gtest.h>
#include <lcm/eventlog.h>

#include <sstream>
#include <vector>

#include "run_rig.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kHeadBytes = 28;  // sync word, number, stamp, two lengths

/// Five events; the third is a picture that nobody of ours reads.
std::vector<LcmEvent> some_events() {
  std::vector<LcmEvent> events;
  for (int i = 0; i < 5; ++i) {
    LcmEvent event;
    event.stamp_us = 1700000000000000 + 1000 * i;
    event.channel = i == 2 ? "CAMERA" : "TILLER_COMMAND";
    event.message = std::string(i == 2 ? 200000 : 10 + i, static_cast<char>('a' + i));
    event.bytes = static_cast<std::uint32_t>(event.message.size());
    events.push_back(event);
  }
  return events;
}

/// As lcm-logger would log them: written by liblcm.
std::string log_of(const std::vector<LcmEvent>& events) {
  const Folder folder;
  lcm_eventlog_t* log = lcm_eventlog_create((folder / "events.lcm").c_str(), "w");
  for (LcmEvent event : events) {
    lcm_eventlog_event_t written{};
    written.timestamp = event.stamp_us;
    written.channellen = static_cast<std::int32_t>(event.channel.size());
    written.channel = event.channel.data();
    written.datalen = static_cast<std::int32_t>(event.message.size());
    written.data = event.message.data();
    EXPECT_EQ(lcm_eventlog_write_event(log, &written), 0);
  }
  lcm_eventlog_destroy(log);
  return bytes_of(folder / "events.lcm");
}

struct Read {
  std::vector<LcmEvent> events;
  std::uint64_t skipped_bytes = 0;
  bool cut_off = false;
};

Read read(const std::string& bytes) {
  std::istringstream file(bytes);
  LcmEventLog log(file);
  Read read;
  for (LcmEvent event; log.next(event);) read.events.push_back(event);
  read.skipped_bytes = log.skipped_bytes();
  read.cut_off = log.cut_off();
  return read;
}

void expect_same(const LcmEvent& a, const LcmEvent& b) {
  EXPECT_EQ(a.stamp_us, b.stamp_us);
  EXPECT_EQ(a.channel, b.channel);
  EXPECT_EQ(a.bytes, b.bytes);
  EXPECT_EQ(a.message, b.bytes > LcmEventLog::kMostBytes ? "" : b.message);
}

std::size_t bytes_of_event(const LcmEvent& event) { return kHeadBytes + event.channel.size() + event.message.size(); }

TEST(LcmEventLog, ReadsWhatLiblcmWrites) {
  const auto events = some_events();
  const Read got = read(log_of(events));
  ASSERT_EQ(got.events.size(), events.size());
  for (std::size_t i = 0; i < events.size(); ++i) expect_same(got.events[i], events[i]);
  EXPECT_EQ(got.skipped_bytes, 0u);
}

TEST(LcmEventLog, CutAtAnyByteItGivesTheWholeEventsBefore) {
  auto events = some_events();
  events.erase(events.begin() + 2);
  const std::string bytes = log_of(events);
  std::vector<std::size_t> end = {0};
  for (const LcmEvent& event : events) end.push_back(end.back() + bytes_of_event(event));
  ASSERT_EQ(end.back(), bytes.size());
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    const Read got = read(bytes.substr(0, size));
    const auto whole = static_cast<std::size_t>(std::upper_bound(end.begin(), end.end(), size) - end.begin()) - 1;
    ASSERT_EQ(got.events.size(), whole) << size;
    for (std::size_t i = 0; i < whole; ++i) expect_same(got.events[i], events[i]);
    EXPECT_EQ(got.cut_off || got.skipped_bytes > 0, size != end[whole]) << size;
  }
}

TEST(LcmEventLog, DamageCostsTheDamagedEventAlone) {
  const auto events = some_events();
  const std::string bytes = log_of(events);
  const std::size_t second = bytes_of_event(events[0]);
  const auto damaged = [&](std::size_t at, char value) {
    std::string copy = bytes;
    copy[second + at] = value;
    return read(copy);
  };
  const struct {
    const char* what;
    std::size_t at;
  } damages[] = {{"sync word", 1}, {"length of the channel", 20}, {"sign of the message's length", 24}};
  for (const auto& damage : damages) {
    const Read got = damaged(damage.at, '\x80');
    ASSERT_EQ(got.events.size(), 4u) << damage.what;
    expect_same(got.events[0], events[0]);
    for (std::size_t i = 1; i < 4; ++i) expect_same(got.events[i], events[i + 1]);
    EXPECT_EQ(got.skipped_bytes, bytes_of_event(events[1])) << damage.what;
  }
}

TEST(LcmEventLog, BytesThatAreNoEventsArePassedOver) {
  const auto events = some_events();
  const std::string first = log_of({events[0]}), second = log_of({events[1]});
  const std::string waste("\xED\xA1\xDA\xED\xA1 waste", 12);  // begins like a sync word, twice
  const Read got = read(waste + first + waste + second + waste);
  ASSERT_EQ(got.events.size(), 2u);
  expect_same(got.events[0], events[0]);
  expect_same(got.events[1], events[1]);
  EXPECT_EQ(got.skipped_bytes, 3 * waste.size());
  EXPECT_EQ(read("").events.size(), 0u);
  EXPECT_EQ(read("\xED\xA1\xDA").skipped_bytes, 3u);
}

TEST(LcmEventLog, MemoryDoesNotDependOnWhatTheFileClaims) {
  std::string bytes = log_of({some_events()[0]});
  for (std::size_t i = 24; i < 28; ++i) bytes[i] = i == 24 ? '\x7f' : '\xff';  // 2 GiB
  std::istringstream file(bytes);
  LcmEventLog log(file);
  LcmEvent event;
  EXPECT_FALSE(log.next(event)) << "it ends before its message does";
  EXPECT_LE(event.message.capacity(), LcmEventLog::kMostBytes);
}

}  // namespace
}  // namespace tiller::tools
