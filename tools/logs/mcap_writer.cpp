#include "tools/logs/mcap_writer.hpp"

#include <zlib.h>

#include <algorithm>
#include <filesystem>

#include "tools/logs/mcap_bytes.hpp"

namespace tiller::tools {
namespace {

using mcap::Bytes;
using mcap::record;

std::uint32_t crc_of(const std::string& bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(
      ::crc32_z(before, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
}

}  // namespace

void McapWriter::open(const std::string& path, const std::string& library) {
  file_.open(path);
  const std::string folder = std::filesystem::path(path).parent_path().string();
  chunk_indexes_.open(folder.empty() ? "." : folder);
  (void)append(mcap::magic() + record(mcap::kHeader, Bytes().text("").text(library)));
}

/// False: the bytes were given up, and nothing may point to them.
bool McapWriter::append(const std::string& bytes) {
  if (!file_.write(bytes)) return false;
  position_ += bytes.size();
  crc_ = crc_of(bytes, crc_);
  // an end without a summary, until the next flush
  file_.set_tail(data_end() + Bytes().u8(mcap::kFooter).u64(20).u64(0).u64(0).u32(0).raw(mcap::magic()).get());
  return true;
}

std::uint16_t McapWriter::add_schema(const std::string& name, const std::string& encoding, const std::string& text) {
  const auto id = static_cast<std::uint16_t>(schemas_.size() + 1);
  schemas_.push_back(record(mcap::kSchema, Bytes().u16(id).text(name).text(encoding).text(text)));
  (void)append(schemas_.back());
  return id;
}

std::uint16_t McapWriter::add_channel(const std::string& topic, const std::string& message_encoding,
                                      std::uint16_t schema) {
  const auto id = static_cast<std::uint16_t>(channels_.size() + 1);
  channels_.push_back(record(mcap::kChannel, Bytes().u16(id).u16(schema).text(topic).text(message_encoding).u32(0)));
  (void)append(channels_.back());
  message_count_.push_back(0);
  chunk_index_.emplace_back();
  return id;
}

void McapWriter::add_attachment(const std::string& name, const std::string& media_type, const std::string& bytes,
                                std::uint64_t time_ns) {
  Bytes content;
  content.u64(time_ns).u64(time_ns).text(name).text(media_type).u64(bytes.size()).raw(bytes);
  content.u32(crc_of(content.get()));
  const std::string whole = record(mcap::kAttachment, content);
  attachments_.push_back({position_, whole.size(), time_ns, bytes.size(), name, media_type});
  if (!append(whole)) attachments_.pop_back();
}

void McapWriter::add_metadata(const std::string& name, const std::map<std::string, std::string>& content) {
  Bytes pairs;
  for (const auto& [key, value] : content) pairs.text(key).text(value);
  const std::string whole = record(mcap::kMetadata, Bytes().text(name).text(pairs.get()));
  metadata_.push_back({position_, whole.size(), 0, 0, name, ""});
  if (!append(whole)) metadata_.pop_back();
}

void McapWriter::add_message(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns,
                             const std::string& data) {
  chunk_index_[channel - 1u].emplace_back(time_ns, chunk_.size());
  chunk_first_ns_ = chunk_messages_ == 0 ? time_ns : std::min(chunk_first_ns_, time_ns);
  chunk_last_ns_ = chunk_messages_ == 0 ? time_ns : std::max(chunk_last_ns_, time_ns);
  ++chunk_messages_;
  chunk_ += record(mcap::kMessage, Bytes().u16(channel).u32(sequence).u64(time_ns).u64(time_ns).raw(data));
  if (chunk_.size() >= kChunkBytes) close_chunk();
}

void McapWriter::close_chunk() {
  if (chunk_messages_ == 0) return;
  std::string bytes = record(mcap::kChunk, Bytes()
                                               .u64(chunk_first_ns_)
                                               .u64(chunk_last_ns_)
                                               .u64(chunk_.size())
                                               .u32(crc_of(chunk_))
                                               .text("")
                                               .u64(chunk_.size())
                                               .raw(chunk_));
  const std::uint64_t length = bytes.size();
  Bytes offset_of;  // of each channel's message index
  for (std::size_t i = 0; i < chunk_index_.size(); ++i) {
    if (chunk_index_[i].empty()) continue;
    Bytes entries;
    for (const auto& [time_ns, offset] : chunk_index_[i]) entries.u64(time_ns).u64(offset);
    offset_of.u16(i + 1).u64(position_ + bytes.size());
    bytes += record(mcap::kMessageIndex, Bytes().u16(i + 1).text(entries.get()));
  }
  Bytes index;
  index.u64(chunk_first_ns_).u64(chunk_last_ns_).u64(position_).u64(length).text(offset_of.get());
  index.u64(bytes.size() - length).text("").u64(chunk_.size()).u64(chunk_.size());
  if (append(bytes)) {
    const bool first = chunk_count_ == 0;
    first_ns_ = first ? chunk_first_ns_ : std::min(first_ns_, chunk_first_ns_);
    last_ns_ = first ? chunk_last_ns_ : std::max(last_ns_, chunk_last_ns_);
    for (std::size_t i = 0; i < chunk_index_.size(); ++i) message_count_[i] += chunk_index_[i].size();
    ++chunk_count_;
    (void)chunk_indexes_.append(record(mcap::kChunkIndex, index));
  } else {
    lost_messages_ += chunk_messages_;
  }
  chunk_.clear();
  chunk_messages_ = 0;
  for (auto& entries : chunk_index_) entries.clear();
}

void McapWriter::flush() {
  close_chunk();
  file_.flush();
}

std::string McapWriter::statistics() const {
  Bytes counts;
  std::uint64_t messages = 0;
  for (std::size_t i = 0; i < message_count_.size(); ++i) {
    counts.u16(i + 1).u64(message_count_[i]);
    messages += message_count_[i];
  }
  return record(mcap::kStatistics, Bytes()
                                       .u64(messages)
                                       .u16(schemas_.size())
                                       .u32(channels_.size())
                                       .u32(attachments_.size())
                                       .u32(metadata_.size())
                                       .u32(chunk_count_)
                                       .u64(first_ns_)
                                       .u64(last_ns_)
                                       .text(counts.get()));
}

std::string McapWriter::data_end() const { return record(mcap::kDataEnd, Bytes().u32(crc_)); }

/// Groups of records, behind them where each group stands, and the footer: its CRC covers all that and the footer up to
/// the CRC itself, its opcode and length too.
///
/// False: something of it was refused, and nothing after that is written. A footer would point to what is not there;
/// without one, readers scan the file.
bool McapWriter::write_summary() {
  const std::uint64_t start = position_ + data_end().size();
  bool good = file_.write(data_end());
  std::uint64_t size = 0;
  std::uint32_t crc = 0;
  std::string offsets;
  const auto put = [&](const std::string& bytes) {
    good = good && file_.write(bytes);
    crc = crc_of(bytes, crc);
    size += bytes.size();
  };
  const auto begin = [&](mcap::Opcode opcode, std::uint64_t bytes) {
    if (bytes > 0) offsets += record(mcap::kSummaryOffset, Bytes().u8(opcode).u64(start + size).u64(bytes));
  };
  const auto group = [&](mcap::Opcode opcode, const std::vector<std::string>& records) {
    std::string all;
    for (const std::string& one : records) all += one;
    begin(opcode, all.size());
    put(all);
  };
  group(mcap::kSchema, schemas_);
  group(mcap::kChannel, channels_);
  group(mcap::kStatistics, {statistics()});
  if (chunk_indexes_.whole()) {  // else readers scan the file, as one that has no end
    begin(mcap::kChunkIndex, chunk_indexes_.size());
    const bool read = chunk_indexes_.each([&](const std::string& piece) {
      put(piece);
      file_.flush();
    });
    good = good && read;
  }
  std::vector<std::string> indexes;
  for (const Named& a : attachments_) {
    Bytes index;
    index.u64(a.offset).u64(a.length).u64(a.time_ns).u64(a.time_ns).u64(a.size).text(a.name).text(a.media_type);
    indexes.push_back(record(mcap::kAttachmentIndex, index));
  }
  group(mcap::kAttachmentIndex, indexes);
  indexes.clear();
  for (const Named& m : metadata_)
    indexes.push_back(record(mcap::kMetadataIndex, Bytes().u64(m.offset).u64(m.length).text(m.name)));
  group(mcap::kMetadataIndex, indexes);
  const std::uint64_t offset_start = start + size;
  put(offsets);
  const std::string footer = Bytes().u8(mcap::kFooter).u64(20).u64(start).u64(offset_start).get();
  return good && file_.write(footer + Bytes().u32(crc_of(footer, crc)).raw(mcap::magic()).get());
}

bool McapWriter::close() {
  close_chunk();
  file_.set_tail("");
  const bool whole = write_summary();
  return file_.close() && whole;
}

}  // namespace tiller::tools
