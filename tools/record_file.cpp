#include "tools/record_file.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>

namespace tiller::tools {
namespace {
constexpr char kMagic[8] = {'T', 'I', 'L', 'L', 'R', 'E', 'C', '1'};
constexpr std::uint32_t kSizes[2] = {sizeof(tiller_config_t), sizeof(RecordEntry)};
}  // namespace

void write_record_header(OutputFile& file, const tiller_config_t& config) {
  tiller_config_t copy = config;
  copy.model = nullptr;
  copy.cost.reference = copy.cost.demonstration_mean = copy.cost.demonstration_root = nullptr;
  copy.cost.own = nullptr;
  file.write(kMagic, sizeof kMagic);
  file.write(reinterpret_cast<const char*>(kSizes), sizeof kSizes);
  file.write(reinterpret_cast<const char*>(&copy), sizeof copy);
}

void write_record(OutputFile& file, const RecordEntry& entry) {
  file.write(reinterpret_cast<const char*>(&entry), sizeof entry);
}

bool read_record_file(const std::string& path, tiller_config_t& config, std::vector<RecordEntry>& entries,
                      std::string& error) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    error = path + ": cannot be read: " + std::strerror(errno) + "\n";
    return false;
  }
  char magic[sizeof kMagic];
  std::uint32_t sizes[2];
  file.read(magic, sizeof magic);
  file.read(reinterpret_cast<char*>(sizes), sizeof sizes);
  if (!file || std::memcmp(magic, kMagic, sizeof magic) != 0) {
    error = path + ": is no record of tiller; `tiller run --record FILE` writes one\n";
    return false;
  }
  if (std::memcmp(sizes, kSizes, sizeof sizes) != 0) {
    error = path + ": was written by another version of tiller; replay it with that one\n";
    return false;
  }
  file.read(reinterpret_cast<char*>(&config), sizeof config);
  for (RecordEntry entry; file.read(reinterpret_cast<char*>(&entry), sizeof entry);) entries.push_back(entry);
  if (entries.empty()) error = path + ": holds no tick\n";
  return !entries.empty();
}

}  // namespace tiller::tools
