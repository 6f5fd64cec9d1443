#include "tools/robot/posterior_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tiller/config.hpp"
#include "tools/base/output_file.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kFormat = "tiller posterior";
constexpr int kVersion = 1;
constexpr std::uintmax_t kLargest_bytes = 1 << 20;  // sixteen parameters and 64 components take a third of it
constexpr const char* kAnew = "write it again with tiller run --save-posterior or tiller identify -o";

/// FNV-1a, 64 bits, over the text without the checksum.
std::string checksum_of(const Json& json) {
  std::uint64_t hash = 14695981039346656037ull;
  for (const char c : json.dump()) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return format("fnv1a-%016llx", static_cast<unsigned long long>(hash));
}

Json rows_of(const double* values, std::uint32_t rows, std::uint32_t columns) {
  Json list = Json::array();
  for (std::uint32_t r = 0; r < rows; ++r)
    list.push_back(std::vector<double>(values + r * columns, values + (r + 1) * columns));
  return list;
}

/// Collects what is wrong and goes on, so that one reading finds everything.
class Checker {
 public:
  Checker(const std::string& path, Words& errors) : path_(path), errors_(errors) {}

  void error(const std::string& key, const Json* value, const std::string& problem, const std::string& remedy) {
    std::string shown;
    if (value) {
      shown = value->is_structured() ? std::string(value->type_name()) : value->dump(-1, ' ', false, kReplace);
      if (shown.size() > 60) shown = shown.substr(0, 57) + "...";
      shown = " = " + shown;
    }
    errors_.push_back(path_ + ": " + key + shown + ": " + problem + "; " + remedy);
    good_ = false;
  }
  bool good() const { return good_; }

  /// The value below `key` if it is there and `fits`.
  template <class Fits>
  const Json* take(const Json& in, const std::string& prefix, const char* key, const char* what, Fits fits) {
    const auto found = in.find(key);
    if (found == in.end()) {
      error(prefix + key, nullptr, "is missing", std::string("it is ") + what + "; " + kAnew);
      return nullptr;
    }
    if (fits(*found)) return &*found;
    error(prefix + key, &*found, std::string("is not ") + what, kAnew);
    return nullptr;
  }
  void refuse_unknown(const Json& in, const std::string& prefix, const Words& known) {
    for (const auto& item : in.items())
      if (index_of(known, item.key()) < 0)
        error(prefix + item.key(), &item.value(), "is unknown", "leave it out; known: " + join(known));
  }

 private:
  static constexpr auto kReplace = Json::error_handler_t::replace;
  const std::string& path_;
  Words& errors_;
  bool good_ = true;
};

bool is_text(const Json& v) { return v.is_string(); }
bool is_object(const Json& v) { return v.is_object(); }
bool is_list(const Json& v) { return v.is_array() && !v.empty(); }
bool is_finite(const Json& v) { return v.is_number() && std::isfinite(v.get<double>()); }
bool is_count(const Json& v) { return v.is_number_unsigned(); }
bool are_finite(const Json& v, std::size_t size) {
  return v.is_array() && v.size() == size && std::all_of(v.begin(), v.end(), is_finite);
}

void read_parameters(const Json& root, Checker& check, StoredPosterior& out) {
  const Json* list = check.take(root, "", "parameters", "a list of one to sixteen parameters",
                                [](const Json& v) { return is_list(v) && v.size() <= TILLER_MAX_PARAMS; });
  if (!list) return;
  std::size_t index = 0;
  for (const Json& one : *list) {
    const std::string prefix = "parameters[" + std::to_string(++index) + "].";
    if (!one.is_object()) {
      check.error("parameters[" + std::to_string(index) + "]", &one, "is no table with name and coordinate", kAnew);
      continue;
    }
    const Json* name = check.take(one, prefix, "name", "a name", is_text);
    const Json* coordinate = check.take(one, prefix, "coordinate", "\"value\" or \"logarithm\"",
                                        [](const Json& v) { return v == "value" || v == "logarithm"; });
    check.refuse_unknown(one, prefix, {"name", "coordinate"});
    if (!name || !coordinate) continue;
    if (index_of(out.params, name->get<std::string>()) >= 0)
      check.error(prefix + "name", name, "stands there twice", kAnew);
    out.params.push_back(name->get<std::string>());
    out.is_logarithm.push_back(*coordinate == "logarithm");
  }
}

