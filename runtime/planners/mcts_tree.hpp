#pragma once

#include <cstdint>

#include "core/arena.hpp"

namespace tiller {

constexpr std::uint32_t kMostTreeActions = 64;  // children of a node: bits of a word

/// levels^inputs, where a node has room for as many choices; else 0: inputs are then chosen one after the other.
constexpr std::uint32_t tree_actions(std::uint32_t levels, std::uint32_t inputs) {
  std::uint32_t count = 1;
  for (std::uint32_t i = 0; i < inputs; ++i)
    if ((count *= levels) > kMostTreeActions) return 0;
  return count;
}

/// A tree over sequences of choices, in a pool of fixed size: who was visited how often at what mean cost, and where to
/// look next. It knows nothing of robots: a choice is a number below `actions`.
///
/// UCT (Kocsis and Szepesvari, "Bandit based Monte-Carlo planning", ECML 2006): a node's untried choices come first,
/// then the child with the largest  q + c sqrt(2 ln N / n),  q its mean cost as a share of the range of costs, 1 the
/// cheapest. A batch of leaves is looked for before any of them is evaluated; visits under way count in N and n as if
/// they were made (WU-UCT, Liu et al., "Watch the unobserved", ICLR 2020), so the batch spreads out.
class MctsTree {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  static constexpr std::uint32_t kRoot = 0;

  void lay_out(Arena& arena, std::uint32_t nodes);
  /// Forgets everything but the root.
  void clear(std::uint32_t actions);

  struct Range {
    double low = 0.0, high = 0.0;
  };
  /// Walks down to a leaf no deeper than `depth`, a new one where a choice is untried and the pool has room: of the
  /// untried, `incumbent[level]` first (kNone: none), else the one that `word` picks. Counts as under way.
  std::uint32_t select(std::uint32_t depth, const std::uint32_t* incumbent, std::uint32_t word, const Range& range,
                       double exploration);
  /// Choices from the root to `leaf`; their number.
  std::uint32_t path(std::uint32_t leaf, std::uint32_t* choices) const;
  /// The cost of a leaf that was under way, to all on its path.
  void back_up(std::uint32_t leaf, double cost);
  /// Everything selected since the last commit() was not selected: its nodes are gone.
  void cancel(const std::uint32_t* leaves, std::uint32_t count);
  void commit() { committed_ = used_; }

  /// The child of the root under `choice` becomes the root; the rest of its siblings are given back. O(nodes).
  void descend(std::uint32_t choice);
  /// Time goes by: what is known counts for less. O(nodes).
  void fade(double share);
  /// Adds to every mean cost. O(1).
  void offset(double change) { base_ += change; }

  std::uint32_t used() const { return used_; }
  double visits(std::uint32_t node) const { return static_cast<double>(nodes_[node].visits); }

 private:
  struct Node {
    std::uint64_t tried = 0;  // choices that have a child
    std::uint32_t parent = kNone, first_child = kNone, next_sibling = kNone;
    std::uint32_t choice = 0;
    std::uint32_t under_way = 0;
    float visits = 0.0f;
    double cost = 0.0;  // mean, less base_
  };

  std::uint32_t best_child(std::uint32_t node, const Range& range, double exploration) const;
  std::uint32_t add_child(std::uint32_t node, std::uint32_t choice);
  std::uint32_t untried(const Node& node, std::uint32_t preferred, std::uint32_t word) const;

  Node* nodes_ = nullptr;           // (size) parents before children
  std::uint32_t* moved_ = nullptr;  // (size) scratch of descend
  std::uint32_t size_ = 0, used_ = 0, committed_ = 0, actions_ = 0;
  double base_ = 0.0;
};

}  // namespace tiller
