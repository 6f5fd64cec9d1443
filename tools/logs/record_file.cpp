#include "tools/logs/record_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "tiller/config.hpp"

namespace tiller::tools {
namespace {
constexpr char kMagic[8] = {'T', 'I', 'L', 'L', 'R', 'E', 'C', '2'};
constexpr std::uint32_t kSizes[2] = {sizeof(Config), sizeof(RecordEntry)};

bool read_joint(std::istream& file, std::shared_ptr<const JointPrior>& joint) {
  std::uint32_t shape[2] = {};
  file.read(reinterpret_cast<char*>(shape), sizeof shape);
  if (!file || shape[0] > Mixture::kMaxComponents || shape[1] > TILLER_MAX_PARAMS) return false;
  if (shape[0] == 0) return true;
  const auto read = [&](std::size_t count) {
    std::vector<double> values(count);
    file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(double)));
    return values;
  };
  auto weight = read(shape[0]), mean = read(std::size_t{shape[0]} * shape[1]);
  auto root = read(std::size_t{shape[0]} * shape[1] * shape[1]);
  joint = std::make_shared<const JointPrior>(shape[1], std::move(weight), std::move(mean), std::move(root));
  return static_cast<bool>(file);
}
}  // namespace

void take_news(const tiller_info_t& info, RecordEntry& entry) {
  entry.force_joints = info.force_joints;
  entry.touched = info.touched;
  std::copy(std::begin(info.force_mean), std::end(info.force_mean), entry.force_mean);
  std::copy(std::begin(info.force_sd), std::end(info.force_sd), entry.force_sd);
  entry.probe = {info.probing,     info.calibration_left, info.probe_value,      info.probe_cost,
                 info.probe_spent, info.probe_allowed,    info.probe_information};
}

std::string record_header(const tiller_config_t& config) {
  Config copy = config;
  tiller_config_t& pointers = copy;
  pointers.model = nullptr;
  pointers.effects = nullptr;
  pointers.priors = nullptr;
  copy.cost.state_low = copy.cost.state_high = copy.cost.bound_weight = nullptr;
  copy.cost.terms = nullptr;
  copy.safety.hold_gain = nullptr;
  copy.safety.cones = nullptr;
  copy.safety.measurement_low = copy.safety.measurement_high = copy.safety.measurement_rate_per_s = nullptr;
  copy.cost.reference = copy.cost.demonstration_mean = copy.cost.demonstration_root = nullptr;
  copy.cost.outputs = nullptr;
  copy.cost.output_reference = nullptr;
  copy.cost.own = nullptr;
  copy.prior_mixture = nullptr;
  std::string bytes(kMagic, sizeof kMagic);
  const auto add = [&](const void* from, std::size_t size) { bytes.append(static_cast<const char*>(from), size); };
  add(kSizes, sizeof kSizes);
  add(&copy, sizeof copy);
  const tiller_mixture_t* m = config.prior_mixture;
  const std::uint32_t shape[2] = {m ? m->components : 0, m ? m->dimension : 0};
  add(shape, sizeof shape);
  if (!m) return bytes;
  add(m->weight, shape[0] * sizeof(double));
  add(m->mean, std::size_t{shape[0]} * shape[1] * sizeof(double));
  add(m->root, std::size_t{shape[0]} * shape[1] * shape[1] * sizeof(double));
  return bytes;
}

void write_record_header(OutputFile& file, const tiller_config_t& config) { file.write(record_header(config)); }

void write_record(OutputFile& file, const RecordEntry& entry) {
  file.write(reinterpret_cast<const char*>(&entry), sizeof entry);
}

bool read_record_header(std::istream& file, const std::string& path, Config& config,
                        std::shared_ptr<const JointPrior>& joint, std::string& error) {
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
  config.own_arrays();
  if (!file || !read_joint(file, joint)) {
    error = path + ": its head is cut off; record the run again\n";
    return false;
  }
  config.prior_mixture = joint ? &joint->mixture : nullptr;
  return true;
}

bool read_record_file(const std::string& path, Config& config, std::shared_ptr<const JointPrior>& joint,
                      std::vector<RecordEntry>& entries, std::string& error) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    error = path + ": cannot be read: " + std::strerror(errno) + "\n";
    return false;
  }
  if (!read_record_header(file, path, config, joint, error)) return false;
  for (RecordEntry entry; file.read(reinterpret_cast<char*>(&entry), sizeof entry);) entries.push_back(entry);
  if (entries.empty()) error = path + ": holds no tick\n";
  return !entries.empty();
}

}  // namespace tiller::tools
