// rollout(): many trajectories of a robot's model at once, in the lanes that planners use.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <optional>
#include <vector>

#include "errors.hpp"
#include "robot.hpp"
#include "rollout/rollout.hpp"
#include "tools/base/thread_pool.hpp"
#include "views.hpp"

namespace tiller::python {
namespace {

using namespace nb::literals;

template <class T>
using Input = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

/// Rows that all lanes share, or one row of `width` values for each lane.
template <class T>
struct Source {
  const T* data = nullptr;
  std::size_t width = 0;
  bool shared = false;
};

/// Threads that stay for the next call; one call at a time has them, others make their own.
class Crew {
 public:
  void run(unsigned threads, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return tools::ThreadPool(threads).run(n, work, arg);
    if (!pool_ || pool_->size() != threads) pool_ = std::make_unique<tools::ThreadPool>(threads);
    pool_->run(n, work, arg);
  }

 private:
  std::mutex mutex_;
  std::unique_ptr<tools::ThreadPool> pool_;
};

Crew& crew() {
  static Crew* const one = new Crew;  // outlives the interpreter: its threads may not be joined while it ends
  return *one;
}

template <class T>
class Batch {
 public:
  static constexpr std::uint32_t kLanes = 32;  // of a piece: its rows stay in the second cache

  Batch(const Robot& robot, Source<T> state, Source<T> controls, Source<T> params, Source<T> history, T* out,
        std::size_t count, std::uint32_t horizon)
      : robot_(robot),
        state_(state),
        controls_(controls),
        params_(params),
        out_(out),
        count_(count),
        horizon_(horizon),
        model_(*robot->model),
        table_(&select_rollout(model_)) {
    check_status(make_step_setup(robot->config, setup_), "rollout");
    history_.assign(history.data, history.data + (history.data ? history.width : 0));
    history_.resize((std::size_t{setup_.delay_steps} + 1) * model_.input_count, T(0));
    effect_state_.assign(setup_.effect_state_count + 1, T(0));
  }

