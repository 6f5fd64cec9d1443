#include "tools/simulator/simulator_lines.hpp"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr auto kReplace = Json::error_handler_t::replace;

Json rows_of(const std::vector<double>& values, std::size_t rows) {
  Json list = Json::array();
  const std::size_t columns = rows ? values.size() / rows : 0;
  for (std::size_t r = 0; r < rows; ++r) {
    const auto from = values.begin() + static_cast<std::ptrdiff_t>(r * columns);
    list.push_back(std::vector<double>(from, from + static_cast<std::ptrdiff_t>(columns)));
  }
  return list;
}

/// JSON has no NaN, but Python's json writes it: null in its place.
std::string without_nan(std::string text) {
  for (const std::string word : {"-Infinity", "Infinity", "NaN"})
    for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at))
      text.replace(at, word.size(), "null");
  return text;
}

bool parse(const std::string& line, Json& json, std::string& error) {
  json = Json::parse(line, nullptr, false);
  if (json.is_discarded()) json = Json::parse(without_nan(line), nullptr, false);
  if (!json.is_discarded() && json.is_object()) return true;
  error = "is no JSON object; print nothing but answers on stdout, one a line, and everything else on stderr";
  return false;
}

/// Appends a row's numbers; null counts as NaN.
bool add_row(const Json& row, std::size_t ny, std::vector<double>& out) {
  if (!row.is_array() || row.size() != ny) return false;
  for (const Json& value : row) {
    if (!value.is_number() && !value.is_null()) return false;
    out.push_back(value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>());
  }
  return true;
}

bool read_measured(const Json& rows, const SimulationRequest& request, std::size_t ny, SimulationAnswer& out,
                   std::string& error) {
  if (!rows.is_array() || rows.size() != request.periods) {
    error = format("\"measured\" has %zu rows, and %zu inputs were sent; answer with a row at the end of each period",
                   rows.is_array() ? rows.size() : 0, request.periods);
    return false;
  }
  for (std::size_t r = 0; r < request.periods; ++r)
    if (!add_row(rows[r], ny, out.measured)) {
      error = format("row %zu of \"measured\" is no list of %zu numbers; answer with a number for each measurement",
                     r + 1, ny);
      return false;
    }
  for (std::size_t i = 0; i < out.measured.size(); ++i) {
    if (std::isfinite(out.measured[i])) continue;
    out.failure = format("not finite from period %zu on", i / ny + 1);
    out.measured.clear();
    break;
  }
  return true;
}

}  // namespace

std::string hello_line(const SimulatorNames& names) {
  const Json json = {{"tiller_simulator", kLinesVersion},
                     {"parameters", names.parameters},
                     {"inputs", names.inputs},
                     {"measurements", names.measurements},
                     {"period_s", names.period_s}};
  return json.dump(-1, ' ', false, kReplace) + "\n";
}

std::string request_line(std::uint64_t id, const SimulationRequest& request) {
  const Json json = {{"id", id},
                     {"seed", request.seed},
                     {"parameters", request.parameters},
                     {"start", request.start},
                     {"inputs", rows_of(request.inputs, request.periods)}};
  return json.dump() + "\n";
}

bool check_hello(const std::string& line, std::string& error) {
  Json json;
  if (!parse(line, json, error)) return false;
  const auto version = json.find("tiller_simulator");
  if (version != json.end() && *version == kLinesVersion) return true;
  error = format("is not {\"tiller_simulator\": %d}; greet with that version, once, before the first answer",
                 kLinesVersion);
  return false;
}

bool read_answer(const std::string& line, std::uint64_t id, const SimulationRequest& request, std::size_t ny,
                 SimulationAnswer& out, std::string& error) {
  out = {};
  Json json;
  if (!parse(line, json, error)) return false;
  const auto own = json.find("id");
  if (own == json.end() || *own != id) {
    error = format("its \"id\" is not %llu; answer requests in the order in which they come",
                   static_cast<unsigned long long>(id));
    return false;
  }
  if (const auto failure = json.find("error"); failure != json.end()) {
    out.failure = failure->is_string() ? failure->get<std::string>() : failure->dump(-1, ' ', false, kReplace);
    if (out.failure.empty()) out.failure = "an error without words";
    return true;
  }
  const auto rows = json.find("measured");
  if (rows == json.end()) {
    error = "has neither \"measured\" nor \"error\"; answer with one of them";
    return false;
  }
  return read_measured(*rows, request, ny, out, error);
}

std::string shown_line(const std::string& line) {
  constexpr std::size_t kShown = 160;
  std::string text = line.substr(0, kShown);
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
  return "'" + text + (line.size() > kShown ? "...'" : "'");
}

}  // namespace tiller::tools
