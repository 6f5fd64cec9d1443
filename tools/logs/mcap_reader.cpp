#include "tools/logs/mcap_reader.hpp"

#include <zlib.h>

#include "tools/logs/mcap_bytes.hpp"

namespace tiller::tools {
namespace {

using mcap::Cursor;

class Reader {
 public:
  Reader(const std::string& bytes, McapContent& out) : bytes_(bytes), out_(out) {}

  bool read() {
    if (bytes_.compare(0, mcap::magic().size(), mcap::magic()) != 0) return false;
    Cursor file(bytes_.data() + mcap::magic().size(), bytes_.size() - mcap::magic().size());
    out_.stopped = "cut off";
    while (file.left() > 0 && records(file, true)) {
    }
    return true;
  }

 private:
  /// One record. False: reading ends here, `stopped` says why.
  bool records(Cursor& in, bool top) {
    const std::uint8_t opcode = in.u8();
    const std::uint64_t length = in.u64();
    const char* from = in.skip(length);
    if (!from) return stop("cut off");
    Cursor record(from, static_cast<std::size_t>(length));
    switch (opcode) {
      case mcap::kSchema: return schema(record);
      case mcap::kChannel: return channel(record);
      case mcap::kMessage: return message(record);
      case mcap::kChunk: return top ? chunk(record) : stop("a chunk inside a chunk");
      case mcap::kAttachment: return attachment(record, from);
      case mcap::kDataEnd:
      case mcap::kFooter: out_.stopped.clear(); return false;
      default: return true;  // an index, a metadata record, or what a later version knows
    }
  }

  bool stop(const char* why) {
    out_.stopped = why;
    return false;
  }

  bool schema(Cursor& in) {
    const std::uint16_t id = in.u16();
    const std::string name = in.text();
    if (in.bad()) return stop("a damaged schema");
    schema_[id] = name;
    return true;
  }

  bool channel(Cursor& in) {
    const std::uint16_t id = in.u16();
    const std::uint16_t of = in.u16();
    McapChannel channel;
    channel.topic = in.text();
    channel.message_encoding = in.text();
    if (in.bad()) return stop("a damaged channel");
    const auto found = schema_.find(of);
    if (found != schema_.end()) channel.schema = found->second;
    out_.channels[id] = channel;
    return true;
  }

  bool message(Cursor& in) {
    McapMessage message;
    message.channel = in.u16();
    message.sequence = in.u32();
    message.time_ns = in.u64();
    (void)in.u64();  // publish time
    message.data = in.raw(in.left());
    if (in.bad()) return stop("a damaged message");
    if (out_.channels.count(message.channel) == 0) return stop("a message of a channel that is not declared");
    out_.messages.push_back(std::move(message));
    return true;
  }

  /// All of it or nothing.
  bool chunk(Cursor& in) {
    (void)in.u64();
    (void)in.u64();
    const std::uint64_t size = in.u64();
    const std::uint32_t crc = in.u32();
    const std::string compression = in.text();
    const std::uint64_t stored = in.u64();
    const char* from = in.skip(stored);
    if (in.bad()) return stop("a damaged chunk");
    if (!compression.empty()) {
      out_.compressed = true;
      return true;
    }
    if (size != stored) return stop("a damaged chunk");
    const auto sum = ::crc32_z(0, reinterpret_cast<const unsigned char*>(from), static_cast<std::size_t>(stored));
    if (crc != 0 && crc != sum) return stop("a chunk with a wrong CRC");
    const std::size_t before = out_.messages.size();
    Cursor inside(from, static_cast<std::size_t>(stored));
    while (inside.left() > 0) {
      if (records(inside, false)) continue;
      out_.messages.resize(before);
      if (out_.stopped.empty()) out_.stopped = "a chunk that holds the end of the file";
      return false;
    }
    ++out_.chunks;
    return true;
  }

  bool attachment(Cursor& in, const char* from) {
    (void)in.u64();
    (void)in.u64();
    const std::string name = in.text();
    (void)in.text();  // media type
    const std::string data = in.raw(in.u64());
    const std::size_t covered = in.at();
    const std::uint32_t crc = in.u32();
    if (in.bad()) return stop("a damaged attachment");
    if (crc != 0 && crc != ::crc32_z(0, reinterpret_cast<const unsigned char*>(from), covered))
      return stop("an attachment with a wrong CRC");
    out_.attachments[name] = data;
    return true;
  }

  const std::string& bytes_;
  McapContent& out_;
  std::map<std::uint16_t, std::string> schema_;
};

}  // namespace

bool read_mcap_bytes(const std::string& bytes, McapContent& content) {
  content = {};
  return Reader(bytes, content).read();
}

}  // namespace tiller::tools
