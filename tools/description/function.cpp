#include "tools/description/function.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "tools/base/report.hpp"
#include "tools/base/toml.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

std::string file_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// JSON has no NaN and no infinity: they are words.
double number(const Json& json) {
  return json.is_string() ? std::strtod(json.get<std::string>().c_str(), nullptr) : json.get<double>();
}
std::vector<double> numbers(const Json& json) {
  std::vector<double> out;
  for (const Json& value : json) out.push_back(number(value));
  return out;
}

constexpr int kLargest = 10000;  // rows; a model has far fewer

FunctionPort port_of(const Json& json) {
  FunctionPort port;
  port.name = json.at("name").get<std::string>();
  port.rows = json.at("shape").at(0).get<int>();
  port.columns = json.at("shape").at(1).get<int>();
  port.row = json.at("rows").get<std::vector<int>>();
  const bool inside =
      std::all_of(port.row.begin(), port.row.end(), [&](int row) { return row >= 0 && row < port.rows; });
  if (!inside || port.rows < 0 || port.columns < 0 || port.rows > kLargest || port.columns > kLargest)
    throw std::invalid_argument("'" + port.name + "' has not the elements that its shape says");
  if (json.contains("elements")) port.elements = json.at("elements").get<Words>();
  return port;
}

FunctionInstruction instruction_of(const Json& json) {
  FunctionInstruction out;
  out.op = json.at(0).get<std::string>();
  out.result = json.at(1).get<int>();
  if (out.op == "const")
    out.constant = number(json.at(2));
  else
    for (std::size_t i = 2; i < json.size(); ++i) out.operands.push_back(json[i].get<int>());
  return out;
}

void read_json(const Json& json, FunctionText& function) {
  function.name = json.at("name").get<std::string>();
  for (const Json& port : json.at("inputs")) {
    function.inputs.push_back(port_of(port));
    if (function.inputs.back().elements.size() != function.inputs.back().size())
      throw std::invalid_argument("input '" + function.inputs.back().name + "' has not a name for each element");
  }
  for (const Json& port : json.at("outputs")) function.outputs.push_back(port_of(port));
  for (const Json& row : json.at("instructions")) function.instructions.push_back(instruction_of(row));
  for (const Json& sample : json.at("samples")) {
    FunctionSample values;
    for (const Json& port : sample.at("in")) values.in.push_back(numbers(port));
    for (const Json& port : sample.at("out")) values.out.push_back(numbers(port));
    function.samples.push_back(values);
  }
}

// ---- details ----------------------------------------------------------------------------------------

/// Reads and keeps what a person has written about a function.
class DetailsReader {
 public:
  DetailsReader(std::string path, FunctionDetails& details, Words& errors)
      : path_(std::move(path)), details_(details), errors_(errors) {}

  void read(const Json& json) {
    if (!json.is_object()) return error("", "is no table of keys");
    const Words known{"name", "period_s", "time", "names", "parameters", "limits", "joints", "angles"};
    for (const auto& [key, value] : json.items()) {
      if (key == "name") {
        if (expect(value.is_string(), key, "a text")) details_.name = value.get<std::string>();
      } else if (key == "period_s") {
        if (expect(value.is_number() && value.get<double>() > 0.0, key, "a number of seconds above 0"))
          details_.period_s = value.get<double>();
      } else if (key == "time") {
        const bool is = value.is_string() && (value == "s" || value == "min" || value == "h");
        if (expect(is, key, "\"s\", \"min\" or \"h\", what the derivatives are per"))
          details_.time = value.get<std::string>();
      } else if (key == "names") {
        each(value, key, [&](const std::string& port, const Json& names) { read_names(port, names); });
      } else if (key == "parameters") {
        each(value, key, [&](const std::string& name, const Json& v) { read_values(name, v); });
      } else if (key == "limits") {
        each(value, key, [&](const std::string& name, const Json& v) { read_limits(name, v); });
      } else if (key == "joints") {
        each(value, key, [&](const std::string& name, const Json& v) { read_joint(name, v); });
      } else if (key == "angles") {
        if (!expect(is_words(value), key, "a list of states' names")) continue;
        details_.has_angles = true;
        details_.angles = value.get<Words>();
      } else {
        const std::string near = nearest(key, known);
        error(key, "is no key here; " + (near.empty() ? "there are " + join(known) : "is '" + near + "' meant?"));
      }
    }
  }

