// The functions of a table from outside, called between guards.
#include <csignal>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/rng.hpp"
#include "tools/base/process_copy.hpp"
#include "tools/robot/model_table.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kGuards = 64;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kFirstFill = 0x1.23456789abcdep-300, kSecondFill = -0x1.fedcba9876543p+300;  // nobody's results
constexpr int kPoints = 8;

bool same_bits(const double* a, const double* b, std::size_t count) {
  return count == 0 || std::memcmp(a, b, count * sizeof(double)) == 0;
}

/// An argument's array: its name, what the table calls its length, and the length.
struct Array {
  const char *name, *count_name;
  std::size_t count;
  bool is(const char* other) const { return std::strcmp(name, other) == 0; }
};

/// The array as a function of the model gets it, between guard numbers.
class Guarded : public Array {
 public:
  explicit Guarded(const Array& array) : Array(array), numbers_(count + 2 * kGuards) {}

  double* data() { return numbers_.data() + kGuards; }
  const double* data() const { return numbers_.data() + kGuards; }
  void fill(double number, double guard) {
    numbers_.assign(numbers_.size(), guard);
    for (std::size_t i = 0; i < count; ++i) data()[i] = number;
  }
  void set(const std::vector<double>& values, double guard) {
    fill(0.0, guard);
    for (std::size_t i = 0; i < count; ++i) data()[i] = values[i];
  }
  /// "name[2]", where a guard is no longer `guard`; "" where all stand.
  std::string overwritten(double guard) const {
    for (std::size_t i = 0; i < numbers_.size(); ++i) {
      const bool inside = i >= kGuards && i < kGuards + count;
      if (!inside && !same_bits(&numbers_[i], &guard, 1))
        return std::string(name) + "[" + std::to_string(static_cast<long>(i) - static_cast<long>(kGuards)) + "]";
    }
    return "";
  }

 private:
  std::vector<double> numbers_;
};

using Arrays = std::vector<Guarded>;
Arrays arrays(std::initializer_list<Array> list) { return Arrays(list.begin(), list.end()); }

/// One function of the table.
struct Function {
  std::string name;
  Arrays in, out;
  std::function<void(const Arrays& in, Arrays& out)> call;
};

std::vector<Function> functions_of(const tiller_model_t& m) {
  static constexpr tiller_body_t body = {0.0, -9.81, 0.0, 0.0};
  const std::size_t nx = m.state_count, nu = m.input_count;
  const Array x = {"x", "state_count", nx}, u = {"u", "input_count", nu}, f = {"f", "joint_count", m.joint_count},
              p = {"p", "param_count", m.param_count};
  std::vector<Function> functions;
  if (m.dynamics)
    functions.push_back(
        {"dynamics", arrays({x, u, f, p}), arrays({{"dxdt", "state_count", nx}}), [&m](const Arrays& in, Arrays& out) {
           m.dynamics(in[0].data(), in[1].data(), in[2].data(), &body, in[3].data(), out[0].data());
         }});
  if (m.jacobian)
    functions.push_back(
        {"jacobian", arrays({x, u, f, p}), arrays({{"a", "state_count", nx * nx}, {"b", "input_count", nx * nu}}),
         [&m](const Arrays& in, Arrays& out) {
           m.jacobian(in[0].data(), in[1].data(), in[2].data(), &body, in[3].data(), out[0].data(), out[1].data());
         }});
  if (m.output_count > 0)
    functions.push_back(
        {"outputs", arrays({x, p}), arrays({{"y", "output_count", m.output_count}}),
         [&m](const Arrays& in, Arrays& out) { m.outputs(in[0].data(), in[1].data(), out[0].data()); }});
  return functions;
}

/// One function at one point.
class Probe {
 public:
  Probe(const tiller_model_t& model, Function& function, const std::vector<std::vector<double>>& point)
      : model_(model), f_(function), point_(point) {}

  std::string problem() {
    const Arrays first = call(0.0, kFirstFill);
    if (!problem_.empty()) return problem_;
    const Arrays second = call(0.0, kSecondFill), again = call(0.0, kFirstFill);
    for (std::size_t k = 0; k < first.size(); ++k)
      for (std::size_t i = 0; i < first[k].count; ++i) {
        if (!same_bits(first[k].data() + i, again[k].data() + i, 1))
          return f_.name + " answers differently to the same arguments at " + element(first[k], i) +
                 "; it must depend on its arguments alone: no static variables, no random numbers, nothing read "
                 "before it is written";
        if (!same_bits(first[k].data() + i, second[k].data() + i, 1))
          return f_.name + " does not write " + element(first[k], i) +
                 "; it must write every number, as double: a signature with float writes half of them";
      }
    for (std::size_t j = 0; j < f_.in.size(); ++j) {
      const Arrays beyond = call(kNaN, kFirstFill, static_cast<int>(j));
      for (std::size_t k = 0; k < first.size(); ++k)
        if (!same_bits(first[k].data(), beyond[k].data(), first[k].count))
          return f_.name + " reads beyond " + f_.in[j].name + ", whose length is " + f_.in[j].count_name + " = " +
                 std::to_string(f_.in[j].count);
    }
    return problem_;
  }

