#!/bin/sh
# no_allocation.sh NM IMAGE: fails where the image holds anything that allocates or that would grow a heap.
set -eu
symbols=$("$1" --demangle "$2") || exit 2
[ -n "$symbols" ] || { echo "$2: no symbols"; exit 2; }
found=$(printf '%s\n' "$symbols" |
  grep -E ' (_?(malloc|calloc|realloc|memalign|free)(_r)?|_?sbrk(_r)?|operator (new|delete).*)$' |
  grep -v 'operator new(.*, void\*)' || true)
if [ -n "$found" ]; then
  printf '%s: symbols of a heap:\n%s\n' "$2" "$found"
  exit 1
fi
echo "$2: $(printf '%s\n' "$symbols" | wc -l) symbols, none of a heap"
