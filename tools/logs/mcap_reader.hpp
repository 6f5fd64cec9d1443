#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tiller::tools {

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint32_t sequence = 0;
  std::uint64_t time_ns = 0;
  std::string data;
};

struct McapChannel {
  std::string topic, message_encoding, schema;  ///< the schema's name
};

/// The content of an MCAP file, in the file's order.
struct McapContent {
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::string, std::string> attachments;  ///< by name
  std::vector<McapMessage> messages;
  std::size_t chunks = 0;
  std::string stopped;      ///< why the rest could not be read: cut off, a wrong CRC; empty: read to its end
  bool compressed = false;  ///< a chunk is compressed: this reader has no decompressor, and its messages are missing
};

/// Reads any bytes front to back, without the summary: everything up to the first record that is cut off or damaged.
/// A chunk counts as a whole, by its CRC where it has one. False: not even the first bytes are those of MCAP. Memory is
/// bounded by a small multiple of the bytes.
bool read_mcap_bytes(const std::string& bytes, McapContent& content);

}  // namespace tiller::tools
