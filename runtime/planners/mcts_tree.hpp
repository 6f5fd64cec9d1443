#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

constexpr std::uint32_t kMostTreeActions = 64;  // children of a node: bits of a word

/// levels^inputs, where a node has room for as many choices; else 0: inputs are then chosen one after the other.
constexpr std::uint32_t tree_actions(std::uint32_t levels, std::uint32_t inputs) {
  std::uint32_t count = 1;
  for (std::uint32_t i = 0; i < inputs; ++i)
    if ((count *= levels) > kMostTreeActions) return 0;
  return count;
}

/// The risk of costs that stand for several hypotheses each: the mean over the costliest `tail` of them.
class SubsetRisk {
 public:
  SubsetRisk() = default;
  explicit SubsetRisk(const tiller_planner_config_t& p) : risk_(p.risk), share_(1.0 - p.cvar_alpha) {}
  /// cost (n), weight (n) of the hypotheses behind each, their number where they are alike; n <= kMostHypotheses.
  /// Infinity where a cost is not finite.
  double value(const double* cost, const double* weight, std::uint32_t n) const;

 private:
  static double mean(const double* cost, const double* weight, std::uint32_t n);
  std::uint32_t risk_ = tiller_risk_mean;
  double share_ = 1.0;
};

constexpr std::uint32_t kMostHypotheses = 64;  // bits of a word

/// A tree over sequences of choices, in a pool of fixed size: who was visited how often at what mean cost, and where to
/// look next. It knows nothing of robots: a choice is a number below `actions`.
///
/// UCT (Kocsis and Szepesvari, "Bandit based Monte-Carlo planning", ECML 2006): a node's untried choices come first,
/// then the child with the largest  q + c sqrt(2 ln N / n),  q its mean cost as a share of the range of costs, 1 the
/// cheapest. A batch of leaves is looked for before any of them is evaluated; visits under way count in N and n as if
/// they were made (WU-UCT, Liu et al., "Watch the unobserved", ICLR 2020), so the batch spreads out.
///
/// With room for outcomes a node is a history of choices and of what was seen (Silver and Veness, "Monte-Carlo planning
/// in large POMDPs", NeurIPS 2010), and holds the hypotheses that agree with it, a bit each. A node whose hypotheses
/// are told apart after its last choice has outcomes as children in the place of choices, and each outcome goes on as a
/// tree with a mean cost, a range and choices for its hypotheses alone. One simulation goes down all outcomes at once:
/// every hypothesis takes part in it, by the path of its own outcome. A hypothesis is deterministic, so costs seen once
/// hold: the least cost of an outcome is that of its cheapest sequence, or the risk over the least costs of outcomes
/// below.
class MctsTree {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  static constexpr std::uint32_t kRoot = 0;

  /// `choices`: length of the sequences that outcomes keep; 0: there are no outcomes.
  void lay_out(Arena& arena, std::uint32_t nodes, std::uint32_t choices = 0);
  /// Forgets everything but the root.
  void clear(std::uint32_t actions);

  struct Range {
    double low = 0.0, high = 0.0;
  };
  /// What a walk through the tree is guided by.
  struct Guide {
    std::uint32_t depth;             // of the deepest leaf
    const std::uint32_t* incumbent;  // (depth) the choice that comes first of the untried; kNone: none
    std::uint32_t word;              // picks among the other untried ones
    Range range;
    double exploration;
  };
  /// Walks down to a leaf no deeper than `depth`, a new one where a choice is untried and the pool has room. Counts as
  /// under way. A node with outcomes ends the walk.
  std::uint32_t select(const Guide& guide) { return walk(kRoot, guide); }
  /// Walks on from outcomes to leaves of all hypotheses: `ends` (2 most hypotheses - 1) are the walks' last nodes, the
  /// root's first, a leaf or a node with outcomes each. Returns their number.
  std::uint32_t select_all(const Guide& guide, std::uint32_t* ends);
  /// Choices from the root to `leaf`; their number.
  std::uint32_t path(std::uint32_t leaf, std::uint32_t* choices) const;
  /// The cost of a walk that was under way, to all on it.
  void back_up(std::uint32_t end, double cost);
  /// A walk since the last commit() did not take place; after all of them remove_uncommitted().
  void cancel(std::uint32_t end);
  void remove_uncommitted();
  /// O(nodes) where a node got outcomes since the last one.
  void commit();

  /// The child of the root under `choice` becomes the root; the rest of its siblings are given back. O(nodes).
  void descend(std::uint32_t choice);
  /// Time goes by: what is known counts for less. O(nodes).
  void fade(double share);
  /// Adds to every mean cost. O(1).
  void offset(double change) { base_ += change; }

  std::uint32_t used() const { return used_; }
  double visits(std::uint32_t node) const { return static_cast<double>(nodes_[node].visits); }

  // ---- outcomes (mcts_outcome_nodes.cpp) ----------------------------------------------------------

