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

/// States in their order, an angle by sine and cosine.
std::vector<Feature> file_features(int states, const std::vector<int>& angles) {
  std::vector<Feature> out;
  for (int i = 0; i < states; ++i) {
    const bool angle = std::find(angles.begin(), angles.end(), i) != angles.end();
    if (!angle) out.push_back({Feature::kState, i});
    if (angle) out.push_back({Feature::kSine, i});
    if (angle) out.push_back({Feature::kCosine, i});
  }
  return out;
}

/// (file's inputs x policy's features), ones where they are the same.
Matrix places(const std::vector<Feature>& file, const std::vector<Feature>& own) {
  Matrix out = Matrix::Zero(static_cast<Eigen::Index>(file.size()), static_cast<Eigen::Index>(own.size()));
  for (std::size_t i = 0; i < file.size(); ++i)
    for (std::size_t j = 0; j < own.size(); ++j)
      if (file[i].kind == own[j].kind && file[i].state == own[j].state)
        out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = 1.0;
  return out;
}

void append(std::vector<double>& out, const Matrix& m) {
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j) out.push_back(m(i, j));
}

/// Weights of a linear policy or of a network, its first layer by the file's inputs.
std::vector<double> net_weights(const Policy& p, const Matrix& place) {
  std::vector<double> out;
  const Eigen::Index n = place.cols();
  const bool linear = p.kind == "linear";
  const Eigen::Index rows = linear ? p.weight.rows() : p.net.widths()[1];
  for (Eigen::Index i = 0; i < rows; ++i) {
    const Vector own = linear ? Vector(p.weight.row(i).transpose()) : Vector(p.net.weights.segment(i * (n + 1) + 1, n));
    out.push_back(linear ? p.bias(i) : p.net.weights(i * (n + 1)));
    append(out, (place * own).transpose());
  }
  if (!linear) append(out, p.net.weights.tail(p.net.weights.size() - rows * (n + 1)).transpose());
  return out;
}

std::vector<double> bump_weights(const Policy& p, const Matrix& place) {
  std::vector<double> out;
  append(out, (place * (-p.bumps.log_length.col(0).array()).exp().matrix()).transpose());
  append(out, (place * p.bumps.x).transpose());
  for (Eigen::Index a = 0; a < p.bumps.beta.cols(); ++a) {
    out.push_back(0.0);
    append(out, p.bumps.beta.col(a).transpose());
  }
  return out;
}

Json network_of(const Policy& p, const std::vector<Feature>& file) {
  const Matrix place = places(file, p.features);
  std::vector<int> hidden = {0, 0};
  if (p.kind == "rbf") hidden[0] = static_cast<int>(p.bumps.x.cols());
  if (p.kind == "tanh")
    for (std::size_t l = 1; l + 1 < p.net.widths().size() && l <= 2; ++l) hidden[l - 1] = p.net.widths()[l];
  Json json;
  json["kind"] = p.kind == "rbf" ? "gaussian" : "tanh";
  for (const Feature& f : file) json["inputs"].push_back(feature_name(f, p.states));
  json["outputs"] = p.commands;
  json["members"] = 1;
  json["hidden"] = hidden;
  json["weights"] = p.kind == "rbf" ? bump_weights(p, place) : net_weights(p, place);
  return json;
}

/// Takes values and keeps the first thing that is wrong.
class Reader {
 public:
  Reader(const Json& json, const std::string& path, std::string& error) : json_(json), path_(path), error_(error) {}

  bool good() const { return error_.empty(); }
  void fail(const std::string& key, const std::string& what) {
    if (good()) error_ = path_ + ": " + key + ": " + what + "; write the file again with tiller policy";
  }
  Json value(const char* key) const { return json_.value(key, Json()); }
  std::string text(const char* key, const Words& known) {
    const Json v = value(key);
    if (v.is_string() && std::find(known.begin(), known.end(), v.get<std::string>()) != known.end())
      return v.get<std::string>();
    fail(key, "is not one of " + join(known));
    return "";
  }
  Words words(const char* key, bool may_be_empty) {
    Words out;
    const Json v = value(key);
    bool fits = v.is_array() && (may_be_empty || !v.empty());
    for (std::size_t i = 0; fits && i < v.size(); ++i) {
      fits = v[i].is_string();
      if (fits) out.push_back(v[i].get<std::string>());
    }
    if (!fits) fail(key, "is no list of names");
    return out;
  }
  Vector numbers(const char* key, std::size_t size) {
    const Json v = value(key);
    Vector out = Vector::Zero(static_cast<Eigen::Index>(size));
    bool fits = v.is_array() && v.size() == size;
    for (std::size_t i = 0; fits && i < size; ++i) {
      fits = v[i].is_number() && std::isfinite(v[i].get<double>());
      if (fits) out(static_cast<Eigen::Index>(i)) = v[i].get<double>();
    }
    if (!fits) fail(key, "is no list of " + std::to_string(size) + " finite numbers");
    return out;
  }

