#include "harness/calibration/calibration_feed.hpp"

#include <time.h>

#include <algorithm>
#include <cmath>

namespace tiller::bench {
namespace {

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

void read(const tiller_config_t& config, const PlantTick& tick, double* measured) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) measured[k] = tick.reading[config.measured_state[k]];
}

}  // namespace

EngineInstance::EngineInstance(const tiller_config_t& config) : config_(config) {
  const char* field = "";
  if (make_step_setup(config_, setup_) != tiller_status_ok) std::abort();
  const RolloutTable& table = select_rollout(*config_.model);
  if (Posterior::check(config_, setup_, table, &field) != tiller_status_ok) std::abort();
  Arena measure;
  Posterior::lay_out(measure, config_, setup_, table, nullptr);
  memory_.reset(std::aligned_alloc(TILLER_ALIGNMENT, measure.used()));
  Arena arena(memory_.get(), measure.used());
  posterior_ = Posterior::lay_out(arena, config_, setup_, table, nullptr);
  if (!posterior_) std::abort();
}

FeedResult feed(Posterior& posterior, const tiller_config_t& config, const PlantRecord& record) {
  FeedResult result;
  double measured[TILLER_MAX_MEASUREMENTS] = {};
  const double begun = thread_seconds();
  posterior.reset();
  read(config, record.tick[0], measured);
  (void)posterior.start(measured);
  for (std::size_t k = 1; k < record.tick.size(); ++k) {
    Transition t;
    t.period_s = record.period_s;
    t.input[0] = record.tick[k].input;
    if (!record.tick[k].measured) {
      (void)posterior.skip(t);
      continue;
    }
    read(config, record.tick[k], t.measured);
    const tiller_status_t said = posterior.update(t);
    result.faults += said != tiller_status_ok && said < 200;
    const AdequacyTest* test = posterior.adequacy();
    if (result.first_alarm > 0 || !test || test->state() != tiller_adequacy_inadequate) continue;
    result.first_alarm = static_cast<int>(k);
    result.alarm_feature = test->feature();
  }
  result.seconds = thread_seconds() - begun;
  PosteriorReport report;
  posterior.report(report);
  result.relearned = report.relearned;
  return result;
}

}  // namespace tiller::bench
