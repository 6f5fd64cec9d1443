#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tools/base/output_file.hpp"
#include "tools/base/spill_file.hpp"

namespace tiller::tools {

/// Writes MCAP (mcap.dev/spec, major version 0): uncompressed chunks with CRC-32, a message index for each, and a
/// summary at the end, so that readers may seek.
///
/// Made for logs that end without warning. Schemas, channels and attachments stand before the first chunk; every flush
/// is one write of whole chunks, followed by the marks of a finished file without a summary, which the next write
/// covers. So a file whose writer was killed is a valid one, and a file that was cut anywhere is readable up to its
/// last whole chunk.
class McapWriter {
 public:
  /// Creates the file and writes its header. `library` names the program.
  void open(const std::string& path, const std::string& library);

  std::uint16_t add_schema(const std::string& name, const std::string& encoding, const std::string& text);
  std::uint16_t add_channel(const std::string& topic, const std::string& message_encoding, std::uint16_t schema);
  /// Before the first chunk.
  void add_attachment(const std::string& name, const std::string& media_type, const std::string& bytes,
                      std::uint64_t time_ns);
  void add_metadata(const std::string& name, const std::map<std::string, std::string>& content);

  /// Into the chunk that is open; a chunk of kChunkBytes closes itself.
  void add_message(std::uint16_t channel, std::uint32_t sequence, std::uint64_t time_ns, const std::string& data);
  /// Ends the chunk that is open; the next message opens another.
  void close_chunk();
  /// Closes the chunk and hands it to the operating system.
  void flush();
  /// Summary and end. False: something is missing in the file, file() tells.
  bool close();

  const OutputFile& file() const { return file_; }
  /// Messages in chunks that were given up because nothing took them.
  std::uint64_t lost_messages() const { return lost_messages_; }

  static constexpr std::size_t kChunkBytes = std::size_t{1} << 18;

 private:
  struct Named {
    std::uint64_t offset, length, time_ns, size;
    std::string name, media_type;
  };

  bool append(const std::string& bytes);
  std::string data_end() const;
  bool write_summary();
  std::string statistics() const;

  OutputFile file_;
  std::uint64_t position_ = 0;  // bytes of the content so far
  std::uint32_t crc_ = 0;       // of them
  std::vector<std::string> schemas_, channels_;
  std::vector<Named> attachments_, metadata_;
  SpillFile chunk_indexes_;  // a record for each chunk: a log of weeks has millions
  std::uint32_t chunk_count_ = 0;
  std::vector<std::uint64_t> message_count_;  // by channel, from 1

  std::string chunk_;
  std::uint64_t chunk_first_ns_ = 0, chunk_last_ns_ = 0, chunk_messages_ = 0;
  std::vector<std::vector<std::pair<std::uint64_t, std::uint64_t>>> chunk_index_;  // by channel: time, offset
  std::uint64_t first_ns_ = 0, last_ns_ = 0, lost_messages_ = 0;
};

}  // namespace tiller::tools
