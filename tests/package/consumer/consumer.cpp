#include <tiller/tiller.h>

#include <core/rng.hpp>
#include <cstdio>

// The headers of the parts are there too: a draw is a function of its names alone.
int main() {
  const double first = tiller::Rng(1, 2, 3).normal();
  const double again = tiller::Rng(1, 2, 3).normal();
  std::printf("tiller %s from C++: %s lanes, drew %g\n", tiller_version(), tiller_instruction_set(), first);
  return first == again ? 0 : 1;
}