void read_component(const Json& one, const std::string& prefix, std::size_t d, Checker& check, GaussianMixture& out) {
  const Json* weight = check.take(one, prefix, "weight", "a number in [0, 1]",
                                  [](const Json& v) { return is_finite(v) && v >= 0.0 && v <= 1.0; });
  const std::string mean_text = "a list of " + std::to_string(d) + " finite numbers";
  const Json* mean =
      check.take(one, prefix, "mean", mean_text.c_str(), [d](const Json& v) { return are_finite(v, d); });
  const std::string rows_text = "a symmetric matrix of " + std::to_string(d) + " rows of finite numbers";
  const Json* rows = check.take(one, prefix, "covariance", rows_text.c_str(), [d](const Json& v) {
    if (!v.is_array() || v.size() != d) return false;
    for (const Json& row : v)
      if (!are_finite(row, d)) return false;
    for (std::size_t r = 0; r < d; ++r)
      for (std::size_t c = 0; c < r; ++c)
        if (v[r][c] != v[c][r]) return false;
    return true;
  });
  check.refuse_unknown(one, prefix, {"weight", "mean", "covariance"});
  if (!weight || !mean || !rows) return;
  GaussianMixture alone;
  alone.dimension = static_cast<std::uint32_t>(d);
  alone.weight = {1.0};
  alone.mean = mean->get<std::vector<double>>();
  for (const Json& row : *rows)
    for (const Json& value : row) alone.covariance.push_back(value.get<double>());
  if (roots_of(alone).empty()) {
    check.error(prefix + "covariance", rows, "is not positive definite", kAnew);
    return;
  }
  out.weight.push_back(weight->get<double>());
  out.mean.insert(out.mean.end(), alone.mean.begin(), alone.mean.end());
  out.covariance.insert(out.covariance.end(), alone.covariance.begin(), alone.covariance.end());
}

void read_mixture(const Json& root, Checker& check, StoredPosterior& out) {
  const Json* list = check.take(root, "", "mixture", "a list of 1 to 64 components",
                                [](const Json& v) { return is_list(v) && v.size() <= Mixture::kMaxComponents; });
  if (!list || out.params.empty()) return;
  out.mixture.dimension = static_cast<std::uint32_t>(out.params.size());
  std::size_t index = 0;
  for (const Json& one : *list) {
    const std::string prefix = "mixture[" + std::to_string(++index) + "]";
    if (one.is_object()) {
      read_component(one, prefix + ".", out.params.size(), check, out.mixture);
    } else {
      check.error(prefix, &one, "is no table with weight, mean and covariance", kAnew);
    }
  }
  double sum = 0.0;
  for (const double w : out.mixture.weight) sum += w;
  if (check.good() && std::fabs(sum - 1.0) > 1e-9)
    check.error("mixture", nullptr, "the weights' sum is " + number_text(sum) + ", not one", kAnew);
}

void read_source(const Json& root, Checker& check, StoredPosterior& out) {
  const Json* source = check.take(root, "", "source", "a table that tells where the posterior comes from", is_object);
  if (!source) return;
  const auto count = [&](const char* key) {
    const Json* v = check.take(*source, "source.", key, "a whole number", is_count);
    return v ? v->get<std::uint64_t>() : 0;
  };
  const auto number = [&](const char* key) {
    const Json* v = check.take(*source, "source.", key, "a finite number", is_finite);
    return v ? v->get<double>() : 0.0;
  };
  const auto text = [&](const char* key) {
    const Json* v = check.take(*source, "source.", key, "a text", is_text);
    return v ? v->get<std::string>() : std::string();
  };
  out.robot = text("robot");
  out.created_by = text("created_by");
  out.episodes = count("episodes");
  out.transitions = count("transitions");
  out.particles = static_cast<std::uint32_t>(std::min<std::uint64_t>(count("particles"), UINT32_MAX));
  out.effective_samples = number("effective_samples");
  out.noise_scale = number("noise_scale");
  out.exponent = number("exponent");
  check.refuse_unknown(
      *source, "source.",
      {"robot", "created_by", "episodes", "transitions", "particles", "effective_samples", "noise_scale", "exponent"});
}

/// Format and version before anything else: what follows is only known for those.
bool is_known_format(const Json& root, Checker& check) {
  if (!root.is_object() || !root.contains("format") || root["format"] != kFormat) {
    const Json* format = root.is_object() && root.contains("format") ? &root["format"] : nullptr;
    check.error("format", format, "is no posterior of tiller", kAnew);
    return false;
  }
  if (!root.contains("version") || root["version"] != kVersion) {
    check.error("version", root.contains("version") ? &root["version"] : nullptr,
                "this tiller reads version " + std::to_string(kVersion),
                std::string("use the tiller that wrote it, or ") + kAnew);
    return false;
  }
  return true;
}

/// After the shape is known to be right.
void compare_checksum(Json root, Checker& check) {
  if (!root.contains("checksum")) return;
  const Json given = root["checksum"];
  root.erase("checksum");
  const std::string expected = checksum_of(root);
  if (given != expected)
    check.error("checksum", &given, "the content has " + expected + ": it was damaged or changed by hand",
                "take a good copy; if the change was meant, delete the line \"checksum\"");
}

