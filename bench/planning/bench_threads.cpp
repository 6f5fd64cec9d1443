// ./dev bench threads: what plans and the posterior's updates gain from 1 to 8 threads of the caller.
//
// A machine has few cores, so that time is simulated: every piece that parallel_for is given runs alone and is timed,
// and so is what lies between; a piece goes to the worker that is free first, in the order of the pieces, as a pool
// hands them out. A sampling planner hands out chunks by itself: its first slot takes all of them here, and the clock,
// which it reads once a rollout call, says where one ended. The same work is repeated and the least time of each piece
// counts, which other programs can only lengthen. Efficiency is the time of one worker over n times that of n. Waking
// workers is not in it; the last rows of a case have it, and two real threads. Goal: 0.9 at 8 workers, for work of a
// millisecond and more.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "bench/problems/planning_problem.hpp"
#include "bench/problems/posterior_problem.hpp"
#include "bench/table/bench_table.hpp"
#include "tools/base/thread_pool.hpp"

namespace {

using namespace tiller;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

/// What ran between two calls of parallel_for, and the pieces of the call that ends it.
struct Phase {
  double serial_s = 0.0;
  std::vector<double> piece_s;
};

class Recorder {
 public:
  Recorder() {
    hooks_.size = sizeof hooks_;
    hooks_.version = TILLER_CONFIG_VERSION;
    hooks_.context = this;
    hooks_.now_ns = [](void* self) -> std::int64_t {
      static_cast<Recorder*>(self)->looks_.push_back(Clock::now());
      return 0;
    };
    hooks_.parallel_for = [](void* self, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
      static_cast<Recorder*>(self)->run(n, work, arg);
    };
  }
  const tiller_hooks_t* hooks() const { return &hooks_; }

  /// The phases of work(), each time the least of `repeats`; prepare() comes before each, untimed.
  /// A piece is cut at every `looks`-th look at the clock; 0: it is whole.
  std::vector<Phase> measure(int repeats, std::size_t looks, const std::function<void()>& prepare,
                             const std::function<void()>& work) {
    std::vector<Phase> least;
    looks_each_ = looks;
    for (int i = 0; i < repeats; ++i) {
      prepare();
      phases_.clear();
      began_ = Clock::now();
      work();
      phases_.push_back({seconds_since(began_), {}});
      if (i == 0)
        least = phases_;
      else
        shorten(least);
    }
    return least;
  }

 private:
  void run(std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
    Phase phase{seconds_since(began_), {}};
    for (std::uint32_t i = 0; i < n; ++i) {
      looks_.clear();
      auto begin = Clock::now();
      work(arg, i);
      for (std::size_t k = looks_each_; looks_each_ > 0 && k < looks_.size(); k += looks_each_) {
        phase.piece_s.push_back(std::chrono::duration<double>(looks_[k] - begin).count());
        begin = looks_[k];
      }
      phase.piece_s.push_back(seconds_since(begin));
    }
    phases_.push_back(std::move(phase));
    began_ = Clock::now();
  }
  void shorten(std::vector<Phase>& least) const {
    if (phases_.size() != least.size()) std::abort();  // the same work has the same phases
    for (std::size_t p = 0; p < least.size(); ++p) {
      least[p].serial_s = std::min(least[p].serial_s, phases_[p].serial_s);
      for (std::size_t i = 0; i < least[p].piece_s.size(); ++i)
        least[p].piece_s[i] = std::min(least[p].piece_s[i], phases_[p].piece_s[i]);
    }
  }