 private:
  void error(const std::string& key, const std::string& what) {
    errors_.push_back(path_ + ": " + (key.empty() ? "" : key + " ") + what);
  }
  bool expect(bool is, const std::string& key, const std::string& what) {
    if (!is) error(key, "is not " + what);
    return is;
  }
  static bool is_words(const Json& json) {
    return json.is_array() && std::all_of(json.begin(), json.end(), [](const Json& word) { return word.is_string(); });
  }
  template <class Take>
  void each(const Json& table, const std::string& key, const Take& take) {
    if (!expect(table.is_object(), key, "a table")) return;
    for (const auto& [name, value] : table.items()) take(name, value);
  }

  void read_names(const std::string& port, const Json& names) {
    if (expect(is_words(names), "names." + port, "a list of texts")) details_.names[port] = names.get<Words>();
  }

  /// A number, a list, or a matrix by rows, which becomes columns as CasADi has it.
  void read_values(const std::string& name, const Json& value) {
    const std::string key = "parameters." + name, what = "a number, a list of numbers or a list of rows of one length";
    std::vector<std::vector<double>> rows;
    for (const Json& row : value.is_array() ? value : Json::array({value})) {
      rows.emplace_back();
      for (const Json& v : row.is_array() ? row : Json::array({row})) {
        if (!expect(v.is_number(), key, what)) return;
        rows.back().push_back(v.get<double>());
      }
      if (!expect(rows.back().size() == rows[0].size(), key, what)) return;
    }
    std::vector<double>& columns = details_.parameters[name];
    columns.clear();
    for (std::size_t c = 0; !rows.empty() && c < rows[0].size(); ++c)
      for (const std::vector<double>& row : rows) columns.push_back(row[c]);
    for (const double v : columns)
      if (!expect(std::isfinite(v), key, "finite")) return;
  }

  void read_limits(const std::string& name, const Json& value) {
    const std::string key = "limits." + name;
    const bool pair = value.is_array() && value.size() == 2 && value[0].is_number() && value[1].is_number();
    if (!expect(pair || value.is_number(), key, "a number (of both signs) or [low, high]")) return;
    const double low = pair ? value[0].get<double>() : -value.get<double>();
    const double high = pair ? value[1].get<double>() : value.get<double>();
    if (expect(low < high && std::isfinite(high - low), key, "a range whose low end is below its high one"))
      details_.limits[name] = {low, high};
  }

  void read_joint(const std::string& name, const Json& value) {
    const std::string key = "joints." + name;
    const auto is_text = [&](const char* part) { return value.contains(part) && value[part].is_string(); };
    if (!expect(value.is_object() && value.size() == 2 && is_text("velocity") && is_text("force"), key,
                "{ velocity = \"STATE\", force = \"INPUT or element of f\" }"))
      return;
    details_.joints.push_back({name, value["velocity"].get<std::string>(), value["force"].get<std::string>()});
  }

  const std::string path_;
  FunctionDetails& details_;
  Words& errors_;
};

/// One row of a list a line, so that a person and `diff` can read it.
std::string one_row_a_line(const Json& json) {
  std::string out;
  for (const auto& [key, value] : json.items()) {
    out += (out.empty() ? "{\n " : ",\n ") + Json(key).dump() + ": ";
    if (!value.is_array() || value.empty() || !value[0].is_structured()) {
      out += value.dump();
      continue;
    }
    for (std::size_t i = 0; i < value.size(); ++i) out += (i == 0 ? "[\n  " : ",\n  ") + value[i].dump();
    out += "\n ]";
  }
  return out + "\n}\n";
}