/// Deeper than any posterior: trees are taken apart by recursion, which would exhaust the stack.
bool is_too_deep(const std::string& text) {
  int depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size() && depth <= 8; ++i) {
    const char c = text[i];
    if (quoted && c == '\\') {
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (!quoted) {
      depth += c == '[' || c == '{' ? 1 : c == ']' || c == '}' ? -1 : 0;
    }
  }
  return depth > 8;
}

int line_of(const std::string& text, std::size_t byte) {
  return 1 + static_cast<int>(std::count(
                 text.begin(), text.begin() + static_cast<std::ptrdiff_t>(std::min(byte, text.size())), '\n'));
}

}  // namespace

StoredPosterior store_posterior(const tiller_config_t& config, const Words& params, const Particles& particles) {
  StoredPosterior out;
  PointCloud cloud;
  Config marginals = config;
  const PriorDistribution law(marginals);
  out.model = config.model->name;
  out.created_by = std::string("tiller ") + tiller_version();
  cloud.dimension = law.dimension();
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    if (config.priors[i].kind == tiller_prior_fixed) continue;
    out.params.push_back(params[i]);
    out.is_logarithm.push_back(config.priors[i].kind == tiller_prior_log_normal);
  }
  for (std::uint32_t j = 0; j < cloud.dimension; ++j) {
    cloud.low.push_back(law.low(j));
    cloud.high.push_back(law.high(j));
    cloud.spread.push_back(law.spread(j));
  }
  const std::size_t np = config.param_count, n = np ? particles.params.size() / np : 0;
  out.particles = static_cast<std::uint32_t>(n);
  double square = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t i = 0; i < np; ++i)
      if (config.priors[i].kind != tiller_prior_fixed)
        cloud.value.push_back(to_coordinate(config.priors[i], particles.params[k * np + i]));
    cloud.weight.push_back(particles.weight.empty() ? 1.0 / static_cast<double>(n) : particles.weight[k]);
    square += cloud.weight.back() * cloud.weight.back();
  }
  out.effective_samples = square > 0.0 ? 1.0 / square : 0.0;
  out.mixture = fit_mixture(cloud);
  return out;
}

std::string posterior_text(const StoredPosterior& p) {
  const std::uint32_t d = p.mixture.dimension;
  Json json = {{"format", kFormat}, {"version", kVersion}, {"model", p.model}};
  for (std::uint32_t j = 0; j < d; ++j)
    json["parameters"].push_back({{"name", p.params[j]}, {"coordinate", p.is_logarithm[j] ? "logarithm" : "value"}});
  for (std::size_t c = 0; c < p.mixture.components(); ++c) {
    const double* mean = &p.mixture.mean[c * d];
    json["mixture"].push_back({{"weight", p.mixture.weight[c]},
                               {"mean", std::vector<double>(mean, mean + d)},
                               {"covariance", rows_of(&p.mixture.covariance[c * d * d], d, d)}});
  }
  json["source"] = {{"robot", p.robot},
                    {"created_by", p.created_by},
                    {"episodes", p.episodes},
                    {"transitions", p.transitions},
                    {"particles", p.particles},
                    {"effective_samples", p.effective_samples},
                    {"noise_scale", p.noise_scale},
                    {"exponent", p.exponent}};
  json["checksum"] = checksum_of(json);
  return json.dump(2) + "\n";
}

bool save_posterior(const std::string& path, const StoredPosterior& posterior, std::string& error) {
  const std::string text = posterior_text(posterior);
  StoredPosterior again;
  Words errors;
  // what could not be read again is not put in the place of what can
  if (parse_posterior(text, path, again, errors)) return replace_file(path, text, error);
  error = path + ": not written: the posterior itself is unusable: " + join(errors, "\n");
  return false;
}

bool parse_posterior(const std::string& text, const std::string& path, StoredPosterior& out, Words& errors) {
  Checker check(path, errors);
  Json root;
  if (is_too_deep(text)) {
    errors.push_back(path + ": is nested deeper than any posterior; " + kAnew);
    return false;
  }
  try {
    root = Json::parse(text);
  } catch (const Json::parse_error& e) {
    errors.push_back(path + ":" + std::to_string(line_of(text, e.byte)) + ": is no JSON, or was cut off; " + kAnew);
    return false;
  } catch (const Json::exception& e) {  // a number out of range
    errors.push_back(path + ": " + e.what() + "; " + kAnew);
    return false;
  }
  if (!is_known_format(root, check)) return false;
  if (const Json* model = check.take(root, "", "model", "a model's name", is_text))
    out.model = model->get<std::string>();
  read_parameters(root, check, out);
  if (check.good()) read_mixture(root, check, out);
  read_source(root, check, out);
  check.refuse_unknown(root, "", {"format", "version", "model", "parameters", "mixture", "source", "checksum"});
  if (check.good()) compare_checksum(root, check);
  return check.good();
}

