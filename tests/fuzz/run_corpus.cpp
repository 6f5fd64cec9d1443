// Drives a fuzzer where there is no libFuzzer: run_corpus.cpp + fuzz_x.cpp = a program that runs every file of the
// folders and files it is given, then every file cut off at up to 200 places, then RUNS damaged ones.
//
//   fuzz_x [-runs=RUNS] FOLDER_OR_FILE...
//
// The damage is a function of the file and of the run's number, so a finding can be repeated.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "fuzz.hpp"

namespace {

using Input = std::vector<std::uint8_t>;

void run(const Input& input) {
  const Input exact(input.begin(), input.end());  // of its own length, for a sanitizer
  LLVMFuzzerTestOneInput(exact.data(), exact.size());
}

std::vector<Input> read_inputs(const std::vector<std::string>& paths) {
  std::vector<std::string> files;
  for (const std::string& path : paths) {
    if (!std::filesystem::is_directory(path)) files.push_back(path);
    if (std::filesystem::is_directory(path))
      for (const auto& entry : std::filesystem::directory_iterator(path)) files.push_back(entry.path().string());
  }
  std::sort(files.begin(), files.end());
  std::vector<Input> inputs;
  for (const std::string& path : files) {
    std::ifstream file(path, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return inputs;
}

void damage(Input& input, const std::vector<Input>& all, std::mt19937& random) {
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random()) % n; };
  for (std::size_t i = 1 + below(4); i > 0; --i) {
    if (input.empty()) input.push_back(0);
    const std::size_t at = below(input.size());
    switch (below(6)) {
      case 0: input[at] ^= static_cast<std::uint8_t>(1u << below(8)); break;
      case 1: input[at] = static_cast<std::uint8_t>(random()); break;
      case 2: input.erase(input.begin() + static_cast<long>(at)); break;
      case 3: input.insert(input.begin() + static_cast<long>(at), static_cast<std::uint8_t>(random())); break;
      case 4: input[at] = below(2) == 0 ? 0xff : 0; break;
      default: {
        const Input& other = all[below(all.size())];
        if (other.empty()) break;
        const std::size_t from = below(other.size());
        const std::size_t length = std::min({1 + below(16), other.size() - from, input.size() - at});
        std::copy_n(other.begin() + static_cast<long>(from), length, input.begin() + static_cast<long>(at));
      }
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  long runs = 0;
  std::vector<std::string> paths;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.rfind("-runs=", 0) == 0)
      runs = std::atol(word.c_str() + 6);
    else
      paths.push_back(word);
  }
  const std::vector<Input> inputs = read_inputs(paths);
  if (inputs.empty()) {
    std::fprintf(stderr, "no inputs in the given folders\n");
    return 1;
  }
  long executions = 0;
  for (const Input& input : inputs) {
    run(input);
    const std::size_t step = std::max<std::size_t>(1, input.size() / 200);
    for (std::size_t size = 0; size < input.size(); size += step, ++executions)
      run(Input(input.begin(), input.begin() + static_cast<long>(size)));
  }
  std::mt19937 random(1);
  for (long k = 0; k < runs; ++k) {
    Input input = inputs[static_cast<std::size_t>(k) % inputs.size()];
    damage(input, inputs, random);
    run(input);
  }
  std::printf("%zu files, %ld executions\n", inputs.size(), executions + static_cast<long>(inputs.size()) + runs);
  return 0;
}
