#include "planners/mcts_tree.hpp"

#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

void MctsTree::lay_out(Arena& arena, std::uint32_t nodes) {
  nodes_ = arena.take<Node>(nodes);
  moved_ = arena.take<std::uint32_t>(nodes);
  size_ = nodes;
}

void MctsTree::clear(std::uint32_t actions) {
  actions_ = actions;
  used_ = committed_ = 1;
  base_ = 0.0;
  nodes_[kRoot] = Node();
}

// ---- looking for leaves -------------------------------------------------------------------------

std::uint32_t MctsTree::select(std::uint32_t depth, const std::uint32_t* incumbent, std::uint32_t word,
                               const Range& range, double exploration) {
  std::uint32_t node = kRoot, level = 0;
  bool grown = false;
  ++nodes_[kRoot].under_way;
  while (level < depth && !grown) {
    const std::uint32_t choice = untried(nodes_[node], incumbent[level], word);
    std::uint32_t next = kNone;
    if (choice != kNone) {
      if (used_ == size_) break;
      next = add_child(node, choice);
      grown = true;
    } else {
      next = best_child(node, range, exploration);
    }
    node = next;
    ++nodes_[node].under_way;
    ++level;
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
  for (std::uint32_t n = leaf; nodes_[n].parent != kNone; n = nodes_[n].parent) ++depth;
  std::uint32_t level = depth;
  for (std::uint32_t n = leaf; nodes_[n].parent != kNone; n = nodes_[n].parent) choices[--level] = nodes_[n].choice;
  return depth;
}

// ---- what came of them --------------------------------------------------------------------------

void MctsTree::back_up(std::uint32_t leaf, double cost) {
  for (std::uint32_t n = leaf; n != kNone; n = nodes_[n].parent) {
    Node& node = nodes_[n];
    --node.under_way;
    node.visits += 1.0f;
    node.cost += (cost - base_ - node.cost) / static_cast<double>(node.visits);
  }
}

void MctsTree::cancel(const std::uint32_t* leaves, std::uint32_t count) {
  for (std::uint32_t i = 0; i < count; ++i)
    for (std::uint32_t n = leaves[i]; n != kNone; n = nodes_[n].parent) --nodes_[n].under_way;
  while (used_ > committed_) {
    const Node& node = nodes_[--used_];  // the youngest child of its parent
    nodes_[node.parent].first_child = node.next_sibling;
    nodes_[node.parent].tried &= ~(std::uint64_t{1} << node.choice);
  }
}

// ---- time ---------------------------------------------------------------------------------------

void MctsTree::descend(std::uint32_t choice) {
  std::uint32_t root = nodes_[kRoot].first_child;
  while (root != kNone && nodes_[root].choice != choice) root = nodes_[root].next_sibling;
  if (root == kNone) return clear(actions_);
  for (std::uint32_t n = 0; n < root; ++n) moved_[n] = kNone;
  std::uint32_t kept = 0;
  for (std::uint32_t n = root; n < used_; ++n) {
    const bool stays = n == root || moved_[nodes_[n].parent] != kNone;
    moved_[n] = stays ? kept : kNone;
    if (stays) nodes_[kept++] = nodes_[n];
  }
  const auto place = [this](std::uint32_t n) { return n == kNone ? kNone : moved_[n]; };
  nodes_[kRoot].parent = nodes_[kRoot].next_sibling = kNone;
  for (std::uint32_t n = 0; n < kept; ++n) {
    Node& node = nodes_[n];
    node.parent = place(node.parent);
    node.first_child = place(node.first_child);
    node.next_sibling = place(node.next_sibling);
  }
  used_ = committed_ = kept;
}

void MctsTree::fade(double share) {
  for (std::uint32_t n = 0; n < used_; ++n) nodes_[n].visits *= static_cast<float>(share);
}

}  // namespace tiller