bool read_posterior(const std::string& path, StoredPosterior& out, Words& errors) {
  namespace fs = std::filesystem;
  std::error_code code;
  const fs::file_status status = fs::status(path, code);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    errors.push_back(path + ": is " + (fs::is_directory(status) ? "a folder" : "no ordinary file") +
                     "; name a posterior file (.json)");
    return false;
  }
  if (const auto size = fs::file_size(path, code); !code && size > kLargest_bytes) {
    errors.push_back(path + ": has " + std::to_string(size) + " bytes, more than any posterior; name a posterior file");
    return false;
  }
  std::ifstream file(path, std::ios::binary);
  std::string text;
  if (file) text.assign(std::istreambuf_iterator<char>(file), {});
  if (!file) {
    errors.push_back(path + ": cannot be read: " + std::strerror(errno) + "; name an existing posterior file");
    return false;
  }
  return parse_posterior(text, path, out, errors);
}

namespace {

/// Position in the posterior of each inferred parameter of the robot file; what does not fit goes to `refuse`.
template <class Refuse>
std::vector<std::size_t> match_parameters(const StoredPosterior& posterior, const RobotFile& robot,
                                          const Refuse& refuse) {
  std::vector<std::size_t> from;
  Words inferred;
  const std::size_t d = posterior.params.size();
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    const tiller_prior_t& prior = robot.config.priors[i];
    if (prior.kind == tiller_prior_fixed) continue;
    const std::string& name = robot.names.params[i];
    inferred.push_back(name);
    const int at = index_of(posterior.params, name);
    if (at < 0) {
      refuse("parameters: has nothing of " + name,
             "give " + name + " a number in the robot file, or learn again with it");
      continue;
    }
    const auto j = static_cast<std::size_t>(at);
    from.push_back(j);
    if (posterior.is_logarithm[j] != (prior.kind == tiller_prior_log_normal)) {
      refuse("parameters." + name + ": is kept as " + (posterior.is_logarithm[j] ? "a logarithm" : "a value"),
             posterior.is_logarithm[j] ? "give it a log_normal prior in the robot file"
                                       : "give it a uniform or normal prior in the robot file");
      continue;
    }
    for (std::size_t c = 0; c < posterior.mixture.components(); ++c) {
      const double mean = posterior.mixture.mean[c * d + j];
      if (mean >= coordinate_low(prior) && mean <= coordinate_high(prior)) continue;
      refuse("mixture[" + std::to_string(c + 1) + "].mean: " + name + " = " +
                 number_text(from_coordinate(prior, mean)) + " lies outside of the robot file's bounds",
             "widen them to hold it, or learn again");
    }
  }
  for (const std::string& name : posterior.params)
    if (index_of(inferred, name) < 0)
      refuse("parameters: holds " + name + ", which has no prior in the robot file",
             "give it one there; inferred there: " + join(inferred));
  return from;
}

GaussianMixture reordered(const GaussianMixture& mixture, std::size_t d, const std::vector<std::size_t>& from) {
  GaussianMixture ordered;
  ordered.dimension = static_cast<std::uint32_t>(d);
  ordered.weight = mixture.weight;
  for (std::size_t c = 0; c < ordered.components(); ++c) {
    for (const std::size_t r : from) ordered.mean.push_back(mixture.mean[c * d + r]);
    for (const std::size_t r : from)
      for (const std::size_t s : from) ordered.covariance.push_back(mixture.covariance[(c * d + r) * d + s]);
  }
  return ordered;
}

}  // namespace

bool take_prior(const StoredPosterior& posterior, const std::string& path, RobotFile& robot, Words& errors) {
  const std::size_t before = errors.size();
  const auto refuse = [&](const std::string& what, const std::string& remedy) {
    errors.push_back(path + ": " + what + "; " + remedy);
  };
  if (posterior.model != robot.config.model->name) {
    refuse("model = \"" + posterior.model + "\": the robot file's model is " + robot.config.model->name,
           "name the posterior of this robot");
    return false;
  }
  const std::vector<std::size_t> from = match_parameters(posterior, robot, refuse);
  if (errors.size() != before) return false;
  const GaussianMixture ordered = reordered(posterior.mixture, posterior.params.size(), from);
  if (roots_of(ordered).empty()) {
    refuse("mixture: a covariance is not positive definite in the robot file's order", kAnew);
    return false;
  }
  robot.memory.joint = std::make_shared<const JointPrior>(ordered);
  robot.config.prior_mixture = &robot.memory.joint->mixture;
  return true;
}

}  // namespace tiller::tools
