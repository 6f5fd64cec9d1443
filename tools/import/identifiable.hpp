#pragma once

#include <string>
#include <vector>

#include "tools/import/unknowns.hpp"

namespace tiller::tools {

/// Which unknowns of a robot its joints' motions can tell, and which only together (base parameters: Mayeda, Yoshida
/// and Osuka 1990; Gautier and Khalil 1990).
///
/// The joints' forces are linear in the bodies' inertial parameters, and their derivatives by the unknowns are analytic
/// in positions, speeds and forces. Their rank is therefore the same in every region of motions that is not degenerate,
/// so that random motions find it. Coordinates of an inertia are taken to first order about the description.

struct Unknown {
  enum class Kind { mass, inertia, gain, payload, viscous, dry };
  Kind kind = Kind::mass;
  std::string name;   ///< as a reader knows it: of a model parameter the parameter's
  std::string about;  ///< link or joint
  double sd = 1.0;    ///< of its prior, about the description's value
};

/// What a motion can tell where single unknowns cannot be told apart: a sum. Its first term, the head, has the factor 1
/// and is in no other sum; the others are unknowns that do less, by their priors, than what stands for them.
struct Combination {
  struct Term {
    double factor = 1.0;
    int unknown = 0;
  };
  std::vector<Term> terms;
};

struct Identifiability {
  std::vector<Unknown> unknowns;
  std::size_t rank = 0;             ///< how many numbers motions can tell
  std::vector<int> unseen;          ///< unknowns that change no joint's force in any motion
  std::vector<Combination> shared;  ///< of two terms and more; one unknown may be in several
  double smallest_kept = 1.0;       ///< share of an unknown's effect that no other has, of those that count in the rank
  double largest_dropped = 0.0;     ///< of those that do not: rounding alone

  bool is_unseen(int unknown) const;
};

/// `payload_frame`: an index of mechanism.frames; -1: nowhere.
Identifiability find_identifiable(const Mechanism& mechanism, const Unknowns& unknowns, int payload_frame);

/// In words, a sentence or so each: what nothing can tell, link by link, and what shows only in combination.
std::vector<std::string> identifiable_notes(const Identifiability& found, bool are_held);

/// "a + 0.4 b - 2 c", of at most so many terms; 0: all.
std::string combination_text(const Identifiability& found, const Combination& combination, std::size_t most = 0);

/// Takes priors away where no motion can tell: unseen parameters and all but the heads of combinations are held at the
/// description's values, and a head's prior becomes as wide as the whole sum's. Nothing that the joints do is lost, to
/// first order. A filter of few particles seems to learn what it cannot: it copies those that fit, and the copies have
/// one value each of everything that does not matter.
void hold_unidentifiable(const Identifiability& found, Unknowns& unknowns);

/// Writes beside each parameter what `found` says of it (ModelParameter::comment).
void comment_parameters(const Identifiability& found, Unknowns& unknowns);

}  // namespace tiller::tools
