#include "bench/learned/simulator_rows.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>

namespace tiller::bench {
namespace {

constexpr double SimulatorLine::*kFields[] = {
    &SimulatorLine::exact,  &SimulatorLine::log_density, &SimulatorLine::mean_off,    &SimulatorLine::sd_ratio,
    &SimulatorLine::inside, &SimulatorLine::seconds,     &SimulatorLine::simulations, &SimulatorLine::width};

}  // namespace

SimulatorRows::SimulatorRows(std::string path) : path_(std::move(path)) {
  std::ifstream file(path_);
  for (std::string text; std::getline(file, text);) {
    if (file.eof()) break;  // without its newline: cut
    std::istringstream cells(text);
    std::string key, seed, value;
    if (!std::getline(cells, key, ';') || !std::getline(cells, seed, ';')) continue;
    SimulatorLine line;
    std::size_t read = 0;
    for (; read < std::size(kFields) && std::getline(cells, value, ';'); ++read)
      line.*kFields[read] = std::strtod(value.c_str(), nullptr);
    if (read == std::size(kFields)) rows_[key][static_cast<unsigned>(std::strtoul(seed.c_str(), nullptr, 10))] = line;
  }
}

bool SimulatorRows::has(const std::string& task, const std::string& way, unsigned seed) const {
  const auto found = rows_.find(task + "/" + way);
  return found != rows_.end() && found->second.count(seed) > 0;
}

void SimulatorRows::add(const std::string& task, const std::string& way, unsigned seed, const SimulatorLine& line) {
  rows_[task + "/" + way][seed] = line;
  std::ofstream file(path_, std::ios::app);
  file.precision(9);
  file << task << "/" << way << ";" << seed;
  for (const auto field : kFields) file << ";" << line.*field;
  file << "\n";
}

std::vector<SimulatorLine> SimulatorRows::of(const std::string& task, const std::string& way, unsigned first,
                                             unsigned last) const {
  std::vector<SimulatorLine> lines;
  const auto found = rows_.find(task + "/" + way);
  if (found == rows_.end()) return lines;
  for (const auto& [seed, line] : found->second)
    if (seed >= first && seed <= last) lines.push_back(line);
  return lines;
}

}  // namespace tiller::bench