  /// Every piece, in portions between which the keyboard is asked. Called without the interpreter's lock.
  void run(unsigned threads) {
    const std::size_t pieces = (count_ + kLanes - 1) / kLanes;
    std::size_t portion = threads;
    while (first_ < pieces) {
      const auto begin = Clock::now();
      const auto n = static_cast<std::uint32_t>(std::min(portion, pieces - first_));
      if (threads == 1)
        for (std::uint32_t i = 0; i < n; ++i) piece(i);
      else
        crew().run(
            threads, n, [](void* self, std::uint32_t i) { static_cast<Batch*>(self)->piece(i); }, this);
      first_ += n;
      // What a step takes is the model's and the processor's: portions grow until one takes long enough.
      if (Clock::now() - begin < kPortion / 4) portion *= 4;
      if (first_ < pieces) ask_keyboard();
    }
  }

  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  /// Index of the first value that is not finite in what came in; kNone.
  std::size_t bad_state() const { return bad_state_; }
  std::size_t bad_control() const { return bad_control_; }
  std::size_t bad_param() const { return bad_param_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kPortion{20};  // nobody notices a wait of that

  static void ask_keyboard() {
    const nb::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  }

  /// Rows of kLanes from one row for each lane; the last lane stands for those beyond the end.
  Lanes<T> load(const Source<T>& source, std::size_t at, std::size_t lanes, std::vector<T>& rows,
                std::atomic<std::size_t>& bad) const {
    if (source.shared) return {source.data, 0};
    rows.resize(source.width * kLanes);
    for (std::size_t l = 0; l < kLanes; ++l) {
      const std::size_t lane = at + std::min(l, lanes - 1);
      const T* from = source.data + lane * source.width;
      T sum = T(0);
      for (std::size_t i = 0; i < source.width; ++i) {
        rows[i * kLanes + l] = from[i];
        sum += from[i] * T(0);  // NaN where a value is not finite
      }
      if (!(sum == T(0))) note_bad(from, source, lane, bad);
    }
    return {rows.data(), kLanes};
  }

  static void note_bad(const T* from, const Source<T>& source, std::size_t lane, std::atomic<std::size_t>& bad) {
    std::size_t i = 0, known = bad.load();
    while (std::isfinite(from[i])) ++i;
    const std::size_t found = lane * source.width + i;
    while (found < known && !bad.compare_exchange_weak(known, found)) {  // the first one, whichever thread saw it
    }
  }

  void piece(std::uint32_t index) {
    thread_local std::vector<T> state, controls, params, way;
    const std::size_t at = (first_ + index) * kLanes, lanes = std::min<std::size_t>(kLanes, count_ - at);
    const std::size_t rows = (std::size_t{horizon_} + 1) * model_.state_count;
    way.resize(rows * kLanes);
    RolloutJob<T> job;
    job.setup = &setup_;
    job.lanes = kLanes;
    job.horizon = horizon_;
    job.state = load(state_, at, lanes, state, bad_state_);
    job.params = load(params_, at, lanes, params, bad_param_);
    job.controls = load(controls_, at, lanes, controls, bad_control_);
    job.effect_state.data = effect_state_.data();
    job.history = history_.data();
    job.trajectory = way.data();
    if constexpr (sizeof(T) == sizeof(double))
      table_->rollout_f64(model_, job);
    else
      table_->rollout_f32(model_, job);
    store(way.data(), rows, lanes, out_ + at * rows);
  }

  /// One row for each lane from rows of kLanes, in squares of a cache line's side: each line is fetched once, where
  /// lane after lane would fetch every line kLanes times.
  static void store(const T* from, std::size_t rows, std::size_t lanes, T* to) {
    constexpr std::size_t kSide = 64 / sizeof(T);
    for (std::size_t r = 0; r < rows; r += kSide)
      for (std::size_t l = 0; l < lanes; l += kSide) {
        const T* const square = from + r * kLanes + l;
        T* const out = to + l * rows + r;
        const std::size_t high = std::min(kSide, lanes - l), wide = std::min(kSide, rows - r);
        for (std::size_t i = 0; i < high; ++i)
          for (std::size_t j = 0; j < wide; ++j) out[i * rows + j] = square[j * kLanes + i];
      }
  }

  const Robot& robot_;
  Source<T> state_, controls_, params_;
  T* out_;
  std::size_t count_;
  std::uint32_t horizon_;
  const tiller_model_t& model_;
  const RolloutTable* table_;
  StepSetup setup_;
  std::vector<T> history_, effect_state_;
  std::size_t first_ = 0;
  std::atomic<std::size_t> bad_state_{kNone}, bad_control_{kNone}, bad_param_{kNone};
};

/// The place of a number as numpy counts it, "[3, 0]": `shape` has as many lengths as the array that was passed.
std::string place(std::size_t index, const std::vector<std::size_t>& shape) {
  std::string text;
  for (std::size_t d = shape.size(); d-- > 0; index /= shape[d])
    text = std::to_string(index % shape[d]) + (text.empty() ? "" : ", ") + text;
  return "[" + text + "]";
}

template <class T>
void refuse(std::size_t index, const char* argument, const Input<T>& array, const tools::Words& names) {
  if (index == Batch<T>::kNone) return;
  std::vector<std::size_t> shape;
  for (std::size_t d = 0; d < array.ndim(); ++d) shape.push_back(array.shape(d));
  const std::string name = names[index % names.size()];
  raise_argument("rollout", argument, "NaN or infinity at " + (argument + place(index, shape)) + " (" + name + ")",
                 "finite numbers", "give every value of " + name + " a finite number");
}

template <class T>
Source<T> source(const Input<T>& array, std::size_t ndim_shared) {
  const std::size_t rows = array.ndim() > ndim_shared ? array.shape(0) : 1;
  return {array.data(), rows > 0 ? array.size() / rows : 0, array.ndim() == ndim_shared};
}

template <class T>
void check_shared(const Source<T>& source, const char* argument, const Input<T>& array, const tools::Words& names) {
  for (std::size_t i = 0; i < source.width && source.shared; ++i)
    if (!std::isfinite(source.data[i])) refuse(i, argument, array, names);
}

/// Shapes are checked by the package: x0 (nx) or (B, nx), controls (H, nu) or (B, H, nu), params (np) or (B, np),
/// history (rows x nu), out (B, H + 1, nx).
template <class T>
void rollout(const Robot& robot, const Input<T>& x0, const Input<T>& controls, const Input<T>& params,
             const Input<T>& history, nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu> out, int threads) {
  const Source<T> state = source<T>(x0, 1), inputs = source<T>(controls, 2), values = source<T>(params, 1);
  check_shared(state, "x0", x0, robot->states);
  check_shared(inputs, "U", controls, robot->inputs);
  check_shared(values, "params", params, robot->params);
  const Source<T> before = source<T>(history, 2);
  check_shared(before, "history", history, robot->inputs);
  Batch<T> batch(robot, state, inputs, values, before, out.data(), out.shape(0),
                 static_cast<std::uint32_t>(out.shape(1) - 1));
  {
    const nb::gil_scoped_release others;
    batch.run(static_cast<unsigned>(threads));
  }
  refuse(batch.bad_state(), "x0", x0, robot->states);
  refuse(batch.bad_control(), "U", controls, robot->inputs);
  refuse(batch.bad_param(), "params", params, robot->params);
}

std::uint32_t history_rows(const Robot& robot) {
  StepSetup setup;
  check_status(make_step_setup(robot->config, setup), "rollout");
  return setup.delay_steps;
}

}  // namespace

void bind_rollout(nb::module_& m) {
  m.def("rollout", &rollout<double>, "robot"_a, "x0"_a.noconvert(), "controls"_a.noconvert(), "params"_a.noconvert(),
        "history"_a.noconvert(), "out"_a.noconvert(), "threads"_a);
  m.def("rollout", &rollout<float>, "robot"_a, "x0"_a.noconvert(), "controls"_a.noconvert(), "params"_a.noconvert(),
        "history"_a.noconvert(), "out"_a.noconvert(), "threads"_a);
  m.def("history_rows", &history_rows, "robot"_a, "Commands before the first that a rollout reads.");
}

}  // namespace tiller::python
