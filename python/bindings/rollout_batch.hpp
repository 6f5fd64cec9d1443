#pragma once

// Trajectories of a robot's model in the lanes that planners use, over rows of arrays: what rollout() and tiller.jax
// share.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <vector>

#include "errors.hpp"
#include "robot.hpp"
#include "rollout/rollout.hpp"
#include "tools/base/thread_pool.hpp"

namespace tiller::python {

/// Rows of `width` values: one that all lanes share, or one for each lane.
template <class T>
struct Source {
  const T* data = nullptr;
  std::size_t width = 0;
  bool shared = false;
  const std::size_t* row = nullptr;  // (lanes) whose row a lane reads; null: its own
  const T* of(std::size_t lane) const { return data + (shared ? 0 : row ? row[lane] : lane) * width; }
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

inline Crew& crew() {
  static Crew* const one = new Crew;  // outlives the interpreter: its threads may not be joined while it ends
  return *one;
}

template <class T>
class Batch {
 public:
  /// Of a piece: four of the widest registers side by side, and its rows stay in the second cache.
  static constexpr std::uint32_t kLanes = 256 / sizeof(T);

  Batch(const Robot& robot, Source<T> state, Source<T> controls, Source<T> params, Source<T> history, T* out,
        std::size_t count, std::uint32_t horizon)
      : robot_(robot),
        state_(state),
        controls_(controls),
        params_(params),
        out_(out),
        count_(count),
        horizon_(horizon),
        model_(*robot->config.model),
        table_(&select_rollout(model_)) {
    check_status(make_step_setup(robot->config, setup_), "rollout");
    history_.assign(history.data, history.data + (history.data ? history.width : 0));
    history_.resize((std::size_t{setup_.delay_steps} + 1) * model_.input_count, T(0));
    effect_state_.assign(setup_.effect_state_count + 1, T(0));
  }

  /// What comes out is the cost of each lane instead of its trajectory.
  void count_cost(const CostTerms<T>* cost) { cost_ = cost; }

