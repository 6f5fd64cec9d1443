#include "tools/identify/method.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/base/text.hpp"

namespace tiller::tools {

const std::vector<Method>& methods() {
  static const std::vector<Method> list = {
#define TILLER_METHOD(name, help, citation, caveat) {#name, help, citation, caveat},
#include "tools/identify/methods.def"
#undef TILLER_METHOD
  };
  return list;
}

const Method* find_method(const std::string& name) {
  for (const Method& method : methods())
    if (name == method.name) return &method;
  return nullptr;
}

std::string method_names() {
  Words names;
  for (const Method& method : methods()) names.emplace_back(method.name);
  return join(names);
}

double effective_samples(const std::vector<double>& weight) {
  double square = 0;
  for (const double w : weight) square += w * w;
  return square > 0 ? 1 / square : 0;
}

void weighted_moments(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np,
                      MethodIteration& iteration) {
  iteration.mean.assign(np, 0.0);
  iteration.sd.assign(np, 0.0);
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::size_t i = 0; i < np; ++i) iteration.mean[i] += weight[s] * params[s * np + i];
  for (std::size_t s = 0; s < weight.size(); ++s)
    for (std::size_t i = 0; i < np; ++i) {
      const double d = params[s * np + i] - iteration.mean[i];
      iteration.sd[i] += weight[s] * d * d;
    }
  for (double& v : iteration.sd) v = std::sqrt(v);
}

double weighted_quantile(const std::vector<double>& params, const std::vector<double>& weight, std::size_t np,
                         std::size_t param, double q) {
  std::vector<std::size_t> order;
  for (std::size_t s = 0; s < weight.size(); ++s)
    if (weight[s] > 0) order.push_back(s);
  const auto value = [&](std::size_t s) { return params[s * np + param]; };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return value(a) < value(b) || (value(a) == value(b) && a < b); });
  double below = 0, last_middle = 0, last_value = NAN;
  for (const std::size_t s : order) {
    const double middle = below + 0.5 * weight[s];
    if (middle >= q) {
      if (std::isnan(last_value)) return value(s);
      return last_value + (q - last_middle) / (middle - last_middle) * (value(s) - last_value);
    }
    below += weight[s];
    last_middle = middle;
    last_value = value(s);
  }
  return last_value;
}

}  // namespace tiller::tools