 private:
  /// The results with `guard` around argument `which` (-1: around all), `fill` in and around what it writes.
  Arrays call(double guard, double fill, int which = -1) {
    const auto guard_of = [&](std::size_t j) { return which < 0 || which == static_cast<int>(j) ? guard : 0.0; };
    for (std::size_t j = 0; j < f_.in.size(); ++j) f_.in[j].set(point_[j], guard_of(j));
    Arrays out = f_.out;
    for (Guarded& array : out) array.fill(fill, fill);
    f_.call(f_.in, out);
    for (const Guarded& array : out)
      if (const std::string at = array.overwritten(fill); !at.empty() && problem_.empty())
        problem_ = f_.name + " writes " + at + ", outside of " + array.name + ", whose length is " + length(array);
    for (std::size_t j = 0; j < f_.in.size(); ++j)
      if (problem_.empty() &&
          (!f_.in[j].overwritten(guard_of(j)).empty() || !same_bits(f_.in[j].data(), point_[j].data(), f_.in[j].count)))
        problem_ = f_.name + " changes its argument " + f_.in[j].name;
    return out;
  }
  std::string length(const Guarded& array) const {
    const std::string rows = "state_count = " + std::to_string(model_.state_count);
    if (f_.name != "jacobian") return std::string(array.count_name) + " = " + std::to_string(array.count);
    return std::to_string(array.count) + " (" + rows +
           (array.is("a") ? ", squared)" : ", times input_count = " + std::to_string(model_.input_count) + ")");
  }
  /// "dxdt[1] (rate_rad_s)"
  std::string element(const Guarded& array, std::size_t i) const {
    const std::string at = std::string(array.name) + "[" + std::to_string(i) + "]";
    if (array.is("dxdt")) return at + " (of " + model_.state_names[i] + ")";
    if (array.is("y")) return at + " (" + model_.output_names[i] + ")";
    const bool states = array.is("a");
    const std::size_t columns = states ? model_.state_count : model_.input_count;
    return at + " (of " + model_.state_names[i / columns] + " by " +
           (states ? model_.state_names : model_.input_names)[i % columns] + ")";
  }

  const tiller_model_t& model_;
  Function& f_;
  const std::vector<std::vector<double>>& point_;
  std::string problem_;
};

/// Zeros, ones, and random numbers: parameters above 0, all others on both sides of it.
std::vector<double> numbers(const Guarded& array, int point, Rng& rng) {
  std::vector<double> values(array.count, point == 0 ? 0.0 : 1.0);
  if (point > 1)
    for (double& value : values) value = array.is("p") ? 0.1 + 2.0 * rng.uniform() : 2.0 * rng.uniform() - 1.0;
  return values;
}

std::string signal_text(int signal) {
  if (signal == SIGALRM || signal == SIGXCPU) return "does not return";
  if (signal == SIGSEGV || signal == SIGBUS) return "reads or writes memory that is not there (segmentation fault)";
  return "ends the process (" + std::string(strsignal(signal)) + ")";
}

}  // namespace

std::string check_model_functions(const tiller_model_t& model) {
  constexpr unsigned kMostSeconds = 2;  // of a few dozen calls
  for (Function& function : functions_of(model)) {
    const auto work = [&] {
      std::string problem;
      for (int k = 0; k < kPoints && problem.empty(); ++k) {
        Rng rng(1, kRngPrior, static_cast<std::uint64_t>(k));
        std::vector<std::vector<double>> point;
        for (const Guarded& array : function.in) point.push_back(numbers(array, k, rng));
        problem = Probe(model, function, point).problem();
      }
      return problem;
    };
    const CopyResult copy = run_in_copy(work, kMostSeconds);
    const std::string problem = !copy.started ? work()
                                : copy.signal ? function.name + " " + signal_text(copy.signal)
                                              : copy.answer;
    if (!problem.empty()) return problem;
  }
  return "";
}

}  // namespace tiller::tools
