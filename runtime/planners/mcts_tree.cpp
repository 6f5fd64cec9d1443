#include "planners/mcts_tree.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kNodesPerOutcome = 4;  // of the pool: an outcome is worth looking into with a few choices

}  // namespace

void MctsTree::lay_out(Arena& arena, std::uint32_t nodes, std::uint32_t choices) {
  size_ = nodes;
  choices_ = choices;
  most_outcomes_ = choices > 0 ? nodes / kNodesPerOutcome : 0;
  const std::uint32_t places = size_ + most_outcomes_;
  nodes_ = arena.take<Node>(places);
  moved_ = arena.take<std::uint32_t>(places);
  if (choices == 0) return;
  branch_ = arena.take<Branch>(places);
  sequences_ = arena.take<std::uint8_t>(std::size_t{most_outcomes_ + 1} * choices);
}

void MctsTree::clear(std::uint32_t actions) {
  actions_ = actions;
  used_ = committed_ = 1;
  base_ = 0.0;
  nodes_[kRoot] = Node();
  outcomes_ = 0;
  released_ = false;
  if (!branch_) return;
  branch_[kRoot] = Branch();
  branch_[kRoot].hypotheses = all_;
  branch_[kRoot].sequence = 0;
}

// ---- looking for leaves -------------------------------------------------------------------------

std::uint32_t MctsTree::walk(std::uint32_t node, const Guide& guide) {
  std::uint32_t at = level(node);
  bool grown = false;
  ++nodes_[node].under_way;
  while (at < guide.depth && !grown && !splits(node)) {
    const std::uint32_t choice = untried(nodes_[node], guide.incumbent[at], guide.word);
    std::uint32_t next = kNone;
    if (choice != kNone) {
      if (used_ - outcomes_ == size_) break;
      next = add_child(node, choice);
      grown = true;
    } else {
      next = best_child(node, guide.range, guide.exploration);
    }
    node = next;
    ++nodes_[node].under_way;
    ++at;
  }
  return node;
}

/// kNone if all were tried.
std::uint32_t MctsTree::untried(const Node& node, std::uint32_t preferred, std::uint32_t word) const {
  std::uint32_t left = 0;
  for (std::uint32_t a = 0; a < actions_; ++a) left += (node.tried >> a) & 1u ? 0u : 1u;
  if (left == 0) return kNone;
  if (preferred < actions_ && !((node.tried >> preferred) & 1u)) return preferred;
  std::uint32_t skip = static_cast<std::uint32_t>((std::uint64_t{word} * left) >> 32);
  for (std::uint32_t a = 0; a < actions_; ++a)
    if (!((node.tried >> a) & 1u) && skip-- == 0) return a;
  return kNone;
}

std::uint32_t MctsTree::add_child(std::uint32_t node, std::uint32_t choice) {
  const std::uint32_t child = used_++;
  nodes_[child] = Node();
  nodes_[child].parent = node;
  nodes_[child].choice = choice;
  nodes_[child].next_sibling = nodes_[node].first_child;
  nodes_[node].first_child = child;
  nodes_[node].tried |= std::uint64_t{1} << choice;
  if (!branch_) return child;
  branch_[child] = Branch();
  branch_[child].hypotheses = branch_[node].hypotheses;
  branch_[child].level = branch_[node].level + 1;
  return child;
}

std::uint32_t MctsTree::child_of(std::uint32_t node, std::uint32_t choice) const {
  std::uint32_t child = nodes_[node].first_child;
  while (child != kNone && nodes_[child].choice != choice) child = nodes_[child].next_sibling;
  return child;
}