 private:
  const Json& json_;
  const std::string& path_;
  std::string& error_;
};

void take_bumps(const Vector& w, Eigen::Index inputs, Eigen::Index outputs, Eigen::Index n, Policy& policy) {
  Bumps& b = policy.bumps;
  // an inverse length of zero: the input has no say
  const Vector inverse = w.head(inputs).cwiseMax(1e-9);
  b.log_length = (-inverse.array().log()).matrix().replicate(1, outputs);
  b.x = Eigen::Map<const Matrix>(w.data() + inputs, inputs, n);
  b.log_signal = Vector::Zero(outputs);
  b.beta.resize(n, outputs);
  for (Eigen::Index a = 0; a < outputs; ++a) b.beta.col(a) = w.segment(inputs + n * inputs + a * (n + 1) + 1, n);
}

void read_network(const Json& json, const std::string& path, std::string& error, Policy& policy) {
  Reader read(json, path, error);
  const auto inputs = static_cast<Eigen::Index>(policy.features.size());
  Words names;
  for (const Feature& f : policy.features) names.push_back(feature_name(f, policy.states));
  if (read.words("inputs", false) != names) read.fail("network.inputs", "are not the states, " + join(names));
  policy.commands = read.words("outputs", false);
  policy.kind = read.text("kind", {"tanh", "gaussian"}) == "gaussian" ? "rbf" : "tanh";
  if (read.value("members") != 1) read.fail("network.members", "is not 1");
  const Vector hidden = read.numbers("hidden", 2);
  if (hidden.minCoeff() < 0 || hidden.maxCoeff() > 512) read.fail("network.hidden", "is beyond 0 to 512");
  if (!read.good()) return;
  const auto outputs = static_cast<Eigen::Index>(policy.commands.size());
  const auto first = static_cast<Eigen::Index>(hidden(0));
  if (policy.kind == "rbf") {
    const Eigen::Index count = inputs * (1 + first) + outputs * (1 + first);
    const Vector w = read.numbers("weights", static_cast<std::size_t>(count));
    if (read.good()) take_bumps(w, inputs, outputs, first, policy);
    return;
  }
  std::vector<int> widths = {static_cast<int>(inputs)};
  for (int l = 0; l < 2; ++l)
    if (hidden(l) > 0) widths.push_back(static_cast<int>(hidden(l)));
  widths.push_back(static_cast<int>(outputs));
  policy.net = nets::Mlp(widths);
  policy.net.weights = read.numbers("weights", static_cast<std::size_t>(policy.net.weights.size()));
}

}  // namespace

std::string policy_text(const Policy& policy, const std::vector<int>& angles) {
  const std::vector<Feature> file = file_features(static_cast<int>(policy.states.size()), angles);
  Json json = {{"format", kFormat}, {"version", 1}};
  json["reads"] = {"state"};
  json["squash"] = policy.sine ? "sine" : "cut";
  json["input_low"] = json["input_high"] = Json::array();
  json["network"] = network_of(policy, file);
  json["period_s"] = policy.period_s;
  json["states"] = policy.states;
  json["angles"] = Json::array();
  for (const int i : angles) json["angles"].push_back(policy.states[static_cast<std::size_t>(i)]);
  json["low"] = list_of(policy.low);
  json["high"] = list_of(policy.high);
  return json.dump(1) + "\n";
}

bool parse_policy(const std::string& text, const std::string& path, Policy& policy, std::string& error) {
  policy = {};
  error.clear();
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_object() || json.value("format", Json()) != kFormat) {
    error = path + ": is no policy file; write one with tiller policy";
    return false;
  }
  Reader read(json, path, error);
  if (json.value("version", Json()) != 1) read.fail("version", "is not 1, the one that this program knows");
  if (read.words("reads", false) != Words{"state"}) read.fail("reads", "is more than the state");
  policy.sine = read.text("squash", {"sine", "cut"}) == "sine";
  policy.states = read.words("states", false);
  std::vector<int> angles;
  for (const std::string& name : read.words("angles", true)) {
    const auto at = std::find(policy.states.begin(), policy.states.end(), name);
    if (at == policy.states.end()) read.fail("angles", name + " is no state");
    angles.push_back(static_cast<int>(at - policy.states.begin()));
  }
  const Json period = read.value("period_s"), network = read.value("network");
  if (period.is_number() && period.get<double>() > 0.0)
    policy.period_s = period.get<double>();
  else
    read.fail("period_s", "is no number above zero");
  if (!network.is_object()) read.fail("network", "is no object");
  if (!read.good()) return false;
  policy.features = file_features(static_cast<int>(policy.states.size()), angles);
  read_network(network, path, error, policy);
  policy.low = read.numbers("low", policy.commands.size());
  policy.high = read.numbers("high", policy.commands.size());
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