  /// A belief of `count` hypotheses: outcomes of the last one are gone, all nodes hold all of them. `weight` (count)
  /// times their number; null: alike. O(nodes).
  void begin_belief(std::uint32_t count, const double* weight = nullptr);
  /// 1 of each hypothesis where they are alike.
  double weight_of(std::uint64_t hypotheses) const;
  std::uint64_t hypotheses(std::uint32_t node) const { return branch_[node].hypotheses; }
  std::uint32_t level(std::uint32_t node) const { return branch_ ? branch_[node].level : 0; }
  std::uint32_t parent(std::uint32_t node) const { return nodes_[node].parent; }
  bool has_outcomes() const { return outcomes_ > 0; }
  bool splits(std::uint32_t node) const { return branch_ && branch_[node].splits; }
  bool is_outcome(std::uint32_t node) const { return branch_ && node != kRoot && branch_[node].sequence != kNone; }
  /// Whether it is known what comes of the node's last choice: outcomes or, without `splits`, one and the same.
  bool is_told(std::uint32_t node) const { return branch_[node].told; }
  /// `groups` (count) are the node's hypotheses as they are told apart. One group, or a pool without room: none are.
  void tell(std::uint32_t node, const std::uint64_t* groups, std::uint32_t count);
  /// What `sequence` costs each hypothesis (kMostHypotheses), to all outcomes below `from` that it passes, for their
  /// own hypotheses: each keeps its cheapest. `from` is an outcome or the root.
  void credit(std::uint32_t from, const std::uint8_t* sequence, const double* cost, const SubsetRisk& risk);
  /// The root's least cost, where one sequence for all hypotheses costs `sequence_cost`. O(nodes).
  double evaluate(double sequence_cost, const SubsetRisk& risk);
  /// By the last evaluate(): the sequence (choices) of the hypothesis; null: that for all of them is the cheapest.
  const std::uint8_t* best_sequence(std::uint32_t hypothesis) const;
  /// A hypothesis whose outcome, time and again, is the likeliest.
  std::uint32_t likeliest() const;
  /// As offset() where hypotheses differ: `change` (count) of each. O(nodes x hypotheses).
  void offset_each(const double* change);

 private:
  struct Node {
    std::uint64_t tried = 0;  // choices that have a child
    std::uint32_t parent = kNone, first_child = kNone, next_sibling = kNone;
    std::uint32_t choice = 0;
    std::uint32_t under_way = 0;
    float visits = 0.0f;
    double cost = 0.0;  // mean, less base_
  };
  /// What a node has beside where there are outcomes.
  struct Branch {
    std::uint64_t hypotheses = 0;
    double sequence_cost = __builtin_huge_val();  // of the kept sequence
    double least_cost = __builtin_huge_val();     // by evaluate(): of what is known from here on
    std::uint32_t level = 0;                      // choices so far
    std::uint32_t sequence = kNone;               // of the root and of outcomes: place of the kept sequence
    std::uint32_t best_child = kNone;             // on the way to outcomes that are cheaper than the sequence
    bool told = false, splits = false, gone = false;
  };

  std::uint32_t walk(std::uint32_t node, const Guide& guide);
  std::uint32_t best_child(std::uint32_t node, const Range& range, double exploration) const;
  std::uint32_t add_child(std::uint32_t node, std::uint32_t choice);
  std::uint32_t child_of(std::uint32_t node, std::uint32_t choice) const;
  std::uint32_t untried(const Node& node, std::uint32_t preferred, std::uint32_t word) const;
  void keep_below(std::uint32_t root);

  void add_outcome(std::uint32_t node, std::uint64_t hypotheses);
  void release_children(std::uint32_t node);
  Range range_of(std::uint32_t outcome, const Range& range) const;
  void offer(std::uint32_t outcome, const std::uint8_t* sequence, const double* cost, const SubsetRisk& risk);
  double outcomes_risk(std::uint32_t node, const SubsetRisk& risk) const;
  std::uint32_t outcome_with(std::uint32_t node, std::uint32_t hypothesis) const;

  Node* nodes_ = nullptr;              // (size + most_outcomes) parents before children
  std::uint32_t* moved_ = nullptr;     // (size + most_outcomes) scratch of keep_below
  Branch* branch_ = nullptr;           // (size + most_outcomes); null: no outcomes
  std::uint8_t* sequences_ = nullptr;  // (most_outcomes + 1 x choices) the root's place is not used
  std::uint32_t size_ = 0, used_ = 0, committed_ = 0, actions_ = 0;
  std::uint32_t choices_ = 0, most_outcomes_ = 0, outcomes_ = 0;
  std::uint64_t all_ = 1;  // hypotheses of the belief
  bool weighted_ = false;
  double weight_[kMostHypotheses] = {};  // of each hypothesis, where they are weighted
  bool released_ = false;                // nodes that wait for keep_below
  double base_ = 0.0;
};

}  // namespace tiller
