// The part of the tree that branches on what is seen after a choice.

#include <cmath>
#include <cstring>

#include "planners/mcts_tree.hpp"

namespace tiller {
namespace {

std::uint32_t first_of(std::uint64_t hypotheses) { return static_cast<std::uint32_t>(__builtin_ctzll(hypotheses)); }

}  // namespace

double SubsetRisk::mean(const double* cost, const double* weight, std::uint32_t n) {
  double sum = 0.0, all = 0.0;
  for (std::uint32_t j = 0; j < n; ++j) {
    sum += weight[j] * cost[j];
    all += weight[j];
  }
  return std::isfinite(sum) ? sum / all : HUGE_VAL;
}

double SubsetRisk::value(const double* cost, const double* weight, std::uint32_t n) const {
  if (risk_ == tiller_risk_mean) return mean(cost, weight, n);
  double sorted[kMostHypotheses], sorted_weight[kMostHypotheses], all = 0.0;
  for (std::uint32_t j = 0; j < n; ++j) {
    if (!std::isfinite(cost[j])) return HUGE_VAL;
    std::uint32_t at = j;  // insertion, costliest first
    for (; at > 0 && sorted[at - 1] < cost[j]; --at) {
      sorted[at] = sorted[at - 1];
      sorted_weight[at] = sorted_weight[at - 1];
    }
    sorted[at] = cost[j];
    sorted_weight[at] = weight[j];
    all += weight[j];
  }
  if (risk_ == tiller_risk_worst) return n > 0 ? sorted[0] : 0.0;
  const double tail = share_ * all;
  double left = tail, sum = 0.0;
  for (std::uint32_t j = 0; j < n && left > 0.0; ++j) {
    sum += std::fmin(left, sorted_weight[j]) * sorted[j];
    left -= sorted_weight[j];
  }
  return sum / tail;
}

// ---- beliefs ------------------------------------------------------------------------------------

double MctsTree::weight_of(std::uint64_t hypotheses) const {
  if (!weighted_) return __builtin_popcountll(hypotheses);
  double sum = 0.0;
  for (std::uint64_t left = hypotheses; left != 0; left &= left - 1) sum += weight_[first_of(left)];
  return sum;
}

void MctsTree::begin_belief(std::uint32_t count, const double* weight) {
  if (!branch_) return;
  weighted_ = weight != nullptr;
  for (std::uint32_t j = 0; weight && j < count; ++j) weight_[j] = weight[j];
  all_ = count < kMostHypotheses ? (std::uint64_t{1} << count) - 1 : ~std::uint64_t{0};
  for (std::uint32_t n = 0; n < used_; ++n) {
    if (branch_[n].splits) release_children(n);
    Branch fresh;
    fresh.hypotheses = all_;
    fresh.level = branch_[n].level;
    fresh.gone = branch_[n].gone;
    branch_[n] = fresh;
  }
  outcomes_ = 0;
  if (released_) keep_below(kRoot);
  branch_[kRoot].sequence = 0;
}

/// What is below a node is about hypotheses that do not stay together there.
void MctsTree::release_children(std::uint32_t node) {
  for (std::uint32_t c = nodes_[node].first_child; c != kNone; c = nodes_[c].next_sibling) {
    branch_[c].gone = true;
    released_ = true;
  }
  nodes_[node].first_child = kNone;
  nodes_[node].tried = 0;
}

void MctsTree::tell(std::uint32_t node, const std::uint64_t* groups, std::uint32_t count) {
  branch_[node].told = true;
  if (count < 2 || outcomes_ + count > most_outcomes_) return;
  release_children(node);
  branch_[node].splits = true;
  for (std::uint32_t g = count; g-- > 0;) add_outcome(node, groups[g]);
}

/// Walks are over when outcomes are added: a batch in between would take them for choices.
void MctsTree::add_outcome(std::uint32_t node, std::uint64_t hypotheses) {
  const std::uint32_t outcome = used_++;
  nodes_[outcome] = Node();
  nodes_[outcome].parent = node;
  nodes_[outcome].next_sibling = nodes_[node].first_child;
  nodes_[node].first_child = outcome;
  branch_[outcome] = Branch();
  branch_[outcome].hypotheses = hypotheses;
  branch_[outcome].level = branch_[node].level;
  branch_[outcome].sequence = ++outcomes_;
  branch_[outcome].told = true;
}

// ---- looking for leaves -------------------------------------------------------------------------

std::uint32_t MctsTree::select_all(const Guide& guide, std::uint32_t* ends) {
  std::uint32_t count = 0;
  ends[count++] = walk(kRoot, guide);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (!splits(ends[i])) continue;
    for (std::uint32_t o = nodes_[ends[i]].first_child; o != kNone; o = nodes_[o].next_sibling) {
      Guide own = guide;
      own.range = range_of(o, guide.range);
      own.word = guide.word + count * 0x9e3779b9u;  // golden ratio: outcomes pick unlike each other
      ends[count++] = walk(o, own);
    }
  }
  return count;
}