  tiller_hooks_t hooks_{};
  std::vector<Phase> phases_;
  std::vector<Clock::time_point> looks_;
  std::size_t looks_each_ = 0;
  Clock::time_point began_;
};

/// The time that `workers` take, each call of parallel_for with more than one of them `wake_s` longer.
double makespan(const std::vector<Phase>& phases, unsigned workers, double wake_s = 0.0) {
  double total = 0.0;
  for (const Phase& phase : phases) {
    std::vector<double> busy(workers, 0.0);
    for (const double s : phase.piece_s) *std::min_element(busy.begin(), busy.end()) += s;
    total += phase.serial_s + *std::max_element(busy.begin(), busy.end());
    if (workers > 1 && phase.piece_s.size() > 1) total += wake_s;
  }
  return total;
}

double serial_share(const std::vector<Phase>& phases) {
  double serial = 0.0;
  for (const Phase& phase : phases) serial += phase.serial_s;
  return serial / makespan(phases, 1);
}

// ---- what is measured -----------------------------------------------------------------------------

struct Case {
  std::string name;
  bool judged;
  int repeats;
  std::size_t looks;  ///< at the clock, a piece
  /// Makes what runs with these hooks: (prepare, work).
  std::function<std::array<std::function<void()>, 2>(const tiller_hooks_t*)> make;
};

tiller::Config planner_config(std::uint32_t kind, std::uint32_t rollouts, std::uint32_t horizon,
                              std::uint32_t particles, std::uint32_t iterations) {
  tiller::Config c = bench::cart_pole_config(kind, horizon);
  const double swinging[4] = {0.0, 3.0, 0.1, 0.5};
  std::copy(swinging, swinging + 4, c.initial_state);
  c.planner.rollouts = rollouts;
  c.planner.particles = particles;
  c.planner.iterations = iterations;
  c.safety.input_rate_per_s[0] = 400.0;
  return c;
}

/// A cold plan: the same each time.
Case plan_case(const std::string& name, bool judged, const tiller::Config& config) {
  return {name, judged, 60, config.planner.particles, [config](const tiller_hooks_t* hooks) {
            auto planning = std::make_shared<bench::Planning>(config, 0.1, best_isa(), hooks);
            planning->request.deadline.deadline_ns = INT64_MAX;
            return std::array<std::function<void()>, 2>{[planning] {
                                                          planning->planner->reset(planning->self);
                                                          planning->request.tick = 0;
                                                          planning->command[0] = 0.0;
                                                        },
                                                        [planning] { planning->plan(); }};
          }};
}

/// 50 updates of a posterior whose window is full.
Case update_case(const std::string& name, bool judged, std::uint32_t particles, std::uint32_t window,
                 std::uint32_t moves) {
  return {name, judged, 6, 0, [=](const tiller_hooks_t* hooks) {
            auto subject = std::make_shared<bench::PosteriorSubject>(particles, window, moves, hooks);
            return std::array<std::function<void()>, 2>{[subject] { subject->warm_up(); },
                                                        [subject] {
                                                          for (int i = 0; i < 50; ++i) subject->update();
                                                        }};
          }};
}

std::vector<Case> cases() {
  std::vector<Case> all;
  const struct {
    const char* name;
    std::uint32_t kind;
  } kinds[] = {
      {"mppi", tiller_planner_mppi}, {"cem", tiller_planner_cem}, {"random_shooting", tiller_planner_random_shooting}};
  for (const auto& k : kinds) {
    const std::string name = k.name;
    all.push_back(plan_case(name + " K=1536 N=50 M=1 x 1", false, planner_config(k.kind, 1536, 50, 1, 1)));
    all.push_back(plan_case(name + " K=512 N=50 M=8 x 2", false, planner_config(k.kind, 512, 50, 8, 2)));
    all.push_back(plan_case(name + " K=1536 N=50 M=8 x 2", true, planner_config(k.kind, 1536, 50, 8, 2)));
    tiller::Config risky = planner_config(k.kind, 1024, 30, 32, 2);
    risky.planner.risk = tiller_risk_cvar;
    risky.planner.cvar_alpha = 0.9;
    all.push_back(plan_case(name + " CVaR.9 K=1024 N=30 M=32 x 2", true, risky));
  }
  all.push_back(update_case("posterior N=512 W=64 M=16", false, 512, 64, 16));
  all.push_back(update_case("posterior N=1024 W=64 M=64", true, 1024, 64, 64));
  all.push_back(update_case("posterior N=2048 W=64 M=256", true, 2048, 64, 256));
  return all;
}

/// Wall time of one and of two real threads, by turns; the least of each.
std::array<double, 2> real_times(const Case& c) {
  std::array<double, 2> least = {1e9, 1e9};
  struct Real {
    explicit Real(unsigned threads) : pool(threads) {
      hooks.size = sizeof hooks;
      hooks.version = TILLER_CONFIG_VERSION;
      hooks.context = &pool;
      hooks.parallel_for = [](void* self, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
        static_cast<tools::ThreadPool*>(self)->run(n, work, arg);
      };
    }
    tools::ThreadPool pool;
    tiller_hooks_t hooks{};
  } real[2] = {Real(1), Real(2)};
  const auto one = c.make(&real[0].hooks), two = c.make(&real[1].hooks);
  for (int i = 0; i < c.repeats; ++i)
    for (int which = 0; which < 2; ++which) {
      const auto& subject = which == 0 ? one : two;
      subject[0]();
      const auto begin = Clock::now();
      subject[1]();
      least[which] = std::min(least[which], seconds_since(begin));
    }
  return least;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string only = argc > 1 ? argv[1] : "";
  bench::Table table;
  std::printf("instruction set in use: %s; cart-pole; N workers in simulated time\n", isa_name(best_isa()));
  constexpr double kWake_s = 10e-6;
  for (const Case& c : cases()) {
    if (c.name.find(only) == std::string::npos) continue;
    Recorder recorder;
    const auto subject = c.make(recorder.hooks());
    const std::vector<Phase> phases = recorder.measure(c.repeats, c.looks, subject[0], subject[1]);
    const double one = makespan(phases, 1);
    table.heading(c.name);
    table.row("one worker", one * 1e6, "us");
    table.row("of it in no piece", serial_share(phases) * 100.0, "%");
    for (const unsigned n : {2u, 3u, 4u, 6u, 8u})
      table.row("efficiency of " + std::to_string(n), one / (n * makespan(phases, n)), "",
                c.judged && n == 8 ? bench::at_least(0.9) : bench::Goal{});
    table.row("efficiency of 8 that take 10 us a call to wake", one / (8 * makespan(phases, 8, kWake_s)), "");
    const std::array<double, 2> real = real_times(c);
    table.row("two real threads, speed-up", real[0] / real[1], "x");
  }
  return table.finish();
}
