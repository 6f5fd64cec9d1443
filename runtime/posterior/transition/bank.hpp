#pragma once

#include <cstdint>

#include "posterior/posterior.hpp"
#include "posterior/transition/bank_delay.hpp"

namespace tiller {

/// Hypotheses that no single cloud holds, side by side: by how many periods the inputs come late, and at which rate
/// what was learnt ages. Each is an engine of its own over the same transitions:
///
///   members 0 .. D-1       a delay of [j, j + 1) periods, the first rate
///   members D .. D+R-2     the delay that leads, rates 1 .. R-1
///
/// so that D delays and R rates cost D + R - 1 clouds. Where a delay lies within its period is a parameter more of
/// each member, which the bank keeps to itself; see DelayHypotheses, also for where delays are whole periods. A
/// delay's weight is its evidence, the product of its prequential predictive densities (Dawid 1984; Kass and Raftery
/// 1995). A rate's is the same with a slow forgetting of its own, as in dynamic model averaging (Raftery, Karny and
/// Ettler, Technometrics 52, 2010), in favour of the first rate as long as the others predict no better.
///
/// Where a faster rate predicts better by kClear nats, what the slower ones know has become untrue: they start again
/// from the prior, are not used while they learn, and come back as trusted as the best. (A faster cloud's own sums are
/// no good start: they still hold the old data's share, which a slower one would keep for long.)
///
/// Cost of an update: D + R - 1 updates of the engine, each with one parameter and as many effects more as the model
/// has inputs; memory likewise, and one configuration each.
class BankPosterior final : public Posterior {
 public:
  /// Whether the configuration asks for more than one hypothesis.
  static bool wanted(const tiller_config_t& config);
  static BankPosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                const RolloutTable& table, const tiller_hooks_t* hooks);

  void reset() override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t skip(const Transition& transition) override;
  tiller_status_t update(const Transition& transition) override;
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override;
  void covariance(double* covariance) const override;
  double quantile(std::uint32_t param, double q) const override;
  double effective_samples() const override { return leader().effective_samples(); }
  double exponent() const override { return leader().exponent(); }
  double noise_scale() const override { return leader().noise_scale(); }
  double acceptance() const override { return leader().acceptance(); }
  std::uint64_t resamplings() const override;
  std::uint64_t gated() const override;
  double log_predictive() const override { return log_predictive_; }
  std::uint32_t size() const override { return members_ * n_; }
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void particle_effects(std::uint32_t index, double* effect_state) const override;
  double particle_delay(std::uint32_t index) const override;
  /// Members in proportion to their weights (systematic sampling). Of a member that gets one column: its mean.
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  void set_origin(const double* state) override;
  /// Of a single column: the mean of all.
  double drawn_delay(std::uint32_t column) const override { return drawn_delay_[column % kColumns]; }
  /// The leading member's: what no delay and no rate explains.
  const AdequacyTest* adequacy() const override { return leader().adequacy(); }
  void clear_adequacy() override;
  void report(PosteriorReport& report) const override;

  /// started again because a faster rate predicted better.
  std::uint64_t restarts() const { return restarts_; }

 private:
  static constexpr std::uint32_t kMaxMembers = TILLER_MAX_HYPOTHESES + TILLER_MAX_FORGETTING - 1;
  static constexpr std::uint32_t kColumns = 64;  // of a selection at a time

  // bank.cpp
  Transition late_for(std::uint32_t member, const Transition& transition) const;
  std::uint32_t delay_of(std::uint32_t member) const { return member < delays_ ? member : best_delay_; }
  std::uint32_t member_of_rate(std::uint32_t rate) const { return rate == 0 ? best_delay_ : delays_ + rate - 1; }
  void restart_rate(std::uint32_t rate);
  void restart_member(std::uint32_t member);
  void remember_input(const double* input);
  void follow_delay(const Transition& transition);

  // bank_evidence.cpp
  void forget_evidence();
  void weigh_delays(const double* log_predictive);
  void weigh_rates(const double* log_predictive);
  bool on_trial(std::uint32_t rate) const;
  void leave_what_has_changed();
  void restart_on_trial(std::uint32_t rate);
  void put_on_trial(std::uint32_t rate);
  void set_member_weights();
  const Posterior& leader() const { return *engine_[leader_]; }

  // bank_report.cpp
  /// Counters of events over the whole life: sums over the members, whoever leads.
  struct Counts {
    std::uint64_t resamplings = 0, gated = 0, relearned = 0, lost = 0;
    void add(const Posterior& engine);
    void subtract(const Posterior& engine);
  };
  Counts counts() const;
  void apportion(std::uint32_t count, std::uint64_t tick, std::uint32_t first, std::uint32_t* columns) const;
  void draw_block(std::uint32_t count, std::uint32_t first, std::uint64_t tick, float* params, float* state,
                  float* effect_state) const;
  double late_share(std::uint32_t member) const;
  double mean_delay() const;
  double periods(std::uint32_t member, double fraction_s) const;

  const tiller_config_t* config_ = nullptr;
  DelayHypotheses hypotheses_;
  std::uint32_t delays_ = 1, rates_ = 1, members_ = 1;
  std::uint32_t n_ = 0, nx_ = 0, nu_ = 0, np_ = 0, ns_ = 0, ny_ = 0;
  std::uint32_t rows_ = 0;    // parameters of a member: np, then its fraction
  bool has_history_ = false;  // members read inputs older than the one they are fed
  Posterior* engine_[kMaxMembers] = {};

  struct Scratch {
    double* value = nullptr;         // (size)
    double* share = nullptr;         // (size)
    std::uint32_t* order = nullptr;  // (size)
    float* drawn = nullptr;          // ((rows + nx + ns) x kColumns)
    std::uint32_t* owner = nullptr;  // (kColumns) member of each column of the last selection
  };
  Scratch scratch_;
  double* drawn_delay_ = nullptr;  // (kColumns) of the last selection, in periods

  // where it stands
  bool started_ = false;
  double last_[TILLER_MAX_MEASUREMENTS] = {};
  double input_[TILLER_MAX_HYPOTHESES][TILLER_MAX_INPUTS] = {};  // newest first
  std::uint32_t best_delay_ = 0, leader_ = 0;
  double delay_evidence_[TILLER_MAX_HYPOTHESES] = {};  // logs, the largest 0
  double rate_evidence_[TILLER_MAX_FORGETTING] = {};
  std::uint32_t age_[TILLER_MAX_FORGETTING] = {};  // ticks since it started again, saturating
  double delay_weight_[TILLER_MAX_HYPOTHESES] = {}, rate_weight_[TILLER_MAX_FORGETTING] = {};
  double weight_[kMaxMembers] = {};
  double log_predictive_ = 0.0;
  std::uint64_t restarts_ = 0;
  Counts retired_;  // of members' lives that ended when they started again
};

}  // namespace tiller
