#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "harness/gap_scoring/gap_cases.hpp"

// results.csv: one line a case, so that a run can be cut and taken up again.

namespace tiller::bench {
namespace {

struct Column {
  const char* name;
  std::string GapRow::*text;
  double GapRow::*number;
};
constexpr Column kColumns[] = {
    {"id", &GapRow::id, nullptr},
    {"section", &GapRow::section, nullptr},
    {"plant", &GapRow::plant, nullptr},
    {"truth", &GapRow::truth, nullptr},
    {"excitation", &GapRow::excitation, nullptr},
    {"verdict", &GapRow::verdict, nullptr},
    {"answer", &GapRow::answer, nullptr},
    {"outcome", &GapRow::outcome, nullptr},
    {"sets", &GapRow::sets, nullptr},
    {"note", &GapRow::note, nullptr},
    {"noise", nullptr, &GapRow::noise},
    {"encoder_step", nullptr, &GapRow::encoder_step},
    {"process_sd", nullptr, &GapRow::process_sd},
    {"r", nullptr, &GapRow::r},
    {"nominal_sigma", nullptr, &GapRow::nominal_sigma},
    {"remaining_sigma", nullptr, &GapRow::remaining_sigma},
    {"gap_before", nullptr, &GapRow::gap_before},
    {"gap_after", nullptr, &GapRow::gap_after},
    {"gap_oracle", nullptr, &GapRow::gap_oracle},
    {"covered", nullptr, &GapRow::covered},
    {"intervals", nullptr, &GapRow::intervals},
    {"oracle_covered", nullptr, &GapRow::oracle_covered},
    {"oracle_intervals", nullptr, &GapRow::oracle_intervals},
    {"cpu_s", nullptr, &GapRow::cpu_s},
    {"memory_MB", nullptr, &GapRow::memory_megabytes},
    {"world_s", nullptr, &GapRow::world_s},
};

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

}  // namespace

std::string row_header() {
  std::string text;
  for (const Column& c : kColumns) text += (text.empty() ? "" : ",") + std::string(c.name);
  return text + ",seed\n";
}

std::string row_text(const GapRow& row) {
  std::string text;
  for (const Column& c : kColumns) {
    if (!text.empty()) text += ',';
    if (c.text) {
      for (const char x : row.*c.text) text += x == ',' || x == '\n' ? ';' : x;
      continue;
    }
    char number[32];
    std::snprintf(number, sizeof number, "%.6g", row.*c.number);
    text += number;
  }
  return text + "," + std::to_string(row.seed) + "\n";
}

std::vector<GapRow> read_rows(const std::string& path) {
  std::ifstream in(path);
  std::string line;
  std::vector<GapRow> rows;
  if (!std::getline(in, line) || line + "\n" != row_header()) return rows;
  std::map<std::string, std::size_t> place;
  while (std::getline(in, line)) {
    const auto cells = cells_of(line);
    if (cells.size() != std::size(kColumns) + 1) continue;  // cut while it was written
    GapRow row;
    for (std::size_t i = 0; i < std::size(kColumns); ++i) {
      if (kColumns[i].text)
        row.*kColumns[i].text = cells[i];
      else
        row.*kColumns[i].number = std::strtod(cells[i].c_str(), nullptr);
    }
    row.seed = std::strtoull(cells.back().c_str(), nullptr, 10);
    const auto [found, fresh] = place.emplace(row.id, rows.size());
    if (fresh)
      rows.push_back(row);
    else
      rows[found->second] = row;
  }
  return rows;
}

}  // namespace tiller::bench
