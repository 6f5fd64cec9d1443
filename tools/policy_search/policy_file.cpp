#include "tools/policy_search/policy_file.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tiller::tools::policy {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kFormat = "tiller policy";

Json list_of(const Vector& v) { return std::vector<double>(v.data(), v.data() + v.size()); }
Json rows_of(const Matrix& m) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) rows.push_back(list_of(m.row(i).transpose()));
  return rows;
}

/// Takes values and keeps the first thing that is wrong.
class Reader {
 public:
  Reader(const Json& json, const std::string& path, std::string& error) : json_(json), path_(path), error_(error) {}

  bool good() const { return error_.empty(); }
  void fail(const std::string& key, const std::string& what) {
    if (good()) error_ = path_ + ": " + key + ": " + what + "; write the file again with tiller policy";
  }
  std::string text(const char* key, const Words& known) {
    const auto v = json_.find(key);
    if (v != json_.end() && v->is_string())
      if (const std::string found = v->get<std::string>();
          known.empty() || std::find(known.begin(), known.end(), found) != known.end())
        return found;
    fail(key, known.empty() ? "is no text" : "is not one of " + join(known));
    return "";
  }
  Words words(const char* key) {
    Words out;
    const auto v = json_.find(key);
    bool fits = v != json_.end() && v->is_array() && !v->empty();
    for (std::size_t i = 0; fits && i < v->size(); ++i) {
      fits = (*v)[i].is_string();
      if (fits) out.push_back((*v)[i].get<std::string>());
    }
    if (!fits) fail(key, "is no list of names");
    return out;
  }
  Vector numbers(const Json& v, const char* key, std::size_t size) {
    Vector out = Vector::Zero(static_cast<Eigen::Index>(size));
    bool fits = v.is_array() && v.size() == size;
    for (std::size_t i = 0; fits && i < size; ++i) {
      fits = v[i].is_number() && std::isfinite(v[i].get<double>());
      if (fits) out(static_cast<Eigen::Index>(i)) = v[i].get<double>();
    }
    if (!fits) fail(key, "is no list of " + std::to_string(size) + " finite numbers");
    return out;
  }
  Vector numbers(const char* key, std::size_t size) {
    static const Json nothing;
    const auto v = json_.find(key);
    return numbers(v == json_.end() ? nothing : *v, key, size);
  }
  /// rows 0: as many as there are.
  Matrix rows(const char* key, std::size_t rows, std::size_t cols) {
    const auto v = json_.find(key);
    if (v == json_.end() || !v->is_array() || v->empty() || (rows > 0 && v->size() != rows)) {
      fail(key, "is no list of " + (rows > 0 ? std::to_string(rows) + " " : std::string()) + "rows");
      return {};
    }
    Matrix out(static_cast<Eigen::Index>(v->size()), static_cast<Eigen::Index>(cols));
    for (std::size_t i = 0; i < v->size(); ++i)
      out.row(static_cast<Eigen::Index>(i)) = numbers((*v)[i], key, cols).transpose();
    return out;
  }
  std::size_t size_of(const char* key) const {
    const auto v = json_.find(key);
    return v != json_.end() && v->is_array() ? v->size() : 0;
  }

 private:
  const Json& json_;
  const std::string& path_;
  std::string& error_;
};

bool parse_feature(const std::string& name, const Words& states, Feature& out) {
  for (const Feature::Kind kind : {Feature::kState, Feature::kSine, Feature::kCosine})
    for (int i = 0; i < static_cast<int>(states.size()); ++i) {
      out = {kind, i};
      if (feature_name(out, states) == name) return true;
    }
  return false;
}

void read_net(Reader& read, std::size_t features, std::size_t commands, Policy& policy) {
  const Vector widths = read.numbers("widths", read.size_of("widths"));
  std::vector<int> w;
  for (Eigen::Index i = 0; i < widths.size(); ++i) w.push_back(static_cast<int>(widths(i)));
  const bool fits = w.size() >= 2 && w.front() == static_cast<int>(features) &&
                    w.back() == static_cast<int>(commands) && *std::min_element(w.begin(), w.end()) >= 1 &&
                    *std::max_element(w.begin(), w.end()) <= 4096;
  if (!fits) return read.fail("widths", "are not those of a network from the inputs to the commands");
  policy.net = nets::Mlp(w);
  policy.net.weights = read.numbers("weights", static_cast<std::size_t>(policy.net.weights.size()));
}