std::uint32_t MctsTree::best_child(std::uint32_t node, const Range& range, double exploration) const {
  const double span = range.high > range.low ? range.high - range.low : 1.0;
  const double parents = static_cast<double>(nodes_[node].visits) + nodes_[node].under_way;
  const double spread = 2.0 * math::log(std::fmax(parents, 1.0));
  std::uint32_t best = nodes_[node].first_child;
  double best_score = -HUGE_VAL;
  for (std::uint32_t c = best; c != kNone; c = nodes_[c].next_sibling) {
    const Node& child = nodes_[c];
    const double visits = static_cast<double>(child.visits) + child.under_way;
    // one that is under way for the first time has no cost yet: between good and bad
    const double share = child.visits > 0.0f ? (range.high - (child.cost + base_)) / span : 0.5;
    const double score =
        std::fmin(std::fmax(share, 0.0), 1.0) + exploration * std::sqrt(spread / std::fmax(visits, 1e-3));
    if (score > best_score) {
      best_score = score;
      best = c;
    }
  }
  return best;
}

std::uint32_t MctsTree::path(std::uint32_t leaf, std::uint32_t* choices) const {
  std::uint32_t depth = 0;
  for (std::uint32_t n = leaf; nodes_[n].parent != kNone; n = nodes_[n].parent) depth += is_outcome(n) ? 0u : 1u;
  std::uint32_t at = depth;
  for (std::uint32_t n = leaf; nodes_[n].parent != kNone; n = nodes_[n].parent)
    if (!is_outcome(n)) choices[--at] = nodes_[n].choice;
  return depth;
}

// ---- what came of them --------------------------------------------------------------------------

void MctsTree::back_up(std::uint32_t end, double cost) {
  for (std::uint32_t n = end; n != kNone; n = is_outcome(n) ? kNone : nodes_[n].parent) {
    Node& node = nodes_[n];
    --node.under_way;
    node.visits += 1.0f;
    node.cost += (cost - base_ - node.cost) / static_cast<double>(node.visits);
  }
}

void MctsTree::cancel(std::uint32_t end) {
  for (std::uint32_t n = end; n != kNone; n = is_outcome(n) ? kNone : nodes_[n].parent) --nodes_[n].under_way;
}

void MctsTree::remove_uncommitted() {
  while (used_ > committed_) {
    const Node& node = nodes_[--used_];  // the youngest child of its parent
    nodes_[node.parent].first_child = node.next_sibling;
    nodes_[node.parent].tried &= ~(std::uint64_t{1} << node.choice);
  }
}

void MctsTree::commit() {
  if (released_) keep_below(kRoot);
  committed_ = used_;
}

// ---- time ---------------------------------------------------------------------------------------

void MctsTree::descend(std::uint32_t choice) {
  const std::uint32_t root = child_of(kRoot, choice);
  if (root == kNone) return clear(actions_);
  keep_below(root);
}

/// `root` becomes the root of what is below it and was not released.
void MctsTree::keep_below(std::uint32_t root) {
  const std::uint32_t root_level = level(root);
  for (std::uint32_t n = 0; n < root; ++n) moved_[n] = kNone;
  std::uint32_t kept = 0;
  for (std::uint32_t n = root; n < used_; ++n) {
    const bool stays = n == root || (moved_[nodes_[n].parent] != kNone && !(branch_ && branch_[n].gone));
    moved_[n] = stays ? kept : kNone;
    if (!stays) continue;
    nodes_[kept] = nodes_[n];
    if (branch_) branch_[kept] = branch_[n];
    ++kept;
  }
  const auto place = [this](std::uint32_t n) { return n == kNone ? kNone : moved_[n]; };
  nodes_[kRoot].parent = nodes_[kRoot].next_sibling = kNone;
  for (std::uint32_t n = 0; n < kept; ++n) {
    Node& node = nodes_[n];
    node.parent = place(node.parent);
    node.first_child = place(node.first_child);
    node.next_sibling = place(node.next_sibling);
    if (branch_) branch_[n].level -= root_level;
  }
  if (branch_) branch_[kRoot].sequence = 0;
  released_ = false;
  used_ = committed_ = kept;
}

void MctsTree::fade(double share) {
  for (std::uint32_t n = 0; n < used_; ++n) nodes_[n].visits *= static_cast<float>(share);
}

}  // namespace tiller