/// Costs of its own hypotheses: from the cheapest to the mean, as for the root.
MctsTree::Range MctsTree::range_of(std::uint32_t outcome, const Range& range) const {
  const double low = branch_[outcome].sequence_cost;
  if (!std::isfinite(low)) return range;
  const bool visited = nodes_[outcome].visits > 0.0f;
  return {low, visited ? nodes_[outcome].cost + base_ : low + (range.high - range.low)};
}

// ---- what came of them --------------------------------------------------------------------------

void MctsTree::offer(std::uint32_t outcome, const std::uint8_t* sequence, const double* cost, const SubsetRisk& risk) {
  Branch& b = branch_[outcome];
  double own[kMostHypotheses], weight[kMostHypotheses];
  std::uint32_t n = 0;
  for (std::uint64_t left = b.hypotheses; left != 0; left &= left - 1, ++n) {
    own[n] = cost[first_of(left)];
    weight[n] = weight_of(left & (~left + 1));
  }
  const double value = risk.value(own, weight, n);
  if (!(value < b.sequence_cost)) return;
  b.sequence_cost = value;
  std::memcpy(sequences_ + std::size_t{b.sequence} * choices_, sequence, choices_);
}

void MctsTree::credit(std::uint32_t from, const std::uint8_t* sequence, const double* cost, const SubsetRisk& risk) {
  std::uint32_t waiting[kMostHypotheses], count = 0;  // outcomes that share no hypothesis
  waiting[count++] = from;
  while (count > 0) {
    std::uint32_t node = waiting[--count];
    if (node != kRoot) offer(node, sequence, cost, risk);
    while (!splits(node) && branch_[node].level < choices_) {
      const std::uint32_t next = child_of(node, sequence[branch_[node].level]);
      if (next == kNone) break;
      node = next;
    }
    if (!splits(node)) continue;
    for (std::uint32_t o = nodes_[node].first_child; o != kNone; o = nodes_[o].next_sibling) waiting[count++] = o;
  }
}

double MctsTree::outcomes_risk(std::uint32_t node, const SubsetRisk& risk) const {
  double cost[kMostHypotheses], weight[kMostHypotheses];
  std::uint32_t n = 0;
  for (std::uint32_t o = nodes_[node].first_child; o != kNone; o = nodes_[o].next_sibling, ++n) {
    cost[n] = branch_[o].least_cost;
    weight[n] = weight_of(branch_[o].hypotheses);
  }
  return risk.value(cost, weight, n);
}

double MctsTree::evaluate(double sequence_cost, const SubsetRisk& risk) {
  branch_[kRoot].sequence_cost = sequence_cost;
  for (std::uint32_t n = 0; n < used_; ++n) {
    branch_[n].least_cost = branch_[n].sequence_cost;
    branch_[n].best_child = kNone;
  }
  for (std::uint32_t n = used_; n-- > 0;) {  // children before parents
    Branch& b = branch_[n];
    if (b.splits) b.least_cost = outcomes_risk(n, risk);
    const std::uint32_t parent = nodes_[n].parent;
    if (parent == kNone || branch_[parent].splits || !(b.least_cost < branch_[parent].least_cost)) continue;
    branch_[parent].least_cost = b.least_cost;
    branch_[parent].best_child = n;
  }
  return branch_[kRoot].least_cost;
}

std::uint32_t MctsTree::outcome_with(std::uint32_t node, std::uint32_t hypothesis) const {
  std::uint32_t o = nodes_[node].first_child;
  while (!((branch_[o].hypotheses >> hypothesis) & 1u)) o = nodes_[o].next_sibling;
  return o;
}

const std::uint8_t* MctsTree::best_sequence(std::uint32_t hypothesis) const {
  std::uint32_t belief = kRoot;
  while (branch_[belief].best_child != kNone) {
    std::uint32_t node = belief;
    while (!branch_[node].splits) node = branch_[node].best_child;
    belief = outcome_with(node, hypothesis);
  }
  return belief == kRoot ? nullptr : sequences_ + std::size_t{branch_[belief].sequence} * choices_;
}

std::uint32_t MctsTree::likeliest() const {
  std::uint32_t belief = kRoot;
  while (branch_[belief].best_child != kNone) {
    std::uint32_t node = belief;
    while (!branch_[node].splits) node = branch_[node].best_child;
    belief = nodes_[node].first_child;
    for (std::uint32_t o = belief; o != kNone; o = nodes_[o].next_sibling)
      if (weight_of(branch_[o].hypotheses) > weight_of(branch_[belief].hypotheses)) belief = o;
  }
  return first_of(branch_[belief].hypotheses);
}

void MctsTree::offset_each(const double* change) {
  const auto mean_of = [&](std::uint64_t hypotheses) {
    double sum = 0.0;
    for (std::uint64_t left = hypotheses; left != 0; left &= left - 1)
      sum += weight_of(left & (~left + 1)) * change[first_of(left)];
    return sum / weight_of(hypotheses);
  };
  const double shared = mean_of(all_);
  offset(shared);
  for (std::uint32_t n = 0; n < used_; ++n) {
    if (branch_[n].hypotheses == all_) continue;
    const double own = mean_of(branch_[n].hypotheses);
    nodes_[n].cost += own - shared;
    branch_[n].sequence_cost += own;
  }
}

}  // namespace tiller