/// A TOML text as JSON; null with an error.
Json json_of(const std::string& text, const std::string& path, Words& errors) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  try {
    if (first != std::string::npos && text[first] == '{') return Json::parse(text);
    std::stringstream json;
    json << toml::json_formatter{toml::parse(text)};
    return Json::parse(json.str());
  } catch (const toml::parse_error& e) {
    errors.push_back(path + ":" + std::to_string(e.source().begin.line) + ": " + std::string(e.description()));
  } catch (const Json::exception& e) {
    errors.push_back(path + ": cannot be read: " + e.what());
  }
  return nullptr;
}

bool read_python(const std::string& path, std::string& json, Words& errors) {
  std::error_code code;
  std::string folder = (std::filesystem::temp_directory_path(code) / "tiller-casadi-XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) {
    errors.push_back(folder + ": no folder for temporary files; set TMPDIR to one that can be written");
    return false;
  }
  const std::string out = folder + "/function.json";
  std::string error;
  const bool ran = run_python_tool("casadi_function", {path, out}, error);
  if (ran)
    json = file_text(out);
  else
    errors.push_back(path + ": " + error);
  std::filesystem::remove_all(folder, code);
  return ran;
}

bool is_json(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  return first != std::string::npos && text[first] == '{';
}

}  // namespace

bool is_function(const std::string& path) {
  const std::string text = file_text(path);
  if (is_json(text)) return text.find("\"casadi\"") != std::string::npos;
  constexpr std::size_t kHead = 32;  // CasADi writes half a byte as one of the first sixteen letters
  return text.size() > kHead &&
         std::all_of(text.begin(), text.begin() + kHead, [](char c) { return c >= 'a' && c <= 'p'; });
}

bool read_compiled_function(const std::string& json, const std::string& path, FunctionText& function, Words& errors) {
  function = {};
  function.path = path;
  function.compiled = json;
  const std::size_t before = errors.size();
  try {
    const Json parsed = Json::parse(json);
    if (parsed.contains("error")) {
      errors.push_back(path + ": " + parsed["error"].get<std::string>());
      return false;
    }
    read_json(parsed, function);
    if (parsed.contains("details")) DetailsReader(path, function.details, errors).read(parsed["details"]);
    if (parsed.contains("details")) function.details.path = path;
  } catch (const std::exception& e) {
    errors.push_back(path + ": what tiller_tools.casadi_function says of it cannot be read: " + e.what());
  }
  return errors.size() == before;
}

bool read_function_details(const std::string& text, const std::string& path, FunctionText& function, Words& errors) {
  const std::size_t before = errors.size();
  const Json details = json_of(text, path, errors);
  if (errors.size() != before) return false;
  DetailsReader(path, function.details, errors).read(details);
  if (path.rfind("--", 0) != 0) function.details.path = path;  // an option is no place to write more
  Json kept = Json::parse(function.compiled);
  kept["details"].merge_patch(details);
  function.compiled = one_row_a_line(kept);
  return errors.size() == before;
}

bool read_function(const std::string& path, const std::string& details, FunctionText& function, Words& errors) {
  std::string json = file_text(path);
  if (!is_json(json) && !read_python(path, json, errors)) return false;
  if (!read_compiled_function(json, path, function, errors)) return false;
  if (!details.empty()) {
    if (std::filesystem::exists(details)) return read_function_details(file_text(details), details, function, errors);
    errors.push_back(details + ": there is no such file; --details names the TOML or JSON about the function");
    return false;
  }
  const std::string stem = std::filesystem::path(path).replace_extension().string();
  for (const std::string& beside : {stem + ".details.toml", stem + ".details.json"})
    if (std::filesystem::exists(beside)) return read_function_details(file_text(beside), beside, function, errors);
  return true;
}

}  // namespace tiller::tools