void read_bumps(Reader& read, std::size_t features, std::size_t commands, Policy& policy) {
  const Matrix centres = read.rows("centres", 0, features), inverse = read.rows("inverse_lengths", commands, features);
  const Matrix weights = read.rows("weights", commands, static_cast<std::size_t>(centres.rows()));
  if (!read.good()) return;
  if (!(inverse.minCoeff() > 0.0)) return read.fail("inverse_lengths", "are not all above zero");
  policy.bumps.x = centres.transpose();
  policy.bumps.log_length = -inverse.transpose().array().log();
  policy.bumps.log_signal = Vector::Zero(static_cast<Eigen::Index>(commands));
  policy.bumps.beta = weights.transpose();
}

}  // namespace

std::string policy_text(const Policy& policy) {
  Json json = {{"format", kFormat},           {"version", 1},
               {"kind", policy.kind},         {"squash", policy.sine ? "sine" : "cut"},
               {"period_s", policy.period_s}, {"states", policy.states},
               {"commands", policy.commands}};
  for (const Feature& f : policy.features) json["inputs"].push_back(feature_name(f, policy.states));
  json["low"] = list_of(policy.low);
  json["high"] = list_of(policy.high);
  if (policy.kind == "linear") {
    json["weight"] = rows_of(policy.weight);
    json["bias"] = list_of(policy.bias);
  } else if (policy.kind == "rbf") {
    json["centres"] = rows_of(policy.bumps.x.transpose());
    json["inverse_lengths"] = rows_of((-policy.bumps.log_length.array()).exp().matrix().transpose());
    json["weights"] = rows_of(policy.bumps.beta.transpose());
  } else {
    json["widths"] = policy.net.widths();
    json["weights"] = list_of(policy.net.weights);
  }
  return json.dump(1) + "\n";
}

bool parse_policy(const std::string& text, const std::string& path, Policy& policy, std::string& error) {
  policy = {};
  error.clear();
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object() || json.value("format", Json()) != kFormat) {
    error = path + ": is no policy file; write one with tiller policy";
    return false;
  }
  Reader read(json, path, error);
  if (json.value("version", Json()) != 1) read.fail("version", "is not 1, the one that this program knows");
  policy.kind = read.text("kind", {"linear", "rbf", "tanh"});
  policy.sine = read.text("squash", {"sine", "cut"}) == "sine";
  policy.states = read.words("states");
  policy.commands = read.words("commands");
  for (const std::string& name : read.words("inputs")) {
    Feature feature;
    if (!parse_feature(name, policy.states, feature)) read.fail("inputs", name + " is made of no state");
    policy.features.push_back(feature);
  }
  const std::size_t features = policy.features.size(), commands = policy.commands.size();
  policy.low = read.numbers("low", commands);
  policy.high = read.numbers("high", commands);
  const Json period = json.value("period_s", Json());
  if (period.is_number() && period.get<double>() > 0.0)
    policy.period_s = period.get<double>();
  else
    read.fail("period_s", "is no number above zero");
  if (policy.kind == "linear") {
    policy.weight = read.rows("weight", commands, features);
    policy.bias = read.numbers("bias", commands);
  } else if (policy.kind == "rbf") {
    read_bumps(read, features, commands, policy);
  } else if (policy.kind == "tanh") {
    read_net(read, features, commands, policy);
  }
  return read.good();
}

bool read_policy(const std::string& path, Policy& policy, std::string& error) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    error = path + ": cannot be read; name a policy file of tiller policy";
    return false;
  }
  std::stringstream text;
  text << file.rdbuf();
  return parse_policy(text.str(), path, policy, error);
}

}  // namespace tiller::tools::policy
