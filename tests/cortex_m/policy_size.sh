#!/bin/sh
# policy_size.sh MAP MOST: bytes of flash that the policy takes (its weights, the planner `policy` and what computes its
# inputs), by the linker's map; fails above MOST, or where the map has none of them.
set -eu
awk -v most="$2" '
  /^Linker script and memory map/ { placed = 1 }
  !placed { next }
  # a section with a long name stands alone on its line; address, size and file follow on the next
  /^ \.(text|rodata)[^ ]*$/ { section = $1; getline; count($1, $2, $3); next }
  /^ \.(text|rodata)[^ ]* +0x/ { section = $1; count($2, $3, $4) }
  function count(address, size, file) {
    if (address == "0x00000000" || address ~ /^0x0+$/) return  # left out by the linker
    if (file ~ /policy(_inputs)?\.cpp\.obj/) code += hex(size)
    else if (section ~ /kPolicy/) weights += hex(size)
  }
  function hex(text,   i, value) {
    value = 0
    text = tolower(substr(text, 3))
    for (i = 1; i <= length(text); ++i) value = 16 * value + index("0123456789abcdef", substr(text, i, 1)) - 1
    return value
  }
  END {
    printf "policy: %d bytes of code, %d bytes of weights and ranges\n", code, weights
    exit !(code > 0 && weights > 0 && code + weights <= most)
  }' "$1"