  /// Every piece, in portions between which `ask` is called (null: nobody). Called without the interpreter's lock.
  void run(unsigned threads, void (*ask)()) {
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
      if (ask && first_ < pieces) ask();
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

  /// Rows of kLanes from one row for each lane; the last lane stands for those beyond the end.
  Lanes<T> load(const Source<T>& source, std::size_t at, std::size_t lanes, std::vector<T>& rows,
                std::atomic<std::size_t>& bad) const {
    if (source.shared) return {source.data, 0};
    const bool neighbours = lanes == kLanes && !source.row;
    if (neighbours && !finite(source.of(at), kLanes * source.width))
      for (std::size_t l = 0; l < kLanes; ++l) check(source, at + l, bad);
    if (neighbours && source.width == 1) return {source.of(at), kLanes};
    rows.resize(source.width * kLanes);
    if (neighbours) {
      turn(source.of(at), source.width, kLanes, source.width, rows.data(), kLanes);
    } else {
      for (std::size_t l = 0; l < kLanes; ++l) {
        const std::size_t lane = at + std::min(l, lanes - 1);
        turn(source.of(lane), source.width, 1, source.width, rows.data() + l, kLanes);
        check(source, lane, bad);
      }
    }
    return {rows.data(), kLanes};
  }

  static void check(const Source<T>& source, std::size_t lane, std::atomic<std::size_t>& bad) {
    if (!finite(source.of(lane), source.width)) note_bad(source.of(lane), source, lane, bad);
  }
  static bool finite(const T* from, std::size_t count) {
    int strange = 0;  // a sum of such products would make each wait for the one before
    for (std::size_t i = 0; i < count; ++i) strange |= from[i] * T(0) == T(0) ? 0 : 1;
    return strange == 0;
  }

  static void note_bad(const T* from, const Source<T>& source, std::size_t lane, std::atomic<std::size_t>& bad) {
    std::size_t i = 0, known = bad.load();
    while (std::isfinite(from[i])) ++i;
    const std::size_t found = lane * source.width + i;
    while (found < known && !bad.compare_exchange_weak(known, found)) {  // the first one, whichever thread saw it
    }
  }

  /// A thread's own, asked for once a piece: in a shared library each access to such a variable is a call.
  struct Scratch {
    std::vector<T> state, controls, params, way;
  };
  static __attribute__((noinline)) Scratch& scratch() {
    thread_local Scratch one;
    return one;
  }

  void piece(std::uint32_t index) {
    Scratch& own = scratch();
    T cost[kLanes];
    const std::size_t at = (first_ + index) * kLanes, lanes = std::min<std::size_t>(kLanes, count_ - at);
    const std::size_t rows = (std::size_t{horizon_} + 1) * model_.state_count;
    if (!cost_) own.way.resize(rows * kLanes);
    RolloutJob<T> job;
    job.setup = &setup_;
    job.lanes = kLanes;
    job.horizon = horizon_;
    job.state = load(state_, at, lanes, own.state, bad_state_);
    job.params = load(params_, at, lanes, own.params, bad_param_);
    job.controls = load(controls_, at, lanes, own.controls, bad_control_);
    job.effect_state.data = effect_state_.data();
    job.history = history_.data();
    job.trajectory = cost_ ? nullptr : own.way.data();
    job.cost = cost_;
    job.cost_out = cost_ ? cost : nullptr;
    if constexpr (sizeof(T) == sizeof(double))
      table_->rollout_f64(model_, job);
    else
      table_->rollout_f32(model_, job);
    if (cost_)
      std::copy(cost, cost + lanes, out_ + at);
    else
      turn(own.way.data(), kLanes, rows, lanes, out_ + at * rows, rows);
  }

  /// `to` (wide x high) is `from` (high x wide) turned, square by square: along `from`, so that many rows of `to` are
  /// written at a time, which is a third quicker than few.
  static void turn(const T* from, std::size_t from_stride, std::size_t high, std::size_t wide, T* to,
                   std::size_t to_stride) {
    const std::size_t whole_high = high / kSquare * kSquare, whole_wide = wide / kSquare * kSquare;
    for (std::size_t i = 0; i < whole_high; i += kSquare)
      for (std::size_t j = 0; j < whole_wide; j += kSquare)
        turn_square(from + i * from_stride + j, from_stride, to + j * to_stride + i, to_stride);
    for (std::size_t j = 0; j < wide; ++j)
      for (std::size_t i = j < whole_wide ? whole_high : 0; i < high; ++i)
        to[j * to_stride + i] = from[i * from_stride + j];
  }
  /// The sides of a square: a register of every 64-bit processor. By itself GCC fetches each number alone.
  static constexpr std::size_t kSquare = 16 / sizeof(T);
  static void turn_square(const T* from, std::size_t from_stride, T* to, std::size_t to_stride) {
    typedef T Row __attribute__((vector_size(16)));
    Row rows[kSquare];
    for (std::size_t i = 0; i < kSquare; ++i) std::memcpy(&rows[i], from + i * from_stride, sizeof(Row));
    if constexpr (kSquare == 4) {
      const Row a = zip<0>(rows[0], rows[2]), b = zip<1>(rows[0], rows[2]);
      const Row c = zip<0>(rows[1], rows[3]), d = zip<1>(rows[1], rows[3]);
      rows[0] = zip<0>(a, c), rows[1] = zip<1>(a, c), rows[2] = zip<0>(b, d), rows[3] = zip<1>(b, d);
    } else {
      const Row a = rows[0];
      rows[0] = zip<0>(a, rows[1]), rows[1] = zip<1>(a, rows[1]);
    }
    for (std::size_t j = 0; j < kSquare; ++j) std::memcpy(to + j * to_stride, &rows[j], sizeof(Row));
  }
  /// The first halves of two rows by turns; kHalf = 1: the second ones.
  template <int kHalf, class Row>
  static Row zip(Row a, Row b) {
#if __has_builtin(__builtin_shufflevector)
    if constexpr (kSquare == 4)
      return __builtin_shufflevector(a, b, 2 * kHalf, 2 * kHalf + 4, 2 * kHalf + 1, 2 * kHalf + 5);
    else
      return __builtin_shufflevector(a, b, kHalf, kHalf + 2);
#else
    Row zipped;
    constexpr std::size_t kFirst = kHalf * kSquare / 2;
    for (std::size_t i = 0; i < kSquare / 2; ++i) zipped[2 * i] = a[kFirst + i], zipped[2 * i + 1] = b[kFirst + i];
    return zipped;
#endif
  }

  const Robot& robot_;
  Source<T> state_, controls_, params_;
  T* out_;
  std::size_t count_;
  std::uint32_t horizon_;
  const tiller_model_t& model_;
  const RolloutTable* table_;
  const CostTerms<T>* cost_ = nullptr;
  StepSetup setup_;
  std::vector<T> history_, effect_state_;
  std::size_t first_ = 0;
  std::atomic<std::size_t> bad_state_{kNone}, bad_control_{kNone}, bad_param_{kNone};
};

}  // namespace tiller::python
