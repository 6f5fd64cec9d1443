// tiller's part of the comparisons of `./dev bench posterior`, by the protocol of table/rounds.hpp:
//
//   bench_posterior_peers                          answers rounds: residuals on the cart-pole, ticks on the pendulum
//   bench_posterior_peers --moments TASK SIGMA N   posteriors of episodes 1..N of a task, one line of JSON each
//   bench_posterior_peers --ticks                  a pendulum episode between callgrind's markers, an update a dump
//
// Settings of the posterior: 1,024 particles, ring of 64 transitions, 128 moves a tick.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "bench/table/arguments.hpp"
#include "bench/table/rounds.hpp"
#include "harness/accuracy/accuracy_run.hpp"
#include "rollout/residual.hpp"
#include "tiller/config.hpp"

#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS
#endif

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr std::uint32_t kParticles = 1024, kRing = 64, kMoves = 128;

struct Free {
  void operator()(void* p) const { std::free(p); }
};
using Block = std::unique_ptr<void, Free>;

AccuracyTask task_named(const std::string& name) {
  for (const AccuracyTask& t : accuracy_tasks())
    if (t.name == name) return t;
  std::fprintf(stderr, "no task '%s'\n", name.c_str());
  std::exit(2);
}

tiller::Config posterior_config(const AccuracyTask& task, std::uint64_t seed) {
  tiller::Config c = task.config;
  c.posterior.kind = tiller_posterior_transition;
  c.posterior.particles = kParticles;
  c.posterior.window = kRing;
  c.posterior.moves_per_tick = kMoves;
  c.posterior.disturbance = 0;
  c.posterior.adequacy = 0;
  c.seed = seed;
  return c;
}

// ---- one-step residuals ------------------------------------------------------------------------------

/// 1,024 cart-poles at some recorded transitions.
class Residuals {
 public:
  explicit Residuals(std::uint32_t count)
      : task_(task_named("cart-pole")),
        steps_(count),
        block_(std::aligned_alloc(TILLER_ALIGNMENT, 4 * kParticles * (sizeof(double) + sizeof(float)))),
        squared_(static_cast<double*>(block_.get())),
        params_(reinterpret_cast<float*>(squared_ + 4 * kParticles)) {
    if (make_step_setup(task_.config, setup_) != tiller_status_ok) std::abort();
    Rng rng(1, kRngSelect, 0);
    for (MeasuredStep& s : steps_) {
      for (double& x : s.state) x = rng.normal();
      for (double& d : s.change) d = 0.1 * rng.normal();
      s.input[0] = 24.0 * rng.uniform() - 12.0;
      s.period_s = task_.config.period_s;
    }
    std::fill_n(squared_, 4 * kParticles, 0.0);
    for (std::uint32_t i = 0; i < 3 * kParticles; ++i)
      params_[i] = i < kParticles ? 1.0f : static_cast<float>(0.1 + 0.9 * rng.uniform());
    job_.setup = &setup_;
    job_.lanes = kParticles;
    job_.count = count;
    job_.steps = steps_.data();
    job_.params = {params_, kParticles};
    job_.squared = squared_;
  }
  void run() { select_rollout(*task_.config.model).residual(*task_.config.model, job_); }

 private:
  AccuracyTask task_;
  StepSetup setup_;
  std::vector<MeasuredStep> steps_;
  Block block_;
  double* squared_;  // (4 x N) both on a cache line, as in a controller's block
  float* params_;    // (3 x N)
  ResidualJob job_;
};

// ---- ticks -------------------------------------------------------------------------------------------

/// A posterior and an episode that it can take in again and again.
class Ticks {
 public:
  Ticks() : task_(task_named("pendulum")), config_(posterior_config(task_, 1)) {
    episode_ = make_episode(task_, kNominalSigma, kEpisodeTicks, 1);
    if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
    const RolloutTable& table = select_rollout(*config_.model);
    Arena measure;
    Posterior::lay_out(measure, config_, setup_, table, nullptr);
    memory_.reset(std::aligned_alloc(TILLER_ALIGNMENT, measure.used()));
    Arena arena(memory_.get(), measure.used());
    posterior_ = Posterior::lay_out(arena, config_, setup_, table, nullptr);
    if (!posterior_) std::abort();
  }
  void begin() {
    posterior_->reset();
    if (posterior_->start(episode_.state.data()) != tiller_status_ok) std::abort();
  }
  std::uint32_t count() const { return episode_.ticks; }
  void take(std::uint32_t k) { (void)posterior_->update(episode_.transition(k, config_.period_s)); }

