// A robot file with the files that it names: networks, policies, posteriors, references and demonstrations. An input is
// these texts with a byte 0x1e between them, the robot file first; its words "@1" to "@4" become the others' names.
// Files that a compiler would read, keys, and names of any other file are left out.
#include <array>

#include "memory_file.hpp"
#include "tools/robot/network_file.hpp"
#include "tools/robot/posterior_file.hpp"
#include "tools/robot/robot_file.hpp"

namespace {

constexpr std::size_t kParts = 4;

bool ends_with(const std::string& text, std::size_t end, const std::string& word) {
  return end >= word.size() && text.compare(end - word.size(), word.size(), word) == 0;
}

/// Whether every key that names a file has one of the parts, and is none of [model], whose file would be compiled.
bool names_parts_alone(const std::string& text) {
  for (const char* word : {"key_file", "\\", "/", "\"\"\"", "'", "{ file", "model."})
    if (text.find(word) != std::string::npos) return false;
  for (std::size_t at = text.find("file"); at != std::string::npos; at = text.find("file", at + 1)) {
    if (text.compare(at, 9, "file = \"@") != 0) return false;
    if (!ends_with(text, at, "[network]\n") && !ends_with(text, at, "[policy]\n") && !ends_with(text, at, "prior_"))
      return false;
  }
  return true;
}

/// What was read is written, and read again the same.
void check_round_trips(const std::string& text) {
  using namespace tiller::tools;
  std::string error;
  StoredNetwork network, network_again;
  if (parse_network(text, network, error))
    fuzz::require(parse_network(network_text(network), network_again, error) &&
                      network_text(network_again) == network_text(network),
                  "a network that was read can be written and read");
  StoredPolicy policy, policy_again;
  if (parse_policy(text, policy, error))
    fuzz::require(
        parse_policy(policy_text(policy), policy_again, error) && policy_text(policy_again) == policy_text(policy),
        "a policy that was read can be written and read");
  StoredPosterior posterior, posterior_again;
  Words errors;
  if (parse_posterior(text, "fuzz.json", posterior, errors))
    fuzz::require(parse_posterior(posterior_text(posterior), "fuzz.json", posterior_again, errors) &&
                      posterior_text(posterior_again) == posterior_text(posterior),
                  "a posterior that was read can be written and read");
  else
    fuzz::require(!errors.empty(), "a posterior is refused with a reason");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static std::array<fuzz::MemoryFile, kParts> files;
  std::string text(reinterpret_cast<const char*>(data), size);
  std::array<std::string, kParts> parts;
  std::size_t end = text.find('\x1e');
  const std::string rest = end == std::string::npos ? "" : text.substr(end);
  text.resize(end == std::string::npos ? text.size() : end);
  for (std::size_t i = 0, at = 1; i < kParts; ++i) {
    if (at <= rest.size()) parts[i] = rest.substr(at, rest.find('\x1e', at) - at), at += parts[i].size() + 1;
    check_round_trips(parts[i]);
    files[i].write(parts[i]);
  }
  if (!names_parts_alone(text)) return 0;
  for (std::size_t i = 0; i < kParts; ++i)
    for (const std::string word = "@" + std::to_string(i + 1); (end = text.find(word)) != std::string::npos;)
      text.replace(end, word.size(), files[i].path());
  std::string errors;
  const auto robot = tiller::tools::parse_robot_text(text, "fuzz/robot.toml", errors).robot;
  fuzz::require((robot == nullptr) == !errors.empty(), "a file is refused with a reason, and taken without one");
  return 0;
}