  /// Median and worst CPU time of the episode's ticks. Each tick does the same work, to the bit, in every repetition:
  /// the quickest of five is its time, which leaves out what the machine does besides.
  void measure() {
    constexpr int kRepetitions = 5;
    std::vector<double> best(count(), INFINITY);
    for (int r = 0; r < kRepetitions; ++r) {
      begin();
      for (std::uint32_t k = 0; k < count(); ++k) {
        const double before = cpu_seconds();
        take(k);
        best[k] = std::min(best[k], cpu_seconds() - before);
      }
    }
    std::sort(best.begin(), best.end());
    median_ = best[best.size() / 2];
    worst_ = best.back();
  }
  double median() const { return median_; }
  double worst() const { return worst_; }

 private:
  AccuracyTask task_;
  tiller::Config config_;
  StepSetup setup_;
  Episode episode_;
  Block memory_;
  Posterior* posterior_ = nullptr;
  double median_ = 0.0, worst_ = 0.0;
};

int answer_rounds() {
  Residuals one(1), ring(kRing);
  Ticks ticks;
  char line[256];
  while (std::fgets(line, sizeof line, stdin)) {
    if (!std::strncmp(line, "check", 5)) {
      std::printf("{\"tiller residuals, one transition\": {\"isa\": \"%s\"}}\n", isa_name(best_isa()));
    } else {
      const double single = time_call([&] { one.run(); }) / kParticles;
      const double many = time_call([&] { ring.run(); }) / (double{kParticles} * kRing);
      ticks.measure();
      std::printf(
          "{\"tiller residuals, one transition\": %.6e, \"tiller residuals, 64 transitions\": %.6e, "
          "\"tiller posterior/median\": %.6e, \"tiller posterior/worst\": %.6e}\n",
          single, many, ticks.median(), ticks.worst());
    }
    std::fflush(stdout);
  }
  return 0;
}

int count_ticks() {
  Ticks ticks;
  ticks.begin();
  for (std::uint32_t k = 0; k < ticks.count(); ++k) {
    CALLGRIND_ZERO_STATS;
    ticks.take(k);
    CALLGRIND_DUMP_STATS;
  }
  return 0;
}

// ---- moments -----------------------------------------------------------------------------------------

void print_list(const char* name, const Eigen::VectorXd& values) {
  std::printf("\"%s\": [", name);
  for (int i = 0; i < values.size(); ++i) std::printf("%s%.12g", i ? ", " : "", values[i]);
  std::printf("]");
}

int print_moments(const std::string& name, double sigma, int count) {
  const AccuracyTask task = task_named(name);
  for (int i = 1; i <= count; ++i) {
    const auto seed = static_cast<std::uint64_t>(i);
    const EngineResult r =
        run_engine(task, posterior_config(task, seed), make_episode(task, sigma, kEpisodeTicks, seed));
    const Eigen::VectorXd mean = r.point * r.weight;
    const Eigen::MatrixXd centred = r.point.colwise() - mean;
    const Eigen::VectorXd sd = (centred.cwiseAbs2() * r.weight).cwiseSqrt();
    std::printf("{\"task\": \"%s\", \"sigma\": %g, \"seed\": %d, \"seconds\": %.6g, ", name.c_str(), sigma, i,
                r.seconds);
    print_list("mean", mean);
    std::printf(", ");
    print_list("sd", sd);
    std::printf("}\n");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "";
  if (mode == "--ticks") return count_ticks();
  if (mode == "--moments" && argc == 5)
    return print_moments(argv[2], bench::real_number(argv[3]), bench::whole_number(argv[4]));
  if (argc == 1) return answer_rounds();
  std::fprintf(stderr, "usage: bench_posterior_peers [--ticks | --moments TASK SIGMA N]\n");
  return 2;
}
